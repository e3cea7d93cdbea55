"""The deterministic simulator: the robots' own nodes and radios over the world's physics, in virtual time."""

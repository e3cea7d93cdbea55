"""The deterministic simulator: the robots' own nodes and radios over the world's physics, in virtual time."""

import rmr  # noqa: F401 - from then on compiled modules are found

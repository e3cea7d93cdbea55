"""Why: where a fact comes from, and why it does not hold (provenance, from the recorded minds of robots)."""

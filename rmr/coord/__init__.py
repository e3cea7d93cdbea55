"""Coordination: who leads an event and who goes when, as a core without input or output (paper IV.C)."""

"""Coordination: leader election, group membership and schedules, as a core without input or output (paper IV.C)."""

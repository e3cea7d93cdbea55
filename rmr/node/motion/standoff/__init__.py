"""Deadlocks between robots: how one is detected, the table of escapes, and which of them is taken."""

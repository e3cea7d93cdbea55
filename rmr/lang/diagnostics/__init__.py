"""Errors and warnings about a program: as data, with their place in the source, and as text or JSON."""

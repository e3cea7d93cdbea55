"""Specialised Python source from verified programs."""

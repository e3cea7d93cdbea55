"""Deadlocks between robots: how one is detected (`detector`), the ways out (`escapes`), and which one is taken (`policy`)."""

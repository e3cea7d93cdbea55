"""The second phase: what the names, constants and types of a program are, and which of its parts look wrong.

Everything here looks at the program of the whole ensemble, as a syntax tree. Errors and warnings are collected as
diagnostics; nothing is raised.
"""

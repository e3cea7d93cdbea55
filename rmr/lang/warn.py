"""Doubts: what is legal and yet probably not meant. Warnings never stop compilation."""

from rmr.lang.diagnostic import Diagnostics
from rmr.lang.names import Names
from rmr.lang.syntax import Module


def warn(module: Module, names: Names, found: Diagnostics) -> None:
    """Report the doubts about `module`."""

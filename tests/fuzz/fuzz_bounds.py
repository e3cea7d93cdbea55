"""Bounds so small that a short script reaches them: what every engine drops must be the same.

A bound is a constant of the module that keeps to it, and other modules may have taken it from there; all of them are
changed. Small too is what decides which way an engine goes to the same end, so that short scripts go all ways. An
engine that writes bounds into the code that it makes must be asked for a program that it has not seen.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

SMALL = {
    "FACTS_MAX": 12,
    "FACTS_LENGTH_MAX": 30,
    "GOALS_MAX": 2,
    "ACHIEVED_MAX": 3,
    "ACTIONS_MAX": 3,
    "CHAINS_MAX": 1,
    "JOBS_MAX": 3,
    "LIVE_MAX": 2,
    "WATCHES_MAX": 1,
    "RECENT_MAX": 2,
    "MATCHES_MAX": 5,
    "ROTOR_MATCHES_MAX": 2,
    "ROTOR_MEMORY_MAX": 2,
    "REPEATS_REPORTED": 2,
    "RANKING_STEPS": 7,
    "RANKING_RUNS_MAX": 2,
    "EDGES_MAX": 12,
    "CHANGES_MAX": 4,
    "NESTED_CALLS_MAX": 3,
    "CALLS_MAX": 9,
}
"""By name. Not of failures: which are forgotten hangs on how often a match is looked at, an engine's own affair."""

TURNS = {
    "CHUNK": 2,
    "INDEX_FROM": 2,
    "HOLES_MAX": 2,
    "NEW_MAX": 2,
    "KEPT_MAX": 5,
    "FRESH_LOOKS_MAX": 6,
    "TAKEN_MAX": 1,
    "AT_ONCE_MAX": 1,
    "SEVERAL": 2,
    "FEW": 3,
    "IN_LOOP_MAX": 2,
    "IN_LINE_MAX": 1,
    "DEPTH_MAX": 3,
}
"""By name: from where on an engine goes another way to the same end."""

ELSEWHERE = {"MATCHES_MAX": ("rmr.vm.once",)}
"""Where a name means another bound, which is left as it is: of a rule's unfired matches here."""

ALL = SMALL | TURNS


@contextmanager
def bounds(small: bool) -> Iterator[None]:
    """Let the bounds of all machines made meanwhile be small, or as they are."""
    with pytest.MonkeyPatch.context() as patch:
        for module in [name for name in sys.modules if small and name.startswith("rmr.vm.")]:
            for name in ALL.keys() & vars(sys.modules[module]).keys():
                if module not in ELSEWHERE.get(name, ()):
                    patch.setattr(sys.modules[module], name, ALL[name])
        yield

"""Bounds on the work of a robot's search for ranks (`rmr.vm.ranks`), which `rmr check --explain` tells.

Estimates have a bound of their own: `rmr.analysis.goal_levels.STEPS_MAX`.
"""

RANKING_STEPS = 5_000
"""Steps of the search that one `run` may take: a few milliseconds of a tick of 16."""

RANKING_RUNS_MAX = 600
"""Runs in a row for which a machine waits for its ranks, 10 s of ticks: enough for a map of a million facts."""

EDGES_MAX = 500_000
"""Steps and nodes of one robot's graph, some 300 bytes each; beyond that nothing further is explored."""

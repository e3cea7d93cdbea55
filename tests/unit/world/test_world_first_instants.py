"""What several rules ask for is worked out once: the first instant of each robot, and the shortest paths of a floor."""

from collections import Counter
from pathlib import Path

from rmr_world.free_flow import FreeFlow, free_flow
from rmr_world.lab_file import load_lab
from rmr_world.lab_program import load_lab_program
from rmr_world.validate import first_instant
from rmr_world.validate.pipeline import run_findings


def counted(monkeypatch, owner, name, key):
    """Count the calls of a function by what `key` makes of their arguments."""
    calls: Counter[object] = Counter()
    real = getattr(owner, name)

    def call(*args):
        calls[key(args)] += 1
        return real(*args)

    monkeypatch.setattr(owner, name, call)
    return calls


def test_each_robot_is_run_once_and_each_path_is_searched_once(monkeypatch):
    lab = load_lab(Path("corridor"))
    program = load_lab_program(lab).program
    free_flow.cache_clear()
    first_instant.first_instants.cache_clear()
    runs = counted(monkeypatch, first_instant, "_run", lambda args: args[2])
    graphs = counted(monkeypatch, FreeFlow, "_dijkstra", lambda args: args[1])
    paths = counted(monkeypatch, FreeFlow, "_length", lambda args: args[1:])
    assert run_findings(lab, program) == []
    for calls in (runs, graphs, paths):
        assert len(calls) >= len(lab.robots)
        assert set(calls.values()) == {1}

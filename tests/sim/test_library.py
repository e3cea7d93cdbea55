"""Files of the library in labs: shared facts, deliveries and silence as frames on the air bring them about."""

import re

import pytest
from lab_maker import small_lab

CUTS = [f"{{from: 0s, to: 200s, link: [{a}, {b}], cut: true}}" for a, b in ((1, 3), (1, 4), (2, 4))]
LINE = ", ".join(CUTS)
"""Of four robots only 1 and 2, 2 and 3, 3 and 4 hear each other."""


def held(run, predicate, dead=()):
    """The arguments behind the owner of the facts of a predicate, by robot, live ones only."""
    found = {}
    for robot, each in enumerate(run.robots, 1):
        if robot not in dead:
            facts = [re.fullmatch(r"!?(\w+)\(@\d+,? ?(.*)\)", fact) for fact in each.node.machine.facts()]
            found[robot] = [fact[2].split(", ") for fact in facts if fact[1] == predicate]
    return found


def ran(folder, program, *, duration, loss, faults="", seed=1, **more):
    run = small_lab(folder, program, robots=4, loss=loss, faults=f"[{faults}]", duration=duration, seed=seed, **more)
    run.run()
    return run


@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_all_know_the_mean_of_the_live_robots(tmp_path, loss):
    program = """
        include "std/gossip.rmr".
        id(R, N) -o gossip_value(R, heat, N).
    """
    run = ran(tmp_path, program, faults=LINE, duration="15s", loss=loss)
    assert held(run, "gossip_mean") == {robot: [["heat", "2.5"]] for robot in range(1, 5)}
    run = ran(tmp_path, program, faults=f"{LINE}, {{at: 15s, kill: 4}}", duration="30s", loss=loss)
    assert held(run, "gossip_mean", dead=[4]) == {robot: [["heat", "2.0"]] for robot in range(1, 4)}

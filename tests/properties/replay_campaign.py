"""Replays of drawn simulated runs with faults: each must equal its log, with either engine.

Labs, seeds, losses, orders of leaders and rules left out are drawn; chaos kills, restarts, stalls, slows and silences
robots and disturbs their radio. A little of it is `test_replay_draws.py`. Run as a program for a long campaign:
``python replay_campaign.py FIRST LAST``; each failing run is printed by its number.
"""

import sys
from pathlib import Path
from random import Random

from rmr.base.time import seconds
from rmr.coord.timing import Order
from rmr.node.trace import TraceLevel
from rmr.vm.engines import Engine

sys.path.append(str(Path(__file__).parents[1] / "unit" / "mind"))
from mind_runs import LABS, MindRun

EXAMPLES = LABS.parents[1] / "docs" / "examples" / "labs"
CHOICES = [
    *(LABS / name for name in ("corridor", "testbed", "twoway", "formation")),
    *(EXAMPLES / name for name in ("aisles", "charging", "crossing")),
]
RULES = ("unwatched", "promise")


def drawn(number: int) -> MindRun:
    """Return the run that `number` draws."""
    rng = Random(f"replay/{number}")
    return MindRun(
        rng.choice(CHOICES),
        rng.randrange(10**6),
        chaos=rng.random() < 0.8,
        loss=rng.choice((None, 0.1, 0.4)),
        order=rng.choice(list(Order)) if rng.random() < 0.3 else Order.OURS,
        without=frozenset(rng.sample(RULES, rng.randrange(3))) if rng.random() < 0.3 else frozenset(),
        duration=seconds(rng.choice((8, 20, 40))),
    )


def check(number: int) -> None:
    """Replay all minds of the run that `number` draws, and compare."""
    rng = Random(f"replay/{number}/how")
    run = drawn(number)
    assert run.logs, number
    assert {robot for robot, _ in run.logs} == set(run.simulation.lab.roster), number
    twins = {}
    for robot, epoch in run.logs:
        engine = rng.choice(list(Engine))
        level = rng.choice((TraceLevel.NOTHING, TraceLevel.NOTES, TraceLevel.FACTS))
        replay = run.replay(robot, epoch, engine=engine, trace=level)
        assert replay.difference is None, (number, robot, epoch, engine, level)
        assert replay.ended, (number, robot, epoch)
        twins[robot, epoch] = replay.node
    for robot in run.simulation.robots:
        twin = twins[robot.robot, robot.restarts]
        assert twin.machine.facts() == robot.node.machine.facts(), (number, robot.robot)
        assert twin.machine.firings == robot.node.machine.firings, (number, robot.robot)


def main(first: int, last: int) -> int:
    """Check the runs `first` to `last`; return 1 if one fails."""
    failed = False
    for number in range(first, last + 1):
        try:
            check(number)
        except AssertionError as error:
            failed = True
            print(f"run {number}: {error}", flush=True)
    print(f"runs: {last - first + 1}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))

"""A new leader hears of a robot that stands when it can be at the gate: it is no nearer than when it asked."""

from pathlib import Path

import pytest

from rmr.base.time import milliseconds, seconds
from rmr.coord.events import LeadershipEnded
from rmr.node.crossing.phases import Asking, Slotted
from rmr_sim.run_setup import Options, load

LAB = Path(__file__).parents[3] / "deploy" / "labs" / "testbed"


@pytest.fixture
def asking():
    """Return the crossings of a robot that has asked and stands, and the one under way."""
    simulation = load(LAB, Options()).simulation(1)
    simulation.observers.append(lambda now: simulation.stop() if now >= milliseconds(130) else None)
    simulation.run()
    crossings = simulation.robots[0].node.crossings
    crossing = crossings.current
    assert crossing is not None
    assert isinstance(crossing.phase, Asking)
    return crossings, crossing


def test_a_robot_that_stands_puts_its_release_off_when_the_leader_changes(asking):
    crossings, crossing = asking
    later = seconds(3)
    assert crossing.release < later + crossing.plan.approach
    crossings.handle(later, LeadershipEnded(crossing.group_id))
    assert crossing.release == later + crossing.plan.approach


def test_a_release_that_is_later_anyway_stays(asking):
    crossings, crossing = asking
    crossing.release = seconds(60)
    crossings.handle(seconds(3), LeadershipEnded(crossing.group_id))
    assert crossing.release == seconds(60)


def test_a_robot_that_has_a_slot_keeps_its_release(asking):
    crossings, crossing = asking
    crossing.phase, before = Slotted(seconds(60), 0), crossing.release
    crossings.handle(seconds(3), LeadershipEnded(crossing.group_id))
    assert crossing.release == before

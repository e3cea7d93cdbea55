"""A new leader hears of a robot that stands when it can be at the gate: it is no nearer than when it asked."""

from pathlib import Path

import pytest
from rmr.node.crossing.turn import Phase

from rmr.base.time import milliseconds, seconds
from rmr.coord.events import LeadershipEnded
from rmr_sim.run import Options, load

LAB = Path(__file__).parents[3] / "deploy" / "labs" / "testbed"


@pytest.fixture
def asking():
    """Return the turns of a robot that has asked and stands, and its turn."""
    simulation = load(LAB, Options()).simulation(1)
    simulation.observers.append(lambda now: simulation.stop() if now >= milliseconds(130) else None)
    simulation.run()
    turns = simulation.robots[0].node.turns
    turn = turns.current
    assert turn is not None
    assert turn.requested
    assert turn.phase is Phase.ASKING
    return turns, turn


def test_a_robot_that_stands_puts_its_release_off_when_the_leader_changes(asking):
    turns, turn = asking
    later = seconds(3)
    assert turn.release < later + turn.approach
    turns.handle(later, LeadershipEnded(turn.event))
    assert turn.release == later + turn.approach


def test_a_release_that_is_later_anyway_stays(asking):
    turns, turn = asking
    turn.release = seconds(60)
    turns.handle(seconds(3), LeadershipEnded(turn.event))
    assert turn.release == seconds(60)


def test_a_robot_that_has_a_slot_keeps_its_release(asking):
    turns, turn = asking
    turn.phase, before = Phase.SLOTTED, turn.release
    turns.handle(seconds(3), LeadershipEnded(turn.event))
    assert turn.release == before

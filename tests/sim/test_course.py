"""A robot that is given another place while it drives: it says so at once, and plans its way in time."""

from itertools import pairwise
from pathlib import Path

from rmr.base.geometry import Point
from rmr.base.time import Instant
from rmr.node.crossing.destination import REPLAN_EVERY
from rmr.node.crossing.phases import Asking, Inside, Slotted
from rmr_sim.run_setup import prepare

FRAMES = 150
"""For so many frames the robot is sent elsewhere: 2.5 s."""
TESTBED = Path(__file__).parents[2] / "deploy" / "labs" / "testbed"


def redirected(phases: tuple[type, ...]) -> tuple[list[Instant], int]:
    """Send one robot to another place in each frame of `phases`; return when it has planned, and how many frames."""
    simulation = prepare(TESTBED, seed=1, robots=2)
    node = simulation.robots[0].node
    planned: dict[Instant, None] = {}
    frames = 0

    def disturb(now: Instant) -> None:
        nonlocal frames
        crossing = node.crossings.crossing(node.actions.driving)
        if crossing is None or crossing.goal is None or type(crossing.phase) not in phases or node.driver is None:
            return
        goal: Point = crossing.goal.places[frames % 2]
        frames += 1
        node.crossings.destinations.redirect(now, goal, crossing)
        assert node.crossings.destinations.current() == goal
        planned[crossing.course.planned_at] = None
        if frames == FRAMES:
            simulation.stop()

    simulation.observers.append(disturb)
    simulation.run()
    return list(planned), frames


def test_before_the_gate_a_way_is_planned_once_a_second_at_most() -> None:
    planned, frames = redirected((Asking, Slotted))
    assert frames == FRAMES
    assert len(planned) > 1
    assert all(b - a >= REPLAN_EVERY for a, b in pairwise(planned))


def test_behind_the_gate_it_is_planned_at_once() -> None:
    planned, frames = redirected((Inside,))
    assert len(planned) == frames > 60

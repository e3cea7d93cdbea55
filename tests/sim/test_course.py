"""A robot that is given another place while it drives: it says so at once, and plans its way in time."""

from itertools import pairwise
from pathlib import Path

from rmr.base.geometry import Point
from rmr.base.time import Instant, seconds
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


NEAR_OR_FAR = """
lab: stores
program: stores.rmr
duration: 120s
finish: delivered(R)
arena: {size: [6.0, 2.0]}
obstacles:
- box: [3.0, 0.0, 3.4, 0.9]
- box: [3.0, 1.1, 3.4, 2.0]
bottleneck: {mouths: [m1, m2]}
areas:
  store: {slots: [[5.4, 1.0], [0.6, 0.4]]}
  m1: {at: [2.9, 1.0]}
  m2: {at: [3.5, 1.0]}
robots:
- {id: 1, pose: [0.5, 1.5, 0deg]}
"""
DELIVERS = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
start(R).
start(R) -o ordered(R).
delivery: assert(ordered(R), delivered(R), 60.0, broadcast(R)).
ordered(R) -o moveto(R, store).
at(R, store) -o delivered(R).
"""


def test_a_robot_whose_way_leads_to_no_gate_plans_that_to_a_place_behind_one_at_once(tmp_path: Path) -> None:
    """Its slot would not wait for it: it is put off until the robot is under way, and so for ever."""
    (tmp_path / "lab.yaml").write_text(NEAR_OR_FAR, "utf-8")
    (tmp_path / "stores.rmr").write_text(DELIVERS, "utf-8")
    simulation = prepare(tmp_path, seed=1)
    node = simulation.robots[0].node
    sent: list[Instant] = []
    planned: list[Instant] = []

    def disturb(now: Instant) -> None:
        crossing = node.crossings.crossing(node.actions.driving)
        if crossing is None or crossing.goal is None or node.driver is None or not crossing.waits:
            return
        route = node.driver.navigator.route
        if route is None:
            return
        if not sent:
            node.crossings.destinations.redirect(now, crossing.goal.places[route.gate_m is not None], crossing)
            sent.extend([now] if route.gate_m is None else [])
        elif route.gate_m is not None:
            planned.append(now)
            simulation.stop()

    simulation.observers.append(disturb)
    simulation.run()
    assert sent
    assert planned
    assert planned[0] - sent[0] <= REPLAN_EVERY + seconds(1)

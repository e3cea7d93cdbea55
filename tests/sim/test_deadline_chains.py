"""One deadline for the whole job: chains of actions, several jobs of one robot, two doors in a row (paper II.C)."""

from itertools import pairwise

import pytest
from lab_maker import small_lab, traced

from rmr.coord.timing import Order
from rmr_sim.run_setup import report_of

pytestmark = pytest.mark.medium

DOORS = """
from rmr import action

@action("first")
async def first(robot):
    await robot.sleep(1.0)

@action("second")
async def second(robot):
    await robot.sleep(1.0)
"""
TWO_DOORS = """
type action first(R: robot) -o outer(R).
type action second(R: robot) -o inner(R).
type !due(robot, float).
type !begun(robot).
start(R).
start(R), due(R, D) -o trip(R, D).
doors: assert(trip(R, D), through(R), D, say(R, "late")).
$trip(R, D), not begun(R) -o begun(R), first(R) then second(R).
outer(R), inner(R) -o through(R).
"""
"""Both doors are one resource: a robot has its turn for the first one, and another turn for the second."""
FETCH = """
from rmr import action

@action("fetch")
async def fetch(robot, number):
    await robot.sleep(2.0)
"""
ORDERS = """
ORDER
type errand(robot, int, float).
type action fetch(R: robot, N: int) -o done(R, N), free(R).
free(R).
errand(R, 1, 9).
errand(R, 2, 6.5).
errand(R, 3, 4).
fetched: watch(errand(R, N, D), done(R, N), D, say(R, "late")).
errand(R, N, _), free(R) -o fetch(R, N).
done(R, _) -o 1.
"""


TWO_ROOMS = TWO_DOORS.replace("outer(R), inner(R)", "inner(R)")
"""The same with a resource at each door: only the second action serves the job, the first one is a step before it."""


def doors(folder, order, program=TWO_DOORS):
    simulation = small_lab(
        folder,
        program,
        robots=3,
        actions=DOORS,
        finish="through(R)",
        facts='["due(@1, 9)", "due(@2, 6.5)", "due(@3, 4)"]',
        order=order,
    )
    assert simulation.run()
    return simulation


def jobs_of(simulation):
    return {robot: part["assertions"][0] for robot, part in report_of(simulation, True)["robots"].items()}


def test_two_doors_in_a_row_under_one_deadline_go_to_the_robot_that_is_due_first(tmp_path):
    simulation = doors(tmp_path, Order.OURS)
    assert [job["met"] for job in jobs_of(simulation).values()] == [True] * 3
    begun = [entry for entry in traced(simulation, "action") if entry["action"].startswith("first")]
    assert [entry["robot"] for entry in sorted(begun, key=lambda each: each["t"])] == [3, 2, 1]


def test_two_doors_in_the_order_of_the_requests_are_late_and_each_door_tells_its_turn(tmp_path):
    late = [job for job in jobs_of(doors(tmp_path, Order.FCFS)).values() if not job["met"]]
    assert late
    for job in late:
        first, second = job["steps"]
        assert (first["action"][:5], second["action"][:6]) == ("first", "second")
        assert first["begin_ns"] == 0
        assert first["end_ns"] == second["begin_ns"]
        for step in (first, second):
            assert set(step["time_ns"]) <= {"rule", "turn", "action"}
            assert step["time_ns"]["action"] == pytest.approx(1e9, abs=2e7)
            assert sum(step["time_ns"].values()) == step["end_ns"] - step["begin_ns"]
        assert sum(step["time_ns"]["turn"] for step in job["steps"]) > 1e9, "it was late for its turns"


def test_two_rooms_in_a_row_have_turns_of_their_own_which_overlap(tmp_path):
    """Each room has one robot at a time, a robot in one does not keep others from the other one."""
    simulation = doors(tmp_path, Order.OURS, TWO_ROOMS)
    assert [job["met"] for job in jobs_of(simulation).values()] == [True] * 3
    within = {"first": [], "second": []}
    for entry in sorted(traced(simulation, "action"), key=lambda each: each["t"]):
        within[entry["action"].partition("(")[0]].append(entry)
    for begun in within.values():
        assert [entry["robot"] for entry in begun] == [3, 2, 1]
        assert all(later["t"] - earlier["t"] >= 1.0 for earlier, later in pairwise(begun))
    assert within["first"][1]["t"] < within["second"][0]["t"] + 1.0


def test_two_rooms_in_the_order_of_the_requests_tell_the_lateness_of_each_and_who_was_inside(tmp_path):
    late = {robot: job for robot, job in jobs_of(doors(tmp_path, Order.FCFS, TWO_ROOMS)).items() if not job["met"]}
    assert list(late) == ["3"]
    first, second = late["3"]["steps"]
    assert first["due_ns"] == pytest.approx(3e9, abs=2e7), "the second room takes a second"
    assert second["due_ns"] == 4e9
    for step in (first, second):
        assert step["late_ns"] == step["end_ns"] - step["due_ns"]
        assert step["end_ns"] - step["begun_ns"] == pytest.approx(1e9, abs=2e7)
    assert (first["late_ns"] < 0, first["behind"]) == (True, []), "it was the first in the first room"
    assert (second["late_ns"] > 2e9, second["behind"]) == (True, [1, 2])


@pytest.mark.parametrize(("order", "met"), [("order deadline.", [True] * 3), ("", [True, True, False])])
def test_three_orders_of_one_robot_are_in_time_in_the_order_of_their_deadlines_alone(tmp_path, order, met):
    simulation = small_lab(tmp_path, ORDERS.replace("ORDER", order), actions=FETCH, duration="8s")
    simulation.run()
    [part] = report_of(simulation, True)["robots"].values()
    jobs = {job["job"]: job["met"] for job in part["assertions"]}
    assert [jobs[f"done(@1, {number})"] for number in (1, 2, 3)] == met

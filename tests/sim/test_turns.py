"""Turns under way: jobs that start anew, actions that fail inside, passages that exclude each other."""

from itertools import pairwise
from pathlib import Path

import pytest
from lab_maker import small_lab, traced

from rmr_sim.run_setup import prepare

LABS = Path(__file__).parents[2] / "deploy" / "labs"

CHARGE = """
from rmr import ActionFailed, action

@action("charge")
async def charge(robot, *left):
    await robot.sleep(2.0)
    if left and left[0] > 0:
        raise ActionFailed("no contact")
"""


def spans(simulation, action):
    """Return (begin, end, robot) of each time that an action was carried out, in order of the beginnings."""
    begun = [(e["robot"], e["t"]) for e in traced(simulation, "action") if e["action"].startswith(action)]
    ended = [(e["robot"], e["t"]) for e in traced(simulation, "action_ended") if e["action"].startswith(action)]
    pairs = zip(sorted(begun), sorted(ended), strict=True)
    return sorted((begin, end, robot) for (robot, begin), (_, end) in pairs)


def overlaps(found):
    return [(a, b) for a, b in pairwise(found) if b[0] < a[1]]


@pytest.mark.parametrize("again_s", [0.1, 1.5, 2.5])
def test_a_job_that_starts_anew_keeps_the_action_that_waits_for_its_turn(tmp_path, again_s):
    simulation = small_lab(
        tmp_path,
        f"""
        type action charge(R: robot) -o charged(R).
        type action wait(R: robot, T: float) -o waited(R).
        start(R).
        start(R) -o need(R), wait(R, {again_s}), once(R).
        charging: assert(need(R), charged(R), 30, say(R, "late")).
        need(R), once(R) -o charge(R).
        waited(R) -o need(R).
        """,
        robots=3,
        actions=CHARGE,
        finish="charged(R)",
    )
    assert simulation.run()
    found = spans(simulation, "charge")
    assert sorted(robot for _, _, robot in found) == [1, 2, 3]
    assert overlaps(found) == []


def test_an_action_that_failed_in_its_turn_tries_again_in_another_one(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action charge(R: robot, N: int) -o charged(R) else again(R, N).
        start(R).
        start(R) -o need(R).
        charging: assert(need(R), charged(R), 60, say(R, "late")).
        need(R) -o charge(R, 2).
        again(R, N) -o charge(R, N - 1).
        """,
        robots=3,
        actions=CHARGE,
        finish="charged(R)",
        duration="60s",
    )
    assert simulation.run()
    found = spans(simulation, "charge")
    assert len(found) == 9
    assert overlaps(found) == []


def test_a_turn_lasts_until_the_last_action_that_serves_it_has_ended(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action charge(R: robot, N: int) -o charged(R) else gone(R).
        type action top(R: robot) -o charged(R).
        start(R).
        start(R) -o need(R).
        charging: assert(need(R), charged(R), 60, say(R, "late")).
        need(R) -o top(R), charge(R, 1).
        """,
        robots=2,
        actions=CHARGE + '\n\n@action("top")\nasync def top(robot):\n    await robot.sleep(3.0)\n',
        finish="charged(R)",
        duration="60s",
    )
    assert simulation.run()
    assert overlaps(spans(simulation, "top")) == []


def test_exclusive_turns_never_overlap_whatever_the_robots_ids(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action charge(R: robot) -o charged(R).
        start(R).
        start(R) -o need(R).
        charging: assert(need(R), charged(R), 30, say(R, "late")).
        need(R) -o charge(R).
        """,
        robots=2,
        actions=CHARGE,
        finish="charged(R)",
    )
    lab = simulation.lab.path
    lab.write_text(lab.read_text().replace("{id: 2,", "{id: 15,"))
    simulation = prepare(tmp_path, seed=1, actions=tmp_path / "actions.py")
    assert simulation.run()
    assert overlaps(spans(simulation, "charge")) == []


def test_a_users_action_that_only_names_an_area_waits_for_its_turn_like_any_other(tmp_path):
    lab = (LABS / "testbed" / "lab.yaml").read_text()
    lab = lab.replace("testbed.rmr", "looking.rmr").replace("finish: at(R, exit)", "finish: inspected(R, exit)")
    (tmp_path / "lab.yaml").write_text(lab)
    (tmp_path / "looking.rmr").write_text(
        """
        type !due(robot, float).
        type action inspect(R: robot, A: area) -o inspected(R, A).
        start(R).
        start(R) -o need(R, exit).
        looking: assert(need(R, A), inspected(R, A), 60, say(R, "late")).
        need(R, A) -o inspect(R, A).
        """
    )
    (tmp_path / "actions.py").write_text(
        'from rmr import action\n\n@action("inspect")\nasync def inspect(robot, area):\n    await robot.sleep(2.0)\n'
    )
    simulation = prepare(tmp_path, seed=1, robots=3, actions=tmp_path / "actions.py")
    assert simulation.run()
    found = spans(simulation, "inspect")
    assert len(found) == 3
    assert overlaps(found) == []
    assert len(traced(simulation, "entered")) == 3


def test_what_is_kept_of_actions_and_events_is_bounded(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action wait(R: robot, T: float) -o waited(R).
        type action light(R: robot, C: colour) -o done(R, 0).
        type need(robot, int).
        need(R, 40).
        lighting: assert(need(R, N), lit(R, N), 9, say(R, "late")).
        need(R, N), N > 0 -o wait(R, 0.01), next(R, N - 1), lit(R, N).
        waited(R), next(R, N) -o need(R, N).
        """,
        duration="2s",
    )
    simulation.run()
    node = simulation.robots[0].node
    assert len(node.machine.jobs) > 32
    assert len(list(node.crossings._table)) <= 32


WAITING_STATION = """
    type action charge(R: robot) -o charged(R).
    type action wait(R: robot, T: float) -o waited(R).
    early(R) -o low(R), wait(R, 45.0).
    late(R) -o wait(R, 5.0), soon(R).
    waited(R), soon(R) -o low(R), can(R).
    waited(R), low(R) -o low(R), can(R).
    charging: assert(low(R), charged(R), 60, say(R, "late")).
    low(R), can(R) -o charge(R).
"""
"""The jobs of those that are `early` start long before their action does, and are due first."""


@pytest.mark.medium
def test_job_that_is_ready_is_not_starved_by_jobs_that_are_not_and_are_due_first(tmp_path):
    simulation = small_lab(
        tmp_path,
        WAITING_STATION,
        robots=3,
        actions=CHARGE,
        finish="charged(R)",
        duration="70s",
        facts='["early(@1)", "early(@2)", "late(@3)"]',
    )
    assert simulation.run()
    entered = {entry["robot"]: entry["t"] for entry in traced(simulation, "entered")}
    assert entered[3] < 8.0
    assert max(entered.values()) < 50.0
    lost = [entry for entry in traced(simulation, "slot_lost") if entry["missed"]]
    assert len(lost) <= 24  # 15 of two robots in 45 s; without a back-off 36
    assert overlaps(spans(simulation, "charge")) == []


LOW = """
    type action charge(R: robot) -o charged(R).
    start(R).
    start(R) -o low(R).
    charging: assert(low(R), charged(R), {deadline}, say(R, "late")).
    low(R) -o charge(R).
"""
QUICK = CHARGE.replace("2.0", "0.5")


def test_lone_robot_has_its_turn_at_once_and_keeps_a_deadline_of_a_second(tmp_path):
    simulation = small_lab(tmp_path, LOW.format(deadline=1), robots=1, actions=QUICK, finish="charged(R)")
    assert simulation.run()
    ((begin, end, _),) = spans(simulation, "charge")
    assert begin <= 0.1
    assert end <= 1.0
    assert simulation.trace()
    assert not [entry for entry in simulation.trace() if "late" in str(entry)]


@pytest.mark.parametrize("robots", [2, 6])
def test_first_of_several_that_ask_together_keeps_a_deadline_of_a_second(tmp_path, robots):
    simulation = small_lab(
        tmp_path, LOW.format(deadline=1), robots=robots, actions=QUICK, finish="charged(R)", size=(3.0, 1.5)
    )
    assert simulation.run()
    found = spans(simulation, "charge")
    assert found[0][1] <= 1.0
    assert overlaps(found) == []


AISLES = """
lab: aisles
program: aisles.rmr
duration: 90s
finish: there(R)
arena: {size: [3.0, 2.4], cell: 0.05}
obstacles:
  - {box: [1.2, 0.0, 1.8, 0.45]}
  - {box: [1.2, 0.75, 1.8, 1.65]}
  - {box: [1.2, 1.95, 1.8, 2.4]}
areas:
  south_west: {at: [1.1, 0.6]}
  south_east: {at: [1.9, 0.6]}
  dock: {slots: [[2.7, 0.2], [2.7, 0.5], [2.7, 0.8]]}
  store: {slots: [[2.7, 1.5], [2.7, 1.8], [2.7, 2.1]]}
  station: {slots: [[0.3, 1.2], [0.6, 1.2], [0.9, 1.2]]}
bottleneck: {mouths: [south_west, south_east]}
robots:
  - {ids: 1-3, grid: {from: [0.3, 0.3], step: [0.3, 0], columns: 3}}
  - {ids: 4-6, grid: {from: [0.3, 2.1], step: [0.3, 0], columns: 3}}
facts:
  - goes(@1, dock)
  - goes(@2, dock)
  - goes(@3, dock)
  - goes(@4, OTHER)
  - goes(@5, OTHER)
  - goes(@6, OTHER)
"""

TWO_EVENTS = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type !goes(robot, area).
start(R).
start(R), goes(R, dock) -o south(R), moveto(R, dock).
start(R), goes(R, OTHER) -o other(R), moveto(R, OTHER).
at(R, A), goes(R, A) -o there(R).
southern: assert(south(R), at(R, dock), 60, say(R, "late")).
others: assert(other(R), at(R, OTHER), 60, say(R, "late")).
"""


@pytest.mark.medium
@pytest.mark.parametrize("other", ["store", "station"])
def test_event_whose_drives_do_not_pass_the_bottleneck_stays_exclusive(tmp_path, other):
    (tmp_path / "lab.yaml").write_text(AISLES.replace("OTHER", other))
    (tmp_path / "aisles.rmr").write_text(TWO_EVENTS.replace("OTHER", other))
    simulation = prepare(tmp_path, seed=1)
    assert simulation.run()
    entered = {e["robot"]: e["t"] for e in traced(simulation, "entered")}
    left = {e["robot"]: e["t"] for e in traced(simulation, "left")}
    assert sorted(entered) == [1, 2, 3, 4, 5, 6]
    whole_drives = sorted((entered[robot], left[robot], robot) for robot in (4, 5, 6))
    assert overlaps(whole_drives) == []
    passages = sorted((entered[robot], left[robot], robot) for robot in (1, 2, 3))
    assert overlaps(passages) != [], "passages of the bottleneck in one way follow each other by a headway"

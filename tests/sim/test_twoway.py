"""Opposing traffic through a corridor one robot wide: one event, two mouths, deadlines drawn from the seed."""

from pathlib import Path

import pytest

from rmr_sim.run_setup import prepare, report_of

pytestmark = pytest.mark.medium

LAB = Path(__file__).parents[2] / "deploy" / "labs" / "twoway"
EASTWARD, WESTWARD = {1, 2, 3, 4}, {5, 6, 7, 8}


@pytest.fixture(scope="module")
def passed():
    """A run of the lab: the simulation when it is over, and its report."""
    simulation = prepare(LAB, seed=3)
    return simulation, report_of(simulation, simulation.run())


def instants(simulation, what):
    return {entry["robot"]: entry["t"] for entry in simulation.trace() if entry["what"] == what}


def test_four_and_four_robots_get_across_without_contact(passed):
    _, report = passed
    assert report["finished"]
    assert report["collisions"] == 0
    assert all("across" in "".join(part["facts"]) for part in report["robots"].values())


def test_entry_waits_while_an_opposed_robot_is_inside(passed):
    simulation, _ = passed
    entered, left = instants(simulation, "entered"), instants(simulation, "left")
    assert set(entered) == set(left) == EASTWARD | WESTWARD
    assert all(left[a] <= entered[b] or left[b] <= entered[a] for a in EASTWARD for b in WESTWARD)


def test_robots_that_go_the_same_way_are_in_the_corridor_together(passed):
    simulation, _ = passed
    entered, left = instants(simulation, "entered"), instants(simulation, "left")
    assert any(entered[a] < entered[b] < left[a] for a in EASTWARD for b in EASTWARD - {a})


def test_both_ways_are_one_event_with_one_order(passed):
    _, report = passed
    assert len({schedule["event"] for schedule in report["schedule"]}) == 1
    assert sorted(report["schedule"][-1]["order"]) == sorted(EASTWARD | WESTWARD)


def test_each_side_fills_its_places_from_the_far_end(passed):
    simulation, _ = passed
    entered = instants(simulation, "entered")
    far_first = {robot: -abs(simulation.world.pose(robot).x - 1.5) for robot in entered}
    for side in (EASTWARD, WESTWARD):
        by_entry = sorted(side, key=lambda robot: entered[robot])
        assert by_entry == sorted(side, key=lambda robot: far_first[robot])


def test_the_report_shows_the_deadlines_that_the_seed_has_drawn(passed):
    _, report = passed
    drawn = {job["job"]: job for part in report["robots"].values() for job in part["assertions"]}
    dues = [fact for part in report["robots"].values() for fact in part["facts"] if "due(" in fact]
    assert len(dues) == 8
    for fact in dues:
        robot, due = fact.removeprefix("!due(").removesuffix(")").split(", ")
        job = drawn[f"across({robot})"]
        assert job["deadline_s"] - job["start_s"] == pytest.approx(float(due))
        assert 14.0 <= float(due) <= 36.0


def test_deadlines_differ_from_seed_to_seed():
    drawn = {str([robot.node.config.facts for robot in prepare(LAB, seed=seed).robots]) for seed in (1, 2, 3)}
    assert len(drawn) == 3


def head_to_head(folder, ways):
    """Return the report of a lab in which robots begin inside the corridor, those from the east against the others."""
    text = (LAB / "lab.yaml").read_text()
    robots = "".join(f"  - {{id: {i}, pose: [{x}, 0.75, {0 if x < 1.5 else 180}deg]}}\n" for i, x in ways.items())
    facts = "".join(f"  - goes(@{i}, {'right' if x < 1.5 else 'left'})\n  - due(@{i}, 60)\n" for i, x in ways.items())
    head, rest = text.split("robots:\n")
    (folder / "lab.yaml").write_text(f"{head}robots:\n{robots}facts:\n{facts}\nrobot:{rest.split('robot:')[1]}")
    (folder / "twoway.rmr").write_text((LAB / "twoway.rmr").read_text())
    simulation = prepare(folder, seed=1)
    return report_of(simulation, simulation.run())


@pytest.mark.parametrize("ways", [{4: 1.38, 8: 1.62}, {3: 1.25, 4: 1.42, 7: 1.77, 8: 1.6}])
def test_robots_that_find_themselves_head_to_head_inside_get_out_without_contact(tmp_path, ways):
    report = head_to_head(tmp_path, ways)
    assert report["finished"]
    assert report["collisions"] == 0

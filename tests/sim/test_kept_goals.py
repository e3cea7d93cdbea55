"""Drives whose goal another robot keeps, or whose only way: they fail in time, with who is in the way."""

import pytest

from rmr_sim.run_setup import Options, load, report_of

STUCK_S = 20.0
"""A drive without a way fails after this (docs/language.md)."""
LOOKS_S = 2.0
"""A look a second, and the time to get there."""

PROGRAM = """
type wants(robot, area).
type action moveto(R: robot, A: area) -o at(R, A) else barred(R).
type barred(robot).
type ends(robot).
type sensor at(robot, area).
wants(R, A) -o moveto(R, A) then ends(R).
ends(@1).
barred(R) -o ends(R).
"""

TO_A_POINT = """
type wants(robot, float, float).
type action goto(R: robot, X: float, Y: float) -o came(R) else barred(R).
type came(robot).
type barred(robot).
type ends(robot).
wants(R, X, Y) -o goto(R, X, Y).
ends(@1).
came(R) -o ends(R).
barred(R) -o ends(R).
"""

WALLS = "[{box: [1.4, 0.0, 2.6, 0.55]}, {box: [1.4, 0.85, 2.6, 1.4]}]"


def ran(tmp_path, *, obstacles="[]", at="0.5, 0.7", robots="", wants="wants(@2, a)", program=PROGRAM):
    """Run a lab in which robot 1 stands `at` a place for good; return the report and the failures by robot.

    Without turns in its passages: for them a robot waits before it drives.
    """
    (tmp_path / "kept.rmr").write_text(program)
    (tmp_path / "lab.yaml").write_text(
        f"""
lab: kept
program: kept.rmr
duration: 100s
finish: ends(R)
arena: {{size: [4.0, 1.4]}}
obstacles: {obstacles}
passages: {{}}
areas: {{a: {{at: [0.5, 0.7]}}}}
robots: [{{id: 1, pose: [{at}, 0deg]}}, {{id: 2, pose: [3.5, 0.7, 180deg]}}{robots}]
facts: ["{wants}"]
"""
    )
    simulation = load(tmp_path, Options()).simulation(7)
    report = report_of(simulation, simulation.run())
    failed = {
        entry["robot"]: (entry["t"], entry["failure"])
        for entry in simulation.trace()
        if entry["what"] == "action_ended" and entry["failure"]
    }
    return report, failed


def barred_since(failed, robot, why):
    """Return since when the way of `robot` was barred, from when its drive failed with the reason `why`."""
    at_s, words = failed[robot]
    assert words == f"no way there: {why}"
    return at_s - STUCK_S


@pytest.mark.medium
@pytest.mark.parametrize("obstacles", ["[]", WALLS], ids=["open floor", "corridor"])
def test_a_drive_to_a_goal_that_another_robot_keeps_fails_although_the_robot_tries_escapes(tmp_path, obstacles):
    report, failed = ran(tmp_path, obstacles=obstacles)
    assert barred_since(failed, 2, "robot 1 stands at the goal") < LOOKS_S
    assert report["finished"]


@pytest.mark.medium
def test_a_drive_whose_only_way_another_robot_keeps_fails(tmp_path):
    report, failed = ran(tmp_path, obstacles=WALLS, at="2.0, 0.7")
    assert barred_since(failed, 2, "robot 1 stands in the way") < LOOKS_S
    assert report["finished"]


@pytest.mark.medium
def test_a_drive_to_a_point_that_another_robot_keeps_fails(tmp_path):
    report, failed = ran(tmp_path, wants="wants(@2, 0.5, 0.7)", program=TO_A_POINT)
    assert barred_since(failed, 2, "robot 1 stands at the goal") < LOOKS_S
    assert report["finished"]


@pytest.mark.medium
def test_of_three_robots_with_one_place_two_fail(tmp_path):
    """One takes the place, and the others learn that it is taken when they are on their way."""
    others = ", {id: 3, pose: [3.5, 0.3, 180deg]}"
    wants = 'wants(@2, a)", "wants(@3, a)", "wants(@1, a)'
    report, failed = ran(tmp_path, at="1.0, 1.0", robots=others, wants=wants)
    assert {*failed} == {2, 3}
    assert {words for _, words in failed.values()} == {"no way there: robot 1 stands at the goal"}
    assert report["finished"]

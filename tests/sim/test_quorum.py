"""`quorum`: which robots have to hold the finish fact before a run is finished, when some of them die."""

import pytest
from lab_maker import small_lab

from rmr.entry import ExitCode
from rmr_sim.run_setup import report_of
from rmr_sim.seed_run import exit_code, row_of
from rmr_world.finding import LabError
from rmr_world.lab_file import load_lab
from rmr_world.run_report import summary, table_rows

DRIVE = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
go(R).
go(R) -o moveto(R, box).
"""
LATER = """
type action wait(R: robot, T: float) -o done(R).
type done(robot).
go(@1). go(@2). go(@3).
go(@1) -o wait(@1, 1.0).
go(@2) -o wait(@2, 2.0).
go(@3) -o wait(@3, 3.0).
"""


def report(folder, program, quorum, faults, finish="done(R)", robots=3):
    simulation = small_lab(
        folder, program, robots=robots, finish=f"{finish}\nquorum: {quorum}", duration="30s", faults=faults
    )
    return report_of(simulation, simulation.run())


@pytest.mark.parametrize(
    ("quorum", "finished", "time_s"),
    [("all", False, 30.0), ("living", True, 2.0), ("2", True, 2.0), ("1", True, 1.0), ("3", False, 30.0)],
)
def test_run_finishes_when_the_quorum_holds_the_finish_fact(tmp_path, quorum, finished, time_s):
    found = report(tmp_path, LATER, quorum, "[{at: 0.5s, kill: 3}]")
    assert found["finished"] is finished
    assert found["time_s"] == pytest.approx(time_s, abs=0.1)
    assert found["dead"] == [3]
    assert str(found["quorum"]) == quorum
    assert exit_code(row_of(found), strict=True) == (0 if finished else ExitCode.FAILED)


def test_living_quorum_waits_for_a_robot_that_a_fault_restarts_later(tmp_path):
    found = report(tmp_path, LATER, "living", "[{at: 0.5s, kill: 3}, {at: 6s, restart: 3}]")
    assert found["finished"] is True
    assert found["time_s"] == pytest.approx(9.0, abs=0.1)
    assert found["dead"] == []


def test_living_quorum_with_no_robot_alive_does_not_finish(tmp_path):
    found = report(tmp_path, LATER, "living", "[{at: 0.5s, kill: 1}, {at: 0.5s, kill: 2}, {at: 0.5s, kill: 3}]")
    assert found["finished"] is False
    assert found["dead"] == [1, 2, 3]


def test_dead_robot_that_held_the_finish_fact_does_not_count_for_a_number(tmp_path):
    found = report(tmp_path, LATER, "2", "[{at: 1.5s, kill: 1}]")
    assert found["finished"] is True
    assert found["time_s"] == pytest.approx(3.0, abs=0.1)


def test_report_table_and_summary_name_the_dead(tmp_path):
    found = report(tmp_path, LATER, "living", "[{at: 0.5s, kill: 3}]")
    assert [cells[2] for cells in table_rows(found)] == ["1.00 s", "2.00 s", "died"]
    assert summary(found).endswith("; robot 3 died")


def test_bound_is_over_the_living(tmp_path):
    """Robot 3 starts nearest to the box, robot 1 farthest from it."""
    far = report(tmp_path, DRIVE, "living", "[{at: 0.5s, kill: 3}]", finish="at(R, box)")
    near = report(tmp_path, DRIVE, "living", "[{at: 0.5s, kill: 1}]", finish="at(R, box)")
    assert far["finished"]
    assert near["finished"]
    assert near["bound_s"] < far["bound_s"] - 0.5
    for found in (near, far):
        assert found["time_s"] >= found["bound_s"]


@pytest.mark.parametrize(
    ("finish", "message"),
    [
        ("done(R)\nquorum: 4", "quorum: 4 robots cannot finish: there are 3 robots in this lab"),
        ("done(R)\nquorum: 0", "quorum: should be all, living, or the number of robots"),
        ("done(R)\nquorum: most", "quorum: should be all, living, or the number of robots"),
        ("done(R)\nquorum: true", "quorum: should be all, living, or the number of robots"),
    ],
)
def test_wrong_quorum_is_an_error_of_the_lab_file(tmp_path, finish, message):
    with pytest.raises(LabError, match=message.replace("(", r"\(")):
        small_lab(tmp_path, LATER, robots=3, finish=finish)


def test_quorum_without_a_finish_fact_is_an_error_of_the_lab_file(tmp_path):
    small_lab(tmp_path, LATER, robots=3)
    text = (tmp_path / "lab.yaml").read_text()
    (tmp_path / "lab.yaml").write_text(text + "quorum: living\n")
    with pytest.raises(
        LabError, match="quorum: says how many robots hold the finish fact: add finish, or leave it out"
    ):
        load_lab(tmp_path)


def test_fewer_robots_than_the_quorum_are_refused(tmp_path):
    lab = small_lab(tmp_path, LATER, robots=3, finish="done(R)\nquorum: 3").lab
    with pytest.raises(LabError, match="quorum: 3 robots cannot finish in a run of 2"):
        lab.with_robots(2)

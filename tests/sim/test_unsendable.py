"""A run in which a fact was dropped because no frames can carry it has failed, simulated or of processes."""

import pytest
from lab_maker import small_lab

from rmr_deploy import lab_run
from rmr_deploy.run_outcome import RunOutcome
from rmr_sim.run_setup import report_of
from rmr_sim.seed_run import exit_code, fails, reasons, row_of
from rmr_world.run_warnings import run_warnings

BIG = """
type big(robot, list int).
type list_of(robot, list int).
type !got(robot).
n(@1, ITEMS). list_of(@1, []). !got(@1).
n(R, N), list_of(R, L), N > 0 -o n(R, N - 1), list_of(R, L + [1234567890123]).
n(R, 0), list_of(R, L) -o big(@2, L), !got(@2).
big(R, _) -o taken(R).
"""


@pytest.mark.parametrize(("items", "code"), [(10, 0), (1000, 1)])
def test_a_fact_that_no_frames_can_carry_ends_a_finished_run_with_1(tmp_path, items, code):
    simulation = small_lab(tmp_path, BIG.replace("ITEMS", str(items)), robots=2, finish="got(R)")
    report = report_of(simulation, simulation.run())
    assert report["finished"]
    row = row_of(report)
    assert (exit_code(row, strict=False), fails(row)) == (code, bool(code))
    assert reasons(row) == ["facts that no frames can carry: 1"] * code
    assert [line for line in run_warnings(report) if "can never be sent" in line] == (
        ["1 of these can never be sent, as no frames can carry them, so the run has failed"] * code
    )
    assert lab_run.exit_code(RunOutcome(finished=True), report, strict=False) == code

"""Findings: their text, their order, and which of them validation returns."""

from world_labs import ROOM, lab_of

from rmr.lang.compiler import compile_source
from rmr_world.finding import END_LINE, Finding
from rmr_world.validate.pipeline import run_findings

PROGRAM = """\
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
start(R).
start(R) -o moveto(R, {area}).
"""
LAB = ROOM + "areas: {yard: {at: [2.0, 0.75]}}\nfaults: [{at: 200s, kill: 1}]\n"


def findings_of(folder, area):
    return run_findings(lab_of(folder, LAB), compile_source(PROGRAM.format(area=area), "room.rmr").program)


def test_a_warning_is_marked_in_the_text_and_an_error_is_not():
    error = Finding("lab.yaml", 3, 1, "duration", "is short")
    warning = Finding("lab.yaml", 3, 1, "duration", "is short", is_warning=True)
    assert [str(error), error.severity] == ["lab.yaml:3:1: duration: is short", "error"]
    assert [str(warning), warning.severity] == ["lab.yaml:3:1: duration: warning: is short", "warning"]


def test_a_finding_without_a_place_names_the_file_alone():
    assert str(Finding("lab.yaml", END_LINE, 1, "", "and 3 more mistakes")) == "lab.yaml: and 3 more mistakes"


def test_a_phase_with_errors_ends_validation_before_feasibility_warnings(tmp_path):
    assert [finding.severity for finding in findings_of(tmp_path, "yrad")] == ["error"]
    (warning,) = findings_of(tmp_path, "yard")
    assert warning.severity == "warning"
    assert "begins when the duration of 120 s is over" in warning.message

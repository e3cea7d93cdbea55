"""`rmr why` of a fact that is the violation of a time assertion, and of what follows from it."""

import pytest
from observed_runs import written

PROGRAM = """
asked(R, 1).
job: watch(asked(R, N), answered(R, N), 2, late(R, N)).
late(R, N), N < 3 -o asked(R, N + 1).
late(R, 3) -o told(@2, R).
answered(R, N), N > 5 -o answered(R, N).
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    return written(PROGRAM, "--robots 2", tmp_path, monkeypatch)


def test_a_fact_leads_through_the_violation_back_to_the_start_of_its_job(run):
    text = run.text("told(@2, @1)")
    assert text.index("told(@2, @1)") < text.index("late(@1, 3)") < text.index("asked(@1, 3)")
    assert "late(@1, 3)  6.000 s  the deadline of job was missed" in text


def test_a_violation_that_has_not_come_is_told(run):
    text = run.why_not("late(@1, 7)")
    assert "it is the violation of job: no such job has missed its deadline" in text

"""Explanations of small programs against the expected text, a file for each: program, run, questions, answers.

`explained/*.txt` holds a program, a line ``==== rmr eval ARGUMENTS``, then ``==== rmr why QUESTION`` with its answer.
"""

import re
from pathlib import Path

import pytest
from observed_runs import written

FILES = sorted((Path(__file__).parent / "explained").glob("*.txt"))


def sections(path):
    """Return the program, the arguments of `rmr eval`, and the questions with their answers."""
    program, *rest = re.split(r"^==== rmr ", path.read_text("utf-8"), flags=re.MULTILINE)
    heads = [section.split("\n", 1) for section in rest]
    assert heads[0][0].startswith("eval "), path
    return program, heads[0][0].removeprefix("eval "), [(head.removeprefix("why "), text) for head, text in heads[1:]]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_explanation_of_a_program_is_the_expected_text(path, tmp_path, monkeypatch):
    program, arguments, questions = sections(path)
    observed = written(program, arguments, tmp_path, monkeypatch)
    assert questions
    for asked, expected in questions:
        absent = asked.startswith("--not ")
        answer = observed.why_not(asked.removeprefix("--not ")) if absent else observed.text(asked)
        assert answer == expected, asked


def test_there_are_explanations_of_a_dozen_typical_mistakes():
    assert len([path for path in FILES if "==== rmr why --not " in path.read_text("utf-8")]) >= 12

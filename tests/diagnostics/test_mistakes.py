"""Mistakes that people make by habit: one mistake gets one diagnostic, with the form that is right as its hint.

Each file in mistakes/ holds cases, parted by a line of `=`: a source, a line of dashes, the output. Run with
RMR_REWRITE=1 to write the outputs anew, and review them as a diff.
"""

import os
from pathlib import Path

import pytest

from rmr.lang.compiler import compile_source
from rmr.lang.diagnostics.render import render_text

HERE = Path(__file__).parent / "mistakes"
RULER, PARTED = "----\n", "====\n"
CASES_MIN = 75
UNHINTED_MAX = 8
"""Of the cases below, those whose message says it all."""


def cases():
    """Return (file, number of the case, its source, its expected output) of all cases."""
    found = []
    for path in sorted(HERE.glob("*.txt")):
        for number, text in enumerate(path.read_text("utf-8").split(PARTED)):
            source, _, expected = text.partition(RULER)
            found.append(pytest.param(path, number, source, expected, id=f"{path.stem} {number}"))
    return found


def compiled(path, source):
    return compile_source(source, f"{path.stem}.rmr")


@pytest.mark.parametrize(("path", "number", "source", "expected"), cases())
def test_output_is_the_golden_one(path, number, source, expected):
    found = compiled(path, source)
    output = render_text(found.diagnostics, found.sources, color=False)
    if os.environ.get("RMR_REWRITE"):
        page = path.read_text("utf-8").split(PARTED)
        page[number] = source + RULER + output
        path.write_text(PARTED.join(page), "utf-8")
    else:
        assert output == expected


@pytest.mark.parametrize(("path", "number", "source", "expected"), cases())
def test_one_mistake_gives_one_diagnostic_no_cascade(path, number, source, expected):
    assert len(compiled(path, source).diagnostics) == 1


def test_there_are_many_cases_and_nearly_all_have_a_hint():
    every = [compiled(each.values[0], each.values[2]).diagnostics[0] for each in cases()]
    assert len(every) >= CASES_MIN
    assert sum(each.hint is None for each in every) <= UNHINTED_MAX


def test_no_case_is_there_twice():
    sources = [each.values[2] for each in cases()]
    assert len(set(sources)) == len(sources)

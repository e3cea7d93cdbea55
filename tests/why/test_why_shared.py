"""`rmr why` names the neighbour that has told a shared fact, when, and why it held there."""

import pytest
from observed_runs import written

pytestmark = pytest.mark.medium

GRADIENT = """\
type shared hops(robot, int).
hops(@1, 0).
hops(@2, 9).
hops(@3, 9).
hops(R, H), H > 0, N = min(X + 1, neighbor(R, B), hops(B, X)), N < H -o hops(R, N).
"""
JOIN = """\
type shared hops(robot, int).
type near(robot, robot).
hops(@1, 0).
neighbor(R, B), hops(B, 0) -o near(R, B).
"""


def test_the_tree_leads_over_the_neighbours_that_have_told(tmp_path, monkeypatch):
    observed = written(GRADIENT, "--robots 3 --topology line", tmp_path, monkeypatch)
    text = observed.text("hops(@3, 2)", depth=9)
    assert "__" not in text
    for words in (
        "hops(@2, 1), as @3 has heard",
        "told by @2, a neighbour",
        "hops(@1, 0), as @2 has heard",
        "told by @1, a neighbour",
        "given by the program",
    ):
        assert words in text, text


def test_a_join_names_who_told_it_and_when(tmp_path, monkeypatch):
    observed = written(JOIN, "--robots 2 --latency 7ms", tmp_path, monkeypatch)
    text = observed.text("near(@2, @1)", depth=9)
    line = next(line for line in text.splitlines() if "as @2 has heard" in line)
    assert "0.007 s" in line
    assert "told by @1, a neighbour" in line
    assert "hops(@1, 0)" in text.replace("hops(@1, 0), as", "")


def test_why_not_says_what_the_neighbour_has_told(tmp_path, monkeypatch):
    observed = written(JOIN.replace("hops(@1, 0)", "hops(@1, 3)"), "--robots 2", tmp_path, monkeypatch)
    text = observed.why_not("near(@2, @1)")
    assert "hops(@1, 0), as @2 has heard" in text
    assert "it states hops(@1, 3), as @2 has heard" in text
    assert "__" not in text

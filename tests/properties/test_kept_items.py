"""A text that is parsed again after each change, with what was kept of it, is parsed like a new one."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.read.kept_items import KeptItems
from rmr.lang.read.parser import parse
from rmr.lang.read.source_text import SourceText

ROOT = Path(__file__).parents[2]
PROGRAMS = sorted(
    (ROOT / "tests" / "programs").glob("figure*.rmr"), key=lambda path: len(path.read_text("utf-8"))
) + sorted((ROOT / "docs" / "examples").glob("*.rmr"))
PIECES = [
    *"pR.,()!?$-o=/*\"'@0 \n\t",
    "-o",
    "//",
    "/*",
    "*/",
    ". ",
    ".\n",
    "p(R).",
    "const q = 3.",
    "#",
    "--",
    "->",
    "==",
    "\U0001f600",
]
PIECES += ["type p(robot).\n", "p(R) -o q(R).\n", "p(R) q(R).\n", "assert(", "Assert(p", "", "x" * 40]


def both(text, kept):
    """Return what parsing gives with and without what was kept: items, and what is reported."""
    results = []
    for keeps in (kept, None):
        found = Diagnostics()
        module = parse(SourceText("a.rmr", text), found, keeps)
        results.append((module, found.in_order(), found.count))
    return results


@settings(max_examples=400)
@given(st.data())
def test_a_changed_text_is_parsed_as_a_new_one(data):
    text = data.draw(st.sampled_from(PROGRAMS)).read_text("utf-8")
    kept = KeptItems()
    both(text, kept)
    for _ in range(data.draw(st.integers(1, 6))):
        start = data.draw(st.integers(0, len(text)))
        end = min(len(text), start + data.draw(st.sampled_from([0, 0, 0, 1, 2, 5, 40, 400])))
        text = text[:start] + "".join(data.draw(st.lists(st.sampled_from(PIECES), max_size=4))) + text[end:]
        again, new = both(text, kept)
        assert again == new


def test_what_stands_before_a_change_is_the_same_node_and_what_stands_behind_it_is_moved():
    text = "type p(robot, int).\np(R, 1).\np(R, N), N > 1 -o p(R, N - 1), {B | q(R, B) | p(B, 0)}.\n"
    text += "?p(R, 0).\nw: assert(p(R, 1), p(R, 0), 5, stop(R)).\n"
    kept = KeptItems()
    [(before, _, _), _] = both(text, kept)
    changed = text.replace("p(R, 1).", "p(R, 100).")
    [(after, _, _), (new, _, _)] = both(changed, kept)
    assert after == new
    assert [one is other for one, other in zip(before.items, after.items, strict=True)] == [True, *[False] * 4]
    assert [each.span.start for each in after.items[2:]] == [each.span.start + 2 for each in before.items[2:]]
    [(same, _, _), _] = both(changed, kept)
    assert all(one is other for one, other in zip(after.items, same.items, strict=True))


@pytest.mark.parametrize("text", ["p(R) q(R) -o 1.\n", "p(R, 99999999999999999999).\n", "type type(robot).\n"])
def test_an_item_with_a_mistake_is_parsed_again_and_told_again(text):
    kept = KeptItems()
    first, _ = both(f"p(R).\n{text}p(R).\n", kept)
    second, _ = both(f"// new\np(R).\n{text}p(R).\n", kept)
    assert len(first[1]) == len(second[1]) > 0


VERSIONS = {
    "a number goes on behind a full stop": ("const q = 3.\n", "const q = 3.5.\n"),
    "a comment of another language makes others of its kind": (
        "const n = 3.\np(R, M), X = M % n -o q(R, X).\n",
        "# a note\nconst n = 3.\np(R, M), X = M % n -o q(R, X).\n",
    ),
    "a capital is told once, at its first place": ("Place(R).\nPlace(R).\n", "\nPlace(R).\n"),
    "a comment begins": ("p(R).\nq(R).\n", "p(R). /*\nq(R).\n"),
    "a comment ends": ("p(R). /*\nq(R).\n", "p(R). /**/\nq(R).\n"),
}


@pytest.mark.parametrize("name", VERSIONS)
def test_what_changes_the_meaning_of_what_is_kept_is_noticed(name):
    kept = KeptItems()
    for text in VERSIONS[name]:
        again, new = both(text, kept)
        assert again == new


def test_a_text_is_told_from_the_last_one_at_its_first_and_last_difference():
    kept = KeptItems()
    for text in (
        "p(R).",
        "",
        "p(R).p(R).",
        "p(R).p(R).p(R).",
        "p(R).",
        "pp(R).",
        "p(R).p(",
        "/*p(R).p(R).",
        "/**/p(R).p(R).",
    ):
        again, new = both(text, kept)
        assert again == new, text

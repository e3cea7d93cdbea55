"""One mistake of spelling costs one message, and hides nothing else that is wrong with the program."""

from pathlib import Path

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rmr.lang.compiler import compile_source
from rmr.lang.read.lexer import tokens

pytestmark = pytest.mark.medium

ROOT = Path(__file__).parents[2]

WHOLE = """type sensor at(robot, area).
type !edge(robot, robot).
type !due(robot, float).
type queue(robot, list int).
type pair(robot, int, int).
type action moveto(R: robot, A: area) -o at(R, A) else stuck(R, A).
type action give(R: robot, B: robot, N: int) -o pair(B, N, N), lost(R).
const total = 4.
const home = @1.
queue(R, [1, 2, 3]).
pair(@1, 1, 2).
!edge(@1, @2).
?pair(R, X, 2).
queue(R, [H | T]), pair(R, X, Y), X > H, not lost(R) -o queue(R, T), pair(R, H, Y).
$queue(R, L), stuck(R, A), member(1, L) = true -o moveto(R, A) then give(R, home, len(L)) then lost(R).
pair(R, X, Y), Y = min(X, total), dist(1, 2, X, Y) < 2.5 -o {B, C | edge(R, B), edge(R, C) | give(R, B, X), told(C)}.
told(R) -o [sum X => V | pair(R, X, _), X > 2 | queue(R, [V])], [count => N | edge(R, B) | pair(R, N, 0)].
lost(R) -o 1.
crossing: assert(stuck(R, A), at(R, A), 1.5min, moveto(R, A)).
watch(pair(R, X, Y), queue(R, L), X * 2, give(R, home, Y)).
"""
"""Every construct, each item on a line of its own."""


def errors(text):
    return [(each.code, each.span.start) for each in compile_source(text).errors]


def line_of(text, offset):
    return text.count("\n", 0, offset)


def words(kind):
    return [token for token in tokens(WHOLE) if token.kind == kind]


DECLARED = [line for line in WHOLE.splitlines() if line.startswith("type")]
STATED = [number for number, line in enumerate(WHOLE.splitlines()) if line.startswith(("pair", "queue", "!edge"))]


def with_another_argument(text, number):
    """Return `text` with one argument too many in the first fact of a line."""
    lines = text.splitlines(keepends=True)
    lines[number] = lines[number].replace(")", ", 1)", 1)
    return "".join(lines)


def test_unmodified_program_of_the_repair_tests_is_sound():
    assert errors(WHOLE) == []
    assert len(STATED) >= 4
    for number in STATED:
        assert [code for code, _ in errors(with_another_argument(WHOLE, number))] == ["E011"]


@given(st.sampled_from(words("COMMA") + words("DOT")), st.sampled_from(STATED))
@settings(max_examples=200, deadline=None)
def test_a_missing_comma_or_full_stop_hides_no_mistake_in_another_item(missing, number):
    spoilt = line_of(WHOLE, missing.start)
    assume(spoilt != number)
    text = with_another_argument(WHOLE[: missing.start] + " " + WHOLE[missing.end :], number)
    found = errors(text)
    assert sorted(code for code, _ in found) == ["E001", "E011"]
    assert [line_of(text, start) for code, start in found if code == "E001"] == [spoilt]
    assert [line_of(text, start) for code, start in found if code == "E011"] == [number]


@given(st.sampled_from(words("COMMA") + words("DOT") + words("RPAR") + words("RSQB") + words("RBRACE")))
@settings(max_examples=100, deadline=None)
def test_a_missing_sign_is_one_mistake(missing):
    found = errors(WHOLE[: missing.start] + " " + WHOLE[missing.end :])
    assert [code for code, _ in found if code == "E001"] == ["E001"]
    assert line_of(WHOLE, found[0][1]) in (line_of(WHOLE, missing.start), line_of(WHOLE, missing.start) + 1)


@given(st.sampled_from(words("COMMA") + words("RPAR")), st.sampled_from([",", ")", "]", "|", ";", ":", "§"]))
@settings(max_examples=200, deadline=None)
def test_a_surplus_sign_spoils_no_other_item(place, sign):
    text = WHOLE[: place.end] + sign + WHOLE[place.end :]
    found = errors(text)
    assert found
    assert {line_of(text, start) for _, start in found} == {line_of(WHOLE, place.start)}


@given(st.lists(st.sampled_from(words("COMMA")), min_size=2, max_size=3, unique=True))
@settings(max_examples=100, deadline=None)
def test_two_missing_commas_are_both_found(missing):
    missing.sort(key=lambda token: token.start)
    text = WHOLE
    for token in reversed(missing):
        text = text[: token.start] + " " + text[token.end :]
    assert [code for code, _ in errors(text)].count("E001") == len(missing)

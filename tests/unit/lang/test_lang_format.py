"""The canonical layout, case by case: what stands on one line, where the rest breaks, where comments stay."""

import subprocess
from pathlib import Path

import pytest

from rmr.bytecode.codec import encode
from rmr.lang.compiler import compile_source
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.format import format_source, one_line
from rmr.lang.format.printer import COLUMNS_MAX
from rmr.lang.read.source_text import SourceText

ROOT = Path(__file__).parents[3]
AS_WRITTEN = {
    "tests/programs/figure3.rmr": "as the paper prints it",
    "tests/programs/figure4.rmr": "as the paper prints it",
    "tests/programs/rules/conditions.rmr": "spells `!=` as `<>`",
}
"""The programs that keep their layout, each with the reason."""
LONG = "a_name_so_long_that_two_of_them_do_not_fit_on_a_line"


def repository():
    listed = subprocess.run(["git", "ls-files", "-z", "*.rmr"], cwd=ROOT, capture_output=True, text=True, check=False)
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


def formatted(text):
    found = Diagnostics()
    result = format_source(SourceText("x", text), found)
    assert found.in_order() == []
    assert formatted_again(result) == result
    return result


def formatted_again(text):
    return format_source(SourceText("x", text), Diagnostics())


def dedented(text):
    """Return a text that is indented by four columns and begins with a line end."""
    return "".join(line[4:] + "\n" for line in text.rstrip().split("\n")[1:])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("type!edge( robot,list  list area ) .", "type !edge(robot, list list area)."),
        ("type p( ).", "type p()."),
        ("type action a (R:robot)⊸p(R) , q(R)else r(R).", "type action a(R: robot) -o p(R), q(R) else r(R)."),
        ("? location( R,middle ).", "?location(R, middle)."),
        ("! edge(@1,@2).", "!edge(@1, @2)."),
        ('include"a.rmr".', 'include "a.rmr".'),
        ("const total=( 4+2 )*-3.", "const total = (4 + 2) * -3."),
        ('p(R,1.50,500ms,1e3,007,"a  b").', 'p(R, 1.50, 500ms, 1e3, 007, "a  b").'),
        ("p(R),X<>3&&not(Y=2)||Z-1> - 1-o 1.", "p(R), X != 3 && not (Y = 2) || Z - 1 > -1 -o 1."),
        ("p(R),not!q(R,_),$r(R),(f(X)),((f(X)))-o 1.", "p(R), not !q(R, _), $r(R), (f(X)), ((f(X))) -o 1."),
        ("p(R,[ ],[1,2|T],- -X).", "p(R, [], [1, 2 | T], --X)."),
        ("p(R)-o a(R)then?b(R)then c(R),d(R).", "p(R) -o a(R) then ?b(R) then c(R), d(R)."),
        ("p(A)-o{B,C|q(A,B)|r(B),s(C)}.", "p(A) -o {B, C | q(A, B) | r(B), s(C)}."),
        ("p(A)-o[count=>N|q(A)|r(A,N)].", "p(A) -o [count => N | q(A) | r(A, N)]."),
        ("p(A)-o[sum(X)=>N|q(A,X)|r(A,N)].", "p(A) -o [sum (X) => N | q(A, X) | r(A, N)]."),
        ("p(A)-o[min-X=>N|q(A,X)|r(A,N)].", "p(A) -o [min -X => N | q(A, X) | r(A, N)]."),
        ("c:assert( p(R),!q(R),2*D,v(R) ).", "c: assert(p(R), !q(R), 2 * D, v(R))."),
    ],
)  # fmt: skip
def test_between_words_stands_one_space_or_none(text, expected):
    assert formatted(text) == expected + "\n"


def test_a_minus_before_the_name_o_never_becomes_an_arrow():
    assert formatted("const o=1. p(R,X - o,- o,-(o)).") == "const o = 1.\np(R, X - o, - o, -(o)).\n"


def test_each_item_has_a_line_and_at_most_one_blank_line_above_it():
    assert formatted("\n\n p(R).q(R).\n\n\n\nr(R).\ns(R). \n\n") == "p(R).\nq(R).\n\nr(R).\ns(R).\n"
    assert formatted(" \n\n") == formatted("") == ""


def test_line_ends_of_another_system_and_a_byte_order_mark_are_dropped():
    assert formatted("\ufeffp(R).\r\n\r\n// a\r\nq(R). /* b\r\nc */\r\n") == "p(R).\n\n// a\nq(R). /* b\nc */\n"


@pytest.mark.parametrize("length", [COLUMNS_MAX, COLUMNS_MAX + 1])
def test_a_rule_breaks_if_and_only_if_it_does_not_fit(length):
    name = "n" * (length - len("p(R, X), q(X) -o (R)."))
    fits = length == COLUMNS_MAX
    assert formatted(f"p(R, X),\nq(X)\n-o {name}(R).") == (
        f"p(R, X), q(X) -o {name}(R).\n" if fits else f"p(R, X), q(X)\n    -o {name}(R).\n"
    )


@pytest.mark.parametrize(
    "text",
    [
        f"""
    p(R), {LONG}(R), X = 1
        -o {LONG}(R), q(R).
    """,
        f"""
    p(R),
    {LONG}(R),
    {LONG}(R, X)
        -o q(R).
    """,
        f"""
    p(R)
        -o q(R, X),
           {{A, B
               | {LONG}(R), p(A)
               | {LONG}(A), p(B)}},
           [sum X => V
               | {LONG}(R),
                 {LONG}(R, X)
               | {LONG}(R, V)],
           {LONG}(R)
               then {LONG}(R)
               then p(R).
    """,
        f"""
    type action moveto(R: robot, A: area)
        -o {LONG}(R),
           {LONG}(A)
        else {LONG}(R),
             {LONG}(A).
    """,
        f"""
    crossing: assert(
        {LONG}(R, D),
        at(R, exit),
        D,
        broadcast({LONG}, R)
    ).
    """,
        f"""
    const places = [
        {LONG},
        [1, 2],
        {LONG}
    ].
    """,
        f"""
    p(R),
    X = {LONG} + 1
        && not Y = {LONG} * 2
        -o q(R).
    """,
        f"""
    p(
        R,
        {LONG} * 2
            + {LONG},
        [
            {LONG}
            | {LONG}
        ]
    ).
    """,
    ],
)
def test_overlong_lines_break_like_this(text):
    expected = dedented(text)
    assert max(len(line) for line in expected.splitlines()) <= COLUMNS_MAX
    assert formatted(" ".join(expected.split())) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("p(R).//a  \n//b\n\n//c\nq(R). /* d */", "p(R).  //a\n//b\n\n//c\nq(R). /* d */\n"),
        ("p(R). /* of q */ q(R).", "p(R).\n/* of q */ q(R).\n"),
        ("p(R). /* of p */\nq(R).", "p(R). /* of p */\nq(R).\n"),
        ("p(R /*a*/ ,/* b */X).", "p(R /*a*/, /* b */ X).\n"),
        ("p(R), // a\nq(R) -o 1.", "p(R),  // a\nq(R)\n    -o 1.\n"),
        ("p(R) // a\n, q(R) -o 1.", "p(R),  // a\nq(R)\n    -o 1.\n"),
        ("p(R)\n// a\n, // b\n q(R) -o 1.", "p(R),\n// a\n// b\nq(R)\n    -o 1.\n"),
        ("p(R) // a\n-o q(R).", "p(R)  // a\n    -o q(R).\n"),
        ("p(R) -o q(R), // a\n r(R) // b\n.", "p(R)\n    -o q(R),  // a\n       r(R).  // b\n"),
        ("p(R) -o q(R)\n// , r(R)\n.", "p(R)\n    -o q(R)\n       // , r(R)\n.\n"),
        ("p(R, // a\n X // b\n).", "p(\n    R,  // a\n    X  // b\n).\n"),
        ("p(R).\n/* a\n   b */\nq(R).", "p(R).\n/* a\n   b */\nq(R).\n"),
        ("// a", "// a\n"),
        ("\n\n/* a */\n\n// b\n\n\n", "/* a */\n\n// b\n"),
        ("p(R).\n\n\n// a\n\n// b\n", "p(R).\n\n// a\n\n// b\n"),
    ],
)
def test_a_comment_stays_between_its_words(text, expected):
    assert formatted(text) == expected


def test_a_part_of_a_program_has_one_line_however_long():
    assert one_line(f"p(R) // a\n , {LONG}( R,\n{LONG})-o /* b */ 1.") == f"p(R), {LONG}(R, {LONG}) -o 1."
    assert one_line("[sum X=>V|\n q(R,X) | r(R,V)]") == "[sum X => V | q(R, X) | r(R, V)]"
    assert one_line(" p (R) ") == "p(R)"
    assert one_line("// a") == ""


def test_a_text_with_syntax_errors_has_no_layout():
    found = Diagnostics()
    assert format_source(SourceText("x", "p(R). q(R"), found) is None
    assert [each.code for each in found.in_order()] == ["E001"]


def test_brackets_nested_as_deep_as_allowed_are_formatted():
    deep = 45  # each is two levels of the tree, of which a hundred are allowed
    text = formatted("p(R, " + "[" * (deep - 1) + LONG + "]" * (deep - 1) + ").")
    assert text.count("\n") == 2 * deep + 2


@pytest.mark.parametrize("name", [name for name in repository() if name not in AS_WRITTEN])
def test_every_program_of_the_repository_is_formatted(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    assert formatted(text) == text


@pytest.mark.parametrize("name", repository())
def test_a_layout_compiles_to_the_same_byte_code(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    programs = [compile_source(each, str(ROOT / name)).program for each in (text, formatted(text))]
    one, other = (each and encode(each, debug=False) for each in programs)
    assert one == other

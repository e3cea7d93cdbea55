"""Whatever the text, the compiler answers with a program or with diagnostics, and what it compiles is valid."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.verify import verify
from rmr.lang.compiler import compile_source
from rmr.lang.diagnostics.render import render_text

pytestmark = pytest.mark.medium

WORDS = (
    "type action sensor list const include order assert watch not then else true false random textual robot int float "
    'area p q r at turn moveto location R X Y _ @1 @2 0 1 2.5 500ms "s" ( ) [ ] { } | || && = != <> < <= > >= + - * / '
    "% ! ? $ : , , , . . . -o -o => if min abs now id dist len nth member sort rest count sum max collect ; == -> and "
    "is then if mod :- <- \\+ # -- 'quoted' “smart” → ≥ null true_ @N @all seconds .5 5. 0x1f += ** left-arm def import"
)

FACTS = st.sampled_from(
    [
        "p(R, X)",
        "q(R, X, Y)",
        "!e(R, B)",
        "$p(R, Y)",
        "not q(R, X, _)",
        "at(R, A)",
        "p(R, X + 1)",
        "l(R, L)",
        "l(R, [H | T])",
        "l(R, [X, Y])",
        "not l(R, [X, 1])",
    ]
)
CONDITIONS = st.sampled_from(
    [
        "X < 3",
        "Y = X + 1",
        "X = s",
        "A = exit",
        "B != R",
        "not (X = Y)",
        "2.5 = Z",
        "Z > Y / 2",
        "X = _",
        "L = [Y | T]",
        "[X, [Y, Z] | _] = L",
        "L = [H]",
        "nth(L, X) = Y",
        "(member(X, L))",
    ]
)
HEADS = st.sampled_from(
    [
        *("1", "p(R, X)", "q(B, 1, X)", "?p(R, s)", "moveto(R, A)", "p(R, if(X > 1, Y, 0.5))", "l(R, [X, Y | L])"),
        *("{C | e(R, C) | p(C, X)}", "p(R, X) then moveto(R, A) then ?p(B, X)", "l(R, sort(L) + [H])"),
        *("[count => N | e(R, C) | p(R, N)]", "[sum N * X => V | q(R, N, _) | p(R, V)]"),
        *("[min N => V | q(R, N, M) | q(R, V, M)]", "[collect N => V | l(R, [N | _]) | l(R, V)]"),
    ]
)
ASSERTED = st.sampled_from(["p(R, X)", "q(R, X, B)", "e(@1, B)", "p(B, X)", "e(B, R)", "e(_, _)", "l(R, [1, 2])"])


def holds(text):
    compilation = compile_source(text, "x")
    render_text(compilation.diagnostics, {"x": compilation.source}, color=True)
    assert (compilation.program is None) == bool(compilation.errors)
    if compilation.program is not None:
        assert verify(compilation.program) == []
        assert decode(encode(compilation.program, debug=True)) == compilation.program


@given(st.text(max_size=80))
@settings(max_examples=100, deadline=None)
def test_compiler_handles_arbitrary_text(text):
    holds(text)


@given(st.lists(st.sampled_from(WORDS.split()), max_size=40))
@settings(max_examples=300, deadline=None)
def test_compiler_handles_arbitrary_token_sequences(words):
    holds(" ".join(words) + ".")


@given(st.lists(FACTS | CONDITIONS, min_size=1, max_size=6), st.lists(HEADS, min_size=1, max_size=3))
@settings(max_examples=300, deadline=None)
def test_any_rule_compiles_into_valid_byte_code_or_is_refused(body, head):
    bound = "p(R, X), $q(R, Y, X), l(R, L), !e(R, B), at(R, A)"
    holds(f"type action moveto(robot, area). {bound}, {', '.join(body)} -o {', '.join(head)}.")


@given(ASSERTED, ASSERTED, st.sampled_from(["10", "X", "len(L)", "X / 2", "now()"]), st.sampled_from("RB_"))
@settings(max_examples=150, deadline=None)
def test_any_assertion_compiles_into_valid_byte_code_or_is_refused(start, finish, deadline, robot):
    holds(
        f"x: assert({start}, {finish}, {deadline}, stop({robot})). p(R, X) -o q(R, X, @1), {{B | e(R, B) | e(B, R)}}."
    )

"""Whatever a program says, inference answers, and in whatever order it says so, the types are the same."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.bytecode.codec import decode, encode
from rmr.bytecode.verify import verify
from rmr.lang.compiler import compile_source

pytestmark = pytest.mark.medium

NAMES = st.sampled_from("pqrs")
VARIABLES = st.sampled_from(["X", "Y", "Z"])
CONSTANTS = st.sampled_from(["1", "2.5", "a", "@2", '"w"', "true", "[]", "[1]", "[2.5, 3]", "[a]", "[[1]]"])
TERMS = st.recursive(
    VARIABLES | VARIABLES | CONSTANTS,
    lambda term: st.one_of(
        st.builds("[{}]".format, term),
        st.builds("[{} | {}]".format, term, term),
        st.builds("{} + {}".format, term, term),
        st.builds("nth({}, 0)".format, term),
        st.builds("if(true, {}, {})".format, term, term),
    ),
    max_leaves=3,
)
TYPES = st.sampled_from(["int", "float", "area", "robot", "list int", "list float", "list area", "list list int"])
"""Every predicate has two arguments behind its owner."""


def fact(argument):
    return st.builds("{}(R, {}, {})".format, NAMES, argument, argument)


BODIES = st.lists(fact(VARIABLES | CONSTANTS | TERMS) | st.builds("{} = {}".format, VARIABLES, TERMS), max_size=2)
HEADS = st.one_of(
    fact(TERMS),
    st.builds("{{B | {} | {}}}".format, fact(VARIABLES | st.just("B")), fact(VARIABLES | st.just("B"))),
    st.builds(
        "[{} {} => V | {} | {}]".format,
        st.sampled_from(["sum", "min", "collect"]),
        VARIABLES,
        fact(VARIABLES),
        fact(VARIABLES | st.just("V")),
    ),
)
ITEMS = st.one_of(
    fact(CONSTANTS).map("{}.".format),
    fact(CONSTANTS | VARIABLES).map("?{}.".format),
    st.builds("{}, {} -o {}.".format, fact(VARIABLES), fact(VARIABLES), HEADS),
    st.builds(
        lambda first, body, head: f"{', '.join([first, *body])} -o {head}.", fact(VARIABLES | TERMS), BODIES, HEADS
    ),
    st.builds("assert({}, {}, 1, {}).".format, fact(VARIABLES), fact(VARIABLES), st.just("stop(R)")),
)
DECLARED = st.dictionaries(NAMES, st.tuples(TYPES, TYPES), max_size=2)


def declarations(declared):
    return [f"type {name}(robot, {one}, {other})." for name, (one, other) in declared.items()]


@given(DECLARED, st.lists(ITEMS, min_size=1, max_size=6))
@settings(max_examples=300, deadline=None)
def test_compiler_handles_any_program_and_writes_valid_byte_code(declared, items):
    compilation = compile_source("\n".join([*declarations(declared), *items]))
    assert (compilation.program is None) == bool(compilation.errors)
    if compilation.program is not None:
        assert verify(compilation.program) == []
        assert decode(encode(compilation.program, debug=True)) == compilation.program


@given(DECLARED, st.lists(ITEMS, min_size=1, max_size=6), st.randoms(use_true_random=False))
@settings(max_examples=300, deadline=None)
def test_types_do_not_depend_on_the_order_of_what_a_program_says(declared, items, random):
    shuffled = random.sample(items, len(items))
    one, other = (compile_source("\n".join([*declarations(declared), *each])) for each in (items, shuffled))
    assert bool(one.errors) == bool(other.errors), (one.errors, other.errors)
    if one.program is not None and other.program is not None:
        here, there = (
            {each.name: each.types for each in program.predicates} for program in (one.program, other.program)
        )
        assert here == there

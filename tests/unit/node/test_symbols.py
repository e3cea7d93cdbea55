"""All robots of a program number its symbols alike, wherever in the program they stand."""

from dataclasses import replace

import pytest

from rmr.bytecode.codec import decode, encode
from rmr.lang.compiler import compile_source
from rmr.node.logic.symbol_numbers import SYMBOLS_MAX, Symbols, symbols_of

EVERYWHERE = """
type action go(R: robot, A: area) -o at(R, effected) else at(R, failing).
type action warn(robot, area).
type place(robot, area).
type tour(robot, list list area).
place(R, stated).
tour(R, [[inlist], [nested]]).
?place(R, wanted).
place(@3, elsewhere).
place(R, matched), $place(R, X), X = compared, Y = if(X = tested, chosen, other)
    -o place(R, Y), ?place(R, sought), go(R, driven), tour(R, [[built, X]]).
place(R, X) -o {L | road(R, L), not place(R, absent) | place(R, comprehended)}.
road(R, X) -o [collect [termed, L] => V | road(R, L), place(R, inner) | tour(R, [[collected]])].
road(R, X) -o go(R, first) then place(R, second).
place(R, X) -o road(R, X).
crossing: watch(place(R, begun), place(R, ended), 10, warn(R, violated)).
"""
VALUES = """
stated inlist nested wanted elsewhere matched compared tested chosen other sought driven built absent
comprehended termed inner collected first second begun ended violated effected failing
"""


def test_the_table_holds_every_symbol_of_the_program_once():
    compilation = compile_source(EVERYWHERE)
    assert compilation.program is not None, compilation.diagnostics
    names = Symbols(compilation.program).names
    assert set(VALUES.split()) <= set(names)
    assert {"crossing", "go", "place"} <= set(names), (
        "names of assertions and predicates are symbols to who senses them"
    )
    assert len(names) == len(set(names))


def test_robots_that_decode_the_same_byte_code_agree_on_the_table():
    compilation = compile_source(EVERYWHERE)
    assert compilation.program is not None
    octets = encode(compilation.program, debug=False)
    one, other = (symbols_of(replace(decode(octets))) for _ in range(2))  # as in two processes: not the same object
    assert one is not other
    assert one.names == other.names
    assert other.numbers == {name: number for number, name in enumerate(one.names)}


def test_robots_of_one_process_share_the_table():
    compilation = compile_source("done(R, yes).")
    assert symbols_of(compilation.program) is symbols_of(compilation.program)


@pytest.mark.medium
def test_symbols_beyond_what_a_number_can_tell_travel_as_text():
    items = ", ".join(f"s{number}" for number in range(1000))
    facts = "\n".join(
        f"p(R, {batch}, [{items.replace('s', f's{batch}x')}])." for batch in range(SYMBOLS_MAX // 1000 + 2)
    )
    compilation = compile_source(facts)
    assert compilation.program is not None, compilation.diagnostics
    assert len(Symbols(compilation.program).names) == SYMBOLS_MAX

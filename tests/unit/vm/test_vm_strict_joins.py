"""Joins of values of different kinds: byte-code may compare a robot with an int, and 1 is not @1 in any order."""

from dataclasses import replace

import pytest

from rmr.base.streams import Choices
from rmr.base.values import Robot
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import SELF_SLOT, Bind, Instruction
from rmr.lang.compiler import compile_source
from rmr.vm.engines import Engine, new_machine

TEXT = """
type !mark(robot, int).
type !who(robot, int).
type hit(robot, int).
mark(R, N), Y = N + 1, who(R, Y) -o hit(R, N).
"""


def program():
    """Return the program with ``Y = R`` before its second atom, which no compiler would write."""
    found = compile_source(TEXT).program
    [rule] = found.rules
    mark, who, _ = rule.body
    [slot] = who.args
    own = Bind(slot.index, (Instruction(Op.LOAD, SELF_SLOT),))
    return replace(found, rules=(replace(rule, body=(mark, own, who)),))


def machine(found, engine):
    made = new_machine(found, 1, Choices("strict joins"), engine=engine)
    made.start(0)
    made.run(0)
    return made


def hits(made):
    return made.held(made.program.index("hit"))


@pytest.mark.parametrize("engine", list(Engine))
@pytest.mark.parametrize("order", [("mark", "who"), ("who", "mark")], ids=lambda order: order[0])
def test_an_int_does_not_match_a_robot_of_the_same_number(engine, order):
    made = machine(program(), engine)
    for at, name in enumerate(order):
        made.insert(at, made.program.index(name), (1,))
        made.run(at)
    made.insert(5, made.program.index("who"), (2,))
    made.run(5)
    assert hits(made) == []


@pytest.mark.parametrize("engine", list(Engine))
def test_a_computed_int_matches_that_int(engine):
    made = machine(compile_source(TEXT).program, engine)
    made.insert(0, made.program.index("mark"), (1,))
    made.insert(0, made.program.index("who"), (2,))
    made.run(0)
    assert hits(made) == [(1,)]
    assert Robot(1) == 1, "the two are equal in Python: that is what is guarded against"

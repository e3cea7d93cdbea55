"""The symbols of a program, numbered: a symbol that the program knows travels as its number.

All robots of one program must agree on the table, so it is a walk over the whole program in one order: wherever a
value stands in it, then the names of its predicates and assertions, which are symbols to those who sense them.
"""

from collections.abc import Iterable, Iterator
from typing import Final

from rmr.base.identity import ByIdentity
from rmr.base.values import Symbol, Value
from rmr.bytecode.heads import bodies, codes
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    Assertion,
    Atom,
    Code,
    Conjunct,
    Constant,
    Fold,
    Pattern,
    Predicate,
    Program,
    Rule,
    Slot,
)

SYMBOLS_MAX: Final = 1 << 16
"""A number travels in two octets; symbols beyond travel as text."""


class Symbols:
    """The table of one program."""

    def __init__(self, program: Program) -> None:
        names = dict.fromkeys(str(symbol) for value in _program(program) for symbol in _symbols(value))
        self.names = tuple(names)[:SYMBOLS_MAX]
        self.numbers = {name: number for number, name in enumerate(self.names)}


symbols_of = ByIdentity(Symbols)
"""Returns the table of a program, worked out once for all robots of a process."""


def _symbols(value: Value) -> Iterator[Symbol]:
    """Yield the symbols in a value, those in lists too, whatever the depth."""
    rest = [value]
    while rest:
        each = rest.pop()
        if isinstance(each, Symbol):
            yield each
        elif isinstance(each, tuple):
            rest.extend(reversed(each))


def _program(program: Program) -> Iterator[Value]:
    for fact in program.facts:
        yield from (arg for arg in fact.args if not isinstance(arg, Slot))
    for goal in program.goals:
        yield from _patterns(goal.args)
    for rule in program.rules:
        yield from _rule(rule)
    for assertion in program.assertions:
        yield from _assertion(assertion)
    for predicate in program.predicates:
        yield from _predicate(predicate)


def _rule(rule: Rule) -> Iterator[Value]:
    for body in bodies(rule):
        for conjunct in body:
            yield from _conjunct(conjunct)
    for code in codes(rule.head):
        yield from _code(code)


def _conjunct(conjunct: Conjunct) -> Iterator[Value]:
    if isinstance(conjunct, Atom):
        yield from _patterns(conjunct.args)
    elif isinstance(conjunct, Fold):  # its body comes by itself
        yield from _code(conjunct.term or ())
    else:
        yield from _code(conjunct.code)


def _assertion(assertion: Assertion) -> Iterator[Value]:
    yield Symbol(assertion.name)
    for args in (assertion.start.args, assertion.finish.args, *(serving.args for serving in assertion.serving)):
        yield from _patterns(args)
    for code in (assertion.deadline, assertion.violation.owner, *assertion.violation.args):
        yield from _code(code)


def _predicate(predicate: Predicate) -> Iterator[Value]:
    yield Symbol(predicate.name)
    for effect in (*predicate.effects, *predicate.else_effects):
        for code in (effect.owner, *effect.args):
            yield from _code(code)


def _patterns(args: Iterable[Pattern]) -> Iterator[Value]:
    yield from (arg.value for arg in args if isinstance(arg, Constant))


def _code(code: Code) -> Iterator[Value]:
    yield from (each.operand for each in code if each.op is Op.CONST and each.operand is not None)

"""Resource limits of a program: every accepted program can be run by a robot.

Each limit is far above handwritten programs. Exceeding one is a mistake of the program's author (or of a forger), not
of the compiler. `exceeded` reports it separately, so that the compiler can turn it into a diagnostic.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from rmr.bytecode import heads
from rmr.bytecode.program import Bind, Code, Guard, Program

SLOTS_MAX = 1024
"""Variables of a rule or assertion: a robot holds this many values for each candidate match."""

STACK_MAX = 256
"""Values on the stack of an expression."""

INSTRUCTIONS_MAX = 4096
"""Instructions of an expression: its evaluation takes a robot a millisecond or two."""

CONJUNCTS_MAX = 256
"""Conjuncts of one body: the depth of the search for a match."""

HEAD_MAX = 1024
"""Facts, goals and actions of one rule's head: a firing is atomic and must be short."""

ARGUMENTS_MAX = 255
"""Arguments of a predicate."""

FUNCTIONS_MAX = 1024
"""Functions of a program: each takes a robot's compiler a millisecond."""

EFFECTS_MAX = 255
"""Effects of an action on completion, and on failure."""

SERVING_MAX = 1024
"""Actions that serve one assertion: each derived action is compared with all of them."""


class Excess(NamedTuple):
    """An exceeded limit."""

    table: str
    """The table: ``functions``, ``predicates``, ``rules`` or ``assertions``."""
    entry: int
    """Index of the entry in its table."""
    text: str
    """Message about the excess, such as ``2000 variables, at most 1024 are possible``."""


def exceeded(program: Program) -> Iterator[Excess]:
    """Yield the limits that `program` exceeds, in the order of its tables."""
    tables = (
        ("functions", _functions),
        ("predicates", _predicates),
        ("rules", _rules),
        ("assertions", _assertions),
    )
    for table, counted in tables:
        for index, counts in enumerate(counted(program)):
            for count, most, what in counts:
                if count > most:
                    yield Excess(table, index, f"{count} {what}, at most {most} are possible")


Counts = list[tuple[int, int, str]]
"""Quantities of one entry: number, limit, and what is counted, in the plural."""


def _functions(program: Program) -> Iterator[Counts]:
    for index, function in enumerate(program.functions):
        yield [
            (index + 1, FUNCTIONS_MAX, "functions in one program"),
            (function.arity, ARGUMENTS_MAX, "arguments"),
            _longest([function.code]),
        ]


def _predicates(program: Program) -> Iterator[Counts]:
    for predicate in program.predicates:
        both = (predicate.effects, predicate.else_effects)
        yield [
            (len(predicate.types), ARGUMENTS_MAX, "arguments"),
            *((len(effects), EFFECTS_MAX, "effects") for effects in both),
            _longest(code for effects in both for effect in effects for code in (effect.owner, *effect.args)),
        ]


def _rules(program: Program) -> Iterator[Counts]:
    for rule in program.rules:
        bodies = list(heads.bodies(rule))
        yield [
            (rule.slots, SLOTS_MAX, "variables"),
            (len(rule.head) + sum(1 for _ in heads.items(rule.head)), HEAD_MAX, "items in the head"),
            (max(map(len, bodies)), CONJUNCTS_MAX, "conjuncts in a body"),
            _longest(heads.codes(rule.head)),
            _longest(each.code for body in bodies for each in body if isinstance(each, Guard | Bind)),
            _longest(fold.term for fold in heads.folds(rule.body) if fold.term is not None),
        ]


def _assertions(program: Program) -> Iterator[Counts]:
    for assertion in program.assertions:
        violation = assertion.violation
        yield [
            (assertion.slots, SLOTS_MAX, "variables"),
            (len(assertion.serving), SERVING_MAX, "actions that serve it"),
            _longest([assertion.deadline, violation.owner, *violation.args]),
        ]


def _longest(codes: Iterable[Code]) -> tuple[int, int, str]:
    return (max(map(len, codes), default=0), INSTRUCTIONS_MAX, "instructions in an expression")

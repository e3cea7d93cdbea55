"""How much of everything a program may hold, so that a robot can run whatever it accepts.

Each bound is far above what people write. What a program has too much of is a mistake of its author (or of
whoever forged it), not of the compiler, so it can be asked for by itself: `exceeded`.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from rmr.bytecode import heads
from rmr.bytecode.program import Bind, Code, Guard, Program

SLOTS_MAX = 1024
"""Variables of a rule or assertion: a robot holds that many values for each match it looks at."""

STACK_MAX = 256
"""Values on the stack of an expression."""

INSTRUCTIONS_MAX = 4096
"""Instructions of an expression: working it out takes a robot a millisecond or two."""

CONJUNCTS_MAX = 256
"""Conjuncts of one body: the search for a match goes a step deeper with each."""

HEAD_MAX = 1024
"""Facts, goals and actions of one rule's head: a firing is atomic and must not take long."""

ARGUMENTS_MAX = 255
"""Arguments of a predicate."""

EFFECTS_MAX = 255
"""Effects of an action on completion, and on failure."""

SERVING_MAX = 1024
"""Actions that serve one assertion: each action that is derived is held against them."""


class Excess(NamedTuple):
    """What a program has too much of."""

    table: str
    """``predicates``, ``rules`` or ``assertions``."""
    entry: int
    """Its index."""
    text: str
    """Such as ``2000 variables, at most 1024 are possible``."""


def exceeded(program: Program) -> Iterator[Excess]:
    """Yield what `program` has too much of, in the order of its tables."""
    for table, counted in (("predicates", _predicates), ("rules", _rules), ("assertions", _assertions)):
        for index, counts in enumerate(counted(program)):
            for count, most, what in counts:
                if count > most:
                    yield Excess(table, index, f"{count} {what}, at most {most} are possible")


Counts = list[tuple[int, int, str]]
"""How many there are, how many there may be, of what."""


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

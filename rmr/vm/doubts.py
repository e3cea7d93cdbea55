"""Whether what is derived has the types that its predicate declares.

Mostly the text tells: a constant was verified, a variable has the type of the argument that binds it. What the
text leaves in doubt is looked at when it is derived, so that a robot never stores a fact of another type.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from rmr.base.values import Value
from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.conform import checker, fits
from rmr.bytecode.program import Derived, Effect, Predicate
from rmr.bytecode.scope import Scope, literal


class Doubt(NamedTuple):
    """An argument whose value may be of another type than the declared one."""

    place: int
    fits: Callable[[Value], bool]
    text: str
    """What to say if it is."""


Doubts = tuple[Doubt, ...]


def doubts(item: Derived | Effect, predicates: Sequence[Predicate], scope: Scope | None = None) -> Doubts:
    """Return what the text of an item leaves in doubt; `scope` holds what is known of its slots."""
    known = scope or Scope()
    declared = predicates[item.predicate]
    return tuple(
        Doubt(place, checker(kind), f"argument {place + 2} of {declared.name} is no {kind.base.name.lower()}")
        for place, (code, kind) in enumerate(zip(item.args, declared.types, strict=True))
        if literal(code) is None and not fits(known.type_of(code), kind)
    )


def settle(doubts: Doubts, args: Sequence[Value]) -> None:
    """Return if the values have the types that were in doubt. Raises NoValue."""
    for place, conforms, text in doubts:
        if not conforms(args[place]):
            raise NoValue(text)

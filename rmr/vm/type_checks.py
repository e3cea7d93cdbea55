"""Run-time type checks: the arguments of a derived item whose declared type the compiler cannot prove.

Most types are known statically: a constant was verified, a variable has the type of the argument that binds it. The
other arguments are checked when the item is derived, so that a robot never stores a fact of another type.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from rmr.base.values import Value
from rmr.bytecode.arithmetic import NoValue
from rmr.bytecode.conform import checker, fits
from rmr.bytecode.program import Derived, Effect, Predicate
from rmr.bytecode.scope import Scope, literal


class TypeCheck(NamedTuple):
    """An argument whose value may be of another type than the declared one."""

    place: int
    fits: Callable[[Value], bool]
    text: str
    """The reason of the failure (`NoValue`)."""


TypeChecks = tuple[TypeCheck, ...]


def type_checks(item: Derived | Effect, predicates: Sequence[Predicate], scope: Scope | None = None) -> TypeChecks:
    """Return the checks that an item needs at run time; `scope` holds the types of its slots that are known."""
    known = scope or Scope()
    declared = predicates[item.predicate]
    return tuple(
        TypeCheck(place, checker(kind), f"argument {place + 2} of {declared.name} is no {kind.base.name.lower()}")
        for place, (code, kind) in enumerate(zip(item.args, declared.types, strict=True))
        if literal(code) is None and not fits(known.type_of(code), kind)
    )


def check_types(checks: TypeChecks, args: Sequence[Value]) -> None:
    """Check argument values. Raises NoValue for the first one of another type."""
    for place, conforms, text in checks:
        if not conforms(args[place]):
            raise NoValue(text)

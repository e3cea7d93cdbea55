"""Static size of a fact in a radio frame: a bound for whether it fits into one.

A constant counts with its encoded size, an unknown value with the least size of its type. An `if` counts with its
larger branch, a concatenation with both parts.
"""

from collections.abc import Callable

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Base, Type
from rmr.lang.read.syntax import Binary, Call, Expression, LetTerm, ListTerm, Literal, Unary, Variable

FACT_OCTETS_MAX = 106
"""Octets for a fact's values in a frame of 127: 11 are the radio's, 10 the fact's own header."""

DELIVERY_OCTETS_MAX = 6908
"""Octets for a fact's values in one delivery: 64 fragments of 108 octets, less the delivery's header of 4.

A secured radio leaves less, so that a fact that is just below this may still be refused by its sender.
"""

HEADER_OCTETS = 3
"""Octets before a text or the items of a list: a tag and the length."""

_LEAST = {Base.ROBOT: 3, Base.INT: 2, Base.FLOAT: 9, Base.STRING: 3, Base.SYMBOL: 3, Base.LIST: 3}
"""Least encoded size by type: a tag and the shortest value; a Boolean is the tag alone."""


def octets(argument: Expression, kind: Type, known: dict[str, Literal], branch: Callable[[int, int], int] = max) -> int:
    """Return the least encoded size of an argument of type `kind`; `known` are variables that equal a constant.

    `branch` chooses between the sizes of the two branches of an `if`.
    """
    if isinstance(argument, Variable) and argument.name in known:
        argument = known[argument.name]
    items = kind.element or Type(Base.OPEN)
    match argument:
        case Literal(value=value):
            return value_octets(value, kind)
        case Call(arguments=(_, then, otherwise)) if argument.name.text == "if":
            return branch(octets(then, kind, known, branch), octets(otherwise, kind, known, branch))
        case Binary(operator="+", left=left, right=right) if kind.base in {Base.STRING, Base.LIST}:
            return octets(left, kind, known, branch) + octets(right, kind, known, branch) - HEADER_OCTETS
        case ListTerm(items=parts, rest=rest):
            behind = HEADER_OCTETS if rest is None else octets(rest, kind, known, branch)
            return behind + sum(octets(part, items, known, branch) for part in parts)
        case Variable() | Call() | Unary() | Binary() | LetTerm():
            return _LEAST.get(kind.base, 1)


def value_octets(value: Value, kind: Type) -> int:
    """Return the encoded size of a value of type `kind`, to which an int is converted if it is a float."""
    match value:
        case tuple():
            items = kind.element or Type(Base.OPEN)
            return HEADER_OCTETS + sum(value_octets(item, items) for item in value)
        case bool():
            return 1
        case Robot() | Symbol():
            return 3
        case int() if kind.base is not Base.FLOAT:
            return 2 if -128 <= value < 128 else 9
        case str():
            return HEADER_OCTETS + len(value.encode())
        case int() | float():
            return 9

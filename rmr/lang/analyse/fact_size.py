"""How large a fact is on its way to another robot: whether it fits into one radio frame.

What is known before the program runs are the constants; each counts as what it takes in a frame. Of an `if` the
larger branch counts, of what is joined both parts, and of a value that is not known the least that its kind takes.
"""

from collections.abc import Callable

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.program import Base, Type
from rmr.lang.read.syntax import Binary, Call, Expression, ListTerm, Literal, Variable

FACT_OCTETS_MAX = 106
"""What a frame of 127 octets leaves for a fact's values: 11 go to the radio, 10 to the fact's own header."""

DELIVERY_OCTETS_MAX = 6908
"""Of a fact's values in one delivery: 64 fragments of 108 octets, less the delivery's header of 4.

A secured radio leaves less, so that a fact that is just below this may still be refused by its sender.
"""

HEADER_OCTETS = 3
"""Before a text or the items of a list: a tag and their number."""

_LEAST = {Base.ROBOT: 3, Base.INT: 2, Base.FLOAT: 9, Base.STRING: 3, Base.SYMBOL: 3, Base.LIST: 3}
"""By type, a tag and the shortest value; a Boolean is the tag alone."""


def octets(argument: Expression, kind: Type, known: dict[str, Literal], branch: Callable[[int, int], int] = max) -> int:
    """Return how many octets an argument of type `kind` takes at least; `known` variables have constants.

    Of the two values of an `if`, `branch` chooses the number that counts.
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
        case _:
            return _LEAST.get(kind.base, 1)


def value_octets(value: Value, kind: Type) -> int:
    """Return how many octets a value of type `kind` takes; an int given to a float takes a float's."""
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
        case _:
            return 9

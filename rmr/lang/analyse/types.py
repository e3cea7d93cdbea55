"""Types: the narrow lattice in which they are inferred, and the functions that programs may call.

Open, then int, then float; a symbol of no particular set, then of a set; lists as their items. Everything else
stands by itself.
"""

from collections.abc import Iterator
from functools import reduce

from rmr.base.record import record
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.functions import FUNCTIONS, Gives
from rmr.bytecode.program import Base, Type
from rmr.lang.analyse.type_spelling import type_text
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Binary, Condition, Conjunct, Expression, Literal, Variable

OPEN = Type(Base.OPEN)
ROBOT = Type(Base.ROBOT)
BOOL = Type(Base.BOOL)
INT = Type(Base.INT)
FLOAT = Type(Base.FLOAT)
SYMBOL = Type(Base.SYMBOL)
LIST = Type(Base.LIST)
"""Of whatever items."""

NUMBERS = {Base.INT, Base.FLOAT}
ORDERED = {Base.INT, Base.FLOAT, Base.STRING, Base.OPEN}
"""What `<` and its like compare; what nothing fixes may be of any type."""


class TypeCell:
    """The type of one argument, variable or expression."""

    __slots__ = ("depth", "fallbacks", "fixed", "items", "kind", "mixed", "origin", "targets")

    def __init__(
        self,
        kind: Type,
        origin: Span | None,
        *,
        fixed: bool = False,
        mixed: bool = False,
        items: "TypeCell | None" = None,
        depth: int = 0,
    ) -> None:
        self.kind = kind
        """Of a list without that of its items."""
        self.origin = origin
        """Where it got its type."""
        self.fixed = fixed
        self.mixed = mixed
        """A float that may be an int when the program runs."""
        self.items = items
        """Of a list: the type of its items."""
        self.depth = depth
        """In how many lists it stands."""
        self.targets: list[TypeCell] = []
        """Its type flows there."""
        self.fallbacks: list[TypeCell] = []
        """These take its type if nothing else gives them one."""

    @property
    def type(self) -> Type:
        """The whole type; of items that nothing fixes it is open."""
        if self.kind.base is not Base.LIST:
            return self.kind
        return Type(Base.LIST, element=OPEN if self.items is None else self.items.type)

    @property
    def innermost(self) -> "TypeCell":
        """Of a list: the items' cell, of lists in lists the innermost; else the cell itself."""
        cell = self
        while cell.kind.base is Base.LIST and cell.items is not None:
            cell = cell.items
        return cell


def cell_of(kind: Type, origin: Span | None, *, fixed: bool = False, mixed: bool = False) -> TypeCell:
    """Return a cell of type `kind`, with cells for the items of lists."""
    whole = cell = TypeCell(kind, origin, fixed=fixed)
    while kind.base is Base.LIST:
        cell.kind = LIST
        kind = kind.element or OPEN
        cell.items = TypeCell(kind, origin, fixed=fixed and kind.base is not Base.OPEN, depth=cell.depth + 1)
        cell = cell.items
    cell.mixed = mixed
    return whole


CALLABLE = {function.name: function for function in FUNCTIONS if not function.internal}
"""The functions that programs may call, by name; beside them there is `if`."""

TIMED = frozenset(function.name for function in CALLABLE.values() if function.timed)
"""Those whose value depends on the time."""

RESULTS = {Gives.NUMBER: OPEN, Gives.INT: INT, Gives.FLOAT: FLOAT, Gives.BOOL: BOOL}
"""The types of results that no list determines; OPEN is the joint type of the arguments."""

WINNING = ("min", "max")
"""Aggregates that one match wins: they derive nothing of no match, and their head sees the match's variables."""

SORTED = {Base.INT, Base.FLOAT, Base.STRING, Base.SYMBOL, Base.ROBOT, Base.OPEN}
"""What the items of a list are that `sort` takes."""


def join(one: Type, other: Type) -> Type:
    """Return the narrowest type that holds both; of a contradiction, the first."""
    if one.base is Base.OPEN:
        return other
    if one.base is Base.LIST and other.base is Base.LIST:
        return one if other.element is None else Type(Base.LIST, element=join(one.element or OPEN, other.element))
    if one.base in NUMBERS and other.base in NUMBERS:
        return FLOAT if Base.FLOAT in {one.base, other.base} else INT
    if one.base is Base.SYMBOL and other.base is Base.SYMBOL and not one.name:
        return other
    return one


def compatible(one: Type, other: Type) -> bool:
    """Whether a value may be of both types, ints counting as floats."""
    if Base.OPEN in {one.base, other.base} or (one.base in NUMBERS and other.base in NUMBERS):
        return True
    if one.base is Base.SYMBOL and other.base is Base.SYMBOL:
        return not one.name or not other.name or one.name == other.name
    if one.base is Base.LIST and other.base is Base.LIST:
        return compatible(one.element or OPEN, other.element or OPEN)
    return one.base is other.base


def fits(value: Type, target: Type) -> bool:
    """Whether a value of the one type can be given to the other; a float is no int."""
    if value.base is Base.LIST and target.base is Base.LIST:
        return fits(value.element or OPEN, target.element or OPEN)
    return compatible(value, target) and not (value.base is Base.FLOAT and target.base is Base.INT)


def literal_type(literal: Literal) -> Type:
    """Return the type of a constant; of a list's items the narrowest that holds all."""
    return value_type(literal.value)


def converted(value: Value, kind: Type) -> Value:
    """Return `value` as an argument of type `kind` holds it: an int given to a float becomes one, in a list too."""
    if kind.base is Base.FLOAT and type(value) is int:
        return float(value)
    if kind.element is not None and isinstance(value, tuple):
        return tuple(converted(each, kind.element) for each in value)
    return value


def value_type(value: Value) -> Type:
    """Return the type of a value."""
    match value:
        case tuple():
            return Type(Base.LIST, element=reduce(join, map(value_type, value), OPEN))
        case bool():
            return BOOL
        case Robot():
            return ROBOT
        case int():
            return INT
        case float():
            return FLOAT
        case Symbol():
            return Type(Base.SYMBOL)
        case _:
            return Type(Base.STRING)


def matched_variables(body: tuple[Conjunct, ...]) -> frozenset[str]:
    """Return the variables that facts of `body` bind."""
    return frozenset(
        argument.name
        for conjunct in body
        if not isinstance(conjunct, Condition) and not conjunct.absent
        for argument in conjunct.arguments
        if isinstance(argument, Variable) and not argument.anonymous
    )


def constants(body: tuple[Conjunct, ...]) -> dict[str, Literal]:
    """Return the variables that `body` equates with a constant, and the first such constant of each."""
    found: dict[str, Literal] = {}
    for conjunct in body:
        equation = equation_of(conjunct)
        if equation is not None:
            found.setdefault(*equation)
    return found


def equation_of(conjunct: Conjunct) -> tuple[str, Literal] | None:
    """Return variable and constant if `conjunct` equates the two."""
    match conjunct:
        case Condition(expression=Binary("=", Variable(name=name), Literal() as value)) if name != "_":
            return name, value
        case Condition(expression=Binary("=", Literal() as value, Variable(name=name))) if name != "_":
            return name, value
        case _:
            return None


def literal_cell(literal: Literal) -> TypeCell:
    """Return a constant's cell."""
    kind = literal_type(literal)
    mixed = isinstance(literal.value, tuple) and any(type(each) is int for each in leaves(literal.value))
    return cell_of(kind, literal.span, mixed=mixed and innermost(kind).base is Base.FLOAT)


def leaves(value: Value) -> Iterator[Value]:
    """Yield what a list holds, and lists in it; else the value itself."""
    if not isinstance(value, tuple):
        yield value
        return
    for item in value:
        yield from leaves(item)


def innermost(kind: Type) -> Type:
    """Return the type of a list's items, of lists in lists that of the innermost; else the type itself."""
    while kind.base is Base.LIST and kind.element is not None:
        kind = kind.element
    return kind


@record
class Types:
    """What inference found out."""

    positions: dict[str, list[TypeCell]]
    """By predicate: its arguments' cells, the owner's first."""
    expressions: dict[Span, TypeCell]

    def arguments(self, name: str) -> tuple[Type, ...]:
        """Return the types of a predicate's arguments after the owner."""
        return tuple(cell.type for cell in self.positions[name][1:])

    def certainly_float(self, expression: Expression) -> bool:
        """Whether the expression's value, of a list its items, needs no conversion to float."""
        cell = self.expressions.get(expression.span)
        return cell is not None and cell.innermost.kind.base is Base.FLOAT and not cell.innermost.mixed


def described(kind: Type) -> str:
    """Return `kind` as a sentence says it: an int, a symbol of `area`, a list of ints."""
    text = type_text(kind)
    if kind.base is Base.SYMBOL:
        return f"a symbol of `{text}`" if kind.name else "a symbol"
    if kind.base is Base.LIST:
        items = kind.element or OPEN
        return "a list" if items.base is Base.OPEN else f"a list of {several(items)}"
    return ("an " if text[0] in "aeiou" else "a ") + text


def several(kind: Type) -> str:
    """Return what several values of type `kind` are called: ints, symbols of `area`, lists of ints."""
    one = described(kind).removeprefix("an ").removeprefix("a ")
    first, *rest = one.split(" ", 1)
    return " ".join([f"{first}s", *rest])

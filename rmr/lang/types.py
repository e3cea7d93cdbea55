"""Types: the narrow lattice in which they are inferred, and what functions take and give.

Open, then int, then float; a symbol of no particular set, then of a set. Everything else stands by itself.
"""

from dataclasses import dataclass, field

from rmr.base.values import Robot, Symbol
from rmr.bytecode.program import Base, Type
from rmr.lang.provided import type_text
from rmr.lang.source import Span
from rmr.lang.syntax import Binary, Condition, Conjunct, Expression, Literal, Variable

OPEN = Type(Base.OPEN)
ROBOT = Type(Base.ROBOT)
BOOL = Type(Base.BOOL)
INT = Type(Base.INT)
FLOAT = Type(Base.FLOAT)

SYMBOL = Type(Base.SYMBOL)

NUMBERS = {Base.INT, Base.FLOAT}
ORDERED = {Base.INT, Base.FLOAT, Base.STRING, Base.OPEN}
"""What `<` and its like compare; what nothing fixes may be of any type."""


@dataclass(slots=True, eq=False)
class Cell:
    """The type of one argument, variable or expression."""

    type: Type
    origin: Span | None
    """Where it got its type."""
    fixed: bool = False
    mixed: bool = False
    """A float that may be an int when the program runs."""
    targets: "list[Cell]" = field(default_factory=list)
    """Its type flows there."""
    fallbacks: "list[Cell]" = field(default_factory=list)
    """These take its type if nothing else gives them one."""


Scope = dict[str, Cell]


@dataclass(frozen=True, slots=True)
class FunctionType:
    """A function's arguments and result; OPEN arguments are numbers whose joint type is an OPEN result."""

    arguments: tuple[Type, ...]
    result: Type


FUNCTIONS: dict[str, FunctionType] = {
    "abs": FunctionType((OPEN,), OPEN),
    "min": FunctionType((OPEN, OPEN), OPEN),
    "max": FunctionType((OPEN, OPEN), OPEN),
    "floor": FunctionType((FLOAT,), INT),
    "sqrt": FunctionType((FLOAT,), FLOAT),
    "sin": FunctionType((FLOAT,), FLOAT),
    "cos": FunctionType((FLOAT,), FLOAT),
    "atan2": FunctionType((FLOAT, FLOAT), FLOAT),
    "dist": FunctionType((FLOAT,) * 4, FLOAT),
    "id": FunctionType((ROBOT,), INT),
    "now": FunctionType((), FLOAT),
}
LATER = ("len", "nth", "member", "sort")
"""Functions of lists."""


def join(one: Type, other: Type) -> Type:
    """Return the narrowest type that holds both; of a contradiction, the first."""
    if one.base is Base.OPEN:
        return other
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
    return one.base is other.base


def fits(value: Type, target: Type) -> bool:
    """Whether a value of the one type can be given to the other; a float is no int."""
    return compatible(value, target) and not (value.base is Base.FLOAT and target.base is Base.INT)


def literal_type(literal: Literal) -> Type:
    """Return the type of a constant."""
    match literal.value:
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


@dataclass(slots=True)
class Types:
    """What inference found out."""

    positions: dict[str, list[Cell]] = field(default_factory=dict)
    """By predicate: its arguments' cells, the owner's first."""
    scopes: dict[Span, Scope] = field(default_factory=dict)
    """By rule, comprehension and assertion: its variables' cells."""
    expressions: dict[Span, Cell] = field(default_factory=dict)

    def arguments(self, name: str) -> tuple[Type, ...]:
        """Return the types of a predicate's arguments after the owner."""
        return tuple(cell.type for cell in self.positions[name][1:])

    def certainly_float(self, expression: Expression) -> bool:
        """Whether the expression's value needs no conversion to float."""
        cell = self.expressions.get(expression.span)
        return cell is not None and cell.type.base is Base.FLOAT and not cell.mixed


def described(kind: Type) -> str:
    """Return `kind` as a sentence says it: an int, a symbol of `area`."""
    text = type_text(kind)
    if kind.base is Base.SYMBOL:
        return f"a symbol of `{text}`" if kind.name else "a symbol"
    return ("an " if text[0] in "aeiou" else "a ") + text

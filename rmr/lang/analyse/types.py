"""The type lattice of inference, its cells, and the types of literals.

Order, narrow to wide: open, int, float; open, symbol of no set, symbol of one set; lists as their items. All other
types are comparable with open only. Types and declarations are also written here in the syntax of the language.
"""

from collections.abc import Iterator
from functools import reduce

from rmr.base.record import record
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.functions import FUNCTIONS, Gives
from rmr.bytecode.program import Base, Type
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import Binary, Condition, Conjunct, Expression, FactNode, FoldNode, Literal, Variable

SYNONYMS = {
    "integer": "int",
    "double": "float",
    "real": "float",
    "number": "float",
    "boolean": "bool",
    "str": "string",
    "text": "string",
}
"""Names of the built-in types in other languages."""


def type_text(kind: Type) -> str:
    """Return `kind` in the syntax of the language; a symbol of no set is ``symbol``."""
    if kind.base is Base.LIST:
        return "list" if kind.element is None else f"list {type_text(kind.element)}"
    if kind.base is Base.SYMBOL:
        return kind.name or "symbol"
    return kind.base.name.lower()


def declaration_text(name: str, types: tuple[Type, ...], word: str) -> str:
    """Return a declaration, such as ``type action moveto(robot, area).``"""

    arguments = ", ".join(["robot", *(type_text(kind) for kind in types)])
    return f"type {word}{name}({arguments})."


OPEN = Type(Base.OPEN)
ROBOT = Type(Base.ROBOT)
BOOL = Type(Base.BOOL)
INT = Type(Base.INT)
FLOAT = Type(Base.FLOAT)
SYMBOL = Type(Base.SYMBOL)
LIST = Type(Base.LIST)
"""A list type without an element type."""

NUMBERS = {Base.INT, Base.FLOAT}
"""Bases of the operands of arithmetic."""
ORDERED = {Base.INT, Base.FLOAT, Base.STRING, Base.OPEN}
"""Bases of the operands of `<`, `<=`, `>` and `>=`; OPEN may turn out to be any of them."""


class TypeCell:
    """The type variable of one argument, variable or expression: a node of the solver's graph."""

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
        """The present type; for a list without the element type, which is in `items`."""
        self.origin = origin
        """The place in the source that gave the type, for the notes of a diagnostic."""
        self.fixed = fixed
        """True for a declared type: flows never change it."""
        self.mixed = mixed
        """True for a float whose value may be an int at run time and needs a conversion."""
        self.items = items
        """The cell of a list's items; None until it is needed."""
        self.depth = depth
        """Number of lists around this cell."""
        self.targets: list[TypeCell] = []
        """Flow edges: cells that become at least as wide as this one."""
        self.fallbacks: list[TypeCell] = []
        """Default edges: cells that take this type if no flow gives them one."""

    @property
    def type(self) -> Type:
        """The complete type, element types included; unknown ones are open."""
        if self.kind.base is not Base.LIST:
            return self.kind
        return Type(Base.LIST, element=OPEN if self.items is None else self.items.type)

    @property
    def innermost(self) -> "TypeCell":
        """The cell of the items of nested lists at the innermost level; the cell itself if it is no list."""
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
"""The functions that programs may call, by name; `if` is separate, since it evaluates one branch only."""

TIMED = frozenset(function.name for function in CALLABLE.values() if function.timed)
"""The callable functions whose value depends on the time."""

DRAWN = frozenset(function.name for function in CALLABLE.values() if function.drawn)
"""The callable functions that give another number at each call."""

RESULTS = {Gives.NUMBER: OPEN, Gives.INT: INT, Gives.FLOAT: FLOAT, Gives.BOOL: BOOL, Gives.ROBOT: ROBOT}
"""Result types of functions without a list argument; OPEN stands for the join of the arguments' types."""

WINNING = ("min", "max")
"""Aggregates with a witness: without a match they derive nothing, and their head sees the winning match's variables."""

SORTED = {Base.INT, Base.FLOAT, Base.STRING, Base.SYMBOL, Base.ROBOT, Base.OPEN}
"""Element types of the lists that `sort` accepts."""


def join(one: Type, other: Type) -> Type:
    """Return the least upper bound of two types; the first of two that contradict each other."""
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
    """Whether two types have values in common, an int counting as a float too."""
    if Base.OPEN in {one.base, other.base} or (one.base in NUMBERS and other.base in NUMBERS):
        return True
    if one.base is Base.SYMBOL and other.base is Base.SYMBOL:
        return not one.name or not other.name or one.name == other.name
    if one.base is Base.LIST and other.base is Base.LIST:
        return compatible(one.element or OPEN, other.element or OPEN)
    return one.base is other.base


def fits(value: Type, target: Type) -> bool:
    """Whether a value of type `value` can be assigned to `target`: compatible, and no float in the place of an int."""
    if value.base is Base.LIST and target.base is Base.LIST:
        return fits(value.element or OPEN, target.element or OPEN)
    return compatible(value, target) and not (value.base is Base.FLOAT and target.base is Base.INT)


def literal_type(literal: Literal) -> Type:
    """Return the type of a literal; the element type of a list is the join of its items' types."""
    return value_type(literal.value)


def converted(value: Value, kind: Type) -> Value:
    """Return `value` converted to type `kind`: ints become floats where it says float, within lists too."""
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
        case str():
            return Type(Base.STRING)


def matched_variables(body: tuple[Conjunct, ...]) -> frozenset[str]:
    """Return the variables that positive facts of `body` bind."""
    return frozenset(
        argument.name
        for conjunct in body
        if isinstance(conjunct, FactNode) and not conjunct.absent
        for argument in conjunct.arguments
        if isinstance(argument, Variable) and not argument.anonymous
    )


def constants(body: tuple[Conjunct, ...]) -> dict[str, Literal]:
    """Return the variables that `body` equates with a constant, each with its first such constant."""
    found: dict[str, Literal] = {}
    computed = {each.result.name for each in body if isinstance(each, FoldNode) and each.result is not None}
    for conjunct in body:
        equation = equation_of(conjunct)
        # An aggregate computes its value: the equation with a constant is a test of it.
        if equation is not None and equation[0] not in computed:
            found.setdefault(*equation)
    return found


def equation_of(conjunct: Conjunct) -> tuple[str, Literal] | None:
    """Return the variable and the constant of an equation between the two, or None for any other conjunct."""
    match conjunct:
        case Condition(expression=Binary("=", Variable(name=name), Literal() as value)) if name != "_":
            return name, value
        case Condition(expression=Binary("=", Literal() as value, Variable(name=name))) if name != "_":
            return name, value
        case _:
            return None


def literal_cell(literal: Literal) -> TypeCell:
    """Return the cell of a literal."""
    kind = literal_type(literal)
    # `[1, 2.5]` is a list of floats whose first item is still an int: it needs a conversion.
    mixed = isinstance(literal.value, tuple) and any(type(each) is int for each in leaves(literal.value))
    return cell_of(kind, literal.span, mixed=mixed and innermost(kind).base is Base.FLOAT)


def leaves(value: Value) -> Iterator[Value]:
    """Yield the values in nested lists that are no lists; the value itself if it is no list."""
    if not isinstance(value, tuple):
        yield value
        return
    for item in value:
        yield from leaves(item)


def innermost(kind: Type) -> Type:
    """Return the element type of nested lists at the innermost level; the type itself if it is no list."""
    while kind.base is Base.LIST and kind.element is not None:
        kind = kind.element
    return kind


@record
class Types:
    """The result of inference."""

    positions: dict[str, list[TypeCell]]
    """Cells of the arguments by predicate, the owner's first."""
    expressions: dict[Span, TypeCell]
    """Cells of all expressions by place."""

    def arguments(self, name: str) -> tuple[Type, ...]:
        """Return the types of a predicate's arguments after the owner."""
        return tuple(cell.type for cell in self.positions[name][1:])

    def certainly_float(self, expression: Expression) -> bool:
        """Whether the value of the expression (of its items, for a list) is a float without conversion."""
        cell = self.expressions.get(expression.span)
        return cell is not None and cell.innermost.kind.base is Base.FLOAT and not cell.innermost.mixed


def described(kind: Type) -> str:
    """Return the English noun phrase for one value of type `kind`: an int, a symbol of `area`, a list of ints."""
    text = type_text(kind)
    if kind.base is Base.SYMBOL:
        return f"a symbol of `{text}`" if kind.name else "a symbol"
    if kind.base is Base.LIST:
        items = kind.element or OPEN
        return "a list" if items.base is Base.OPEN else f"a list of {several(items)}"
    return ("an " if text[0] in "aeiou" else "a ") + text


def several(kind: Type) -> str:
    """Return the English plural for values of type `kind`: ints, symbols of `area`, lists of ints."""
    one = described(kind).removeprefix("an ").removeprefix("a ")
    first, *rest = one.split(" ", 1)
    return " ".join([f"{first}s", *rest])

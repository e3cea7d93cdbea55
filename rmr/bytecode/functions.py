"""The functions of expressions (paper III.A): one table, `FUNCTIONS`, a row for each.

All that the rest of the tree knows of a function is in its row: the language its types and whether it may be called by
name, byte-code its number (the row's index) and arity, the interpreter its scalar function, the engine that writes
Python and the columns of numpy the names of their own forms of it. Either form may be absent: then they call the scalar
function, for each value. A new function is a row at the end of the table, and its line in `docs/language.md`, whose
text is the row's.

Functions of numbers have no value outside their domain; those of lists none for a value that is not a list, for a
position that the list does not have, and for items without an order.
"""

import math
from collections.abc import Callable
from enum import Enum, auto

from rmr.base.record import record
from rmr.base.time import Instant, in_seconds
from rmr.base.values import ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.arithmetic import NoValue, built, checked, numbers, same
from rmr.bytecode.conform import LENGTH_MAX

SORTABLE: tuple[set[type], ...] = ({int, float}, {str}, {Symbol}, {Robot})
"""Sets of item classes that have a common order for `sort`."""


FLOAT_MAX = 1.7976931348623157e308
"""The largest finite float."""


class Takes(Enum):
    """The demand on an argument."""

    NUMBER = auto()
    ROBOT = auto()
    LIST = auto()
    LIST_OR_STRING = auto()
    SORTABLE_LIST = auto()
    """A list whose items have a common order."""
    POSITION = auto()
    """An index into the list argument, from 0."""
    ITEM = auto()
    """A value of the type of the list argument's items."""
    INT = auto()
    """A whole number."""


class Gives(Enum):
    """The type of the value."""

    NUMBER = auto()
    """An int if all arguments are ints, else a float."""
    INT = auto()
    FLOAT = auto()
    BOOL = auto()
    ITEM = auto()
    """The type of the list argument's items."""
    LIST = auto()
    """The type of the list argument."""
    WIDER_LIST = auto()
    """A list of the items of the list argument and of the item argument."""
    ROBOT = auto()


LISTS = frozenset({Takes.LIST, Takes.LIST_OR_STRING, Takes.SORTABLE_LIST})
"""The demands that admit a list."""


@record
class Function:
    """A function of expressions."""

    name: str
    """The name in expressions."""
    parameters: str
    """The names of the arguments in documents."""
    takes: tuple[Takes, ...]
    gives: Gives
    scalar: Callable[..., Value]
    """The function of single values. Raises NoValue; a function of numbers alone also ValueError and OverflowError,
    and its caller checks the range of the result."""
    doc: str = ""
    """Description of the value, for the language reference."""
    example: str = ""
    """A call with the arguments in the right order, for the hint of an error that swaps them."""
    bounds: tuple[float, float] | None = None
    """Least and greatest value (for a list, length); None if the type alone bounds it."""
    fallible: bool = True
    """True if arguments of the right types may have no value, for which columns need a mask."""
    timed: bool = False
    """True if the value depends on the time; the only argument of `scalar` is then the instant in ns."""
    drawn: bool = False
    """True if each call gives another number of the robot's stream; `scalar` is then not called."""
    internal: bool = False
    """True for a function that only the compiler calls."""
    source: str | None = None
    """The name of its form in `rmr.vm.generate.function_source.FORMS`."""
    columns: str | None = None
    """The name of its form in `rmr.columns.numbers.FORMS`."""

    @property
    def signature(self) -> str:
        """The call with named arguments, for documents."""
        return f"{self.name}({self.parameters})"

    @property
    def arity(self) -> int:
        """The number of its arguments."""
        return len(self.takes)

    @property
    def numeric(self) -> bool:
        """Whether all its arguments are numbers."""
        return not self.timed and not self.drawn and all(each is Takes.NUMBER for each in self.takes)

    @property
    def list_at(self) -> int | None:
        """The index of the argument that is a list; None if there is none."""
        return next((index for index, each in enumerate(self.takes) if each in LISTS), None)


# ---- the scalar functions


def _extreme(choose: Callable[[float, float], float], a: float, b: float) -> float:
    """Return the smaller or larger of two numbers; a float if either is one."""
    chosen = choose(a, b)
    return chosen if type(a) is type(b) else float(chosen)


def _smaller(a: float, b: float) -> float:
    return _extreme(min, a, b)


def _larger(a: float, b: float) -> float:
    return _extreme(max, a, b)


def _distance(x1: float, y1: float, x2: float, y2: float) -> float:
    return math.hypot(x2 - x1, y2 - y1)


def _items(name: str, value: Value) -> tuple[Value, ...]:
    """Return `value` if it is a list."""
    if type(value) is not tuple:
        raise NoValue(f"{name} of something that is no list")
    return value


def _place(name: str, value: Value, size: int) -> int:
    """Return `value` if it is a whole number from 0 up to `size`."""
    if type(value) is not int:
        raise NoValue(f"{name} at a place that is no whole number")
    if not 0 <= value <= size:
        raise NoValue(f"{name} at a place that the list does not have")
    return value


def _len(value: Value) -> Value:
    """Return how many items a list, or characters a string, has."""
    return len(value) if type(value) is str else len(_items("len", value))


def _nth(value: Value, place: Value) -> Value:
    """Return the item at `place`, counted from 0."""
    items = _items("nth", value)
    return items[_place("nth", place, len(items) - 1)]


def _member(item: Value, value: Value) -> Value:
    return any(same(item, each) for each in _items("member", value))


def _sort(value: Value) -> Value:
    """Return the items in ascending order; of equal ones (1 and 1.0) the first stays first."""
    items = _items("sort", value)
    kinds = {type(item) for item in items}
    if not any(kinds <= sortable for sortable in SORTABLE):
        raise NoValue("sort of items without an order")
    return tuple(sorted(items))


def _rest(value: Value, count: Value) -> Value:
    """Return a list without its first `count` items."""
    items = _items("rest", value)
    return items[_place("rest", count, len(items)) :]


def _id(value: Value) -> Value:
    if type(value) is not Robot:
        raise NoValue("id of something that is no robot")
    return int(value)


def _robot(value: Value) -> Value:
    """Return the robot of a number."""
    if type(value) is not int:
        raise NoValue("robot of something that is no whole number")
    if not 0 <= value <= ROBOT_ID_MAX:
        raise NoValue("robot of a number that no robot has")
    return Robot(value)


def _remove(value: Value, item: Value) -> Value:
    return tuple([each for each in _items("remove", value) if not same(item, each)])


def _reverse(value: Value) -> Value:
    return _items("reverse", value)[::-1]


def _dedupe(value: Value) -> Value:
    """Return the items, each once, at its first place; the work is quadratic only among items that hash alike."""
    kept: dict[Value, list[Value]] = {}
    found: list[Value] = []
    for item in _items("dedupe", value):
        # Python's 1, 1.0, True and @1 share a key; `same` tells them apart.
        alike = kept.setdefault(item, [])
        if not any(same(item, each) for each in alike):
            alike.append(item)
            found.append(item)
    return tuple(found)


def _slice(value: Value, first: Value, behind: Value) -> Value:
    """Return the items from place `first` up to before place `behind`."""
    items = _items("slice", value)
    begin = _place("slice", first, len(items))
    end = _place("slice", behind, len(items))
    if begin > end:
        raise NoValue("slice that ends before it begins")
    return items[begin:end]


def _update(value: Value, place: Value, item: Value) -> Value:
    """Return the list with another item at `place`."""
    items = _items("update", value)
    at = _place("update", place, len(items) - 1)
    return built((*items[:at], item, *items[at + 1 :]))


def _index(value: Value, item: Value) -> Value:
    """Return the place of the first of the items that are equal to `item`."""
    for place, each in enumerate(_items("index", value)):
        if same(item, each):
            return place
    raise NoValue("index of an item that the list does not have")


def _nothing_drawn() -> Value:
    raise NoValue("random where nothing is drawn")


# ---- the table

_JOINT_NUMBER = "of ints an int, else a float"
_FLOATS = "floats, angles in radians"
_ONE = (Takes.NUMBER,)
_TWO = (Takes.NUMBER,) * 2

FUNCTIONS: tuple[Function, ...] = (
    Function("abs", "X", _ONE, Gives.NUMBER, abs, _JOINT_NUMBER, source="absolute", columns="absolute"),
    Function(
        "min", "X, Y", _TWO, Gives.NUMBER, _smaller, _JOINT_NUMBER, fallible=False, source="smaller", columns="smaller"
    ),
    Function(
        "max", "X, Y", _TWO, Gives.NUMBER, _larger, _JOINT_NUMBER, fallible=False, source="larger", columns="larger"
    ),
    Function("floor", "X", _ONE, Gives.INT, math.floor, "an int", source="rounded_down", columns="rounded_down"),
    Function("sqrt", "X", _ONE, Gives.FLOAT, math.sqrt, _FLOATS, bounds=(0, FLOAT_MAX), source="root", columns="root"),
    Function("sin", "X", _ONE, Gives.FLOAT, math.sin, _FLOATS, bounds=(-1, 1), source="total"),
    Function("cos", "X", _ONE, Gives.FLOAT, math.cos, _FLOATS, bounds=(-1, 1), source="total"),
    Function("atan2", "Y, X", _TWO, Gives.FLOAT, math.atan2, _FLOATS, bounds=(-4, 4), source="total"),
    Function(
        "dist",
        "X1, Y1, X2, Y2",
        (Takes.NUMBER,) * 4,
        Gives.FLOAT,
        _distance,
        "the distance of two points",
        bounds=(0, FLOAT_MAX),
        source="distance",
    ),
    Function(
        "id",
        "R",
        (Takes.ROBOT,),
        Gives.INT,
        _id,
        "a robot's number",
        bounds=(0, ROBOT_ID_MAX),
        fallible=False,
        source="robot_number",
        columns="robot_number",
    ),
    Function(
        "now",
        "",
        (),
        Gives.FLOAT,
        in_seconds,
        "lab time in seconds; in heads, effects and violations only, since time alone satisfies no rule",
        timed=True,
    ),
    Function(
        "len",
        "L",
        (Takes.LIST_OR_STRING,),
        Gives.INT,
        _len,
        "the number of a [list's](#lists) items, or of a string's characters",
        bounds=(0, LENGTH_MAX),
        source="length",
    ),
    Function(
        "nth",
        "L, I",
        (Takes.LIST, Takes.POSITION),
        Gives.ITEM,
        _nth,
        "item I of a list, the first is 0",
        example="nth(L, 0)",
        source="item",
    ),
    Function(
        "member",
        "X, L",
        (Takes.ITEM, Takes.LIST),
        Gives.BOOL,
        _member,
        "whether X is among L's items",
        example="member(X, L)",
        source="membership",
    ),
    Function(
        "sort",
        "L",
        (Takes.SORTABLE_LIST,),
        Gives.LIST,
        _sort,
        "the items in ascending order: numbers, strings, symbols, or robots by number",
        source="sorted",
    ),
    Function("rest", "L, I", (Takes.LIST, Takes.POSITION), Gives.LIST, _rest, internal=True, source="rest"),
    Function("exp", "X", _ONE, Gives.FLOAT, math.exp, "e to the power of X, a float", bounds=(0, FLOAT_MAX)),
    Function("log", "X", _ONE, Gives.FLOAT, math.log, "the natural logarithm, a float"),
    Function(
        "hypot",
        "X, Y",
        _TWO,
        Gives.FLOAT,
        math.hypot,
        "the distance of the point X, Y from the origin",
        bounds=(0, FLOAT_MAX),
    ),
    Function("robot", "N", (Takes.INT,), Gives.ROBOT, _robot, "the robot with the number N: `robot(4)` is `@4`"),
    Function(
        "remove",
        "L, X",
        (Takes.LIST, Takes.ITEM),
        Gives.LIST,
        _remove,
        "the list L without the items equal to X",
        example="remove(L, X)",
    ),
    Function("reverse", "L", (Takes.LIST,), Gives.LIST, _reverse, "the items in the opposite order"),
    Function("dedupe", "L", (Takes.LIST,), Gives.LIST, _dedupe, "of equal items only the first"),
    Function(
        "slice",
        "L, I, J",
        (Takes.LIST, Takes.POSITION, Takes.POSITION),
        Gives.LIST,
        _slice,
        "the items from place I up to before place J",
        example="slice(L, 0, 2)",
    ),
    Function(
        "update",
        "L, I, X",
        (Takes.LIST, Takes.POSITION, Takes.ITEM),
        Gives.WIDER_LIST,
        _update,
        "the list L with X as item I",
        example="update(L, 0, X)",
    ),
    Function(
        "index",
        "L, X",
        (Takes.LIST, Takes.ITEM),
        Gives.INT,
        _index,
        "the place of the first item equal to X",
        example="index(L, X)",
        bounds=(0, LENGTH_MAX),
    ),
    Function(
        "random",
        "",
        (),
        Gives.FLOAT,
        _nothing_drawn,
        "a random number from 0 up to below 1, another one at each call; in heads of rules only",
        bounds=(0, 1),
        fallible=False,
        drawn=True,
    ),
)
"""The functions; the index of a row is the operand of CALL. `if` is none of them: it compiles to jumps."""

BY_NAME = {function.name: function for function in FUNCTIONS}
"""The rows by name."""

_NUMERIC = frozenset(function.name for function in FUNCTIONS if function.numeric)


def call(name: str, args: list[Value], now: Instant) -> Value:
    """Return the value of the function called `name` at `now`. Raises NoValue."""
    function = BY_NAME[name]
    if function.timed:
        return function.scalar(now)
    if name not in _NUMERIC:
        return function.scalar(*args)
    try:
        return checked(function.scalar(*numbers(name, *args)))  # type: ignore[arg-type]
    except (ValueError, OverflowError):
        raise NoValue(f"{name} outside its domain") from None

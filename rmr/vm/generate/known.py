"""Abstract values (static analysis by intervals): the type of a value, and bounds on it, known before run time.

The bounds of a number are those of its value, the bounds of a list or string those of its length. They decide which
checks generated source can leave out: a sum whose bounds stay within 64 bits cannot overflow. Every operation on
numbers rounds monotonically, so the bounds of a result are the results of the bounds, for floats as for ints.
"""

from math import ceil, floor, inf, nextafter

from rmr.base.record import record
from rmr.base.values import INT_MAX, INT_MIN, Value
from rmr.bytecode.conform import LENGTH_MAX, NUMBERS, fits
from rmr.bytecode.program import Base, Type
from rmr.bytecode.scope import UNKNOWN, type_of_value

Bound = int | float
Bounds = tuple[Bound, Bound]

FLOAT_MAX = 1.7976931348623157e308
"""The largest finite float."""

LIMITS: dict[Base, Bounds] = {
    Base.INT: (INT_MIN, INT_MAX),
    Base.FLOAT: (-FLOAT_MAX, FLOAT_MAX),
    Base.STRING: (0, LENGTH_MAX),
    Base.LIST: (0, LENGTH_MAX),
}
"""Bounds on every value of a type."""


@record
class Known:
    """An abstract value; a bound of None is that of the type (`LIMITS`)."""

    type: Type | None = None
    """None: nothing is known."""
    low: Bound | None = None
    high: Bound | None = None

    @property
    def base(self) -> Base:
        """The base of its type; OPEN if nothing is known."""
        return Base.OPEN if self.type is None else self.type.base

    @property
    def element(self) -> Type:
        """The type of a list's items; OPEN if nothing is known."""
        return self.type.element or UNKNOWN if self.type is not None else UNKNOWN

    @property
    def bounds(self) -> Bounds:
        """The interval in which it lies; defined only for a type in `LIMITS`."""
        low, high = LIMITS[self.base]
        return (low if self.low is None else self.low, high if self.high is None else self.high)


NOTHING = Known()
BOOL = Known(Type(Base.BOOL))
INT = Type(Base.INT)
FLOAT = Type(Base.FLOAT)


def within(kind: Type, bounds: Bounds) -> Known:
    """Return the abstract value of `kind` within `bounds`, intersected with the limits of the type."""
    least, most = LIMITS[kind.base]
    low = max(bounds[0], least)
    high = min(bounds[1], most)
    # An empty interval stands for code that is never reached: the type alone is a safe answer.
    if low > high or (low, high) == (least, most):
        return Known(kind)
    return Known(kind, float(low), float(high)) if kind.base is Base.FLOAT else Known(kind, low, high)


def of_value(value: Value) -> Known:
    """Return what is known of a constant."""
    if type(value) is tuple:
        kinds = [of_value(item).type for item in value]
        element = kinds[0] if kinds and all(kind == kinds[0] for kind in kinds) else None
        return Known(Type(Base.LIST, element=element), len(value), len(value))
    kind = type_of_value(value)
    if kind.base in NUMBERS:
        return Known(kind, value, value)  # type: ignore[arg-type]
    return Known(kind, len(value), len(value)) if type(value) is str else Known(kind)


def either(one: Known, other: Known) -> Known:
    """Return the join of two abstract values: it covers the values of both."""
    if one.type is None or other.type is None:
        return NOTHING
    kind = common(one.type, other.type)
    if kind is None or kind.base not in LIMITS:
        return Known(kind)
    lows, highs = zip(one.bounds, other.bounds, strict=True)
    return within(kind, (min(lows), max(highs)))


def common(one: Type, other: Type) -> Type | None:
    """Return the narrowest common supertype of two types; None if there is none."""
    if fits(one, other):
        return other
    if fits(other, one):
        return one
    return Type(Base.LIST) if one.base is other.base is Base.LIST else None


def different(one: Type, other: Type) -> bool:
    """Return whether no value of one type equals one of the other."""
    if Base.OPEN in (one.base, other.base) or (one.base in NUMBERS and other.base in NUMBERS):
        return False
    return one.base is not other.base


def at_most(known: Known, most: Bound, *, strictly: bool = False) -> Known:
    """Return what is known of a number or length that is not above `most`, or, `strictly`, below it."""
    if known.base is not Base.FLOAT:
        # The greatest integer below (or not above) a bound that may be a float.
        bound: Bound = ceil(most) - 1 if strictly else floor(most)
    else:
        bound = float(most)  # of a large int rounded: stepped down only if it is not below `most` already
        if strictly and bound >= most:
            bound = nextafter(bound, -inf)
    low, high = known.bounds
    return known if low > bound else within(known.type or UNKNOWN, (low, min(high, bound)))


def at_least(known: Known, least: Bound, *, strictly: bool = False) -> Known:
    """Return what is known of a number or length that is not below `least`, or, `strictly`, above it."""
    if known.base is not Base.FLOAT:
        bound: Bound = floor(least) + 1 if strictly else ceil(least)
    else:
        bound = float(least)
        if strictly and bound <= least:
            bound = nextafter(bound, inf)
    low, high = known.bounds
    return known if high < bound else within(known.type or UNKNOWN, (max(low, bound), high))

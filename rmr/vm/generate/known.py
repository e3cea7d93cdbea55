"""Abstract values (static analysis by intervals): the type of a value, and bounds on it, known before run time.

The bounds of a number are those of its value, the bounds of a list or string those of its length. They decide which
checks generated source can leave out: a sum whose bounds stay within 64 bits cannot overflow. Every operation on
numbers rounds monotonically, so the bounds of a result are the results of the bounds, for floats, ints and both mixed.
A bound of a result may lie beyond the type's limits, or be infinite: then the result must be checked.

What is known of a slot narrows with the outcome of a condition (`assumed`; flow-sensitive analysis). A comparison
bounds the number in a slot, or the length of a list in one, by the bounds of the other side, so later guards need fewer
checks. A comparison of ``N + 1`` also implies that the sum has a value, which bounds ``N``.
"""

from collections.abc import Callable, Mapping
from math import ceil, floor, inf, nextafter

from rmr.base.record import record
from rmr.base.values import INT_MAX, INT_MIN, Value
from rmr.bytecode.conform import LENGTH_MAX, NUMBERS, fits
from rmr.bytecode.functions import FLOAT_MAX, FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Type
from rmr.bytecode.scope import UNKNOWN, type_of_value
from rmr.vm.generate.trees import Tree

Bound = int | float
Bounds = tuple[Bound, Bound]

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


def _sum(one: Bounds, other: Bounds) -> Bounds:
    return one[0] + other[0], one[1] + other[1]


def _difference(one: Bounds, other: Bounds) -> Bounds:
    return one[0] - other[1], one[1] - other[0]


def _product(one: Bounds, other: Bounds) -> Bounds:
    corners = [a * b for a in one for b in other]  # a product is monotonic in each factor: extremes are at corners
    return min(corners), max(corners)


RESULTS: dict[Op, Callable[[Bounds, Bounds], Bounds]] = {Op.ADD: _sum, Op.SUB: _difference, Op.MUL: _product}


def nonzero(bounds: Bounds) -> bool:
    """Return whether no number within `bounds` is zero."""
    return bounds[0] > 0 or bounds[1] < 0


def quotient(one: Bounds, other: Bounds, *, whole: bool) -> Bounds:
    """Return the bounds of a quotient by a divisor that is not zero at run time; `whole`: the divisor is an int."""
    if nonzero(other):
        corners = [float(a / b) for a in one for b in other]
        return min(corners), max(corners)
    # An int other than 0 has a magnitude of 1 or more. A float near 0 gives any quotient: 2 * FLOAT_MAX is infinite.
    most = float(max(abs(one[0]), abs(one[1]))) if whole else 2 * FLOAT_MAX
    return -most, most


def remainder(one: Bounds, other: Bounds, *, whole: bool) -> Bounds:
    """Return the bounds of a remainder, which has the divisor's sign; `whole`: of an int by an int."""
    low = min(0, other[0])
    high = max(0, other[1])
    if not whole:
        return low, high  # a float remainder may be rounded to the divisor itself
    if low == 0 and one[0] >= 0:
        return 0, min(one[1], high - 1)
    return min(0, low + 1), max(0, high - 1)


def negative(bounds: Bounds) -> Bounds:
    """Return the bounds of a negated value."""
    return -bounds[1], -bounds[0]


def magnitude(bounds: Bounds) -> Bounds:
    """Return the bounds of the absolute value."""
    low, high = bounds
    return max(0, low, -high), max(abs(low), abs(high))


LEN = next(i for i, function in enumerate(FUNCTIONS) if function.name == "len")

_OPPOSITE = {Op.LT: Op.GE, Op.LE: Op.GT, Op.GT: Op.LE, Op.GE: Op.LT, Op.EQ: Op.NE, Op.NE: Op.EQ}
"""The negation of each comparison of numbers; there are no NaNs, so it is total."""

_MIRRORED = {Op.LT: Op.GT, Op.LE: Op.GE, Op.GT: Op.LT, Op.GE: Op.LE, Op.EQ: Op.EQ, Op.NE: Op.NE}
"""The comparison with its sides exchanged."""


def assumed(node: Tree, outcome: bool, known: Mapping[int, Known]) -> dict[int, Known]:
    """Return the abstract values of the slots when `node` has the value `outcome`."""
    if node.op is Op.NOT:
        return assumed(node.parts[0], not outcome, known)
    # A true conjunction and a false disjunction determine both operands; the other outcomes leave open which one.
    if (node.op is Op.AND and outcome) or (node.op is Op.OR and not outcome):
        left, right = node.parts
        return assumed(right, outcome, assumed(left, outcome, known))
    if node.op not in _OPPOSITE:
        return dict(known)
    op = node.op if outcome else _OPPOSITE[node.op]
    left, right = node.parts
    narrower = dict(known)
    _narrow(narrower, left, op, _bounds(right, known))
    _narrow(narrower, right, _MIRRORED[op], _bounds(left, known))
    return narrower


@record
class _Measure:
    """A compared term that depends on one slot: its number, its number plus `offset`, or the length of its value."""

    slot: int
    bases: tuple[Base, ...] = NUMBERS
    """Types of the slot for which the term's bounds are those of the slot, but for the offset."""
    offset: int = 0


def _measure(node: Tree) -> _Measure | None:
    """Return one side of a comparison as a measure of a slot; None if it has another form."""
    if node.op is Op.LOAD:
        assert isinstance(node.operand, int)
        return _Measure(node.operand)
    if not node.parts or node.parts[0].op is not Op.LOAD:
        return None
    slot = node.parts[0].operand
    assert isinstance(slot, int)
    if node.op is Op.CALL and node.operand == LEN:
        return _Measure(slot, (Base.LIST, Base.STRING))
    if node.op in (Op.ADD, Op.SUB) and node.parts[1].op in (Op.CONST, Op.INT):
        offset = node.parts[1].operand
        return _Measure(slot, (Base.INT,), offset if node.op is Op.ADD else -offset) if type(offset) is int else None
    return None


def _bounds(node: Tree, known: Mapping[int, Known]) -> Bounds | None:
    """Return the bounds of one side of a comparison; None if it is not known to be a number."""
    if node.op in (Op.CONST, Op.INT):
        assert node.operand is not None
        constant = of_value(node.operand)
        return constant.bounds if constant.base in NUMBERS else None
    measure = _measure(node)
    if measure is None or known.get(measure.slot, NOTHING).base not in measure.bases:
        return None
    low, high = known[measure.slot].bounds
    return within(INT, (low + measure.offset, high + measure.offset)).bounds if measure.offset else (low, high)


def _narrow(known: dict[int, Known], node: Tree, op: Op, other: Bounds | None) -> None:
    """Narrow the slot in `node`, which compares by `op` with a value within `other`."""
    measure = _measure(node)
    if measure is None or known.get(measure.slot, NOTHING).base not in measure.bases:
        return
    slot = measure.slot
    offset = measure.offset
    if offset:  # the sum was evaluated, so it did not overflow
        known[slot] = at_least(at_most(known[slot], INT_MAX - offset), INT_MIN - offset)
    if other is None or (offset and not all(type(bound) is int for bound in other)):
        return  # shifting a float bound by the offset could round it inwards
    shifted = (other[0] - offset, other[1] - offset)
    for narrow in _NARROWERS.get(op, ()):
        known[slot] = narrow(known[slot], shifted)


_NARROWERS: dict[Op, tuple[Callable[[Known, Bounds], Known], ...]] = {
    Op.LT: (lambda known, other: at_most(known, other[1], strictly=True),),
    Op.LE: (lambda known, other: at_most(known, other[1]),),
    Op.GT: (lambda known, other: at_least(known, other[0], strictly=True),),
    Op.GE: (lambda known, other: at_least(known, other[0]),),
    Op.EQ: (lambda known, other: at_most(known, other[1]), lambda known, other: at_least(known, other[0])),
}

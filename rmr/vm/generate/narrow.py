"""Narrowing (flow-sensitive analysis): the bounds on slots that follow from the outcome of a condition.

A comparison bounds the number in a slot, or the length of a list in one, by the bounds of the other side, so later
guards need fewer checks. A comparison of ``N + 1`` also implies that the sum has a value, which bounds ``N``.
"""

from collections.abc import Callable, Mapping

from rmr.base.record import record
from rmr.base.values import INT_MAX, INT_MIN
from rmr.bytecode.conform import NUMBERS
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base
from rmr.vm.generate.known import INT, NOTHING, Bounds, Known, at_least, at_most, of_value, within
from rmr.vm.generate.trees import Tree

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

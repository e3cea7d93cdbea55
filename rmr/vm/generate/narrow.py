"""What a condition says of the slots that it compares, once it is known to be true or false.

Only comparisons of a number in a slot, or of the length of a list in one, bound anything; with the bounds of the
other side, so that a guard after another one says more.
"""

from collections.abc import Callable, Mapping

from rmr.bytecode.opcodes import FUNCTIONS, Op
from rmr.bytecode.program import Base
from rmr.vm.generate.known import NOTHING, NUMBERS, Bounds, Known, at_least, at_most, of_value
from rmr.vm.generate.trees import Tree

_OPPOSITE = {Op.LT: Op.GE, Op.LE: Op.GT, Op.GT: Op.LE, Op.GE: Op.LT, Op.EQ: Op.NE, Op.NE: Op.EQ}
"""What holds of two numbers if a comparison does not."""

_MIRRORED = {Op.LT: Op.GT, Op.LE: Op.GE, Op.GT: Op.LT, Op.GE: Op.LE, Op.EQ: Op.EQ, Op.NE: Op.NE}
"""The comparison with its sides exchanged."""

LEN = next(i for i, function in enumerate(FUNCTIONS) if function.name == "len")


def assumed(node: Tree, outcome: bool, known: Mapping[int, Known]) -> dict[int, Known]:
    """Return what is known of the slots when `node` is `outcome`."""
    if node.op is Op.NOT:
        return assumed(node.parts[0], not outcome, known)
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


def _bounds(node: Tree, known: Mapping[int, Known]) -> Bounds | None:
    """Return between what one side of a comparison lies if it is a number."""
    slot = _slot(node)
    if node.op in (Op.CONST, Op.INT):
        assert node.operand is not None
        side = of_value(node.operand)
    elif slot is not None:
        side = known.get(slot, NOTHING)
    else:
        return None
    return side.bounds if side.base in _compared(node) else None


def _narrow(known: dict[int, Known], node: Tree, op: Op, other: Bounds | None) -> None:
    """Note that the slot in `node` compares so with what lies within `other`."""
    slot = _slot(node)
    if slot is None or other is None or known.get(slot, NOTHING).base not in _compared(node):
        return
    for narrow in _NARROWERS.get(op, ()):
        known[slot] = narrow(known[slot], other)


def _slot(node: Tree) -> int | None:
    """Return the slot whose value, or whose length, `node` is."""
    if node.op is Op.CALL and node.operand == LEN:
        (node,) = node.parts
    if node.op is not Op.LOAD:
        return None
    assert isinstance(node.operand, int)
    return node.operand


def _compared(node: Tree) -> tuple[Base, ...]:
    """Return the types of which the bounds are those of `node`: what has a length, or the numbers."""
    return (Base.LIST, Base.STRING) if node.op is Op.CALL else NUMBERS


_NARROWERS: dict[Op, tuple[Callable[[Known, Bounds], Known], ...]] = {
    Op.LT: (lambda known, other: at_most(known, other[1], strictly=True),),
    Op.LE: (lambda known, other: at_most(known, other[1]),),
    Op.GT: (lambda known, other: at_least(known, other[0], strictly=True),),
    Op.GE: (lambda known, other: at_least(known, other[0]),),
    Op.EQ: (lambda known, other: at_most(known, other[1]), lambda known, other: at_least(known, other[0])),
}

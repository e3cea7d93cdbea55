"""Byte-code as a tree of operations: the form in which the compiler lays out ``&&``, ``||`` and ``if``.

The right side of AND and OR and the two branches of a condition are stretches of code that leave one value by
themselves. Verified code may jump otherwise, and nest deeper than source can; such code has no tree.
"""

from rmr.base.record import record
from rmr.base.values import Value
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import FORMS, Op
from rmr.bytecode.program import Code, OwnFunction

DEPTH_MAX = 40
"""Operations in operations: each writes up to three parentheses, and Python takes 200 in one another."""


@record
class Tree:
    """An operation and what it is applied to; JUMP_IF_FALSE is applied to a condition and two branches."""

    op: Op
    operand: Value | None
    parts: "tuple[Tree, ...]"
    depth: int
    function: OwnFunction | None = None
    """Of APPLY."""


class _Unstructured(Exception):  # noqa: N818  (an outcome, not a fault)
    """The code has no tree."""


TREES_MAX = 512
"""Trees remembered: the same condition is written once for each way in which a rule is searched."""

_trees: dict[int, tuple[Code, Tree | None]] = {}
"""By the identity of the code: equal codes are not the same, for 1 equals 1.0."""


def tree(code: Code) -> Tree | None:
    """Return the tree of verified `code`, or None."""
    known = _trees.get(id(code))
    if known is not None:
        return known[1]
    if len(_trees) >= TREES_MAX:
        _trees.clear()
    made = _tree(code)
    _trees[id(code)] = code, made  # which keeps the code, so that no other one gets its identity
    return made


def _tree(code: Code) -> Tree | None:
    try:
        return _stretch(code, 0, len(code), 0)
    except _Unstructured:
        return None


def _stretch(code: Code, start: int, stop: int, nesting: int) -> Tree:
    """Return the tree of a stretch of `code` that leaves one value; `nesting` branches are around it."""
    if nesting > DEPTH_MAX:
        raise _Unstructured
    stack: list[Tree] = []
    index = start
    while index < stop:
        instruction = code[index]
        op = instruction.op
        operand = instruction.operand
        index += 1
        if op is Op.JUMP:
            raise _Unstructured
        if op in (Op.AND, Op.OR, Op.JUMP_IF_FALSE):
            assert isinstance(operand, int)
            branches, index = _branches(code, index, operand, op)
            if index > stop:
                raise _Unstructured
            trees = (_stretch(code, one, other, nesting + 1) for one, other in branches)
            stack.append(_made(op, None, (*_popped(stack, 1), *trees)))
        else:
            function = instruction.function
            pops = function.arity if function is not None else _pops(op, operand)
            stack.append(_made(op, operand, _popped(stack, pops), function))
    if len(stack) != 1:
        raise _Unstructured
    return stack[0]


def _branches(code: Code, index: int, skip: int, op: Op) -> tuple[list[tuple[int, int]], int]:
    """Return the stretches that follow a jump before `index`, and where they end."""
    end = index + skip
    if op is not Op.JUMP_IF_FALSE:
        return [(index, end)], end
    if skip < 1 or end > len(code) or code[end - 1].op is not Op.JUMP:
        raise _Unstructured
    otherwise = code[end - 1].operand
    assert isinstance(otherwise, int)
    return [(index, end - 1), (end, end + otherwise)], end + otherwise


def _pops(op: Op, operand: Value | None) -> int:
    if op is Op.LIST or op is Op.CALL:
        assert isinstance(operand, int)
        return operand if op is Op.LIST else FUNCTIONS[operand].arity
    return FORMS[op].pops


def _popped(stack: list[Tree], count: int) -> tuple[Tree, ...]:
    """Take the topmost values off the stack."""
    start = len(stack) - count
    if start < 0:
        raise _Unstructured
    parts = tuple(stack[start:])
    del stack[start:]
    return parts


def _made(op: Op, operand: Value | None, parts: tuple[Tree, ...], function: OwnFunction | None = None) -> Tree:
    depth = 1 + max((part.depth for part in parts), default=0)
    if depth > DEPTH_MAX:
        raise _Unstructured
    return Tree(op, operand, parts, depth, function)

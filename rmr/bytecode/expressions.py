"""The verifier's checks of an expression by itself, independent of its uses.

Operands are in range. Jumps stay inside and go forward. Every instruction is reachable. On every path the stack holds
the operands of each instruction, and exactly one value is left. An expression is examined once for all entries that
share it; whether its slots are bound is checked at each use.
"""

from collections.abc import Iterator, Sequence

from rmr.base.record import record
from rmr.bytecode.constants import Constants
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.limits import SLOTS_MAX, STACK_MAX
from rmr.bytecode.opcodes import FORMS, Op, Operand
from rmr.bytecode.program import Code, Instruction, OwnFunction

TIMED = frozenset(index for index, function in enumerate(FUNCTIONS) if function.timed)
"""Indices of the functions of time."""
DRAWN = frozenset(index for index, function in enumerate(FUNCTIONS) if function.drawn)
"""Indices of the functions of chance."""
JUMPS = (Op.JUMP, Op.JUMP_IF_FALSE, Op.AND, Op.OR)
"""Instructions with a jump target."""


@record
class Examined:
    """The properties of an expression."""

    wrong: str
    """The first defect; empty for a sound expression."""
    slots: int
    """The slots that it reads, as a bit mask."""
    timed: bool
    """Whether it calls a function of time."""
    drawn: bool
    """Whether it calls a function of chance."""


def examine(code: Code, constants: Constants, functions: Sequence[OwnFunction] = ()) -> Examined:
    """Return the properties of `code` in a program that has `functions`."""
    wrong = next((reason for each in code for reason in _operand(each, constants, functions)), "") or _unbalanced(code)
    if wrong:
        return Examined(wrong, 0, False, False)
    slots = 0
    for slot in {i.operand: None for i in code if i.op is Op.LOAD}:
        assert isinstance(slot, int)
        slots |= 1 << slot
    calls = {i.operand: None for i in code if i.op is Op.CALL}
    return Examined("", slots, any(each in TIMED for each in calls), any(each in DRAWN for each in calls))


def _operand(instruction: Instruction, constants: Constants, functions: Sequence[OwnFunction]) -> Iterator[str]:
    """Check the operand against the opcode table."""
    op = instruction.op
    operand = instruction.operand
    form = FORMS[op].operand
    if form is Operand.NONE:
        if operand is not None:
            yield f"{op.name} takes no operand"
    elif operand is None or (form is not Operand.CONSTANT and type(operand) is not int):
        yield f"{op.name} without a proper operand"
    elif not constants.proper(operand):
        yield f"{op.name} with a value out of range"
    elif form is Operand.SLOT and not 0 <= operand < SLOTS_MAX:  # type: ignore[operator]
        yield f"there is no slot {operand}"
    elif form in (Operand.COUNT, Operand.SKIP) and operand < 0:  # type: ignore[operator]
        yield f"{op.name} with the negative operand {operand}"
    elif form is Operand.OWN and not _is_of(instruction, functions):
        yield f"there is no function {operand} of the program"
    elif form is Operand.FUNCTION and not 0 <= operand < len(FUNCTIONS):  # type: ignore[operator]
        yield f"there is no function {operand}"


def _is_of(instruction: Instruction, functions: Sequence[OwnFunction]) -> bool:
    """Tell whether an instruction refers to one of `functions`."""
    index = instruction.operand
    assert isinstance(index, int)
    return 0 <= index < len(functions) and instruction.function is functions[index]


def _unbalanced(code: Code) -> str:
    """Return the first defect of control flow or stack depth, else an empty string.

    An abstract interpretation with the stack depth as state; one pass suffices, because jumps only go forward.
    """
    depths: list[int | None] = [0] + [None] * len(code)
    for index, instruction in enumerate(code):
        depth = depths[index]
        if depth is None:
            return f"instruction {index} is never reached"
        pops, pushes = _effect(instruction)
        if depth < pops or depth - pops + pushes > STACK_MAX:
            return f"instruction {index} ({instruction.op.name}) with {depth} values on the stack"
        for target, after in _successors(index, instruction, depth, depth - pops + pushes):
            if not index < target <= len(code):
                return f"instruction {index} jumps out of the expression"
            if depths[target] not in (None, after):
                return f"the ways to instruction {target} leave different numbers of values"
            depths[target] = after
    return "" if depths[-1] == 1 else f"the expression leaves {depths[-1] or 0} values instead of one"


def _effect(instruction: Instruction) -> tuple[int, int]:
    """Return the numbers of values that an instruction pops and pushes."""
    form = FORMS[instruction.op]
    if form.pops >= 0:
        return form.pops, form.pushes
    if instruction.function is not None:
        return instruction.function.arity, form.pushes
    operand = instruction.operand
    assert isinstance(operand, int)
    return (FUNCTIONS[operand].arity if form.operand is Operand.FUNCTION else operand), form.pushes


def _successors(index: int, instruction: Instruction, before: int, after: int) -> Iterator[tuple[int, int]]:
    """Yield the possible next instructions, each with the stack depth there."""
    op = instruction.op
    if op is not Op.JUMP:
        yield index + 1, after
    if op in JUMPS:
        assert isinstance(instruction.operand, int)
        # A short circuit keeps the left operand as the result; falling through has popped it.
        kept = before if op in (Op.AND, Op.OR) else after
        yield index + 1 + instruction.operand, kept

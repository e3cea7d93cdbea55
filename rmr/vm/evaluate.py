"""The value of an expression (paper III.A): a stack machine over the instructions of `rmr.bytecode.opcodes`.

A call of a function of the program (APPLY) has a frame of its own: its arguments as slots, and a stack. Frames stand in
a list, so that recursion in a program is none in the machine. One call may lead to calls nested at most
`NESTED_CALLS_MAX` deep and to `CALLS_MAX` calls altogether; beyond that it has no value. Both engines count alike: a
call is counted after its arguments have been evaluated and before its own expression is.
"""

from collections.abc import Sequence
from typing import Any, Final

from rmr.base.printable import shortened
from rmr.base.time import Instant
from rmr.base.values import Value, format_value
from rmr.bytecode.arithmetic import BINARY, UNARY, NoValue, built, same, truth
from rmr.bytecode.functions import FUNCTIONS, call
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Code, OwnFunction

NESTED_CALLS_MAX: Final = 250
"""Bound on the depth of nested calls: generated code recurses, and Python allows a thousand frames in all."""

CALLS_MAX: Final = 10_000
"""Calls that one call leads to: some milliseconds. A robot fires rules between two of its 60 ticks a second."""

SHOWN_MAX: Final = 60
"""Characters of the arguments that a message shows."""


def beyond(name: str, depth: int, args: Sequence[Value]) -> NoValue:
    """Return the reason why a call of a function at nesting depth `depth` has no value."""
    shown = shortened(", ".join([format_value(arg) for arg in args]), SHOWN_MAX)
    if depth > NESTED_CALLS_MAX:
        return NoValue(f"{name}({shown}): more than {NESTED_CALLS_MAX} calls within one another")
    return NoValue(f"{name}({shown}): more than {CALLS_MAX} calls in one expression")


__all__ = ["NoValue", "evaluate", "same"]


def evaluate(code: Code, env: Sequence[Value], now: Instant) -> Value:
    """Return the value of verified `code` with the slots `env` at `now`.

    Raises:
        NoValue: it has none.
    """
    first = code[0]
    if len(code) == 1 and first.op is not Op.CALL and first.function is None:
        return _push(first.op, first.operand, env)
    stack: list[Value] = []
    index = 0
    while index < len(code):
        instruction = code[index]
        if instruction.function is not None:
            stack.append(_applied(instruction.function, stack, now))
            index += 1
        else:
            index += 1 + _step(instruction.op, instruction.operand, stack, env, now)
    return stack[0]


class _Frame:
    """A call of a function of the program under way."""

    __slots__ = ("args", "code", "index", "stack")

    def __init__(self, function: OwnFunction, stack: list[Value]) -> None:
        """Begin a call with the topmost values of the `stack` of its caller."""
        start = len(stack) - function.arity
        self.code = function.code
        self.args = stack[start:]
        del stack[start:]
        self.index = 0
        self.stack: list[Value] = []


def _applied(function: OwnFunction, stack: list[Value], now: Instant) -> Value:
    """Return the value of a function of the program for the topmost values of `stack`, which are removed."""
    frames = [_Frame(function, stack)]
    calls = 1
    while True:
        frame = frames[-1]
        code = frame.code
        while frame.index < len(code):
            instruction = code[frame.index]
            if instruction.function is not None:
                break
            frame.index += 1 + _step(instruction.op, instruction.operand, frame.stack, frame.args, now)
        else:
            frames.pop()
            if not frames:
                return frame.stack[0]
            frames[-1].stack.append(frame.stack[0])
            continue
        called = instruction.function
        assert called is not None
        frame.index += 1
        frames.append(_Frame(called, frame.stack))
        calls += 1
        if len(frames) > NESTED_CALLS_MAX or calls > CALLS_MAX:
            raise beyond(called.name, len(frames), frames[-1].args)


def _push(op: Op, operand: Value | None, env: Sequence[Value]) -> Value:
    """Return what an instruction pushes that pops nothing."""
    if op is Op.LOAD:
        return env[operand]  # type: ignore[index]
    if op is Op.LIST:
        return ()
    assert operand is not None
    return operand


def _step(op: Op, operand: Value | None, stack: list[Value], env: Sequence[Value], now: Instant) -> int:
    """Execute one instruction; return how many of the next ones to skip."""
    if op is Op.LOAD or op is Op.CONST or op is Op.INT:
        stack.append(_push(op, operand, env))
    elif op in BINARY:
        right = stack.pop()
        stack.append(BINARY[op](stack.pop(), right))
    elif op in UNARY:
        stack.append(UNARY[op](stack.pop()))
    elif op is Op.CALL or op is Op.LIST:
        _gather(op, operand, stack, env, now)
    else:
        return _jump(op, operand, stack)
    return 0


def _gather(op: Op, operand: Value | None, stack: list[Value], env: Sequence[Value], now: Instant) -> None:
    """Replace the topmost values by a list of them or by a function's value."""
    assert isinstance(operand, int)
    if op is Op.CALL and FUNCTIONS[operand].drawn:
        draws: Any = env[-1]  # behind the slots of a rule that draws (`rmr.vm.derive`)
        stack.append(draws.draw())
        return
    count = operand if op is Op.LIST else FUNCTIONS[operand].arity
    start = len(stack) - count
    args = stack[start:]
    del stack[start:]
    stack.append(built(tuple(args)) if op is Op.LIST else call(FUNCTIONS[operand].name, args, now))


def _jump(op: Op, operand: Value | None, stack: list[Value]) -> int:
    """Return how many instructions a jump skips; AND and OR keep the value that decides."""
    assert isinstance(operand, int)
    if op is Op.JUMP:
        return operand
    condition = truth(stack.pop())
    if op is Op.JUMP_IF_FALSE:
        return 0 if condition else operand
    if condition is (op is Op.AND):
        return 0
    stack.append(condition)
    return operand

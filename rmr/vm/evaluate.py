"""The value of an expression (paper III.A).

A stack machine over the instructions of `rmr.bytecode.opcodes`. Integers are 64-bit and checked, floats
finite; what leaves these ranges, divides by zero or mixes types has no value. An int and a float may be
mixed: the result is a float. Numbers of different types are equal when they denote the same number; values of
different kinds (a robot and an int, a symbol and a string) are never equal, and only numbers and strings are
ordered.
"""

import math
from collections.abc import Callable, Sequence

from rmr.base.time import Instant, in_seconds
from rmr.base.values import INT_MAX, INT_MIN, Robot, Value
from rmr.bytecode.opcodes import FUNCTIONS, Op
from rmr.bytecode.program import Code

LENGTH_MAX = 65536
"""Characters of a string and items of a list that an expression may build."""


class NoValue(Exception):  # noqa: N818  (an outcome, not a fault)
    """The expression has no value; the message says why."""


def _is_number(value: Value) -> bool:
    kind = type(value)
    return kind is int or kind is float


def same(left: Value, right: Value) -> bool:
    """Tell whether two values are one: 1 is 1.0, but @1 is not 1, true not 1, and ``a`` not ``"a"``."""
    if left != right:
        return False
    if type(left) is tuple and type(right) is tuple:
        return all(same(a, b) for a, b in zip(left, right, strict=True))
    return type(left) is type(right) or (_is_number(left) and _is_number(right))


def _checked(value: int | float) -> Value:
    """Return `value` if it is in range."""
    if type(value) is int:
        if INT_MIN <= value <= INT_MAX:
            return value
        raise NoValue("an integer beyond 64 bits")
    if math.isfinite(value):
        return value
    raise NoValue("a float beyond its range")


def _numbers(name: str, *values: Value) -> tuple[float, ...]:
    """Return `values` if all are numbers."""
    for value in values:
        if not _is_number(value):
            raise NoValue(f"{name} of something that is no number")
    return values  # type: ignore[return-value]


def _add(left: Value, right: Value) -> Value:
    """Add numbers, join strings or lists."""
    kind = type(left)
    if kind is type(right) and kind in (str, tuple):
        joined: Value = left + right  # type: ignore[operator]
        if len(joined) > LENGTH_MAX:  # type: ignore[arg-type]
            raise NoValue(f"longer than {LENGTH_MAX}")
        return joined
    a, b = _numbers("+", left, right)
    return _checked(a + b)


def _subtract(left: Value, right: Value) -> Value:
    a, b = _numbers("-", left, right)
    return _checked(a - b)


def _multiply(left: Value, right: Value) -> Value:
    a, b = _numbers("*", left, right)
    return _checked(a * b)


def _divide(left: Value, right: Value) -> Value:
    a, b = _numbers("/", left, right)
    if b == 0:
        raise NoValue("division by zero")
    return _checked(float(a / b))


def _modulo(left: Value, right: Value) -> Value:
    """Return the remainder; it has the divisor's sign."""
    a, b = _numbers("%", left, right)
    if b == 0:
        raise NoValue("division by zero")
    return _checked(a % b)


def _less(left: Value, right: Value) -> bool:
    if _is_number(left) and _is_number(right):
        return left < right  # type: ignore[operator]
    if type(left) is str and type(right) is str:
        return left < right
    raise NoValue("values without an order compared")


BINARY: dict[Op, Callable[[Value, Value], Value]] = {
    Op.ADD: _add,
    Op.SUB: _subtract,
    Op.MUL: _multiply,
    Op.DIV: _divide,
    Op.MOD: _modulo,
    Op.EQ: same,
    Op.NE: lambda left, right: not same(left, right),
    Op.LT: _less,
    Op.LE: lambda left, right: not _less(right, left),
    Op.GT: lambda left, right: _less(right, left),
    Op.GE: lambda left, right: not _less(left, right),
}


def _negate(value: Value) -> Value:
    (number,) = _numbers("-", value)
    return _checked(-number)


def _truth(value: Value) -> bool:
    if type(value) is not bool:
        raise NoValue("a condition that is neither true nor false")
    return value


def _float(value: Value) -> Value:
    (number,) = _numbers("float", value)
    return float(number)


UNARY: dict[Op, Callable[[Value], Value]] = {
    Op.NEG: _negate,
    Op.NOT: lambda value: not _truth(value),
    Op.FLOAT: _float,
}


def _extreme(choose: Callable[[float, float], float], a: float, b: float) -> float:
    """Return the smaller or larger of two numbers; a float if either is one."""
    chosen = choose(a, b)
    return chosen if type(a) is type(b) else float(chosen)


NUMERIC: dict[str, Callable[..., float]] = {
    "abs": abs,
    "min": lambda a, b: _extreme(min, a, b),
    "max": lambda a, b: _extreme(max, a, b),
    "floor": math.floor,
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "atan2": math.atan2,
    "dist": lambda x1, y1, x2, y2: math.hypot(x2 - x1, y2 - y1),
}


def _call(name: str, args: list[Value], now: Instant) -> Value:
    """Return the value of a function of `FUNCTIONS`."""
    if name == "now":
        return in_seconds(now)
    if name == "id":
        if type(args[0]) is not Robot:
            raise NoValue("id of something that is no robot")
        return int(args[0])
    try:
        return _checked(NUMERIC[name](*_numbers(name, *args)))
    except (ValueError, OverflowError):
        raise NoValue(f"{name} outside its domain") from None


def evaluate(code: Code, env: Sequence[Value], now: Instant) -> Value:
    """Return the value of verified `code` with the slots `env` at `now`.

    Raises:
        NoValue: it has none.
    """
    first = code[0]
    if len(code) == 1 and first.op is not Op.CALL:
        return _push(first.op, first.operand, env)
    stack: list[Value] = []
    index = 0
    while index < len(code):
        instruction = code[index]
        index += 1 + _step(instruction.op, instruction.operand, stack, env, now)
    return stack[0]


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
        _gather(op, operand, stack, now)
    else:
        return _jump(op, operand, stack)
    return 0


def _gather(op: Op, operand: Value | None, stack: list[Value], now: Instant) -> None:
    """Replace the topmost values by a list of them or by a function's value."""
    assert isinstance(operand, int)
    count = operand if op is Op.LIST else FUNCTIONS[operand].arity
    start = len(stack) - count
    args = stack[start:]
    del stack[start:]
    stack.append(tuple(args) if op is Op.LIST else _call(FUNCTIONS[operand].name, args, now))


def _jump(op: Op, operand: Value | None, stack: list[Value]) -> int:
    """Return how many instructions a jump skips; AND and OR keep the value that decides."""
    assert isinstance(operand, int)
    if op is Op.JUMP:
        return operand
    condition = _truth(stack.pop())
    if op is Op.JUMP_IF_FALSE:
        return 0 if condition else operand
    if condition is (op is Op.AND):
        return 0
    stack.append(condition)
    return operand

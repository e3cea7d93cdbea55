"""An expression as a straight line of typed operations, as far as it is of numbers, Booleans, symbols and robots.

A stack machine jumps; columns of many robots cannot, since some robots would jump and others not. Jumps are replaced
by selection: the code that a jump skips is evaluated like any other operand, and AND, OR and IF select an operand.
Each operation names the earlier operations that are its operands; the last one is the expression. All types are known
statically. Operations on constants are folded.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.arithmetic import BINARY, UNARY, NoValue
from rmr.bytecode.conform import NUMBERS
from rmr.bytecode.functions import FUNCTIONS, Function, Gives, Takes, call
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Code, Instruction

LOAD = "load"
CONST = "const"
NOTHING = "nothing"
IF = "if"
AND = "and"
OR = "or"
NEVER = "never"
ALWAYS = "always"
"""``eq`` and ``ne`` of values of different kinds, which are never the same."""

JUMPS = "jumps that are none of `if`, `and` and `or`"

BASES: dict[type, Base] = {
    bool: Base.BOOL,
    int: Base.INT,
    float: Base.FLOAT,
    Symbol: Base.SYMBOL,
    Robot: Base.ROBOT,
}
"""What columns hold."""


class Unsuitable(Exception):  # noqa: N818  (an outcome, not a fault)
    """The expression is more than columns can hold; the message says what."""


class Operation(NamedTuple):
    """One value on the way."""

    name: str
    """``load``, ``const``, ``nothing`` (it has no value), ``and``, ``or``, ``if``, ``never``, ``always``, or that of an
    instruction or function in small letters."""
    base: Base
    args: tuple[int, ...] = ()
    """The operations that it works on."""
    operand: Value | None = None
    """The slot of ``load``, the value of ``const``."""


class _Open(NamedTuple):
    """A jump that has been passed."""

    name: str
    args: tuple[int, ...]
    """The condition, and the first branch when that is complete."""
    end: int
    """Where the ways meet again."""
    below: list[int]
    """What is on the stack beneath the value that decides: no way changes it."""


def straight(code: Code, slots: Mapping[int, Base]) -> tuple[Operation, ...]:
    """Return verified `code` as operations, given the types of its slots. Raises Unsuitable."""
    line = _Line(slots)
    for index, instruction in enumerate(code):
        line.meet(index)
        line.add(index, instruction)
    line.meet(len(code))
    return line.result()


class _Line:
    """The operations of one expression in the making."""

    def __init__(self, slots: Mapping[int, Base]) -> None:
        self._slots = slots
        self._operations: list[Operation] = []
        self._stack: list[int] = []
        self._open: list[_Open] = []

    def result(self) -> tuple[Operation, ...]:
        """Return the operations, the value last."""
        return tuple(self._operations)

    def meet(self, index: int) -> None:
        """Join the ways that meet at `index`."""
        while self._open and self._open[-1].end == index:
            jump = self._open.pop()
            value = self._branch(jump)
            if jump.name == IF and len(jump.args) == 1:
                raise Unsuitable(JUMPS)
            self._push(jump.name, (*jump.args, value))

    def _branch(self, jump: _Open) -> int:
        """Take the value of a branch that ends here."""
        if not self._stack or self._stack[:-1] != jump.below:
            raise Unsuitable(JUMPS)
        return self._stack.pop()

    def add(self, index: int, instruction: Instruction) -> None:
        """Add what one instruction does."""
        op = instruction.op
        operand = instruction.operand
        if op in (Op.CONST, Op.INT):
            assert operand is not None
            self._constant(operand)
        elif op is Op.LOAD:
            assert isinstance(operand, int)
            base = self._slots.get(operand, Base.OPEN)
            self._put(Operation(LOAD, base, (), operand))
        elif op in (Op.AND, Op.OR, Op.JUMP_IF_FALSE, Op.JUMP):
            assert isinstance(operand, int)
            self._jump(op, index, index + 1 + operand)
        elif op is Op.LIST:
            raise Unsuitable("a list")
        elif op is Op.APPLY:
            raise Unsuitable("a function of the program")
        else:
            function = FUNCTIONS[operand] if op is Op.CALL and isinstance(operand, int) else None
            arity = function.arity if function else 2 if op in BINARY else 1
            args = tuple(self._stack[len(self._stack) - arity :])
            del self._stack[len(self._stack) - arity :]
            self._push(function.name if function else op.name.lower(), args)

    def _jump(self, op: Op, index: int, target: int) -> None:
        if op is Op.JUMP:
            jump = self._open.pop() if self._open else None
            if jump is None or jump.name != IF or jump.end != index + 1 or len(jump.args) != 1:
                raise Unsuitable(JUMPS)
            self._open.append(_Open(IF, (*jump.args, self._branch(jump)), target, jump.below))
            return
        condition = self._stack.pop()
        if self._operations[condition].base is not Base.BOOL:
            raise Unsuitable("a condition that is neither true nor false")
        name = {Op.AND: AND, Op.OR: OR}.get(op, IF)
        self._open.append(_Open(name, (condition,), target, list(self._stack)))

    def _constant(self, value: Value) -> None:
        if type(value) not in BASES:
            raise Unsuitable("a string" if type(value) is str else "a list")
        self._put(Operation(CONST, BASES[type(value)], (), value))

    def _push(self, name: str, args: tuple[int, ...]) -> None:
        """Put the value of an operation on the stack."""
        operands = [self._operations[arg] for arg in args]
        base = _base(name, [each.base for each in operands])
        if name in ("eq", "ne") and not _alike(*[each.base for each in operands]):
            name = NEVER if name == "eq" else ALWAYS
        if name in _FOLDED and all(each.name == CONST for each in operands):
            self._put(_folded(name, base, [each.operand for each in operands]))  # type: ignore[misc]
        else:
            self._put(Operation(name, base, args))

    def _put(self, operation: Operation) -> None:
        self._stack.append(len(self._operations))
        self._operations.append(operation)


def _folded(name: str, base: Base, values: list[Value]) -> Operation:
    """Return what is made of constants alone."""
    try:
        return Operation(CONST, base, (), work_out(name, values))
    except NoValue:
        return Operation(NOTHING, base)


def work_out(name: str, values: Sequence[Value]) -> Value:
    """Return what an operation makes of single values. Raises NoValue."""
    return _FOLDED[name](*values)


# ---- types


def _alike(one: Base, other: Base) -> bool:
    """Return whether values of two types can be the same."""
    return one is other or (one in NUMBERS and other in NUMBERS)


def _base(name: str, bases: list[Base]) -> Base:
    """Return the type of an operation on values of `bases`. Raises Unsuitable if it cannot have a value."""
    if Base.OPEN in bases:
        raise Unsuitable("a value of a type that nothing fixes")
    if name in _TYPES:
        taken, given = _TYPES[name]
        if any(base not in taken for base in bases):
            raise Unsuitable(f"`{name}` of a type other than {' and '.join(each.name.lower() for each in taken)}")
        return given or (Base.FLOAT if Base.FLOAT in bases else Base.INT)
    if name in (AND, OR, IF):
        first = bases[-2]
        last = bases[-1]
        if first is not last:
            raise Unsuitable(f"`{name}` of values of two types, {first.name.lower()} and {last.name.lower()}")
        return last
    raise Unsuitable(f"`{name}`")


def _taken(function: Function) -> tuple[Base, ...]:
    """Return the types that all arguments of a function may have; none if it takes other values as well, or none."""
    takes = set(function.takes)
    return NUMBERS if takes == {Takes.NUMBER} else (Base.ROBOT,) if takes == {Takes.ROBOT} else ()


_GIVEN = {Gives.NUMBER: None, Gives.INT: Base.INT, Gives.FLOAT: Base.FLOAT, Gives.BOOL: Base.BOOL}

_TYPES: dict[str, tuple[tuple[Base, ...], Base | None]] = {
    **dict.fromkeys(("add", "sub", "mul", "mod", "neg"), (NUMBERS, None)),
    **dict.fromkeys(("div", "float"), (NUMBERS, Base.FLOAT)),
    **dict.fromkeys(("lt", "le", "gt", "ge"), (NUMBERS, Base.BOOL)),
    **dict.fromkeys(("eq", "ne"), (tuple(BASES.values()), Base.BOOL)),
    "not": ((Base.BOOL,), Base.BOOL),
    **{each.name: (taken, _GIVEN[each.gives]) for each in FUNCTIONS if (taken := _taken(each))},
}
"""By operation: the types that it takes, and the one that it gives (None: float if any is one)."""


def _called(name: str, *values: Value) -> Value:
    return call(name, list(values), 0)


_FOLDED: dict[str, Callable[..., Value]] = {
    **{op.name.lower(): work for op, work in (*BINARY.items(), *UNARY.items())},
    **{each.name: partial(_called, each.name) for each in FUNCTIONS if each.name in _TYPES},
}
"""Constant folding, by operation."""

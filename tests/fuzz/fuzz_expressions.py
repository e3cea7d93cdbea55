"""Which expressions have a value of which type: what the fuzzer draws so that most of them have one."""

from collections.abc import Callable
from random import Random

from program_maker import BOOL, CALL, COMPARISON, FLOAT, INT, ROBOT, STRING

from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import Base, Code, Instruction, Type

Part = Callable[[Type], Code]
"""Makes an expression of a type."""

INTS = Type(Base.LIST, element=INT)
LIST = Type(Base.LIST)
CHOSEN = 0.15
"""How often an expression is an `if`, or an item of a list."""


def _all(ops: list[Op], *kinds: Type) -> list[tuple[tuple[Type, ...], Instruction]]:
    return [(kinds, Instruction(op)) for op in ops]


def _calls(names: str, *kinds: Type) -> list[tuple[tuple[Type, ...], Instruction]]:
    return [(kinds, CALL[name]) for name in names.split()]


SHAPES: dict[Base, list[tuple[tuple[Type, ...], Instruction]]] = {
    Base.INT: [
        *_all([Op.ADD, Op.SUB, Op.MUL, Op.MOD] * 2, INT, INT),
        *_all([Op.NEG], INT),
        *_calls("abs", INT),
        *_calls("min max", INT, INT),
        *_calls("floor", FLOAT),
        *_calls("len len", LIST),
        *_calls("len", STRING),
        *_calls("id", ROBOT),
        *_calls("index", INTS, INT),
    ],
    Base.FLOAT: [
        *_all([Op.ADD, Op.SUB, Op.MUL, Op.MOD, Op.DIV], FLOAT, FLOAT),
        *_all([Op.ADD, Op.DIV], INT, FLOAT),
        *_all([Op.DIV], INT, INT),
        *_all([Op.FLOAT, Op.FLOAT], INT),
        *_all([Op.NEG], FLOAT),
        *_calls("sqrt sin cos abs", FLOAT),
        *_calls("atan2 min max hypot", FLOAT, INT),
        *_calls("exp log", FLOAT),
        *_calls("dist", FLOAT, INT, FLOAT, INT),
    ],
    Base.STRING: _all([Op.ADD], STRING, STRING),
    Base.BOOL: [
        *_all(COMPARISON * 2, INT, INT),
        *_all(COMPARISON, INT, FLOAT),
        *_all(COMPARISON, STRING, STRING),
        *_all([Op.NOT] * 3, BOOL),
        *_calls("member member", INT, INTS),
    ],
    Base.LIST: [
        *_all([Op.ADD, Op.ADD], INTS, INTS),
        *_all([Op.FLOAT], INTS),
        *_calls("sort sort", INTS),
        *_calls("rest rest", INTS, INT),
        *_calls("reverse dedupe", INTS),
        *_calls("remove", INTS, INT),
        *_calls("slice", INTS, INT, INT),
        *_calls("update", INTS, INT, INT),
    ],
    Base.ROBOT: _calls("robot", INT),
}
"""By the type of the value: the types of what an instruction takes, and the instruction."""

OTHERS = [INT, FLOAT, STRING, BOOL, INTS]
"""What stands for an open type."""


def compound(rng: Random, part: Part, kind: Type) -> Code:
    """Return an expression with parts, of type `kind` if there is one."""
    if kind.base is Base.OPEN:
        kind = rng.choice(OTHERS)
    draw = rng.random()
    if draw < CHOSEN:
        return _choice(part, kind)
    if draw < 1.5 * CHOSEN:
        return (*part(Type(Base.LIST, element=kind)), *part(INT), CALL["nth"])
    if kind.base is Base.LIST and draw < 0.5:
        items = [part(kind.element or INT) for _ in range(rng.randint(0, 3))]
        return (*(each for item in items for each in item), Instruction(Op.LIST, len(items)))
    if kind.base is Base.BOOL and draw < 0.4:
        right = part(BOOL)
        return (*part(BOOL), Instruction(rng.choice([Op.AND, Op.OR]), len(right)), *right)
    if kind.base not in SHAPES:
        return part(kind)
    kinds, last = rng.choice(SHAPES[kind.base])
    return (*(each for one in kinds for each in part(one)), last)


def _choice(part: Part, kind: Type) -> Code:
    """Return ``if(condition, one, other)``."""
    yes, no = part(kind), part(kind)
    skip, leave = Instruction(Op.JUMP_IF_FALSE, len(yes) + 1), Instruction(Op.JUMP, len(no))
    return (*part(BOOL), skip, *yes, leave, *no)

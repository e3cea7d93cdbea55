"""The instruction set: the one table from which encoder, decoder, verifier, disassembler, interpreter and docs derive.

An expression is a sequence of instructions for a stack machine. Jumps go forward only, by a count of instructions, so
that every expression terminates. The verifier balances `pops` and `pushes`; CALL pops the function's arity, LIST its
operand, APPLY the arity of the program's function.
"""

from enum import IntEnum

from rmr.base.record import record


class Operand(IntEnum):
    """The operand behind the opcode octet."""

    NONE = 0
    CONSTANT = 1
    """Index into the program's constants (varint); in a decoded instruction, the value itself."""
    SLOT = 2
    """Number of a variable slot of the rule (varint); slot 0 is the robot itself."""
    SMALL = 3
    """Signed integer (zigzag varint); in a decoded instruction, the int."""
    FUNCTION = 4
    """Index into `rmr.bytecode.functions.FUNCTIONS` (one octet)."""
    SKIP = 5
    """Number of instructions to skip, at least 0 (varint)."""
    COUNT = 6
    """Number of values (varint)."""
    OWN = 7
    """Index into the program's functions (varint)."""


class Op(IntEnum):
    """Instructions of expressions."""

    CONST = 0x01
    INT = 0x02
    LOAD = 0x03
    ADD = 0x10
    SUB = 0x11
    MUL = 0x12
    DIV = 0x13
    MOD = 0x14
    NEG = 0x15
    EQ = 0x20
    NE = 0x21
    LT = 0x22
    LE = 0x23
    GT = 0x24
    GE = 0x25
    NOT = 0x28
    FLOAT = 0x29
    """Convert an int on top of the stack, or the ints of a list, to float, for an argument of a float type."""
    CALL = 0x30
    LIST = 0x31
    """Make a list of COUNT values."""
    APPLY = 0x32
    """Call a function of the program."""
    JUMP = 0x40
    JUMP_IF_FALSE = 0x41
    """Pop the condition; skip when it is false."""
    AND = 0x42
    """If the top is false keep it and skip, else pop it."""
    OR = 0x43
    """If the top is true keep it and skip, else pop it."""


@record
class Form:
    """The operand and the stack effect of one instruction."""

    operand: Operand
    pops: int
    """Number of popped values; -1 if it depends on the operand."""
    pushes: int


FORMS: dict[Op, Form] = {
    Op.CONST: Form(Operand.CONSTANT, 0, 1),
    Op.INT: Form(Operand.SMALL, 0, 1),
    Op.LOAD: Form(Operand.SLOT, 0, 1),
    **{
        op: Form(Operand.NONE, 2, 1)
        for op in (Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.MOD, Op.EQ, Op.NE, Op.LT, Op.LE, Op.GT, Op.GE)
    },
    Op.NEG: Form(Operand.NONE, 1, 1),
    Op.NOT: Form(Operand.NONE, 1, 1),
    Op.FLOAT: Form(Operand.NONE, 1, 1),
    Op.CALL: Form(Operand.FUNCTION, -1, 1),
    Op.LIST: Form(Operand.COUNT, -1, 1),
    Op.APPLY: Form(Operand.OWN, -1, 1),
    Op.JUMP: Form(Operand.SKIP, 0, 0),
    Op.JUMP_IF_FALSE: Form(Operand.SKIP, 1, 0),
    Op.AND: Form(Operand.SKIP, 1, 0),
    Op.OR: Form(Operand.SKIP, 1, 0),
}

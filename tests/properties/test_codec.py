"""Properties of the byte-code: nothing is lost on the way, and no octets but intact ones become a program."""

import zlib
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from program_maker import Maker

from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.codec import BytecodeError, decode, encode
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.layout import CRC_OFFSET, MAGIC, VERSION, checksum
from rmr.bytecode.octets import identity
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF,
    Aggregate,
    Anything,
    Assertion,
    Atom,
    Base,
    Bind,
    Comprehension,
    Constant,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Effect,
    Guard,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Lead,
    Mode,
    Operator,
    Place,
    Predicate,
    Program,
    Serving,
    Slot,
    Steps,
    Strategy,
    Type,
)
from rmr.bytecode.verify import verify

programs = st.integers(0, 2**32).map(lambda seed: Maker(seed).program())
few = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def reseal(octets: bytearray) -> bytes:
    """Make size and CRC-32 right again, as somebody would who means harm."""
    octets[6:10] = len(octets).to_bytes(4, "little")
    octets[CRC_OFFSET : CRC_OFFSET + 4] = checksum(bytes(octets)).to_bytes(4, "little")
    return bytes(octets)


def parts(thing: object) -> Iterator[object]:
    """Everything that a program is made of."""
    yield thing
    if is_dataclass(thing):
        for each in fields(thing):
            yield from parts(getattr(thing, each.name))
    elif isinstance(thing, tuple):
        for item in thing:
            yield from parts(item)


def test_the_programs_that_are_drawn_have_every_construct() -> None:
    found = [part for seed in range(150) for part in parts(Maker(seed).program())]
    kinds = {type(part) for part in found}
    assert kinds >= {
        *(Atom, Guard, Bind, DeriveFact, DeriveGoal, DeriveAction, Comprehension, Aggregate, Steps),
        *(Effect, InitialFact, InitialGoal, Lead, Serving, Assertion, Slot, Constant, Anything, Place),
    }
    instructions = [part for part in found if isinstance(part, Instruction)]
    assert {each.op for each in instructions} == set(Op)
    assert {each.operand for each in instructions if each.op is Op.CALL} == set(range(len(FUNCTIONS)))
    for enumeration in (Kind, Base, Mode, Operator, Strategy):
        assert {part for part in found if isinstance(part, enumeration)} == set(enumeration)
    assertions = [part for part in found if isinstance(part, Assertion)]
    assert {each.robot is None for each in assertions} == {True, False}
    assert {type(each.finisher) for each in assertions} == {Slot, Constant}
    assert {part.owner == SELF for part in found if isinstance(part, Effect)} == {True, False}


@pytest.mark.medium
@few
@given(programs)
def test_a_program_comes_back_as_it_was(program: Program) -> None:
    assert verify(program) == []
    back = decode(encode(program, debug=True))
    assert repr(back) == repr(program)
    assert repr(decode(encode(program, debug=False)).rules) == repr(program.rules)


@pytest.mark.medium
@few
@given(programs)
def test_debug_information_changes_nothing_but_the_size(program: Program) -> None:
    plain, full = encode(program, debug=False), encode(program, debug=True)
    assert decode(plain) == decode(full)
    assert decode(plain).debug is None
    assert len(plain) < len(full)


@few
@given(programs)
def test_every_program_can_be_disassembled_without_a_gap(program: Program) -> None:
    data = encode(program, debug=True)
    shown = [line[8:44] for line in disassemble(data).splitlines() if line.startswith("0x")]
    assert bytes.fromhex("".join(shown)) == data


@settings(few, max_examples=10)
@given(programs)
def test_every_truncation_is_rejected(program: Program) -> None:
    data = encode(program, debug=False)
    for length in range(len(data)):
        with pytest.raises(BytecodeError):
            decode(data[:length])


@pytest.mark.medium
@settings(few, max_examples=60)
@given(programs, st.data())
def test_flipped_bits_are_rejected(program: Program, draw: st.DataObject) -> None:
    data = encode(program, debug=False)
    for _ in range(20):
        octets = bytearray(data)
        for bit in draw.draw(st.sets(st.integers(0, len(data) * 8 - 1), min_size=1, max_size=3)):
            octets[bit // 8] ^= 1 << bit % 8
        with pytest.raises(BytecodeError):
            decode(bytes(octets))


@few
@given(st.binary(max_size=200))
def test_random_octets_are_rejected(octets: bytes) -> None:
    with pytest.raises(BytecodeError):
        decode(octets)


@few
@given(st.binary(max_size=120), st.integers(0, 3))
def test_random_octets_behind_a_proper_header_are_rejected_or_sound(octets: bytes, flags: int) -> None:
    data = reseal(bytearray(MAGIC + bytes([VERSION, flags]) + bytes(8) + octets))
    try:
        program = decode(data)
    except BytecodeError:
        return
    assert verify(program) == []


@pytest.mark.medium
@settings(few, max_examples=150)
@given(programs, st.integers(0, 2**32))
def test_forged_octets_are_rejected_or_sound_and_never_raise_anything_else(program: Program, seed: int) -> None:
    rng = Random(seed)
    octets = bytearray(encode(program, debug=True))
    for _ in range(rng.randint(1, 4)):
        octets[rng.randrange(14, len(octets))] = rng.randrange(256)
    try:
        disassemble(reseal(octets))
        forged = decode(reseal(octets))
    except BytecodeError:
        return
    assert verify(forged) == []


@few
@given(st.lists(st.sampled_from([1, 1.0, True, Robot(1), "a", Symbol("a"), (1,), (True,), 0.0, -0.0]), max_size=9))
def test_values_that_python_calls_equal_are_kept_apart(values: list[Value]) -> None:
    predicate = Predicate("p", Kind.TEMPORARY, (Type(Base.OPEN),))
    program = Program((predicate,), tuple(InitialFact(0, None, (value,)) for value in values))
    back = [fact.args[0] for fact in decode(encode(program, debug=False)).facts]
    assert [identity(value) for value in back] == [identity(value) for value in values]


def test_the_crc_is_the_one_of_zlib() -> None:
    data = encode(Program(()), debug=False)
    assert int.from_bytes(data[10:14], "little") == zlib.crc32(data[:10] + data[14:])

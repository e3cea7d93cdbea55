"""The codec's edges: each kind of wrong has its own message."""

from dataclasses import replace
from hashlib import blake2b

import pytest
from vm_hand import AREA, INT, Hand, V

from rmr.base.values import Symbol
from rmr.bytecode.codec import VERSION, BytecodeError, decode, digest, encode
from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.layout import SIZE_MAX, checksum, read_layout
from rmr.bytecode.program import Base, Debug, InitialFact, Kind, Place, Predicate, Program, Strategy, Type
from rmr.bytecode.wire import Reader, Writer


def sample() -> Program:
    hand = Hand()
    p, q = hand.temporary("p", AREA, INT), hand.persistent("q", INT)
    hand.fact(p, "here", 5)
    hand.rule([hand.atom(p, V(1), V(2))], [hand.head(q, V(2))])
    return hand.program()


def sealed(data: bytes) -> bytes:
    octets = bytearray(data)
    octets[6:10] = len(octets).to_bytes(4, "little")
    octets[10:14] = checksum(bytes(octets)).to_bytes(4, "little")
    return bytes(octets)


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04", b"location(R, s).\n", bytes(64)])
def test_what_is_no_byte_code_is_called_so(data: bytes) -> None:
    with pytest.raises(BytecodeError, match="not RMR byte-code"):
        decode(data)


def test_another_version_is_named_beside_ours() -> None:
    data = bytearray(encode(sample(), debug=False))
    data[4] = 9
    for octets in (bytes(data), sealed(bytes(data)), bytes(data[:5])):
        with pytest.raises(BytecodeError, match=f"version 9, but this runtime reads version {VERSION}"):
            decode(octets)


@pytest.mark.parametrize("length", [1, 4, 13, 14, -1])
def test_a_truncated_file_is_called_so(length: int) -> None:
    with pytest.raises(BytecodeError, match="truncated"):
        decode(encode(sample(), debug=False)[:length])


def test_octets_behind_the_end_are_refused() -> None:
    with pytest.raises(BytecodeError, match="wrong size"):
        decode(encode(sample(), debug=False) + b"\0")


def test_a_damaged_file_is_called_so() -> None:
    data = bytearray(encode(sample(), debug=False))
    data[-1] ^= 1
    with pytest.raises(BytecodeError, match="CRC-32"):
        decode(bytes(data))


def test_an_intact_file_with_an_unsound_program_is_refused() -> None:
    data = encode(sample(), debug=False)
    rules = read_layout(data).tables["rules"]
    octets = bytearray(data)
    octets[rules.start] = 0
    with pytest.raises(BytecodeError, match="does not verify"):
        decode(sealed(bytes(octets)))


def test_a_huge_count_is_refused_before_anything_is_allocated() -> None:
    writer = Writer()
    writer.varint(2**60)
    with pytest.raises(BytecodeError, match="a count of"):
        Reader(bytes(writer.octets), 0, len(writer.octets)).count()
    header = bytearray(encode(sample(), debug=False))
    header[6:10] = (SIZE_MAX + 1).to_bytes(4, "little")
    with pytest.raises(BytecodeError):
        decode(bytes(header))


def test_nesting_is_bounded() -> None:
    octets = bytes([7, 1] * (NESTING_MAX + 2))
    with pytest.raises(BytecodeError, match="nested deeper"):
        Reader(octets, 0, len(octets)).value()


@pytest.mark.parametrize("number", [0, 1, 127, 128, 2**32, 2**64 - 1])
def test_varints_come_back(number: int) -> None:
    writer = Writer()
    writer.varint(number)
    assert Reader(bytes(writer.octets), 0, len(writer.octets)).varint() == number


@pytest.mark.parametrize("number", [0, -1, 63, -64, 2**63 - 1, -(2**63)])
def test_signed_numbers_come_back(number: int) -> None:
    writer = Writer()
    writer.zigzag(number)
    assert Reader(bytes(writer.octets), 0, len(writer.octets)).zigzag() == number


def test_numbers_of_more_than_64_bits_are_refused() -> None:
    for octets in (b"\xff" * 11, b"\xff" * 9 + b"\x7f"):
        with pytest.raises(BytecodeError, match="64 bits"):
            Reader(octets, 0, len(octets)).varint()


def test_encoding_an_unsound_program_is_refused() -> None:
    program = Program((Predicate("p", Kind.TEMPORARY, (Type(Base.INT),)),), (InitialFact(0, None, (Symbol("a"),)),))
    with pytest.raises(BytecodeError, match=r"does not verify.*wrong type"):
        encode(program, debug=False)


def test_the_digest_is_32_bits_and_tells_programs_apart() -> None:
    one, other = encode(sample(), debug=False), encode(Program(()), debug=False)
    assert 0 <= digest(one) < 2**32
    assert digest(one) == digest(bytes(one)) != digest(other)


def test_the_digest_is_the_same_with_and_without_places_in_the_source() -> None:
    program = sample()
    places = tuple(Place("a.rmr", line, 1) for line in range(1, 1 + len(program.rules)))
    traced = replace(program, debug=Debug(rules=places))
    plain, debug = encode(traced, debug=False), encode(traced, debug=True)
    assert plain != debug
    assert digest(plain) == digest(debug)
    assert digest(plain) == int.from_bytes(blake2b(plain, digest_size=4).digest(), "big")
    textual = encode(replace(traced, strategy=Strategy.TEXTUAL), debug=True)
    assert digest(textual) != digest(debug)


def test_what_is_no_byte_code_has_no_digest() -> None:
    with pytest.raises(BytecodeError):
        digest(encode(sample(), debug=False)[:-1])


def test_the_text_shows_offsets_in_hex_rules_and_places() -> None:
    program = sample()
    debug = Debug(rules=(Place("a.rmr", 3, 1),))
    text = disassemble(encode(Program(program.predicates, program.facts, (), program.rules, debug=debug), debug=True))
    assert text.startswith("0x0000  52 4d 52 1a")
    assert "type p(robot, area, int)" in text
    assert "p(_, here, 5)" in text
    assert "p($0, $1, $2) -o !q($0, $2)  ; 8 slots  ; a.rmr:3:1" in text
    assert "LOAD $2" in text

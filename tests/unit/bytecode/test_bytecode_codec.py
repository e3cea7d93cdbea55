"""The codec's edges: each kind of wrong has its own message."""

import re
from dataclasses import replace
from hashlib import blake2b

import pytest
from vm_hand import AREA, INT, ROBOT, Hand, V, code

from rmr.base.identity import REMEMBERED_MAX
from rmr.base.values import Symbol
from rmr.bytecode.codec import VERSION, BytecodeError, decode, digest, encode
from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.layout import SIZE_MAX, TABLES, assemble, checksum, read_layout
from rmr.bytecode.octets import Reader, Writer
from rmr.bytecode.program import (
    Base,
    Debug,
    Effect,
    InitialFact,
    InitialGoal,
    Kind,
    Lead,
    Operator,
    Place,
    Predicate,
    Program,
    Rule,
    Slot,
    Strategy,
    Type,
)


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
def test_file_that_is_no_byte_code_is_reported(data: bytes) -> None:
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
    deadline = encode(replace(traced, strategy=Strategy.DEADLINE), debug=True)
    assert digest(deadline) not in (digest(debug), digest(textual))
    assert deadline[5] == 0x0A
    assert decode(deadline).strategy is Strategy.DEADLINE
    assert "flags 0x0a: order deadline, with a debug table" in disassemble(deadline)


def test_two_strategies_in_one_file_are_refused() -> None:
    data = bytearray(encode(replace(sample(), strategy=Strategy.DEADLINE), debug=False))
    data[5] |= 1
    data[10:14] = checksum(bytes(data)).to_bytes(4, "little")
    with pytest.raises(BytecodeError, match="two strategies in the flags 0x09"):
        decode(bytes(data))


def test_file_that_is_no_byte_code_has_no_digest() -> None:
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


def number(value: int) -> bytes:
    writer = Writer()
    writer.varint(value)
    return bytes(writer.octets)


def forged(**changed: tuple[int, bytes]) -> bytes:
    """A file with p() temporary, q(open) persistent, an action go(), ``LOAD 0`` as code 0; tables as given."""
    tables: dict[str, tuple[int, bytes]] = dict.fromkeys(TABLES, (0, b""))
    tables["constants"] = (3, b"\x05\x01p\x05\x01q\x05\x02go")
    tables["code"] = (1, b"\x01\x03\x00")
    tables["predicates"] = (3, b"\x00\x00\x00" + b"\x01\x01\x01\x00" + b"\x03\x02\x00\x00\x00")
    return assemble(0, tables | changed)


def test_the_forged_file_is_sound_as_long_as_nothing_is_changed() -> None:
    assert [predicate.name for predicate in decode(forged()).predicates] == ["p", "q", "go"]
    assert decode(forged(rules=(1, b"\x01\x00\x01\x00\x00\x00"))).rules[0].head != ()


FORGED = {
    "unknown or misplaced kind of head 12": {"rules": (1, b"\x01\x00\x01\x0c")},
    "unknown or misplaced kind of head 3": {"rules": (1, b"\x01\x00\x01\x03\x00\x00\x01\x03\x00\x00\x00")},
    "unknown or misplaced kind of head 4": {"rules": (1, b"\x01\x00\x01\x05\x01\x00\x00\x01\x04\x00\x00")},
    "unknown kind of conjunct 11": {"rules": (1, b"\x01\x01\x0b")},
    "a fold within a fold": {"rules": (1, b"\x01\x01\x06\x01\x00\x01\x06" + bytes(9))},
    "index 1 into 0 functions of the program": {"code": (1, b"\x01\x32\x01")},
    "unknown kind of assertion 0x08": {"assertions": (1, b"\x08" + bytes(20))},
    "leaves open who finishes it": {"assertions": (1, b"\x04\x00" + bytes(20))},
    "a fact that leaves an argument open": {"facts": (1, b"\x01\x00\x00")},
    "index 9 into 3 constants": {"facts": (1, b"\x01\x00" + number(20))},
    "index 3 into 3 predicates": {"facts": (1, b"\x03\x00")},
    "index 1 into 1 expressions": {"rules": (1, b"\x01\x01\x04\x01\x00")},
    "a count of 5 where at most 0 fit": {"goals": (1, b"\x00\x00\x06")},
    "unknown opcode 0x7f": {"code": (1, b"\x01\x7f")},
    "index 99 into 27 functions": {"code": (1, b"\x01\x30\x63")},
    "unknown kind of value 8": {"constants": (1, b"\x08")},
    "robot id 65534": {"constants": (1, b"\x06" + number(65534))},
    "a float that is not finite": {"constants": (1, b"\x03" + b"\xff" * 8)},
    "not UTF-8": {"constants": (1, b"\x04\x01\xff")},
    "unknown kind of predicate 0x40": {"predicates": (1, b"\x40\x00\x00")},
    "a name that is not a symbol": {"constants": (1, b"\x00"), "predicates": (1, b"\x00\x00\x00")},
    "nested type 9": {"predicates": (1, b"\x00\x00\x01\x09")},
    "nested type 7": {"predicates": (1, b"\x00\x00\x01" + b"\x07" * (NESTING_MAX + 2) + b"\x00")},
    "a count of 1 where at most 0 fit": {"predicates": (1, b"\x03\x00\x00\x01\x00")},
    "do not fill their table": {"effects": (1, b"\x00\x00")},
    "1 octets too many in the table of rules": {"rules": (1, b"\x01\x00\x00\x00")},
    "the table ends too early": {"rules": (2, b"\x01\x00\x00")},
    "the debug table contradicts the flags": {"debug": (1, bytes(4))},
    "the table of rules does not fit (3 entries)": {"rules": (3, b"\x01\x00")},
}


@pytest.mark.parametrize("reason", FORGED)
def test_undecodable_byte_code_is_refused_with_the_reason(reason: str) -> None:
    data = forged(**FORGED[reason])
    for read in (decode, disassemble):
        with pytest.raises(BytecodeError, match=re.escape(reason)):
            read(data)


def test_a_gap_before_the_first_table_is_refused() -> None:
    octets = bytearray(forged())
    octets[15] = 1
    with pytest.raises(BytecodeError, match="a gap before the first table"):
        decode(sealed(bytes(octets)))


def test_unknown_flags_are_refused() -> None:
    octets = bytearray(forged())
    octets[5] = 32
    with pytest.raises(BytecodeError, match="unknown flags 0x20"):
        decode(sealed(bytes(octets)))


@pytest.mark.parametrize("version", [1, 2])
def test_older_byte_code_is_refused_and_the_way_out_named(version: int) -> None:
    octets = bytearray(forged())
    octets[4] = version
    with pytest.raises(BytecodeError, match=f"version {version}, but this runtime reads version 3; recompile it"):
        decode(sealed(bytes(octets)))


def everything() -> Program:
    """A program in which what version 2 brings stands once."""
    hand = Hand()
    p, q = hand.temporary("p", ROBOT), hand.persistent("q", INT)
    give = hand.action("give", ROBOT, effects=(Effect(p, (code(V(0)),), code(V(1))),))
    hand.fact(p, V(0), owner=3)
    hand.rule([hand.atom(p, V(1))], [hand.then(hand.head(give, V(1)), hand.head(q, 1, to=V(1)))], slots=2)
    longest = hand.fold(Operator.MAX, V(2), V(3), [hand.atom(q, V(2))], hand.head(q, V(3)), V(2))
    hand.rule([], [longest], slots=4)
    hand.rule([], [hand.fold(Operator.COUNT, None, V(3), [hand.atom(q, 7)], hand.head(q, V(3)))], slots=4)
    hand.goals.append(InitialGoal(q, None, (Slot(1),), (Lead(0, 2), Lead(2, None))))
    hand.goals.append(InitialGoal(p, 4, (Slot(0),), ()))
    late = hand.head(give, V(1))
    hand.asserts(hand.keep(p, V(1)), hand.keep(p, V(0)), 5, late, scheduled=False, robot=6, finisher=V(1))
    return hand.program()


SHOWN = """\
type action give(robot, robot) -o p($1, $0)
p(@3, $0)
?!q(_, $1)  ; led to by rule 0 at 2, rule 2 at _
?p(@4, $0)  ; led to by no rule
p($0, $1) -o give($0, $1) then !q($1, 1)  ; 2 slots
 -o [max $2 => $3, $2 | !q($0, $2) | !q($0, $3)]  ; 4 slots
 -o [count => $3 | !q($0, 7) | !q($0, $3)]  ; 4 slots
p: watch(p(@6, $1), p($1, $0), 5, give($0, $1))
"""


def test_every_construct_round_trips_and_is_disassembled() -> None:
    data = encode(everything(), debug=False)
    assert repr(decode(data)) == repr(everything())
    text = disassemble(data)
    assert [line for line in SHOWN.splitlines() if f": {line}\n" not in text] == []


def octets_of(program: Program, table: str) -> int:
    _entries, start, end = read_layout(encode(program, debug=False)).tables[table]
    return end - start


def test_leads_take_two_octets_each() -> None:
    program = everything()
    bare = replace(program, goals=tuple(replace(goal, leads=None) for goal in program.goals))
    assert octets_of(program, "goals") - octets_of(bare, "goals") == 2 * 2


def test_default_fields_of_an_assertion_take_no_octets() -> None:
    program = everything()
    usual = replace(program.assertions[0], robot=None, finisher=Slot(0))
    assert octets_of(program, "assertions") - octets_of(replace(program, assertions=(usual,)), "assertions") == 2


def test_terminal_control_sequences_are_shown_as_text() -> None:
    hand = Hand()
    p = hand.temporary("p", Type(Base.STRING))
    hand.facts.append(InitialFact(p, None, ("\x1b[2J\r",)))
    text = disassemble(encode(hand.program(), debug=False))
    assert r"\u001b[2J\u000d" in text
    assert text.replace("\n", "").isprintable()


def test_a_long_list_that_facts_share_is_shown_whole_once() -> None:
    hand = Hand()
    p = hand.temporary("p", Type(Base.LIST, element=INT))
    hand.facts.extend([InitialFact(p, None, (tuple(range(1000)),))] * 20)
    text = disassemble(encode(hand.program(), debug=False))
    assert text.count("998, 999]") == 1
    assert text.count("0, 1, 2, ") == 21


def test_entries_that_name_the_same_constant_or_expression_share_it() -> None:
    hand = Hand()
    p = hand.temporary("p", Type(Base.LIST, element=INT))
    hand.facts.extend([InitialFact(p, None, ((1, 2),))] * 2)
    hand.rules.extend(Rule(1, (hand.atom(p, (1, 2)),), (hand.head(p, code((1, 2))),)) for _ in range(2))
    program = decode(encode(hand.program(), debug=False))
    one, other = program.facts
    assert one.args[0] is other.args[0]
    first, second = (rule.head[0] for rule in program.rules)
    assert first.args[0] is second.args[0]  # type: ignore[union-attr]
    assert program.rules[0].body[0].args[0] is program.rules[1].body[0].args[0]  # type: ignore[union-attr]


def test_the_same_octets_are_the_same_program_as_long_as_they_are_remembered():
    octets = encode(sample(), debug=False)
    program = decode(octets)
    assert decode(bytes(bytearray(octets))) is program
    for number in range(REMEMBERED_MAX):
        hand = Hand()
        hand.fact(hand.persistent("q", INT), number)
        decode(encode(hand.program(), debug=False))
    assert decode(octets) is not program
    assert decode(octets) == program


def test_refused_octets_are_refused_again_and_evict_nothing_from_the_cache():
    octets = encode(sample(), debug=False)
    program = decode(octets)
    for number in range(2 * REMEMBERED_MAX):
        with pytest.raises(BytecodeError):
            decode(octets[:-1] + bytes([octets[-1] ^ 1]) if number % 2 else octets[:number])
    assert decode(octets) is program

"""Properties of the byte-code: nothing is lost on the way, and no octets but intact ones become a program."""

import zlib
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rmr.base.values import INT_MAX, INT_MIN, ROBOT_ID_MAX, Robot, Symbol, Value
from rmr.bytecode.codec import BytecodeError, decode, encode
from rmr.bytecode.disassemble import disassemble
from rmr.bytecode.layout import CRC_OFFSET, checksum
from rmr.bytecode.opcodes import FUNCTIONS, Op
from rmr.bytecode.program import (
    ANY,
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    Debug,
    DeriveAction,
    DeriveFact,
    DeriveGoal,
    Effect,
    Guard,
    Head,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Mode,
    Pattern,
    Place,
    Predicate,
    Program,
    Rule,
    Serving,
    Slot,
    Strategy,
    Type,
)
from rmr.bytecode.verify import verify
from rmr.bytecode.wire import identity

BASES = [base for base in Base if base is not Base.LIST]
BINARY = [Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.MOD, Op.EQ, Op.NE, Op.LT, Op.LE, Op.GT, Op.GE]


class Maker:
    """Draws a sound program from a seed, with every construct in reach."""

    def __init__(self, seed: int) -> None:
        self.rng = Random(seed)
        self.slots = 12
        count = self.rng.randint(2, 6)
        kinds = [self.type() for _ in range(count * 2)]
        self.bare = [
            Predicate(
                f"p{i}_{self.word()}",
                Kind.ACTION if i == 1 else Kind.TEMPORARY if i == 0 else self.rng.choice(list(Kind)),
                tuple(self.rng.choices(kinds, k=self.rng.randint(0, 3))),
                self.rng.random() < 0.2,
            )
            for i in range(count)
        ]
        self.facts = [i for i, p in enumerate(self.bare) if p.kind is not Kind.ACTION]
        self.actions = [i for i, p in enumerate(self.bare) if p.kind is Kind.ACTION]

    def word(self) -> str:
        return "".join(self.rng.choices("abcxyzäß_09", k=self.rng.randint(0, 6)))

    def type(self, depth: int = 0) -> Type:
        if depth < 3 and self.rng.random() < 0.2:
            return Type(Base.LIST, element=self.type(depth + 1) if self.rng.random() < 0.7 else None)
        base = self.rng.choice(BASES)
        return Type(base, self.word() if base is Base.SYMBOL else "")

    def value(self, kind: Type | None = None, depth: int = 0) -> Value:
        rng = self.rng
        base = kind.base if kind else Base.OPEN
        if base is Base.OPEN:
            base = rng.choice([base for base in Base if base is not Base.OPEN and (depth < 3 or base is not Base.LIST)])
            kind = None
        values: dict[Base, Value] = {
            Base.ROBOT: Robot(rng.choice([0, 1, 200, ROBOT_ID_MAX])),
            Base.INT: rng.choice([0, 1, -1, 300, INT_MAX, INT_MIN, rng.randint(-99, 99)]),
            Base.FLOAT: rng.choice([0.0, -0.0, 1.0, 1.5, -1e300, 5e-324, rng.random()]),
            Base.BOOL: rng.random() < 0.5,
            Base.STRING: self.word() + '"\n',
            Base.SYMBOL: Symbol("s" + self.word()),
        }
        if base is not Base.LIST:
            return values[base]
        element = kind.element if kind else None
        return tuple(self.value(element, depth + 1) for _ in range(rng.randint(0, 3)))

    def pattern(self, kind: Type, slots: int) -> Pattern:
        choice = self.rng.random()
        if choice < 0.2 or (choice < 0.6 and slots <= 1):
            return ANY
        return Slot(self.rng.randrange(slots)) if choice < 0.6 else Constant(self.value(kind))

    def patterns(self, predicate: int, slots: int) -> tuple[Pattern, ...]:
        return tuple(self.pattern(kind, slots) for kind in self.bare[predicate].types)

    def code(self, bound: list[int], depth: int = 0, now: bool = True) -> Code:
        rng = self.rng
        choice = rng.randrange(10 if depth < 3 else 3)
        if choice == 0:
            return (Instruction(Op.LOAD, rng.choice(bound)),)
        if choice == 1:
            return (Instruction(Op.INT, rng.randint(-(2**40), 2**40)),)
        if choice == 2:
            return (Instruction(Op.CONST, self.value()),)
        left, right = (self.code(bound, depth + 1, now) for _ in range(2))
        if choice in (3, 4):
            return (*left, *right, Instruction(rng.choice(BINARY)))
        if choice == 5:
            return (*left, Instruction(rng.choice([Op.NEG, Op.NOT, Op.FLOAT])))
        if choice == 6:
            return (*left, Instruction(rng.choice([Op.AND, Op.OR]), len(right)), *right)
        if choice == 7:
            other = self.code(bound, depth + 1, now)
            skip, leave = Instruction(Op.JUMP_IF_FALSE, len(right) + 1), Instruction(Op.JUMP, len(other))
            return (*left, skip, *right, leave, *other)
        if choice == 8:
            return (*left, *right, Instruction(Op.LIST, 2))
        index = rng.choice([i for i, f in enumerate(FUNCTIONS) if now or f.name != "now"])
        args = [self.code(bound, depth + 1, now) for _ in range(FUNCTIONS[index].arity)]
        return (*(item for arg in args for item in arg), Instruction(Op.CALL, index))

    def codes(self, predicate: int, bound: list[int]) -> tuple[Code, ...]:
        return tuple(self.code(bound) for _ in self.bare[predicate].types)

    def atom(self, slots: int) -> Atom:
        predicate = self.rng.choice(self.facts)
        modes = [Mode.CONSUME, Mode.KEEP] if self.bare[predicate].kind is Kind.TEMPORARY else [Mode.READ]
        return Atom(predicate, self.patterns(predicate, slots), self.rng.choice([*modes, *modes, Mode.ABSENT]))

    def body(self, bound: list[int], slots: range) -> tuple[Conjunct, ...]:
        """A body that may bind `slots`; `bound` grows."""
        body: list[Conjunct] = []
        for _ in range(self.rng.randint(0, 4)):
            free = [slot for slot in slots if slot not in bound]
            choice = self.rng.random()
            if choice < 0.6:
                atom = self.atom(1)
                names = [*bound, *free]
                args = tuple(
                    Slot(self.rng.choice(names)) if isinstance(arg, Slot) or self.rng.random() < 0.4 else arg
                    for arg in atom.args
                )
                body.append(Atom(atom.predicate, args, atom.mode))
                if atom.mode is not Mode.ABSENT:
                    bound.extend(arg.index for arg in args if isinstance(arg, Slot) and arg.index not in bound)
            elif choice < 0.8 or not free:
                body.append(Guard(self.code(bound, now=False)))
            else:
                body.append(Bind(free[0], self.code(bound, now=False)))
                bound.append(free[0])
        return tuple(body)

    def simple(self, bound: list[int]) -> DeriveFact | DeriveGoal | DeriveAction:
        kind = self.rng.choice([DeriveFact, DeriveGoal, DeriveAction])
        predicate = self.rng.choice(self.actions if kind is DeriveAction else self.facts)
        return kind(predicate, self.code(bound), self.codes(predicate, bound))

    def rule(self) -> Rule:
        bound = [0]
        body = self.body(bound, range(self.slots // 2))
        head: list[Head] = []
        for _ in range(self.rng.randint(0, 3)):
            if self.rng.random() < 0.7:
                head.append(self.simple(bound))
                continue
            inner = bound.copy()
            middle = self.body(inner, range(self.slots // 2, self.slots))
            new = tuple(slot for slot in inner if slot not in bound)
            head.append(Comprehension(new, middle, tuple(self.simple(inner) for _ in range(2))))
        return Rule(self.slots, body, tuple(head))

    def assertion(self) -> Assertion:
        start, finish = self.atom(self.slots), self.atom(self.slots)
        bound = [0, *(arg.index for arg in start.args if isinstance(arg, Slot))]
        action = self.rng.choice(self.actions)
        serving = tuple(Serving(a, self.patterns(a, self.slots)) for a in self.rng.choices(self.actions, k=2))
        return Assertion(
            "a" + self.word(),
            self.slots,
            start,
            finish,
            self.code(bound),
            DeriveAction(action, self.code(bound), self.codes(action, bound)),
            self.rng.random() < 0.5,
            serving,
        )

    def effects(self, predicate: Predicate) -> tuple[Effect, ...]:
        bound = list(range(len(predicate.types) + 1))
        chosen = self.rng.choices(self.facts, k=self.rng.randint(0, 2))
        return tuple(Effect(index, self.codes(index, bound)) for index in chosen)

    def complete(self, predicate: Predicate) -> Predicate:
        if predicate.kind is not Kind.ACTION:
            return predicate
        name, kind, types, provided = predicate.name, predicate.kind, predicate.types, predicate.provided
        return Predicate(name, kind, types, provided, self.effects(predicate), self.effects(predicate))

    def program(self) -> Program:
        rng = self.rng
        some = [rng.choice(self.facts) for _ in range(6)]
        return Program(
            tuple(map(self.complete, self.bare)),
            tuple(InitialFact(p, rng.choice([None, 0, 7]), tuple(map(self.value, self.bare[p].types))) for p in some),
            tuple(InitialGoal(p, rng.choice([None, 9]), self.patterns(p, 0)) for p in some),  # type: ignore[arg-type]
            tuple(self.rule() for _ in range(rng.randint(0, 5))),
            tuple(self.assertion() for _ in range(rng.randint(0, 2))),
            rng.choice(list(Strategy)),
            Debug((Place("a.rmr", rng.randint(1, 999), 1), Place("b.rmr", 2, 2)), (), (Place("a.rmr", 1, 1),)),
        )


programs = st.integers(0, 2**32).map(lambda seed: Maker(seed).program())
few = settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def reseal(octets: bytearray) -> bytes:
    """Make size and CRC-32 right again, as somebody would who means harm."""
    octets[6:10] = len(octets).to_bytes(4, "little")
    octets[CRC_OFFSET : CRC_OFFSET + 4] = checksum(bytes(octets)).to_bytes(4, "little")
    return bytes(octets)


@few
@given(programs)
def test_a_program_comes_back_as_it_was(program: Program) -> None:
    assert verify(program) == []
    back = decode(encode(program, debug=True))
    assert repr(back) == repr(program)
    assert repr(decode(encode(program, debug=False)).rules) == repr(program.rules)


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
    data = reseal(bytearray(b"RMR\x1a\x01" + bytes([flags]) + bytes(8) + octets))
    try:
        program = decode(data)
    except BytecodeError:
        return
    assert verify(program) == []


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

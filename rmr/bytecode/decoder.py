"""Decoder: the octets of the tables to a program; the inverse of `encoder`.

Checked here is only what reading on depends on: indices, counts, tags, nesting. Soundness of the program is checked
by the verifier. Entries with the same index share one constant or expression object, so that a program takes memory
in proportion to its octets. On request the decoder notes each part with its offsets, for the disassembler.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

from rmr.base.values import Symbol, Value
from rmr.bytecode.conform import NESTING_MAX
from rmr.bytecode.encoder import (
    AGGREGATE,
    BEST,
    BIND,
    COMPREHENSION,
    FINISHED_ELSEWHERE,
    FOLD,
    FOR_ONE,
    GOALS,
    GUARD,
    HERE,
    KIND_MASK,
    LIST_OF_ANYTHING,
    PROVIDED,
    SCHEDULED,
    STEPS,
    TAGS,
    UNORDERED,
    VALUE,
    WHEN,
)
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.layout import FLAG_DEADLINE, FLAG_DEBUG, FLAG_ENSEMBLE, FLAG_TEXTUAL, Layout
from rmr.bytecode.octets import Reader
from rmr.bytecode.opcodes import FORMS, Op, Operand
from rmr.bytecode.program import (
    ANY,
    GOALS_OF,
    REFERRING_DUTIES,
    Aggregate,
    Anything,
    Assertion,
    Atom,
    Base,
    Best,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    Debug,
    DeriveAction,
    Derived,
    DeriveFact,
    Duty,
    Effect,
    Fold,
    Guard,
    Head,
    HeadValue,
    HiddenPredicate,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Lead,
    Mode,
    Operator,
    OwnFunction,
    Pattern,
    Place,
    Predicate,
    Program,
    Rule,
    Serving,
    Slot,
    Steps,
    Strategy,
    Type,
    When,
)

T = TypeVar("T")

OPS = {int(op): op for op in Op}
"""Opcodes by octet: a lookup is cheaper than `Op(octet)` and returns None for an unknown one."""
DERIVED = {tag: kind for kind, tag in TAGS.items()}
"""Classes of derived items by the tag of a head."""


INSTRUCTION = "instruction"
"""The `table` of a note about one instruction of an expression."""


class Note(NamedTuple):
    """The decoded meaning of the octets ``start`` to ``end`` (exclusive)."""

    table: str
    start: int
    end: int
    what: object


class _Raw(NamedTuple):
    """A predicate with the number of its effects; the effects have a table of their own, which is read later."""

    name: str
    kind: Kind
    provided: bool
    types: tuple[Type, ...]
    effects: int
    else_effects: int
    best: Best | None
    unordered: bool


def decode_tables(data: bytes, layout: Layout, notes: list[Note] | None = None) -> Program:
    """Return the program in `data`, unverified.

    Raises:
        BytecodeError: a table is malformed.
    """
    return _Decoder(data, layout, notes).program()


class _Decoder:
    """Reads the tables in order of dependence: an entry refers to earlier tables only."""

    def __init__(self, data: bytes, layout: Layout, notes: list[Note] | None) -> None:
        self.data = data
        self.layout = layout
        self.notes = notes
        self.constants: list[Value] = []
        self.codes: list[Code] = []
        self.raw: list[_Raw] = []
        # Shared instances: an instruction without operand and an equal pattern are one object each.
        self.bare = {op: Instruction(op) for op, form in FORMS.items() if form.operand is Operand.NONE}
        self.shared: dict[int, Pattern] = {0: ANY}
        # Expressions come before the functions that they call: those are made empty and filled by `function`.
        self.functions = [OwnFunction("", 0) for _ in range(layout.tables["functions"].entries)]
        self.filled = 0
        self.within = False
        """Whether the body of a fold is being read."""

    def program(self) -> Program:
        self.constants = self.table("constants", Reader.value)
        self.codes = self.table("code", self.code)
        functions = tuple(self.table("functions", self.function))
        self.raw = self.table("predicates", self.predicate)
        effects = self.table("effects", self.effect)
        flags = self.layout.flags
        deadline = Strategy.DEADLINE if flags & FLAG_DEADLINE else Strategy.RANDOM
        strategy = Strategy.TEXTUAL if flags & FLAG_TEXTUAL else deadline
        return Program(
            predicates=self.predicates(effects),
            facts=tuple(self.table("facts", self.fact)),
            goals=tuple(self.table("goals", self.goal)),
            rules=tuple(self.table("rules", self.rule)),
            assertions=tuple(self.table("assertions", self.assertion)),
            strategy=strategy,
            functions=functions,
            debug=self.debug(),
            ensemble=self.ensemble(),
        )

    def table(self, name: str, read: Callable[[Reader], T]) -> list[T]:
        """Return the entries of a table; octets left over are an error."""
        count, start, end = self.layout.tables[name]
        reader = Reader(self.data, start, end)
        entries = []
        for _ in range(count):
            begin = reader.position
            entries.append(read(reader))
            if self.notes is not None:
                self.notes.append(Note(name, begin, reader.position, entries[-1]))
        if reader.position != end:
            raise reader.fail(f"{end - reader.position} octets too many in the table of {name}")
        return entries

    # Tuples are built from lists, not from generators: that is faster, and every entry comes through here.
    def code(self, reader: Reader) -> Code:
        return tuple([self.instruction(reader) for _ in range(reader.count())])

    def instruction(self, reader: Reader) -> Instruction:
        begin = reader.position
        octet = reader.octet()
        op = OPS.get(octet)
        if op is None:
            raise reader.fail(f"unknown opcode 0x{octet:02x}")
        bare = self.bare.get(op)
        instruction = self.loaded(reader, op) if bare is None else bare
        if self.notes is not None:
            self.notes.append(Note(INSTRUCTION, begin, reader.position, instruction))
        return instruction

    def loaded(self, reader: Reader, op: Op) -> Instruction:
        """Return an instruction with an operand."""
        if op is Op.APPLY:
            index = reader.index(len(self.functions), "functions of the program")
            return Instruction(op, index, self.functions[index])
        return Instruction(op, self.operand(reader, FORMS[op].operand))

    def function(self, reader: Reader) -> OwnFunction:
        function = self.functions[self.filled]
        self.filled += 1
        function.name = self.name(reader)
        function.arity = reader.varint()
        function.code = self.expression(reader)
        return function

    def operand(self, reader: Reader, form: Operand) -> Value:
        if form is Operand.CONSTANT:
            return self.constant(reader)
        if form is Operand.SMALL:
            return reader.zigzag()
        if form is Operand.FUNCTION:
            return reader.index(len(FUNCTIONS), "functions")
        return reader.varint()

    def constant(self, reader: Reader) -> Value:
        return self.constants[reader.index(len(self.constants), "constants")]

    def expression(self, reader: Reader) -> Code:
        return self.codes[reader.index(len(self.codes), "expressions")]

    def name(self, reader: Reader) -> str:
        value = self.constant(reader)
        if not isinstance(value, Symbol):
            raise reader.fail("a name that is not a symbol")
        return str(value)

    def predicate(self, reader: Reader) -> _Raw:
        octet = reader.octet()
        if octet & ~(KIND_MASK | PROVIDED | BEST | GOALS | UNORDERED):
            raise reader.fail(f"unknown kind of predicate 0x{octet:02x}")
        kind = Kind(octet & KIND_MASK)
        name = (GOALS_OF if octet & GOALS else "") + self.name(reader)
        types = tuple([self.type(reader) for _ in range(reader.count())])
        best = self.best(reader) if octet & BEST else None
        limit = self.layout.tables["effects"].entries
        counts = (reader.count(limit), reader.count(limit)) if kind is Kind.ACTION else (0, 0)
        return _Raw(name, kind, bool(octet & PROVIDED), types, *counts, best, bool(octet & UNORDERED))

    @staticmethod
    def best(reader: Reader) -> Best:
        number = reader.varint()
        return Best(number >> 1, bool(number & 1))

    def type(self, reader: Reader, nesting: int = 0) -> Type:
        octet = reader.octet()
        if octet == LIST_OF_ANYTHING:
            return Type(Base.LIST)
        if octet > LIST_OF_ANYTHING or nesting > NESTING_MAX:
            raise reader.fail(f"unknown or too deeply nested type {octet}")
        base = Base(octet)
        if base is Base.SYMBOL:
            return Type(base, self.name(reader))
        return Type(base, element=self.type(reader, nesting + 1)) if base is Base.LIST else Type(base)

    def predicates(self, effects: list[Effect]) -> tuple[Predicate, ...]:
        """Return the predicates, each action with its slice of the table of effects."""
        reader = Reader(self.data, self.layout.tables["effects"].end, self.layout.tables["effects"].end)
        if sum(raw.effects + raw.else_effects for raw in self.raw) != len(effects):
            raise reader.fail("the actions' effects do not fill their table")
        rest = iter(effects)
        predicates = []
        for raw in self.raw:
            done = tuple([next(rest) for _ in range(raw.effects)])
            failed = tuple([next(rest) for _ in range(raw.else_effects)])
            predicates.append(
                Predicate(raw.name, raw.kind, raw.types, raw.provided, done, failed, raw.best, raw.unordered)
            )
        return tuple(predicates)

    def predicate_index(self, reader: Reader) -> int:
        return reader.index(len(self.raw), "predicates")

    def codes_for(self, reader: Reader, predicate: int) -> tuple[Code, ...]:
        return tuple([self.expression(reader) for _ in self.raw[predicate].types])

    def effect(self, reader: Reader) -> Effect:
        owner = self.expression(reader)
        predicate = self.predicate_index(reader)
        return Effect(predicate, self.codes_for(reader, predicate), owner)

    def owner(self, reader: Reader) -> int | None:
        # 0: every robot; else the robot's id plus 1.
        number = reader.varint()
        return None if number == 0 else number - 1

    def fact(self, reader: Reader) -> InitialFact:
        predicate = self.predicate_index(reader)
        owner = self.owner(reader)
        args: list[Value | Slot] = []
        for pattern in self.patterns(reader, predicate):
            if isinstance(pattern, Anything):
                raise reader.fail("a fact that leaves an argument open")
            args.append(pattern if isinstance(pattern, Slot) else pattern.value)
        return InitialFact(predicate, owner, tuple(args))

    def goal(self, reader: Reader) -> InitialGoal:
        predicate = self.predicate_index(reader)
        owner = self.owner(reader)
        return InitialGoal(predicate, owner, self.patterns(reader, predicate), self.leads(reader))

    @staticmethod
    def leads(reader: Reader) -> tuple[Lead, ...] | None:
        # 0: not computed; else the count plus 1. Rules ascend: each is written as the number of rules skipped.
        count = reader.varint()
        if count == 0:
            return None
        leads: list[Lead] = []
        rule = 0
        for _ in range(reader.fits(count - 1)):
            rule += reader.varint()
            rank = reader.varint()
            leads.append(Lead(rule, None if rank == 0 else rank - 1))
            rule += 1
        return tuple(leads)

    def patterns(self, reader: Reader, predicate: int) -> tuple[Pattern, ...]:
        return tuple([self.pattern(reader) for _ in self.raw[predicate].types])

    def pattern(self, reader: Reader) -> Pattern:
        number = reader.varint()
        known = self.shared.get(number)
        if known is None:
            known = self.shared[number] = self.new_pattern(reader, number)
        return known

    def new_pattern(self, reader: Reader, number: int) -> Pattern:
        # The lowest bit tells slots (odd) from constants (even, from 2: 0 is the wildcard).
        if number & 1:
            return Slot(number >> 1)
        index = (number >> 1) - 1
        if index >= len(self.constants):
            raise reader.fail(f"index {index} into {len(self.constants)} constants")
        return Constant(self.constants[index])

    def rule(self, reader: Reader) -> Rule:
        return Rule(reader.varint(), self.body(reader), tuple([self.head(reader) for _ in range(reader.count())]))

    def body(self, reader: Reader) -> tuple[Conjunct, ...]:
        return tuple([self.conjunct(reader) for _ in range(reader.count())])

    def conjunct(self, reader: Reader) -> Conjunct:
        tag = reader.octet()
        if tag == GUARD:
            return Guard(self.expression(reader))
        if tag == BIND:
            return Bind(reader.varint(), self.expression(reader))
        if FOLD <= tag < FOLD + len(Operator):
            return self.fold(reader, Operator(tag - FOLD))
        return self.atom(reader, tag)

    def fold(self, reader: Reader, operator: Operator) -> Fold:
        if self.within:
            raise reader.fail("a fold within a fold")
        self.within = True
        fold = Fold(operator, *self.gathered(reader, operator))
        self.within = False
        return fold

    def gathered(
        self, reader: Reader, operator: Operator
    ) -> tuple[Code | None, int, tuple[int, ...], tuple[Conjunct, ...]]:
        """Return term, result, slots and body of a fold or an aggregate."""
        term = None if operator is Operator.COUNT else self.expression(reader)
        return term, reader.varint(), self.slots(reader), self.body(reader)

    def atom(self, reader: Reader, tag: int) -> Atom:
        if tag > Mode.ABSENT:
            raise reader.fail(f"unknown kind of conjunct {tag}")
        predicate = self.predicate_index(reader)
        return Atom(predicate, self.patterns(reader, predicate), Mode(tag))

    def head(self, reader: Reader) -> Head:
        tag = reader.octet()
        if tag == VALUE:
            return HeadValue(reader.varint(), self.expression(reader))
        if tag == WHEN:
            return When(reader.varint(), self.part(reader, reader.octet()))
        return self.part(reader, tag)

    def part(self, reader: Reader, tag: int) -> Comprehension | Aggregate | Steps | Derived:
        if tag == COMPREHENSION:
            return Comprehension(self.slots(reader), self.body(reader), self.items(reader))
        if tag == STEPS:
            return Steps(self.items(reader))
        if AGGREGATE <= tag < AGGREGATE + len(Operator):
            return self.aggregate(reader, Operator(tag - AGGREGATE))
        return self.item(reader, tag)

    def aggregate(self, reader: Reader, operator: Operator) -> Aggregate:
        return Aggregate(operator, *self.gathered(reader, operator), self.items(reader))

    @staticmethod
    def slots(reader: Reader) -> tuple[int, ...]:
        return tuple([reader.varint() for _ in range(reader.count())])

    def items(self, reader: Reader) -> tuple[Derived, ...]:
        return tuple([self.item(reader, reader.octet()) for _ in range(reader.count())])

    def item(self, reader: Reader, tag: int) -> Derived:
        kind = DERIVED.get(tag)
        if kind is None:
            raise reader.fail(f"unknown or misplaced kind of head {tag}")
        owner = self.expression(reader)
        predicate = self.predicate_index(reader)
        return kind(predicate, owner, self.codes_for(reader, predicate))

    def assertion(self, reader: Reader) -> Assertion:
        flags = reader.octet()
        if flags & ~(SCHEDULED | FOR_ONE | FINISHED_ELSEWHERE):
            raise reader.fail(f"unknown kind of assertion 0x{flags:02x}")
        # Keyword arguments are evaluated in the order written here, which is the order of the octets.
        return Assertion(
            robot=reader.varint() if flags & FOR_ONE else None,
            finisher=self.finisher(reader) if flags & FINISHED_ELSEWHERE else HERE,
            name=self.name(reader),
            slots=reader.varint(),
            start=self.atom(reader, reader.octet()),
            finish=self.atom(reader, reader.octet()),
            deadline=self.expression(reader),
            violation=self.violation(reader),
            scheduled=bool(flags & SCHEDULED),
            serving=tuple([self.serving(reader) for _ in range(reader.count())]),
        )

    def finisher(self, reader: Reader) -> Slot | Constant:
        pattern = self.pattern(reader)
        if isinstance(pattern, Anything):
            raise reader.fail("an assertion that leaves open who finishes it")
        return pattern

    def violation(self, reader: Reader) -> DeriveAction | DeriveFact:
        owner = self.expression(reader)
        predicate = self.predicate_index(reader)
        derive = DeriveAction if self.raw[predicate].kind is Kind.ACTION else DeriveFact
        return derive(predicate, owner, self.codes_for(reader, predicate))

    def serving(self, reader: Reader) -> Serving:
        action = self.predicate_index(reader)
        return Serving(action, self.patterns(reader, action))

    def ensemble(self) -> tuple[HiddenPredicate, ...]:
        if not self.layout.flags & FLAG_ENSEMBLE:
            return ()
        entries = tuple(self.table("ensemble", self.hidden))
        if not entries:
            raise Reader(self.data, 0, 0).fail("the table of ensemble rules contradicts the flags")
        return entries

    def hidden(self, reader: Reader) -> HiddenPredicate:
        predicate = self.predicate_index(reader)
        duty = reader.octet()
        if duty >= len(Duty):
            raise reader.fail(f"unknown duty {duty} of a predicate")
        refers = duty in REFERRING_DUTIES
        return HiddenPredicate(predicate, Duty(duty), self.predicate_index(reader) if refers else None)

    def debug(self) -> Debug | None:
        entries = self.table("debug", self.debug_entry)
        if len(entries) != (1 if self.layout.flags & FLAG_DEBUG else 0):
            raise Reader(self.data, 0, 0).fail("the debug table contradicts the flags")
        return entries[0] if entries else None

    def debug_entry(self, reader: Reader) -> Debug:
        files = [reader.text() for _ in range(reader.count())]
        rules, assertions, predicates = [
            tuple([self.place(reader, files) for _ in range(reader.count())]) for _ in range(3)
        ]
        return Debug(rules, assertions, predicates)

    def place(self, reader: Reader, files: list[str]) -> Place:
        return Place(files[reader.index(len(files), "files")], reader.varint(), reader.varint())

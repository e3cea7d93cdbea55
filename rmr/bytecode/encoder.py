"""Encoder: a program to the octets of its tables; the inverse of `decoder`.

Constants and expressions are pooled: each distinct one is written once and referred to by its index. The owner
expression of nearly every head thus costs one octet. A pattern is one varint: 0 for the wildcard, odd for a slot,
even for a constant. The number of arguments of an entry is not written: it follows from the predicate.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

from rmr.base.values import Symbol, Value
from rmr.bytecode.octets import Writer, identity
from rmr.bytecode.opcodes import FORMS, Operand
from rmr.bytecode.program import (
    GOALS_OF,
    SELF_SLOT,
    Aggregate,
    Anything,
    Assertion,
    Atom,
    Base,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    Debug,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
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
    Type,
    When,
)

GUARD = 4
"""Tag of a guard among conjuncts; tags 0 to 3 are atoms, with the mode as tag."""
BIND = 5
"""Tag of a binding among conjuncts."""
FOLD = 6
"""Tag of a fold among conjuncts, plus its operator."""
FACT, GOAL, ACTION, COMPREHENSION, STEPS, AGGREGATE = range(6)
"""Tags of heads; an aggregate's tag is AGGREGATE plus its operator."""
VALUE = AGGREGATE + len(Operator)
"""Tag of a value that a head works out."""
WHEN = VALUE + 1
"""Tag of a conditional item; the slot of its condition and the item follow."""
LIST_OF_ANYTHING = 8
"""Tag of a list type without an element type; tags 0 to 7 are the bases."""
KIND_MASK = 3
"""Bits of a predicate's first octet that hold its kind."""
PROVIDED = 4
"""Bit of a predicate's first octet: the predicate is provided."""
BEST = 8
"""Bit of a predicate's first octet: which facts are kept follows its types, the argument times 2, plus 1 for min."""
GOALS = 16
"""Bit of a predicate's first octet: it stands for the open goals of the predicate whose name is written."""
UNORDERED = 32
"""Bit of a predicate's first octet: what is sent of it takes effect when it arrives."""
SCHEDULED = 1
"""Bit of an assertion's first octet: `assert`, not `watch`."""
FOR_ONE = 2
"""Bit of an assertion's first octet: the one robot that has such jobs follows."""
FINISHED_ELSEWHERE = 4
"""Bit of an assertion's first octet: the finisher follows."""

HERE = Slot(SELF_SLOT)
"""The default finisher, which is not written: the robot of the job."""

TAGS: dict[type[Derived], int] = {DeriveFact: FACT, DeriveGoal: GOAL, DeriveAction: ACTION}
"""Tags of heads by class of the derived item."""

T = TypeVar("T")


class Pools:
    """The constants and expressions written so far, in the order of their first use."""

    def __init__(self) -> None:
        self.constants: dict[tuple[str, object], int] = {}
        self.values: list[Value] = []
        self.codes: dict[tuple[object, ...], int] = {}
        self.code = Writer()

    def constant(self, value: Value) -> int:
        """Return the index of `value`."""
        # Not the value itself as key: 1, 1.0, True and robot 1 are equal and have different octets.
        key = identity(value)
        if key not in self.constants:
            self.constants[key] = len(self.values)
            self.values.append(value)
        return self.constants[key]

    def expression(self, code: Code) -> int:
        """Return the index of `code`."""
        key = tuple((i.op, None if i.operand is None else identity(i.operand)) for i in code)
        if key not in self.codes:
            self.codes[key] = len(self.codes)
            self.code.varint(len(code))
            for instruction in code:
                self._instruction(instruction)
        return self.codes[key]

    def _instruction(self, instruction: Instruction) -> None:
        self.code.octet(instruction.op)
        form = FORMS[instruction.op].operand
        operand = instruction.operand
        if form is Operand.NONE:
            return
        assert operand is not None  # verified before
        if form is Operand.CONSTANT:
            self.code.varint(self.constant(operand))
            return
        assert isinstance(operand, int)
        if form is Operand.SMALL:
            self.code.zigzag(operand)
        else:
            self.code.varint(operand)


def encode_tables(program: Program, debug: bool) -> dict[str, tuple[int, bytes]]:
    """Return (number of entries, octets) for each table of `program`, which is verified."""
    encoder = _Encoder(program)
    effects = [e for p in program.predicates for e in (*p.effects, *p.else_effects)]
    tables = {
        "functions": _table(program.functions, encoder.function),
        "predicates": _table(program.predicates, encoder.predicate),
        "effects": _table(effects, encoder.derived),
        "facts": _table(program.facts, encoder.fact),
        "goals": _table(program.goals, encoder.goal),
        "rules": _table(program.rules, encoder.rule),
        "assertions": _table(program.assertions, encoder.assertion),
        "debug": _debug_table(program.debug if debug else None),
    }
    if program.ensemble:
        tables["ensemble"] = _table(program.ensemble, encoder.hidden)
    # The pools last: encoding the other tables fills them.
    pools = encoder.pools
    tables["code"] = (len(pools.codes), bytes(pools.code.octets))
    tables["constants"] = _table(pools.values, lambda writer, value: writer.value(value))
    return tables


def _table(entries: Iterable[T], write: Callable[[Writer, T], None]) -> tuple[int, bytes]:
    writer = Writer()
    count = 0
    for entry in entries:
        write(writer, entry)
        count += 1
    return count, bytes(writer.octets)


def _debug_table(debug: Debug | None) -> tuple[int, bytes]:
    """Return the debug table: the file names, then the places of rules, assertions and predicates."""
    if debug is None:
        return 0, b""
    writer = Writer()
    groups = (debug.rules, debug.assertions, debug.predicates)
    files = list(dict.fromkeys(place.file for group in groups for place in group))
    writer.varint(len(files))
    for file in files:
        writer.text(file)
    for group in groups:
        writer.varint(len(group))
        for place in group:
            _place(writer, place, files)
    return 1, bytes(writer.octets)


def _place(writer: Writer, place: Place, files: list[str]) -> None:
    writer.varint(files.index(place.file))
    writer.varint(place.line)
    writer.varint(place.column)


class _Encoder:
    """Writes entries of each kind; holds the pools they refer to."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.pools = Pools()

    def function(self, writer: Writer, function: OwnFunction) -> None:
        writer.varint(self.pools.constant(Symbol(function.name)))
        writer.varint(function.arity)
        writer.varint(self.pools.expression(function.code))

    def predicate(self, writer: Writer, predicate: Predicate) -> None:
        best = predicate.best
        bits = PROVIDED * predicate.provided | BEST * (best is not None) | UNORDERED * predicate.unordered
        goals = predicate.name.startswith(GOALS_OF)
        writer.octet(predicate.kind | bits | GOALS * goals)
        writer.varint(self.pools.constant(Symbol(predicate.name.removeprefix(GOALS_OF))))
        writer.varint(len(predicate.types))
        for kind in predicate.types:
            self.type(writer, kind)
        if best is not None:
            writer.varint(best.argument * 2 + best.least)
        if predicate.kind is Kind.ACTION:
            writer.varint(len(predicate.effects))
            writer.varint(len(predicate.else_effects))

    @staticmethod
    def hidden(writer: Writer, hidden: HiddenPredicate) -> None:
        writer.varint(hidden.predicate)
        writer.octet(hidden.duty)
        if hidden.other is not None:
            writer.varint(hidden.other)

    def type(self, writer: Writer, kind: Type) -> None:
        if kind.base is Base.LIST and kind.element is None:
            writer.octet(LIST_OF_ANYTHING)
            return
        writer.octet(kind.base)
        if kind.base is Base.SYMBOL:
            writer.varint(self.pools.constant(Symbol(kind.name)))
        if kind.element is not None:
            self.type(writer, kind.element)

    def derived(self, writer: Writer, item: Effect | Derived) -> None:
        """Write the owner, the predicate and the arguments."""
        writer.varint(self.pools.expression(item.owner))
        writer.varint(item.predicate)
        for code in item.args:
            writer.varint(self.pools.expression(code))

    def fact(self, writer: Writer, fact: InitialFact) -> None:
        self._owned(writer, fact.predicate, fact.owner)
        self.patterns(writer, [arg if isinstance(arg, Slot) else Constant(arg) for arg in fact.args])

    def goal(self, writer: Writer, goal: InitialGoal) -> None:
        self._owned(writer, goal.predicate, goal.owner)
        self.patterns(writer, goal.args)
        self.leads(writer, goal.leads)

    def leads(self, writer: Writer, leads: tuple[Lead, ...] | None) -> None:
        """Write the count plus 1, or 0 if the leads are not computed; each rule as the number of rules skipped."""
        writer.varint(0 if leads is None else len(leads) + 1)
        expected = 0
        for lead in leads or ():
            writer.varint(lead.rule - expected)
            writer.varint(0 if lead.rank is None else lead.rank + 1)
            expected = lead.rule + 1

    def _owned(self, writer: Writer, predicate: int, owner: int | None) -> None:
        writer.varint(predicate)
        writer.varint(0 if owner is None else owner + 1)

    def patterns(self, writer: Writer, patterns: Iterable[Pattern]) -> None:
        for pattern in patterns:
            self.pattern(writer, pattern)

    def pattern(self, writer: Writer, pattern: Pattern) -> None:
        if isinstance(pattern, Anything):
            writer.varint(0)
        elif isinstance(pattern, Slot):  # odd numbers; constants take the even ones from 2
            writer.varint(pattern.index * 2 + 1)

        else:
            writer.varint(self.pools.constant(pattern.value) * 2 + 2)

    def rule(self, writer: Writer, rule: Rule) -> None:
        writer.varint(rule.slots)
        self.body(writer, rule.body)
        self.heads(writer, rule.head)

    def body(self, writer: Writer, body: tuple[Conjunct, ...]) -> None:
        writer.varint(len(body))
        for conjunct in body:
            if isinstance(conjunct, Atom):
                self.atom(writer, conjunct)
            elif isinstance(conjunct, Fold):
                writer.octet(FOLD + conjunct.operator)
                self.gathered(writer, conjunct)
            elif isinstance(conjunct, Guard):
                writer.octet(GUARD)
                writer.varint(self.pools.expression(conjunct.code))
            else:
                writer.octet(BIND)
                writer.varint(conjunct.slot)
                writer.varint(self.pools.expression(conjunct.code))

    def atom(self, writer: Writer, atom: Atom) -> None:
        writer.octet(atom.mode)
        writer.varint(atom.predicate)
        self.patterns(writer, atom.args)

    def heads(self, writer: Writer, heads: Sequence[Head]) -> None:
        writer.varint(len(heads))
        for head in heads:
            self.head(writer, head)

    def head(self, writer: Writer, head: Head) -> None:
        match head:
            case Comprehension():
                writer.octet(COMPREHENSION)
                self.slots(writer, head.slots)
                self.body(writer, head.body)
                self.heads(writer, head.head)
            case Steps():
                writer.octet(STEPS)
                self.heads(writer, head.steps)
            case Aggregate():
                self.aggregate(writer, head)
            case HeadValue():
                writer.octet(VALUE)
                writer.varint(head.slot)
                writer.varint(self.pools.expression(head.code))
            case When():
                writer.octet(WHEN)
                writer.varint(head.slot)
                self.head(writer, head.item)
            case DeriveFact() | DeriveGoal() | DeriveAction():
                writer.octet(TAGS[type(head)])
                self.derived(writer, head)

    def aggregate(self, writer: Writer, head: Aggregate) -> None:
        writer.octet(AGGREGATE + head.operator)
        self.gathered(writer, head)
        self.heads(writer, head.head)

    def gathered(self, writer: Writer, part: Aggregate | Fold) -> None:
        """Write what is gathered, and where it goes."""
        if part.term is not None:
            writer.varint(self.pools.expression(part.term))
        writer.varint(part.result)
        self.slots(writer, part.slots)
        self.body(writer, part.body)

    @staticmethod
    def slots(writer: Writer, slots: tuple[int, ...]) -> None:
        writer.varint(len(slots))
        for slot in slots:
            writer.varint(slot)

    def assertion(self, writer: Writer, assertion: Assertion) -> None:
        for_one = assertion.robot is not None
        elsewhere = assertion.finisher != HERE
        writer.octet(SCHEDULED * assertion.scheduled | FOR_ONE * for_one | FINISHED_ELSEWHERE * elsewhere)
        if assertion.robot is not None:
            writer.varint(assertion.robot)
        if elsewhere:
            self.pattern(writer, assertion.finisher)
        writer.varint(self.pools.constant(Symbol(assertion.name)))
        writer.varint(assertion.slots)
        self.atom(writer, assertion.start)
        self.atom(writer, assertion.finish)
        writer.varint(self.pools.expression(assertion.deadline))
        self.derived(writer, assertion.violation)
        writer.varint(len(assertion.serving))
        for serving in assertion.serving:
            self.serving(writer, serving)

    def serving(self, writer: Writer, serving: Serving) -> None:
        writer.varint(serving.action)
        self.patterns(writer, serving.args)

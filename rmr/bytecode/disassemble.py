"""The disassembler: byte-code as text, every octet of a file with its offset and its meaning.

Each line holds the offset in hex, the octets and their meaning. Variables are written as slots (``$0`` is the
robot itself), expressions in postfix (``{$1 s EQ}``), in the order of execution.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import TypeVar

from rmr.base.printable import counted, shortened
from rmr.base.values import Value, format_value
from rmr.bytecode.decoder import INSTRUCTION, Note, decode_tables
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.layout import (
    CRC_OFFSET,
    FLAG_WORDS,
    HEADER,
    SIGNED_HEAD,
    TABLES,
    VERSION,
    Layout,
    read_layout,
    split,
    tables_of,
)
from rmr.bytecode.opcodes import FORMS, Op, Operand
from rmr.bytecode.program import (
    Aggregate,
    Anything,
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Debug,
    DeriveAction,
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
    Mode,
    OwnFunction,
    Pattern,
    Place,
    Predicate,
    Program,
    Rule,
    Slot,
    Steps,
    Type,
    When,
)

OCTETS_SHOWN = 12
"""Octets on a line; a longer entry continues on lines without text."""

SHARED_MAX = 200
"""Characters shown of a constant or expression at its uses, since many entries may share a long one."""

T = TypeVar("T")

_KINDS = {Kind.TEMPORARY: "type ", Kind.PERSISTENT: "type !", Kind.SENSED: "type sensor ", Kind.ACTION: "type action "}
_MODES = {Mode.CONSUME: "", Mode.READ: "", Mode.KEEP: "$", Mode.ABSENT: "not "}


def disassemble(data: bytes) -> str:
    """Return `data` as annotated text, one line for each entry, offsets in hex.

    Raises:
        BytecodeError: `data` is no byte-code of this version, damaged or malformed.
    """
    notes: list[Note] = []
    whole, (data, certificate, signature) = data, split(data)
    layout = read_layout(data)
    text = _Text(decode_tables(data, layout, notes))
    entries = {table: [note for note in notes if note.table == table] for table in tables_of(layout.flags)}
    instructions = iter([note for note in notes if note.table == INSTRUCTION])
    lines = list(_header(data, layout))
    for table in tables_of(layout.flags):
        count, start, end = layout.tables[table]
        lines.append(f"; {table}: {count} at 0x{start:04x}, {end - start} octets")
        for number, note in enumerate(entries[table]):
            if table == "code":
                lines.extend(_expression(data, text, instructions, number, note))
            else:
                lines.extend(_line(data, note.start, note.end, f"{number}: {text.entry(number, note)}"))
    if signature:
        sizes = f"a certificate of {len(certificate)} octets, a signature of {len(signature)}"
        lines.append(f"; signed: {sizes}")
        lines.extend(_line(whole, layout.size, layout.size + SIGNED_HEAD.size, "magic and sizes"))
        signed = layout.size + SIGNED_HEAD.size + len(certificate)
        lines.extend(_line(whole, layout.size + SIGNED_HEAD.size, signed, "certificate"))
        lines.extend(_line(whole, signed, len(whole), "signature"))
    return "\n".join(lines) + "\n"


def _line(data: bytes, start: int, end: int, text: str) -> Iterator[str]:
    """Yield the lines of the octets `start` to `end`, the text on the first one."""
    text = _printable(text)
    for at in range(start, max(end, start + 1), OCTETS_SHOWN):
        octets = data[at : min(end, at + OCTETS_SHOWN)].hex(" ")
        yield f"0x{at:04x}  {octets:<{OCTETS_SHOWN * 3}}{text}".rstrip()
        text = ""


def _printable(text: str) -> str:
    """Return `text` with control characters escaped."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else f"\\u{ord(each):04x}" for each in text)


def _header(data: bytes, layout: Layout) -> Iterator[str]:
    yield from _line(data, 0, 4, "magic")
    yield from _line(data, 4, 5, f"version {VERSION}")
    words = ", ".join([word for flag, word in FLAG_WORDS.items() if layout.flags & flag])
    yield from _line(data, 5, 6, f"flags {layout.flags:#04x}{': ' if words else ''}{words}")
    yield from _line(data, 6, CRC_OFFSET, f"size {layout.size} octets")
    yield from _line(data, CRC_OFFSET, HEADER.size, f"CRC-32 {layout.crc:08x}")
    yield from _line(data, HEADER.size, layout.tables[TABLES[0]].start, "directory: entries and offset of each table")


def _expression(data: bytes, text: "_Text", instructions: Iterator[Note], number: int, note: Note) -> Iterator[str]:
    """Yield the lines of an expression, its instructions one below the other."""
    inner = list(islice(instructions, len(note.what)))  # type: ignore[arg-type]
    first = inner[0].start if inner else note.end
    yield from _line(data, note.start, first, f"{number}: {counted(len(inner), 'instruction')}")
    for item in inner:
        assert isinstance(item.what, Instruction)
        yield from _line(data, item.start, item.end, "   " + text.instruction(item.what))


def _braced(words: list[str]) -> str:
    return words[0] if len(words) == 1 else "{" + " ".join(words) + "}"


def type_text(kind: Type) -> str:
    """Return a type as in a declaration; ``_`` for an undetermined one."""
    if kind.base is Base.OPEN:
        return "_"
    if kind.base is Base.LIST:
        return "list " + (type_text(kind.element) if kind.element is not None else "_")
    return (kind.name if kind.base is Base.SYMBOL else "") or kind.base.name.lower()


class _Text:
    """Renders entries with the names of one program's predicates; the texts of shared parts are cached."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._shared: dict[int, str] = {}

    def entry(self, number: int, note: Note) -> str:
        debug = self.program.debug or Debug()
        match note.what:
            case Rule() as rule:
                return self.rule(rule) + _place(debug.rules, number)
            case Assertion() as assertion:
                return self.assertion(assertion) + _place(debug.assertions, number)
            case Effect() as effect:
                return self.effect(effect)
            case InitialFact() as fact:
                args = [self.pattern(arg) if isinstance(arg, Slot) else self.value(arg) for arg in fact.args]
                return self.term(fact.predicate, _owner(fact.owner), args)
            case InitialGoal() as goal:
                text = "?" + self.term(goal.predicate, _owner(goal.owner), map(self.pattern, goal.args))
                return text + _leads(goal.leads)
            case OwnFunction() as function:
                return f"{function.name}/{function.arity} = {self.code(function.code)}"
            case HiddenPredicate(predicate=index, duty=duty, other=other):
                behind = "" if other is None else f" of {self.program.predicates[other].name}"
                return f"{self.program.predicates[index].name}: {duty.name.lower()}{behind}"
            case Debug():
                return "places in the source"
            case _:  # a predicate, or a value of the table of symbols and constants
                pass
        if note.table == "predicates":
            return self.predicate(self.program.predicates[number]) + _place(debug.predicates, number)
        return format_value(note.what)  # type: ignore[arg-type]

    def value(self, value: Value) -> str:
        return self._once(value, format_value) if isinstance(value, tuple | str) else format_value(value)

    def code(self, code: Code) -> str:
        """Return an expression in postfix."""
        return self._once(code, lambda each: _braced([self._word(instruction) for instruction in each]))

    def _once(self, thing: T, write: Callable[[T], str]) -> str:
        """Return the shortened text of a shared object, cached by identity; the program keeps the object alive."""
        text = self._shared.get(id(thing))
        if text is None:
            text = self._shared[id(thing)] = shortened(write(thing), SHARED_MAX)
        return text

    def pattern(self, pattern: Pattern) -> str:
        """Return a pattern: ``_``, a slot or a constant."""
        if isinstance(pattern, Anything):
            return "_"
        return f"${pattern.index}" if isinstance(pattern, Slot) else self.value(pattern.value)

    def instruction(self, instruction: Instruction) -> str:
        """Return an instruction with its operand."""
        operand = instruction.operand
        if operand is None:
            return instruction.op.name
        form = FORMS[instruction.op].operand
        if form is Operand.FUNCTION:
            assert isinstance(operand, int)
            return f"CALL {FUNCTIONS[operand].name}/{FUNCTIONS[operand].arity}"
        if instruction.function is not None:
            return f"APPLY {operand}:{instruction.function.name}/{instruction.function.arity}"
        mark = "$" if form is Operand.SLOT else ""
        return f"{instruction.op.name} {mark}{self.value(operand)}"

    def _word(self, instruction: Instruction) -> str:
        """Return an instruction as it stands within an expression."""
        operand = instruction.operand
        if instruction.op is Op.LOAD:
            return f"${operand}"
        if instruction.op in (Op.CONST, Op.INT) and operand is not None:
            return self.value(operand)
        return self.instruction(instruction).replace(" ", ":")

    def name(self, predicate: int) -> str:
        declared = self.program.predicates[predicate]
        return ("!" if declared.kind is Kind.PERSISTENT else "") + declared.name

    def term(self, predicate: int, owner: str, args: Iterable[str]) -> str:
        return f"{self.name(predicate)}({', '.join([owner, *args])})"

    def predicate(self, predicate: Predicate) -> str:
        types = list(map(type_text, predicate.types))
        if predicate.best is not None:
            at = predicate.best.argument
            types[at : at + 1] = [f"{'min' if predicate.best.least else 'max'} {each}" for each in types[at : at + 1]]
        words = ("unordered " if predicate.unordered else "") + _KINDS[predicate.kind]
        text = f"{words}{predicate.name}({', '.join(['robot', *types])})"
        for word, effects in ((" -o ", predicate.effects), (" else ", predicate.else_effects)):
            if effects:
                text += word + ", ".join(map(self.effect, effects))
        return text + (" (provided)" if predicate.provided else "")

    def effect(self, effect: Effect) -> str:
        return self.term(effect.predicate, self.code(effect.owner), map(self.code, effect.args))

    def rule(self, rule: Rule) -> str:
        return f"{self.body(rule.body)} -o {self.heads(rule.head)}  ; {rule.slots} slots"

    def body(self, body: Iterable[Conjunct]) -> str:
        return ", ".join(map(self.conjunct, body))

    def conjunct(self, conjunct: Conjunct) -> str:
        match conjunct:
            case Atom():
                return _MODES[conjunct.mode] + self.atom(conjunct)
            case Guard():
                return self.code(conjunct.code)
            case Bind():
                return f"${conjunct.slot} = {self.code(conjunct.code)}"
            case Fold():
                return self.fold(conjunct)

    def fold(self, fold: Fold) -> str:
        term = "" if fold.term is None else self.code(fold.term) + ", "
        slots = f"  ; {_slots(fold.slots)}" if fold.slots else ""
        return f"${fold.result} = {fold.operator.name.lower()}({term}{self.body(fold.body)}{slots})"

    def atom(self, atom: Atom, owner: str = "$0") -> str:
        return self.term(atom.predicate, owner, map(self.pattern, atom.args))

    def heads(self, heads: Iterable[Head]) -> str:
        return ", ".join(map(self.head, heads)) or "1"

    def head(self, head: Head) -> str:
        match head:
            case Comprehension():
                return f"{{{_slots(head.slots)} | {self.body(head.body)} | {self.heads(head.head)}}}"
            case Steps():
                return " then ".join(map(self.head, head.steps))
            case Aggregate():
                return self.aggregate(head)
            case HeadValue():
                return f"${head.slot} = {self.code(head.code)}"
            case When():
                return f"if ${head.slot} {self.head(head.item)}"
            case DeriveFact() | DeriveGoal() | DeriveAction():
                mark = "?" if isinstance(head, DeriveGoal) else ""
                return mark + self.term(head.predicate, self.code(head.owner), map(self.code, head.args))

    def aggregate(self, aggregate: Aggregate) -> str:
        operator = aggregate.operator.name.lower()
        term = "" if aggregate.term is None else " " + self.code(aggregate.term)
        result = f"${aggregate.result}, {_slots(aggregate.slots)}" if aggregate.slots else f"${aggregate.result}"
        return f"[{operator}{term} => {result} | {self.body(aggregate.body)} | {self.heads(aggregate.head)}]"

    def assertion(self, assertion: Assertion) -> str:
        start = self.atom(assertion.start, _owner(assertion.robot, "$0"))
        finish = self.atom(assertion.finish, self.pattern(assertion.finisher))
        parts = [start, finish, self.code(assertion.deadline), self.head(assertion.violation)]
        word = "assert" if assertion.scheduled else "watch"
        text = f"{assertion.name}: {word}({', '.join(parts)})"
        served = [self.term(s.action, "$0", map(self.pattern, s.args)) for s in assertion.serving]
        return text + ("  ; served by " + ", ".join(served) if served else "")


def _owner(owner: int | None, everyone: str = "_") -> str:
    return everyone if owner is None else f"@{owner}"


def _slots(slots: tuple[int, ...]) -> str:
    return ", ".join(f"${slot}" for slot in slots)


def _leads(leads: tuple[Lead, ...] | None) -> str:
    """Return the rules that lead to a goal, each with its rank (``_``: it depends)."""
    if leads is None:
        return ""
    ranked = [f"rule {lead.rule} at {'_' if lead.rank is None else lead.rank}" for lead in leads]
    return "  ; led to by " + (", ".join(ranked) or "no rule")


def _place(places: tuple[Place, ...], number: int) -> str:
    if number >= len(places):
        return ""
    place = places[number]
    return f"  ; {place.file}:{place.line}:{place.column}"

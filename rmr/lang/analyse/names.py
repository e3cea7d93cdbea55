"""Symbol table: the kind and the arity of each predicate and action, and the place that decided it.

A declaration decides. An undeclared name is classified by its uses, in this order: the violation of an assertion is
an action; a provided name that the program neither states nor derives has the provided kind; a fact with one `!` is
persistent; everything else is temporary. Every use is then checked against the result.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto
from types import MappingProxyType

from rmr.base.printable import counted
from rmr.base.record import record
from rmr.bytecode import provided
from rmr.bytecode.program import Base, Best, Kind, Type
from rmr.lang.analyse.types import DRAWN, ORDERED, TIMED, declaration_text
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics, Fix, WordHint
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    AggregateNode,
    AssertionItem,
    ComprehensionNode,
    Condition,
    Conjunct,
    ConstantItem,
    Declared,
    FactItem,
    FactNode,
    FoldNode,
    FunctionItem,
    GoalItem,
    IncludeItem,
    Item,
    Mark,
    ModuleNode,
    PlainHeadItem,
    RuleItem,
    StepsNode,
    StrategyItem,
    TypeDeclaration,
    TypeName,
    flat,
)

CANDIDATES_MAX = 500
"""Search budget of a spelling suggestion: the names compared with the misspelt one."""


LETTERS_OFF = 2
"""Largest difference in length between a misspelt name and its correction."""

LETTERS_MAX = 60
"""Longest name for which a correction is searched: the comparison is quadratic in the length."""


Given = Mapping[str, bool]
"""Predicates whose facts the run inserts from outside; true: an undeclared one is persistent."""

NOTHING_GIVEN: Given = MappingProxyType({})
"""Default of `Given`: the run inserts no facts."""


class FactRole(Enum):
    """The syntactic position of a fact."""

    FACT = auto()
    GOAL = auto()
    BODY = auto()
    HEAD = auto()
    EFFECT = auto()
    START = auto()
    FINISH = auto()
    VIOLATION = auto()

    @property
    def derives(self) -> bool:
        """Whether the program makes facts there; else it consumes them or waits for them."""
        return self in {FactRole.FACT, FactRole.HEAD, FactRole.EFFECT, FactRole.VIOLATION}


@record
class Use:
    """One occurrence of a predicate or an action."""

    fact: FactNode
    role: FactRole


@dataclass(slots=True)
class Signature:
    """The kind, arity and argument types of one predicate or action."""

    name: str
    kind: Kind
    arity: int
    """Number of arguments, the owner included."""
    place: Span
    """The declaration, else the first use."""
    declaration: TypeDeclaration | None = None
    provided: bool = False
    types: tuple[Type, ...] = ()
    """Types of the arguments after the owner, declared or provided; OPEN where inference decides."""
    best: Best | None = None
    """Which of several facts is kept; None: all."""
    banged: Span | None = None
    """The use whose `!` makes an undeclared predicate persistent."""

    @property
    def is_shared(self) -> bool:
        """Whether neighbours of its owner may read it."""
        return self.declaration is not None and self.declaration.shared is not None and self.kind is Kind.TEMPORARY

    @property
    def is_fact(self) -> bool:
        """Whether it is a predicate, not an action."""
        return self.kind is not Kind.ACTION


@dataclass(slots=True)
class Names:
    """The symbol table of a program: declared names first, then undeclared ones in the order of their first use."""

    signatures: dict[str, Signature] = field(default_factory=dict)
    uses: list[Use] = field(default_factory=list)
    given: Given = field(default_factory=lambda: NOTHING_GIVEN)
    closed: bool = False
    """Whether nothing but `given` comes from outside: no handler, event or other program brings facts."""
    functions: dict[str, FunctionItem] = field(default_factory=dict)
    """The program's own functions."""
    begins: dict[str, int] = field(default_factory=dict)
    """The offset of each file's first item."""

    def of(self, fact: FactNode) -> Signature:
        """Return the signature of the predicate or action that `fact` names; each name in the program has one."""
        return self.signatures[fact.name.text]

    def sharing(self, fact: FactNode) -> str:
        """Return the end of a hint at a fact of another robot: neighbours may be told of it; empty if they cannot."""
        signature = self.of(fact)
        if signature.kind is not Kind.TEMPORARY or signature.is_shared or fact.mark is Mark.GOAL:
            return ""
        return f"; or declare `type shared {signature.name}(...)`, and what neighbours have told last is read"

    def declaring(self, file: str, declaration: str) -> Fix | None:
        """Return the fix that writes a declaration before the first item of a file."""
        begin = self.begins.get(file)
        return None if begin is None else Fix(Span(file, begin, begin), f"{declaration}\n")


def near(name: str, candidates: list[str]) -> str | None:
    """Return the closest candidate to `name`, or None if none is close enough."""
    from difflib import get_close_matches  # noqa: PLC0415 - most programs have no misspelling

    if len(name) > LETTERS_MAX:
        return None
    alike = [each for each in candidates[:CANDIDATES_MAX] if each != name and abs(len(each) - len(name)) <= LETTERS_OFF]
    # A transposition wins: the similarity ratio ranks it too low in a short name.
    swapped = [each for each in alike if _swapped(name, each)]
    matches = swapped or get_close_matches(name, alike, n=1, cutoff=0.75)
    return matches[0] if matches else None


def _swapped(one: str, other: str) -> bool:
    """Whether the two names differ by one transposition of neighbouring letters."""
    if len(one) != len(other):
        return False
    off = [k for k, (a, b) in enumerate(zip(one, other, strict=True)) if a != b]
    return len(off) == 2 and off[1] == off[0] + 1 and one[off[0]] == other[off[1]] and one[off[1]] == other[off[0]]


def meant(name: str, candidates: list[str], at: Span | None = None) -> str | None:
    """Return the hint "did you mean" for a misspelt name, or None; `at`: its place if more than it is reported."""
    match = near(name, candidates)
    return WordHint(f"did you mean `{match}`?", match, at) if match is not None else None


# ---- uses


def uses(item: Item) -> Iterator[Use]:
    """Yield every use of a predicate or action in `item`, in source order; the declared name itself is no use."""
    match item:
        case FactItem(fact=fact):
            yield Use(fact, FactRole.FACT)
        case GoalItem(fact=fact):
            yield Use(fact, FactRole.GOAL)
        case TypeDeclaration():
            for fact in (*item.effects, *item.else_effects):
                yield Use(fact, FactRole.EFFECT)
        case RuleItem():
            yield from _body_uses(item.body)
            for part in flat(item.head):
                yield from _head_uses(part)
        case AssertionItem():
            yield Use(item.start, FactRole.START)
            yield Use(item.finish, FactRole.FINISH)
            yield Use(item.violation, FactRole.VIOLATION)
        case ConstantItem() | IncludeItem() | StrategyItem() | FunctionItem():
            pass


def _body_uses(body: tuple[Conjunct, ...]) -> Iterator[Use]:
    for conjunct in body:
        if isinstance(conjunct, FoldNode):
            yield from _body_uses(conjunct.body)
        elif not isinstance(conjunct, Condition):
            yield Use(conjunct, FactRole.BODY)


def _head_uses(part: PlainHeadItem) -> Iterator[Use]:
    match part:
        case FactNode():
            yield Use(part, FactRole.HEAD)
        case StepsNode(derived=derived):
            for fact in derived:
                yield Use(fact, FactRole.HEAD)
        case ComprehensionNode():
            yield from _body_uses(part.body)
            for fact in part.head:
                yield Use(fact, FactRole.HEAD)
        case AggregateNode():
            yield from _body_uses(part.body)
            for fact in part.head:
                yield Use(fact, FactRole.HEAD)


# ---- signatures

_KINDS = {
    Declared.TEMPORARY: Kind.TEMPORARY,
    Declared.PERSISTENT: Kind.PERSISTENT,
    Declared.SENSED: Kind.SENSED,
    Declared.ACTION: Kind.ACTION,
}
_BASES = {"robot": Base.ROBOT, "int": Base.INT, "float": Base.FLOAT, "bool": Base.BOOL, "string": Base.STRING}


def declared_type(name: TypeName) -> Type:
    """Return the type denoted by `name`; a name that is no built-in type denotes a set of symbols."""
    if name.element is not None:
        return Type(Base.LIST, element=declared_type(name.element))
    base = _BASES.get(name.name)
    return Type(base) if base is not None else Type(Base.SYMBOL, name.name)


def collect(module: ModuleNode, found: Diagnostics, given: Given = NOTHING_GIVEN) -> Names:
    """Return the symbol table of `module`; report repeated declarations and uses that contradict the table."""
    names = Names(uses=[use for item in module.items for use in uses(item)], given=given)
    for item in module.items:
        names.begins.setdefault(item.span.file, item.span.start)
    for item in module.items:
        if isinstance(item, TypeDeclaration):
            _declare(item, names, found)
        elif isinstance(item, FunctionItem):
            _define(item, names, found)
    for name, group in _undeclared(names).items():
        names.signatures[name] = _infer(name, group, given.get(name, False))
    for use in names.uses:
        # The declaration of a name in `broken` may be among the lost text: an inferred signature proves nothing.
        if use.fact.name.text not in module.broken or names.of(use.fact).declaration is not None:
            _check_use(use, names, found)
    return names


def _declare(item: TypeDeclaration, names: Names, found: Diagnostics) -> None:
    name = item.name.text
    if (earlier := names.signatures.get(name)) is not None:
        notes = (DiagnosticNote(earlier.place, "first declared here"),)
        found.report("E010", f"`{name}` is declared twice", item.name.span, hint="drop one of them", notes=notes)
        return
    if not item.parameters or item.parameters[0].type.name != "robot":
        span = item.parameters[0].span if item.parameters else item.name.span
        what = "executor" if item.kind is Declared.ACTION else "owner"
        message = f"the first argument of `{name}` is its {what}, a robot"
        found.report("E021", message, span, hint=f"`{name}(robot, ...)`")
    if item.kind is Declared.SENSED and item.unordered is not None:
        message = f"`{name}` is a sensed fact; each robot senses its own, none is sent"
        found.report("E012", message, item.unordered, hint="drop `unordered`")
    if item.kind is not Declared.TEMPORARY and item.shared is not None:
        message = f"`shared` is for temporary facts, which neighbours then read; `{name}` is {item.kind.value}"
        hint = f"`type shared {name}(...)`, or drop `shared`; a persistent or sensed fact is told by a rule: "
        hint += "`seen(R, X) -o sees(R, X).` with a shared `sees`"
        found.report("E012", message, item.shared, hint=hint)
    types = tuple(declared_type(parameter.type) for parameter in item.parameters[1:])
    signature = Signature(name, _KINDS[item.kind], max(1, len(item.parameters)), item.name.span, item, types=types)
    signature.provided = provided.is_provided(name, signature.kind, signature.types)
    signature.best = _best(item, found)
    names.signatures[name] = signature
    action = provided.ACTIONS.get(name) if item.kind is Declared.ACTION else None
    if action is not None and not _same_shape(types, action.types):
        message = f"the action `{name}` is provided with other arguments"
        hint = declaration_text(name, action.types, "action ")
        found.report("E014", message, item.span, hint=f"`{hint}`")


def _best(item: TypeDeclaration, found: Diagnostics) -> Best | None:
    """Return which facts of a declared predicate are kept, if not all."""
    marked = [(place, each) for place, each in enumerate(item.parameters) if each.extreme]
    best: Best | None = None
    for place, each in marked:
        word = each.extreme
        if item.kind is not Declared.PERSISTENT:
            hint = f"declare `type !{item.name.text}(...)`"
            message = f"`{word}` keeps the best of persistent facts; `{item.name.text}` is {item.kind.value}"
            found.report("E012", message, each.span, hint=hint)
        elif place == 0 or declared_type(each.type).base not in ORDERED - {Base.OPEN}:
            hint = "an argument behind the owner: an int, a float or a string"
            found.report("E020", f"`{word}` compares numbers or strings", each.span, hint=hint)
        elif place != marked[0][0]:
            notes = (DiagnosticNote(marked[0][1].span, "here"),)
            hint = f"drop this `{word}`: the arguments behind the first come with it; or declare one fact for each"
            found.report("E010", "the best is kept by one argument only", each.span, hint=hint, notes=notes)
        else:
            best = Best(place - 1, word == "min")
    return best


def _define(item: FunctionItem, names: Names, found: Diagnostics) -> None:
    """Add a function of the program."""
    name = item.name.text
    earlier = names.functions.get(name)
    if name in TIMED | DRAWN or name == "if":
        message = f"`{name}` is a function of the language that no other one replaces"
        found.report("E010", message, item.name.span, hint="choose another name")
    elif earlier is not None:
        notes = (DiagnosticNote(earlier.name.span, "first defined here"),)
        found.report("E010", f"the function `{name}` is defined twice", item.name.span, notes=notes)
    else:
        names.functions[name] = item


def _same_shape(one: tuple[Type, ...], other: tuple[Type, ...]) -> bool:
    return [kind.base for kind in one] == [kind.base for kind in other]


def _undeclared(names: Names) -> dict[str, list[Use]]:
    groups: dict[str, list[Use]] = {}
    for use in names.uses:
        if use.fact.name.text not in names.signatures:
            groups.setdefault(use.fact.name.text, []).append(use)
    return groups


def _infer(name: str, group: list[Use], persistent: bool) -> Signature:
    first = group[0].fact
    arity = max(1, len(first.arguments))
    roles = {use.role for use in group}
    # Only a violation and heads: an action. A use that only a fact can have makes it a fact.
    if FactRole.VIOLATION in roles and not roles & _FOR_FACTS.keys():
        if name in provided.ACTIONS:
            types = provided.ACTIONS[name].types
            return Signature(name, Kind.ACTION, 1 + len(types), first.span, types=types)
        return Signature(name, Kind.ACTION, arity, first.span, types=_open(arity))
    # A program that states or derives the predicate has one of its own that shadows the provided one.
    own = any(use.role in {FactRole.FACT, FactRole.HEAD} and use.fact.mark is not Mark.GOAL for use in group)
    if name in provided.PREDICATES and not own:
        row = provided.PREDICATES[name]
        return Signature(name, row.kind, 1 + len(row.types), first.span, provided=True, types=row.types)
    banged = next((use.fact.span for use in group if use.fact.mark is Mark.BANG), None)
    kind = Kind.PERSISTENT if persistent or banged is not None else Kind.TEMPORARY
    return Signature(name, kind, arity, first.span, types=_open(arity), banged=banged)


def _open(arity: int) -> tuple[Type, ...]:
    return (Type(Base.OPEN),) * (arity - 1)


# ---- checks of uses against signatures


def _check_use(use: Use, names: Names, found: Diagnostics) -> None:
    signature = names.of(use.fact)
    fact = use.fact
    name = use.fact.name.text
    if name in names.functions:
        defined = DiagnosticNote(names.functions[name].name.span, "defined here")
        found.report("E012", f"`{name}` is a function, not a fact", fact.span, notes=(defined,))
        return
    notes = () if signature.place == fact.span else (DiagnosticNote(signature.place, _place_note(signature)),)
    given = len(fact.arguments)
    if given == 0:
        message = f"`{name}` has no argument; the first argument is its owner, a robot"
        found.report("E021", message, fact.span, hint=f"`{name}(R)`")
    elif given != signature.arity:
        hint = None
        if signature.provided or (signature.declaration is None and name in provided.ACTIONS and not signature.is_fact):
            word = {Kind.SENSED: "sensor ", Kind.PERSISTENT: "!", Kind.ACTION: "action "}[signature.kind]
            hint = f"provided is `{declaration_text(name, signature.types, word)}`"
        message = f"`{name}` has {counted(signature.arity, 'argument')}, here it is given {given}"
        found.report("E011", message, fact.span, hint=hint, notes=notes)
    _check_kind(use, names, notes, found)


def _place_note(signature: Signature) -> str:
    if signature.declaration is not None:
        return "declared here"
    return "first used here"


_FOR_FACTS = {
    FactRole.BODY: "a body reads facts; an action is never stored",
    FactRole.FACT: "an action is derived by rules, it does not hold at the start",
    FactRole.GOAL: "a goal is a fact that is wanted, not an action",
    FactRole.EFFECT: "an action's effects are facts",
    FactRole.START: "a job starts with a fact",
    FactRole.FINISH: "a job ends with a fact",
}
"""Positions in which an action is an error, each with the hint."""


def _check_kind(use: Use, names: Names, notes: tuple[DiagnosticNote, ...], found: Diagnostics) -> None:
    fact = use.fact
    name = use.fact.name.text
    signature = names.of(fact)
    kind = signature.kind
    word = kind.name.lower()
    if use.role is FactRole.VIOLATION:
        if kind is Kind.SENSED:
            message = f"`{name}` is sensed by the robot, no violation derives it"
            found.report("E012", message, fact.span, notes=notes)
        return
    if kind is Kind.ACTION:
        _check_action_use(use, names, notes, found)
        return
    if fact.mark is Mark.BANG and kind is not Kind.PERSISTENT:
        hint = f"drop the `!`, or declare `type !{name}(...)`"
        hint += f"; that there is none is `not {name}(...)`" if use.role is FactRole.BODY else ""
        message = f"`{name}` is a {word} fact, not a persistent one"
        found.report("E012", message, fact.span, hint=hint, notes=notes, fix=_unmarked(fact))
    elif fact.mark is Mark.KEEP and kind is not Kind.TEMPORARY:
        message = f"`$` keeps a temporary fact; `{name}` is {word} and is never consumed"
        if signature.banged is not None:
            notes = (DiagnosticNote(signature.banged, "persistent because of this `!`"),)
        found.report("E012", message, fact.span, hint="drop the `$`", notes=notes, fix=_unmarked(fact))
    elif use.role is FactRole.HEAD and fact.mark is not Mark.GOAL and kind is Kind.SENSED:
        message = f"`{name}` is sensed by the robot, no rule derives it"
        found.report("E012", message, fact.span, notes=notes)


def _check_action_use(use: Use, names: Names, notes: tuple[DiagnosticNote, ...], found: Diagnostics) -> None:
    fact = use.fact
    name = use.fact.name.text
    signature = names.of(fact)
    if use.role in _FOR_FACTS:
        found.report("E012", f"`{name}` is an action", fact.span, hint=_FOR_FACTS[use.role], notes=notes)
    elif fact.mark is not Mark.NONE:
        found.report("E012", f"`{name}` is an action; `{fact.mark.value}` marks facts", fact.span, notes=notes)
    elif signature.declaration is None:
        text = declaration_text(name, signature.types, "action ")
        message = f"the action `{name}` is derived but not declared"
        fix = names.declaring(fact.span.file, text)
        found.report("E013", message, fact.span, hint=f"`{text}`", notes=notes, fix=fix)


def _unmarked(fact: FactNode) -> Fix | None:
    """Return the fix that drops the mark of a fact; behind `not` it stands somewhere else."""
    start = fact.span.start
    return None if fact.absent else Fix(Span(fact.span.file, start, start + 1), "")

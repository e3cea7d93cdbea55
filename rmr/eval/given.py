"""Inputs of an evaluation: the program, and facts from outside of it.

Facts from outside come from a file of facts, `--edges` (neighbourhoods) and `--insert` (events at instants). Their
predicates are passed to the compiler first, for they decide the kind of an undeclared predicate. Their values are
checked against the compiled program, source or byte-code alike. A mistake in a file is a diagnostic as in a program; a
mistake in an option is an `OptionError`.
"""

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rmr.base.ids import shown
from rmr.base.time import Instant
from rmr.base.values import Robot, Value
from rmr.bytecode import codec
from rmr.bytecode.codec import BytecodeError
from rmr.bytecode.layout import MAGIC, SIZE_MAX
from rmr.bytecode.program import Base, InitialFact, InitialGoal, Kind, Pattern, Program, Slot
from rmr.eval.options import OptionError, outside_event
from rmr.eval.topology import Topology
from rmr.lang.analyse.names import meant
from rmr.lang.compiler import Compilation, compile_file, compile_text
from rmr.lang.diagnostics.diagnostic import Diagnostic, Diagnostics
from rmr.lang.fact_text import FactError, action_patterns, read_fact, stated
from rmr.lang.read.parser import parse
from rmr.lang.read.source_text import SourceError, SourceText, Span, read_source
from rmr.lang.read.syntax import FactItem, FactNode, Mark

EDGE_FACTS_MAX = 1_000_000
"""Facts about neighbours and peers, over all robots; more take gigabytes, and minutes before the run starts."""

_NAME = re.compile(r"[a-z][A-Za-z0-9_]*", re.ASCII)
_FAILING = re.compile(r"(?P<action>[a-z][A-Za-z0-9_]*|.*\))(?:@(?P<number>[0-9]{1,9}))?", re.ASCII | re.DOTALL)


class InvalidBytecodeError(Exception):
    """The file is no valid byte-code; the message says which and why."""


@dataclass(frozen=True, slots=True)
class Insertion:
    """A fact that comes from outside during the run."""

    at: Instant
    fact: InitialFact
    text: str
    """Text of the option."""


@dataclass(frozen=True, slots=True)
class FactsFile:
    """A parsed file of facts."""

    source: SourceText
    facts: tuple[FactNode, ...] = ()
    problems: tuple[Diagnostic, ...] = ()
    unreadable: bool = False


@dataclass(frozen=True, slots=True)
class Failing:
    """The actions that one `--fail` makes fail."""

    action: str
    patterns: tuple[Pattern, ...]
    """Patterns of the executor and the arguments."""
    number: int | None
    """Number of the matching action that fails, from 1 in the order of their starts; None: all fail."""
    text: str
    """Text of the option."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """The options whose check needs the program."""

    program: Path | SourceText
    """Its file, or its text."""
    facts: Path | None = None
    edges: str | None = None
    inserts: tuple[str, ...] = ()
    fails: tuple[str, ...] = ()
    timed: tuple[str, ...] = ()
    """The actions that `--action-time` names."""


@dataclass(frozen=True, slots=True)
class Given:
    """The checked program and facts of an evaluation."""

    program: Program | None
    """None if there are errors."""
    digest: int
    """Identity of the program in messages between robots."""
    facts: tuple[InitialFact, ...]
    edges: int | None
    """Index of the predicate of `--edges`."""
    insertions: tuple[Insertion, ...]
    """In order of time, then as they were given."""
    failing: tuple[Failing, ...]
    checked: tuple[Compilation, ...]
    """Diagnostics of the program and of the file of facts."""


def read_given(wanted: Wanted) -> Given:
    """Read and check all that `wanted` names.

    Raises:
        OptionError: an option is wrong, or does not fit the program.
        InvalidBytecodeError: the program is byte-code and cannot be run.
    """
    inserted = [_inserted(text) for text in wanted.inserts]
    file = FactsFile(SourceText("", "")) if wanted.facts is None else _read_facts(wanted.facts)
    edges = {wanted.edges: True} if wanted.edges is not None else {}
    if wanted.edges is not None and _NAME.fullmatch(wanted.edges) is None:
        raise OptionError(f"--edges: {shown(wanted.edges)} is no name of a predicate; write a name such as edge")
    compilation = _compile(wanted.program, {**_arriving((*file.facts, *(fact for _, fact, _ in inserted))), **edges})
    program = compilation.program
    if program is None:
        return Given(None, 0, (), None, (), (), (compilation, _as_compilation(file)))
    facts, checked = _check_file(file, program)
    insertions = sorted((_insertion(each, program) for each in inserted), key=lambda each: each.at)
    failing = tuple([_failing(text, program) for text in wanted.fails])
    for name in wanted.timed:
        _check_timed(name, program)
    predicate = None if wanted.edges is None else _edges(wanted.edges, program)
    failed = bool(compilation.errors or checked.errors)
    # Without the debug section: the same program compiled elsewhere must have the same identity.
    digest = 0 if failed else codec.digest(codec.encode(program, debug=False))
    both = (compilation, checked)
    return Given(None if failed else program, digest, facts, predicate, tuple(insertions), failing, both)


# ---- the program


def _compile(path: Path | SourceText, given: dict[str, bool]) -> Compilation:
    """Return the program in `path`, source or byte-code, as a compilation."""
    if isinstance(path, SourceText):
        return compile_text(path, given, closed=True)
    octets = _bytecode(path)
    if octets is None:
        return compile_file(path, given, closed=True)
    try:
        return Compilation(SourceText(str(path), ""), codec.decode(octets), [])
    except BytecodeError as error:
        raise InvalidBytecodeError(f"{path}: error: this is no valid byte-code: {error}") from None


def _bytecode(path: Path) -> bytes | None:
    """Return the octets of `path` if its name or its first octets mark it as byte-code; else None.

    At most `SIZE_MAX` octets and the magic number are read: enough for the decoder to reject a file that is too large.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(len(MAGIC))
            if path.suffix != ".rbc" and head != MAGIC:
                return None
            return head + stream.read(SIZE_MAX)
    except (OSError, ValueError):
        return None  # the compiler reports why the file cannot be read


def _arriving(facts: Sequence[FactNode]) -> dict[str, bool]:
    """Return the predicates of `facts`, true for those that a bang makes persistent."""
    names: dict[str, bool] = {}
    for fact in facts:
        names[fact.name.text] = names.get(fact.name.text, False) or fact.mark is Mark.BANG
    return names


# ---- a file of facts


def _read_facts(path: Path) -> FactsFile:
    try:
        source = read_source(path)
    except SourceError as error:
        problem = Diagnostic("E003", str(error), Span(str(path), 0, 0), error.hint)
        return FactsFile(SourceText(str(path), ""), (), (problem,), error.usage)
    found = Diagnostics()
    module = parse(source, found)
    facts: list[FactNode] = []
    for item in module.items:
        if isinstance(item, FactItem):
            facts.append(item.fact)
        else:
            hint = "goals, rules and declarations stand in the program"
            found.report("E012", "a file of facts holds facts alone, such as `due(@1, 25).`", item.span, hint=hint)
    return FactsFile(source, tuple(facts), tuple(found.in_order()))


def _check_file(file: FactsFile, program: Program) -> tuple[tuple[InitialFact, ...], Compilation]:
    """Return the file's facts, and the diagnostics of the file against `program`."""
    found = Diagnostics()
    facts: list[InitialFact] = []
    for fact in file.facts:
        try:
            facts.append(stated(fact, program))
        except FactError as error:
            found.report(error.code, error.message, error.span or fact.span, hint=error.hint)
    problems = sorted((*file.problems, *found.in_order()), key=lambda each: each.span.start)
    return tuple(facts), _as_compilation(replace(file, problems=tuple(problems)))


def _as_compilation(file: FactsFile) -> Compilation:
    return Compilation(file.source, None, list(file.problems), file.unreadable)


# ---- options checked against the program


def _inserted(text: str) -> tuple[Instant, FactNode, str]:
    try:
        at, fact = outside_event(text)
        return at, read_fact(fact), text
    except (OptionError, FactError) as error:
        raise OptionError(f"--insert {shown(text)}: {error}") from None


def _insertion(inserted: tuple[Instant, FactNode, str], program: Program) -> Insertion:
    at, fact, text = inserted
    try:
        return Insertion(at, stated(fact, program), text.strip())
    except FactError as error:
        raise OptionError(f"--insert {shown(text)}: {error}") from None


def _failing(text: str, program: Program) -> Failing:
    match = _FAILING.fullmatch(text.strip())
    if match is None:
        raise OptionError(f"--fail {shown(text)}: write an action such as 'charge(@2, _)', or 'charge(@2, _)@3'")
    number = None if match["number"] is None else int(match["number"])
    if number == 0:
        raise OptionError(f"--fail {shown(text)}: actions are counted from 1")
    try:
        action, patterns = action_patterns(match["action"], program)
    except FactError as error:
        raise OptionError(f"--fail {shown(text)}: {error}") from None
    return Failing(action, patterns, number, text.strip())


def _check_timed(name: str, program: Program) -> None:
    actions = [each.name for each in program.predicates if each.kind is Kind.ACTION]
    if name not in actions:
        hint = meant(name, actions)
        raise OptionError(f"--action-time: the program has no action {shown(name)}" + (f"; {hint}" if hint else ""))


def _edges(name: str, program: Program) -> int:
    """Return the predicate `name`, which must be a persistent one of two robots. Raises OptionError."""
    index = program.index(name)
    if index is None:
        hint = meant(name, [each.name for each in program.predicates if each.kind is not Kind.ACTION])
        raise OptionError(f"--edges: the program knows no fact `{name}`" + (f"; {hint}" if hint else ""))
    predicate = program.predicates[index]
    if predicate.kind is not Kind.PERSISTENT:
        what = "an action" if predicate.kind is Kind.ACTION else f"a {predicate.kind.name.lower()} fact"
        raise OptionError(f"--edges: `{name}` is {what}; declare `type !{name}(robot, robot).`")
    if len(predicate.types) != 1 or predicate.types[0].base not in (Base.ROBOT, Base.OPEN):
        raise OptionError(f"--edges: `{name}` does not take two robots; declare `type !{name}(robot, robot).`")
    return index


# ---- facts of each robot


def check_size(given: Given, program: Program, topology: Topology, robots: Collection[int]) -> None:
    """Raise OptionError if facts about neighbours and peers would exceed `EDGE_FACTS_MAX`."""
    in_range = sum(topology.degree(robot) for robot in robots)
    there = len(robots) * (len(robots) - 1)
    named = {"neighbor": in_range, "range": in_range, "peer": there}
    counts = {each.name: named[each.name] for each in program.predicates if each.provided and each.name in named}
    if given.edges is not None:
        counts[program.predicates[given.edges].name] = in_range
    for name, count in counts.items():
        if count > EDGE_FACTS_MAX:
            less = "take fewer robots" if name == "peer" else "take fewer robots or another --topology"
            raise OptionError(f"{count} facts `{name}` are more than {EDGE_FACTS_MAX}; {less}")


def facts_by_owner(facts: Sequence[InitialFact]) -> dict[int | None, list[InitialFact]]:
    """Return `facts` by owner; None: every robot's."""
    owned: dict[int | None, list[InitialFact]] = {}
    for fact in facts:
        owned.setdefault(fact.owner, []).append(fact)
    return owned


def values(fact: InitialFact, robot: int) -> tuple[Value, ...]:
    """Return the arguments of `fact` as `robot` holds it: a variable is the robot itself."""
    return tuple([Robot(robot) if isinstance(arg, Slot) else arg for arg in fact.args])


def strangers(given: Given, program: Program, robots: Collection[int]) -> Iterator[tuple[str, int]]:
    """Yield (predicate, robot), each once, of the facts and goals stated for robots that do not exist."""
    stated_items: list[InitialFact | InitialGoal] = [*program.facts, *program.goals, *given.facts]
    stated_items += [insertion.fact for insertion in given.insertions]
    found = {(program.predicates[each.predicate].name, each.owner): None for each in stated_items}
    for name, owner in found:
        if owner is not None and owner not in robots:
            yield name, owner

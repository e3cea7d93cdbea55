"""The compiler as a whole: a file in, one robot's program or diagnostics out."""

from collections.abc import Mapping
from pathlib import Path

from rmr.analysis.servers import with_serving
from rmr.base.record import record
from rmr.bytecode.limits import exceeded
from rmr.bytecode.program import Debug, Place, Program
from rmr.lang.analyse.names import NOTHING_GIVEN, Given
from rmr.lang.analyse.supply import is_brought, only_stated
from rmr.lang.checker import Checked, check
from rmr.lang.diagnostics.diagnostic import Diagnostic, Diagnostics, Severity
from rmr.lang.lower.emitter import Emitter
from rmr.lang.lower.goal_paths import with_leads
from rmr.lang.read.include import Editing, Loader, short_name
from rmr.lang.read.source_text import SourceError, SourceText, Span, read_source
from rmr.lang.read.syntax import FactItem, FactNode, GoalItem, ModuleNode

UNCERTAIN = frozenset({"E012", "E013", "E020", "E021", "E022", "E023"})
"""Errors that declarations in an unread file might disprove; they are dropped then, as all warnings are."""


@record
class Compilation:
    """The result of compiling a source text."""

    source: SourceText
    program: Program | None
    """None if there are errors."""
    diagnostics: list[Diagnostic]
    """Errors and warnings in source order."""
    unreadable: bool = False
    """True if the path is wrong (no file there), not the program."""
    included: tuple[SourceText, ...] = ()
    """The included files."""
    checked: Checked | None = None
    """The analysed form of the program; None if there are errors."""
    known: Checked | None = None
    """The analysed form as far as errors allow; None for a file that cannot be read."""
    module: ModuleNode | None = None
    """The items as they were read, before any analysis; None for a file that cannot be read."""

    @property
    def sources(self) -> dict[str, SourceText]:
        """All texts by the file names that diagnostics use."""
        return {each.file: each for each in (self.source, *self.included)}

    @property
    def errors(self) -> list[Diagnostic]:
        """The errors alone."""
        return [each for each in self.diagnostics if each.severity is Severity.ERROR]


def compile_file(path: Path, given: Given = NOTHING_GIVEN, *, closed: bool = False) -> Compilation:
    """Compile the program in `path`; an unreadable file is a diagnostic as well.

    Facts of the predicates in `given` come from outside: they are never reported as underivable. `closed`: no others
    do, so that a declaration alone is no reason to expect any.
    """
    try:
        source = read_source(path)
    except SourceError as error:
        span = Span(str(path), 0, 0)
        diagnostic = Diagnostic("E003", str(error), span, error.hint)
        return Compilation(SourceText(str(path), ""), None, [diagnostic], error.usage)
    return compile_text(source, given, closed=closed)


def compile_source(text: str, file: str = "<string>") -> Compilation:
    """Compile a program given as text; `file` is its name in diagnostics."""
    return compile_text(SourceText(file, text))


def compile_text(
    source: SourceText,
    given: Given = NOTHING_GIVEN,
    *,
    closed: bool = False,
    editing: Editing | None = None,
) -> Compilation:
    """Compile a source; `given` and `closed` as in `compile_file`, `editing` is an editor's."""
    found = Diagnostics()
    loader = Loader(found, editing)
    module = loader.module(source)
    if not module.items and not found.failed:
        found.report("W107", "the program is empty: robots will do nothing", Span(source.file, 0, 0))
    checked = check(module, found, given, closed=closed)
    program = None if found.failed else emit(checked, loader.sources)
    if program is not None:
        _report_excess(program, checked, found)
        _report_unserved(program, checked, loader.sources, found)
    diagnostics = found.in_order(loader.sources)
    if loader.incomplete:
        diagnostics = [each for each in diagnostics if each.severity is Severity.ERROR and each.code not in UNCERTAIN]
    _, *included = loader.sources.values()
    without_errors = None if found.failed else checked
    if without_errors is None:
        program = None
    return Compilation(
        source, program, diagnostics, False, tuple(included), without_errors, known=checked, module=module
    )


def _report_excess(program: Program, checked: Checked, found: Diagnostics) -> None:
    """Report the exceeded resource limits at the places of their items."""
    places = {
        "functions": [each.span for each in checked.names.functions.values()],
        "predicates": [each.place for each in checked.names.signatures.values()],
        "rules": [each.rule.span for each in checked.rules],
        "assertions": [each.item.span for each in checked.assertions],
    }
    for table, index, text in exceeded(program):
        found.report("E008", f"this has {text}", places[table][index])


def _report_unserved(program: Program, checked: Checked, sources: Mapping[str, SourceText], found: Diagnostics) -> None:
    """Report scheduled time assertions without a serving action: there is nothing to hold back for a turn."""
    for index, assertion in enumerate(program.assertions):
        item = checked.assertions[index].item
        if not assertion.scheduled or assertion.serving or found.reported_at("W104", item.finish.span):
            continue
        if only_stated(item.finish, checked.names) and is_brought(item.start, checked.names):
            start, finish = (_text(fact, sources) for fact in (item.finish, item.start))
            message = f"start and finish fact seem to be swapped: `{item.finish.name.text}` is only an initial fact"
            hint = f"the start fact stands first: `assert({start}, {finish}, ...)`"
            found.report("W116", message, item.span, hint=hint)
            continue
        message = f"no action's effect leads to `{item.finish.name.text}(...)`: this is only watched, never scheduled"
        hint = "if that is meant write `watch(...)`; else declare the effect: `type action go(R: robot) -o "
        hint += f"{item.finish.name.text}({', '.join(['R', *['...'][: len(item.finish.arguments) - 1]])}).`"
        found.report("W116", message, item.span, hint=hint)


def _text(fact: FactNode, sources: Mapping[str, SourceText]) -> str:
    return " ".join(sources[fact.span.file].text[fact.span.start : fact.span.end].split())


def emit(checked: Checked, sources: Mapping[str, SourceText]) -> Program:
    """Return the program of a module without errors."""
    emitter = Emitter(checked.names, checked.types)
    items = checked.module.items
    program = Program(
        functions=emitter.functions(),
        predicates=emitter.predicates(),
        facts=tuple(emitter.fact(item) for item in (*items, *checked.ensemble.facts) if isinstance(item, FactItem)),
        goals=tuple(emitter.goal(item) for item in items if isinstance(item, GoalItem)),
        rules=tuple(emitter.rule(projected) for projected in checked.rules),
        assertions=tuple(emitter.assertion(each.item, each.environment, each.finish) for each in checked.assertions),
        strategy=checked.strategy,
        debug=_debug(checked, emitter, sources),
        ensemble=emitter.hidden(checked.ensemble.made),
    )
    return with_leads(with_serving(program))


def _debug(checked: Checked, emitter: Emitter, sources: Mapping[str, SourceText]) -> Debug:
    def place(span: Span) -> Place:
        name = short_name(span.file).encode(errors="replace").decode()  # of a file's name any octets but 0 may be part
        return Place(name, *sources[span.file].position(span.start))

    return Debug(
        rules=tuple(place(projected.rule.span) for projected in checked.rules),
        assertions=tuple(place(each.item.span) for each in checked.assertions),
        predicates=tuple(place(span) for span in emitter.places),
    )

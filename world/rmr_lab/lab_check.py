"""`rmr check LAB`: programs and labs are checked as `rmr sim` and `rmr up` check them.

Checked are the lab file, its program, both together, the radio's key, and the files of actions and events. As many
errors as possible are reported at once: the program of a wrong lab file is compiled, too. All findings are one list,
for people or as JSON; a picture of the lab can be drawn with it.

A file of actions or events is a Python file: what it registers is known when it has been executed, as a run does. That
is said before it is done, for a lab may come from elsewhere, and can be declined.
"""

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rmr.bytecode.program import Kind, Program
from rmr.entry import ExitCode, print_json
from rmr.entry.terminal import has_colour
from rmr.lang.compiler import compile_file
from rmr.lang.diagnostics.diagnostic import Diagnostic
from rmr.lang.diagnostics.render import render_text, to_json
from rmr.lang.read.source_text import SourceText
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler
from rmr.node.actions.user_file import ActionsError, load_actions
from rmr_lab.explained_lab import ExplainedLab, show
from rmr_lab.explained_lab import explain as explain_lab
from rmr_lab.picture import draw
from rmr_sim.user_events import load_events
from rmr_world.bound import bound_s, destinations
from rmr_world.document import read
from rmr_world.finding import Finding, LabError
from rmr_world.hosts import read_hosts
from rmr_world.lab import PROGRAM_SUFFIXES, Lab
from rmr_world.lab_file import lab_path, load_lab, radio_key
from rmr_world.lab_program import ProgramError, load_program, program_missing
from rmr_world.narrow_places import narrow_places
from rmr_world.validate.first_instant import first_destinations
from rmr_world.validate.pipeline import run_findings

ERROR = "error"
_HINT = re.compile(r"; (did you mean .*\?|known are .*)$")
_PLACE = re.compile(r"^(?P<file>.+?):(?P<line>[0-9]+): (?P<message>.*)$", re.DOTALL)


@dataclass(slots=True)
class CheckResult:
    """The findings about one program or lab."""

    path: Path
    """Path as given on the command line."""
    diagnostics: Sequence[Diagnostic] = ()
    """Diagnostics of the compiler."""
    sources: Mapping[str, SourceText] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    """Findings about the lab and its files, and about the lab and its program together."""
    lab: Lab | None = None
    """The lab, if its file is valid."""
    program: Program | None = None
    unreadable: bool = False
    """Whether the file does not exist or cannot be read."""

    @property
    def severities(self) -> list[str]:
        """The severity of each finding."""
        return [each.severity.value for each in self.diagnostics] + [each.severity for each in self.findings]

    def as_json(self) -> list[dict[str, object]]:
        """Return the findings in the shape of `rmr check --json`."""
        return [*to_json(self.diagnostics, self.sources), *map(_as_json, self.findings)]

    def text(self, color: bool) -> str:
        """Return the findings as text for people."""
        lines = "".join(f"{_line(finding)}\n" for finding in self.findings)
        return render_text(self.diagnostics, self.sources, color) + lines


def check(path: Path, *, hosts: Path | None = None, execute: bool = True) -> CheckResult:
    """Check `path`: a program, a lab file, a lab's folder, or the name of a provided lab; with a lab the file `hosts`.

    `execute`: Python files that a lab names are executed, which is said on standard error; else they are not checked.
    """
    found = CheckResult(path)
    if path.suffix == ".rmr":
        _compile(found, path, ())
        return found
    _check_lab(found, path, execute=execute)
    if hosts is not None and found.lab is not None:
        _check_hosts(found, hosts, found.lab)
    return found


def _check_lab(found: CheckResult, path: Path, *, execute: bool) -> None:
    try:
        lab = load_lab(path)
        radio_key(lab)
    except LabError as error:
        found.findings += error.problems
        found.unreadable = any(problem.line == 0 for problem in error.problems)
        _compile_of_wrong_lab(found, lab_path(path))
        return
    found.lab = lab
    if not lab.program.exists():
        found.findings.append(program_missing(lab))
        return
    _load(found, lab.program, lab.given, closed=lab.is_closed)
    if found.program is None:
        return
    found.findings += run_findings(lab, found.program)
    _say_executed(path, lab, execute=execute)
    if execute:
        found.findings += [*_handlers(lab, found.program), *_events(lab)]
    elif lab.actions is None:
        found.findings += _handlers(lab, found.program)
    found.findings.sort()


def _check_hosts(found: CheckResult, hosts: Path, lab: Lab) -> None:
    try:
        read_hosts(hosts, lab)
    except LabError as error:
        found.findings += error.problems
        found.unreadable |= any(problem.line == 0 for problem in error.problems)


def _load(found: CheckResult, program: Path, stated: Sequence[str], *, closed: bool = False) -> None:
    """Compile or read the program; facts of the predicates `stated` come from the lab, if `closed` no others."""
    if program.suffix == ".rmr":
        _compile(found, program, stated, closed=closed)
        return
    try:
        found.program = load_program(program).program
    except ProgramError as error:
        found.findings.append(_finding_in(str(error), str(program)))


def _compile(found: CheckResult, program: Path, stated: Sequence[str], *, closed: bool = False) -> None:
    compilation = compile_file(program, dict.fromkeys(stated, False), closed=closed)
    found.diagnostics = compilation.diagnostics
    found.sources = compilation.sources
    found.program = compilation.program
    found.unreadable = compilation.unreadable


def _compile_of_wrong_lab(found: CheckResult, file: Path) -> None:
    """Compile the program of a wrong lab file if the file names one."""
    try:
        value = read(file).value
    except LabError:
        return
    if not isinstance(value, dict):
        return
    name = value.get("program")
    facts = value.get("facts")
    if isinstance(name, str) and Path(name).suffix in PROGRAM_SUFFIXES and (file.parent / name).is_file():
        items = facts if isinstance(facts, list) else []
        texts = [item.get("fact") if isinstance(item, dict) else item for item in items]
        stated = [str(text).split("(")[0].strip(" !") for text in texts]
        _load(found, file.parent / name, stated)


def _say_executed(path: Path, lab: Lab, *, execute: bool) -> None:
    """Say which Python files of the lab are about to be executed, or are not."""
    names = " and ".join(file.name for file in (lab.actions, lab.events) if file is not None)
    if names:
        how = "executed, as by a run (not with --no-code)" if execute else "not executed, and so not checked"
        print(f"{path}: {names}: {how}", file=sys.stderr, flush=True)


def _handlers(lab: Lab, program: Program) -> Iterable[Finding]:
    """Yield the errors of the file of actions, and an error for each action without a handler."""
    handlers: dict[str, Handler] = {}
    try:
        with redirect_stdout(sys.stderr):
            handlers = load_actions(lab.actions)
    except ActionsError as error:
        yield _finding_in(str(error), str(lab.actions))
        return
    places = program.debug.predicates if program.debug is not None else ()
    for index, predicate in enumerate(program.predicates):
        if predicate.kind is not Kind.ACTION or predicate.name in {*handlers, *PROVIDED, *lab.performs}:
            continue
        where = lab.actions or "a Python file that the lab file names under actions"
        message = f'no handler for action {predicate.name}: write one in {where}, @action("{predicate.name}")'
        if index < len(places):
            place = places[index]
            yield Finding(place.file, place.line, place.column, "", message)
        else:
            yield Finding(str(lab.program), 0, 0, "", message)


def _events(lab: Lab) -> Iterable[Finding]:
    try:
        with redirect_stdout(sys.stderr):
            load_events(lab.events, lab, lab.seed)
    except ProgramError as error:
        yield _finding_in(str(error), str(lab.events))


def _finding_in(text: str, file: str) -> Finding:
    """Return the error `text` of a user's file as a finding, at its line if the text begins with one."""
    placed = _PLACE.match(text)
    if placed is not None:
        return Finding(placed["file"], int(placed["line"]), 1, "", placed["message"])
    return Finding(file, 0, 0, "", text.removeprefix(f"{file}: "))


def _line(finding: Finding) -> str:
    """Return a finding as one line with its severity, like those of the compiler."""
    path = f"{finding.path}: " if finding.path else ""
    return f"{finding.where}: {finding.severity}: {path}{finding.message}"


def _as_json(finding: Finding) -> dict[str, Any]:
    line, column = (finding.line, finding.column) if finding.has_place else (1, 1)
    hint = _HINT.search(finding.message)
    message = _HINT.sub("", finding.message)
    return {
        "file": finding.file,
        "line": line,
        "column": column,
        "end_line": line,
        "end_column": column,
        "severity": finding.severity,
        "code": None,
        "message": f"{finding.path}: {message}" if finding.path else message,
        "hint": None if hint is None else hint[1],
        "fix": None,
    }


# --- the command


def perform(
    paths: Sequence[Path], *, as_json: bool, explain: bool, svg: Path | None, hosts: Path | None, execute: bool
) -> int:
    """Check `paths`, print the findings, explain the labs, draw one if `svg` is given; return the exit code.

    `hosts` is a file that is checked with the only lab.

    `execute`: Python files of the labs are executed.
    """
    found = [check(path, hosts=hosts, execute=execute) for path in paths]
    explained = _explained(found) if explain else []
    if as_json:
        listed = [entry for each in found for entry in each.as_json()]
        labs = {"explanation": {"labs": [asdict(each) for each in explained]}} if explain else {}
        print_json({"diagnostics": listed, **labs})
    else:
        _show(found)
        print("\n".join(map(show, explained)), end="")
    code = _exit_code(found)
    if svg is not None:
        code = _draw(found[0], svg, explain=explain) or code
    return code


def _explained(found: Sequence[CheckResult]) -> list[ExplainedLab]:
    """Return the explanations of the labs without errors."""
    return [
        explain_lab(str(each.path), each.lab, each.program)
        for each in found
        if each.lab is not None and each.program is not None and ERROR not in each.severities
    ]


def _show(found: Sequence[CheckResult]) -> None:
    color = has_colour(sys.stderr)
    for each in found:
        print(each.text(color), end="", file=sys.stderr)
    severities = [severity for each in found for severity in each.severities]
    errors = severities.count(ERROR)
    if severities:
        print(f"{_counted(errors, 'error')}, {_counted(len(severities) - errors, 'warning')}", file=sys.stderr)
    for each in found:
        if each.lab is not None and ERROR not in each.severities:
            print(f"{each.path}: {_in_short(each.lab)}", file=sys.stderr)


def _counted(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _in_short(lab: Lab) -> str:
    least_s = bound_s(lab)
    bound = f"; no schedule finishes sooner than {least_s:.2f} s" if 0.0 < least_s < float("inf") else ""
    return f"{_counted(len(lab.robots), 'robot')}, {_counted(len(lab.arena.areas), 'area')}{bound}"


def _exit_code(found: Sequence[CheckResult]) -> int:
    if any(ERROR in each.severities and not each.unreadable for each in found):
        return ExitCode.INVALID
    return ExitCode.USAGE if any(each.unreadable for each in found) else 0


def _draw(found: CheckResult, svg: Path, *, explain: bool) -> int:
    """Write the picture, with the narrow passages if it is to `explain`; return the exit code."""
    lab = found.lab
    if lab is None:
        print(f"{svg} is not drawn: the lab file has errors", file=sys.stderr)
        return ExitCode.INVALID
    goals = destinations(lab) if found.program is None else first_destinations(lab, found.program)
    try:
        passages = narrow_places(lab.arena).passages if explain else ()
        svg.write_text(draw(lab, goals, passages), encoding="utf-8")
    except OSError as error:
        print(f"{svg}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE
    return 0

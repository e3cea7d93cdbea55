"""All that is judged before a run, of programs and labs alike, as one list.

A lab is judged as `rmr sim` and `rmr up` do it: the lab file, its program, both together, the radio's key, the files of
actions and events. As much as possible is told at once: a program is compiled even if its lab file is wrong.
"""

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rmr.bytecode.program import Kind, Program
from rmr.lang.compiler import compile_file
from rmr.lang.diagnostics.diagnostic import Diagnostic
from rmr.lang.diagnostics.render import render_text, to_json
from rmr.lang.read.source_text import SourceText
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler
from rmr.node.actions.user_file import ActionsError, load_actions
from rmr_sim.user_events import load_events
from rmr_world.document import END_LINE, LabError, Problem, read
from rmr_world.judge import errors_of, warnings_of
from rmr_world.lab import PROGRAMS, Lab, lab_path, load_lab
from rmr_world.program import ProgramError, load_program, program_missing
from rmr_world.radio_key import radio_key

ERROR, WARNING = "error", "warning"
_WARNING = "warning: "
_HINT = re.compile(r"; (did you mean .*\?|known are .*)$")
_PLACE = re.compile(r"^(?P<file>.+?):(?P<line>[0-9]+): (?P<message>.*)$", re.DOTALL)


@dataclass(slots=True)
class Findings:
    """What was found in one program or lab."""

    path: Path
    """As it was named."""
    diagnostics: Sequence[Diagnostic] = ()
    """Of the program."""
    sources: Mapping[str, SourceText] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    """Of the lab, and of the lab and its program together; of warnings the message begins with `warning: `."""
    lab: Lab | None = None
    """If the lab file is valid."""
    program: Program | None = None
    unreadable: bool = False
    """Whether there is no such file."""

    @property
    def severities(self) -> list[str]:
        """The severity of each finding."""
        own = [WARNING if problem.message.startswith(_WARNING) else ERROR for problem in self.problems]
        return [*(each.severity.value for each in self.diagnostics), *own]

    def as_json(self) -> list[dict[str, object]]:
        """Return the findings in the shape of `rmr check --json`."""
        return [*to_json(self.diagnostics, self.sources), *map(_as_json, self.problems)]

    def text(self, color: bool) -> str:
        """Return the findings for people."""
        lines = "".join(f"{_shown(problem)}\n" for problem in self.problems)
        return render_text(self.diagnostics, self.sources, color) + lines


def judge(path: Path) -> Findings:
    """Return what is wrong with `path`: a program, a lab file, a lab's folder, or the name of a provided lab."""
    if path.suffix == ".rmr":
        found = Findings(path)
        _compile(found, path, ())
        return found
    found = Findings(path)
    file = lab_path(path)
    try:
        lab = load_lab(path)
        radio_key(lab)
    except LabError as error:
        found.problems += error.problems
        found.unreadable = any(problem.line == 0 for problem in error.problems)
        _compile_of_wrong_lab(found, file)
        return found
    found.lab = lab
    if not lab.program.exists():
        found.problems += program_missing(lab)
        return found
    _load(found, lab.program, [fact.name for fact in lab.stated_facts])
    if found.program is None:
        return found
    errors = errors_of(lab, found.program)
    found.problems += errors or warnings_of(lab, found.program)
    found.problems += [*_handlers(lab, found.program), *_events(lab)]
    found.problems.sort()
    return found


def _load(found: Findings, program: Path, stated: Sequence[str]) -> None:
    """Compile or read the program; facts of the predicates `stated` come from the lab."""
    if program.suffix == ".rmr":
        _compile(found, program, stated)
        return
    try:
        found.program = load_program(program).program
    except ProgramError as error:
        found.problems.append(_problem_in(str(error), str(program)))


def _compile(found: Findings, program: Path, stated: Sequence[str]) -> None:
    compilation = compile_file(program, dict.fromkeys(stated, False))
    found.diagnostics, found.sources = compilation.diagnostics, compilation.sources
    found.program, found.unreadable = compilation.program, compilation.unreadable


def _compile_of_wrong_lab(found: Findings, file: Path) -> None:
    """Compile the program that a wrong lab file names, if it does."""
    try:
        value = read(file).value
    except LabError:
        return
    if not isinstance(value, dict):
        return
    name, facts = value.get("program"), value.get("facts")
    if isinstance(name, str) and Path(name).suffix in PROGRAMS and (file.parent / name).is_file():
        stated = [str(fact).split("(")[0].strip(" !") for fact in facts] if isinstance(facts, list) else []
        _load(found, file.parent / name, stated)


def _handlers(lab: Lab, program: Program) -> Iterable[Problem]:
    """Yield what is wrong with the file of actions, and each action that nothing carries out."""
    handlers: dict[str, Handler] = {}
    try:
        with redirect_stdout(sys.stderr):
            handlers = load_actions(lab.actions)
    except ActionsError as error:
        yield _problem_in(str(error), str(lab.actions))
        return
    places = program.debug.predicates if program.debug is not None else ()
    for index, predicate in enumerate(program.predicates):
        if predicate.kind is not Kind.ACTION or predicate.name in handlers or predicate.name in PROVIDED:
            continue
        where = lab.actions or "a Python file that the lab file names under actions"
        message = f'no handler for action {predicate.name}: write one in {where}, @action("{predicate.name}")'
        if index < len(places):
            place = places[index]
            yield Problem(place.file, place.line, place.column, "", message)
        else:
            yield Problem(str(lab.program), 0, 0, "", message)


def _events(lab: Lab) -> Iterable[Problem]:
    try:
        with redirect_stdout(sys.stderr):
            load_events(lab.events, lab, lab.seed)
    except ProgramError as error:
        yield _problem_in(str(error), str(lab.events))


def _problem_in(text: str, file: str) -> Problem:
    """Return what is wrong with a user's file, as a problem at its line if `text` begins with one."""
    placed = _PLACE.match(text)
    if placed is not None:
        return Problem(placed["file"], int(placed["line"]), 1, "", placed["message"])
    return Problem(file, 0, 0, "", text.removeprefix(f"{file}: "))


def _shown(problem: Problem) -> str:
    """Return the problem as a line that says its severity, like those of programs."""
    message = problem.message.removeprefix(_WARNING)
    severity = WARNING if problem.message.startswith(_WARNING) else ERROR
    where = f"{problem.file}:{problem.line}:{problem.column}" if 0 < problem.line < END_LINE else problem.file
    return f"{where}: {severity}: {f'{problem.path}: ' if problem.path else ''}{message}"


def _as_json(problem: Problem) -> dict[str, Any]:
    placed = 0 < problem.line < END_LINE
    line, column = (problem.line, problem.column) if placed else (1, 1)
    severity = WARNING if problem.message.startswith(_WARNING) else ERROR
    message = problem.message.removeprefix(_WARNING)
    hint = _HINT.search(message)
    return {
        "file": problem.file,
        "line": line,
        "column": column,
        "end_line": line,
        "end_column": column,
        "severity": severity,
        "code": None,
        "message": f"{problem.path}: {_HINT.sub('', message)}" if problem.path else _HINT.sub("", message),
        "hint": None if hint is None else hint[1],
    }

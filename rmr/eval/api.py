"""`rmr.compile` and `rmr.evaluate`: what `rmrc` and `rmr eval` do, as functions that return plain data.

They raise what `rmr.base.errors` names, print nothing and write no file.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import Any

from rmr.base.errors import CompileError, ProgramError, UsageError, require
from rmr.base.ids import spelled
from rmr.base.time import Duration
from rmr.bytecode.codec import BytecodeError, encode
from rmr.bytecode.program import Program, Strategy
from rmr.eval import options
from rmr.eval.column_run import ColumnRun, hindrance
from rmr.eval.ensemble import Conditions, Ensemble, Note, Sink
from rmr.eval.eval_report import EvaluatedRun, reasons, report
from rmr.eval.given import Given, InvalidBytecodeError, Wanted, check_size, read_given, strangers
from rmr.eval.options import COLUMNAR, deaths
from rmr.eval.topology import read as read_topology
from rmr.lang.compiler import Compilation, compile_file, compile_text
from rmr.lang.diagnostics.render import render_text, to_json
from rmr.lang.read.source_text import SourceText
from rmr.vm.engines import Engine

Seconds = float | str
"""A time: a number of seconds, or a duration as in programs (``500ms``)."""


@dataclass(frozen=True, slots=True)
class Compiled:
    """A program without errors."""

    octets: bytes = field(repr=False)
    """Its byte-code, as `rmrc` writes it."""
    diagnostics: list[dict[str, Any]]
    """The warnings, as `rmr check --json` lists them."""
    program: Program = field(repr=False)
    """What robots run."""
    source: SourceText = field(repr=False)


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A program has been run on robots without bodies."""

    report: dict[str, Any]
    """The report that `rmr eval` prints."""
    trace: list[dict[str, Any]] = field(repr=False)
    """The entries that `rmr eval --trace` writes; empty unless requested."""
    messages: list[str]
    """Warnings, and the work outstanding at the end: what `rmr eval` prints besides the report."""

    @property
    def quiescent(self) -> bool:
        """Whether nothing was left to do."""
        return bool(self.report["quiescent"])

    def facts(self, robot: int) -> list[str]:
        """Return the facts of one robot, in program syntax. Raises UsageError for one that is not there."""
        parts = self.report["robots"]
        if str(robot) not in parts:
            raise UsageError(f"robot: one of {spelled(sorted(map(int, parts)))}, not {robot!r}")
        facts: list[str] = parts[str(robot)]["facts"]
        return facts


def compile(program: str | PathLike[str], *, strip: bool = False) -> Compiled:  # noqa: A001 - of the module `rmr`
    """Return a compiled program.

    `program` is a path, or the text of a program: a string with a line break, or that ends neither in ``.rmr`` nor in
    ``.rbc``. `strip` leaves out where everything stands in the source.

    Raises CompileError if the program has errors, or its file cannot be read.
    """
    where = _program(program)
    compilation = compile_text(where) if isinstance(where, SourceText) else compile_file(where)
    if compilation.program is None:
        raise _refused([compilation])
    try:
        octets = encode(compilation.program, debug=not strip)
    except BytecodeError as error:
        raise CompileError(f"{compilation.source.file}: error: {error}", []) from None
    return Compiled(octets, _listed([compilation]), compilation.program, compilation.source)


def evaluate(
    program: str | PathLike[str] | Compiled,
    *,
    robots: int | str | Iterable[int] = 1,
    topology: str = "complete",
    edges: str | None = None,
    facts: str | PathLike[str] | None = None,
    insert: Sequence[str] = (),
    kill: Sequence[str] = (),
    restart: Sequence[str] = (),
    fail: Sequence[str] = (),
    seed: int = 0,
    until: Seconds = 60.0,
    loss: float = 0.0,
    latency: Seconds = 0.005,
    action_time: Seconds = 0.0,
    action_times: Mapping[str, Seconds] | None = None,
    strategy: str | None = None,
    engine: str = "generated",
    trace: bool = False,
) -> Evaluation:
    """Run a program on robots without bodies, in virtual time, until nothing is left to do.

    `program` is as in `compile`, or compiled. The other arguments are the options of `rmr eval`; times are seconds, or
    durations such as ``500ms``. `robots` is a number, ids, or text such as ``0-5,9``; `facts` is a file.

    Raises UsageError for an argument that cannot be used, CompileError or ProgramError if the program cannot.
    """
    ids = dict.fromkeys(options.robots(robots if isinstance(robots, str) else _ids(robots)))
    times = _times(action_times)
    where = program.source if isinstance(program, Compiled) else _program(program)
    _check_files_and_names(topology, edges, facts)
    insert = _texts("insert", insert)
    fail = _texts("fail", fail)
    wanted = Wanted(where, None if facts is None else Path(facts), edges, insert, fail, tuple(times))
    shape = read_topology(topology, ids)
    conditions = Conditions(
        ids,
        shape,
        _seed(seed),
        _share(loss),
        _duration("latency", latency),
        _duration("action_time", action_time),
        times,
        deaths(_texts("kill", kill), _texts("restart", restart), ids),
    )
    given = _given(wanted)
    assert given.program is not None
    check_size(given, given.program, shape, ids)
    ordered = given.program if strategy is None else replace(given.program, strategy=_strategy(strategy))
    notes: list[Note] = []
    run, said = _prepared(engine, ordered, given, conditions, notes.extend if trace else None)
    said = [*_listed_texts(given), *_dropped(given, ordered, ids), *said]
    run.run(_duration("until", until), lambda: None)
    said += [text for texts in run.warnings() for text in texts]
    return Evaluation(report(run), notes, said if run.quiescent else said + reasons(run))


def _prepared(
    engine: str, program: Program, given: Given, conditions: Conditions, sink: Sink | None
) -> tuple[EvaluatedRun, list[str]]:
    """Return the run, and why it is not columnar if that was requested."""
    engines = [each.value for each in Engine]
    if engine not in (*engines, COLUMNAR):
        raise UsageError(f"engine: {engine!r} is none of {', '.join([*engines, COLUMNAR])}")
    if engine != COLUMNAR:
        return Ensemble(program, given, replace(conditions, engine=Engine(engine)), sink), []
    found = hindrance(program, given, conditions, traced=sink is not None)
    if found is None:
        return ColumnRun(program, given, conditions), []
    return Ensemble(program, given, conditions, sink), [f"each robot by itself instead of columns: {found.text}"]


def _given(wanted: Wanted) -> Given:
    try:
        given = read_given(wanted)
    except InvalidBytecodeError as error:
        raise ProgramError(str(error)) from None
    if given.program is None:
        raise _refused(given.checked)
    return given


def _refused(found: Sequence[Compilation]) -> CompileError:
    text = "".join(render_text(each.diagnostics, each.sources, color=False) for each in found)
    return CompileError(text.rstrip("\n"), _listed(found))


def _listed(found: Sequence[Compilation]) -> list[dict[str, Any]]:
    return [listed for each in found for listed in to_json(each.diagnostics, each.sources)]


def _listed_texts(given: Given) -> list[str]:
    texts = [render_text(each.diagnostics, each.sources, color=False).rstrip("\n") for each in given.checked]
    return [text for text in texts if text]


def _dropped(given: Given, program: Program, ids: Collection[int]) -> list[str]:
    dropped = strangers(given, program, ids)
    return [f"robot {robot} is not among the robots; `{name}` is dropped" for name, robot in dropped]


# ---- arguments


def _program(program: str | PathLike[str]) -> Path | SourceText:
    require("program", program, (str, PathLike), "a path, a text, or what `rmr.compile` has returned")
    if isinstance(program, str) and ("\n" in program or not program.endswith((".rmr", ".rbc"))):
        return SourceText("<program>", program)
    return Path(program)


def _ids(robots: int | Iterable[int]) -> str:
    require("robots", robots, (Integral, Iterable), "a number, ids, or text such as 0-5,9")
    if not isinstance(robots, Iterable):
        return str(int(robots))
    ids = list(robots)
    return ",".join(map(str, ids)) if len(ids) != 1 else f"{ids[0]}-{ids[0]}"


def _check_files_and_names(topology: object, edges: object, facts: object) -> None:
    require("topology", topology, str, "the name of a topology")
    require("edges", edges, (str, NoneType), "the name of a predicate")
    require("facts", facts, (str, PathLike, NoneType), "the path of a file")


def _texts(name: str, texts: Sequence[str]) -> tuple[str, ...]:
    """Return several texts; a single one is taken for one."""
    takes = f"a list of texts, as `--{name}` takes them"
    require(name, texts, Iterable, takes)
    several = (texts,) if isinstance(texts, str) else tuple(texts)
    for text in several:
        require(name, text, str, takes)
    return several


def _times(times: Mapping[str, Seconds] | None) -> dict[str, Duration]:
    require("action_times", times, (Mapping, NoneType), 'a dict of times by action, such as {"moveto": 2.0}')
    return {name: _duration(f"action_times[{name!r}]", time) for name, time in (times or {}).items()}


def _duration(name: str, time: Seconds) -> Duration:
    require(name, time, (str, Real), "seconds, or a duration such as '500ms'")
    try:
        return options.duration(time if isinstance(time, str) else repr(float(time)))
    except options.OptionError as error:
        raise UsageError(f"{name}: {error}") from None


def _share(loss: float) -> float:
    require("loss", loss, (str, Real), "a share from 0 to 1")
    try:
        return options.share(str(loss))
    except options.OptionError as error:
        raise UsageError(f"loss: {error}") from None


def _seed(seed: int) -> int:
    require("seed", seed, Integral, "a whole number from 0")
    if seed < 0:
        raise UsageError(f"seed: a whole number from 0, not {seed}")
    return int(seed)


def _strategy(name: str) -> Strategy:
    known = [each.name.lower() for each in Strategy]
    if name not in known:
        raise UsageError(f"strategy: {name!r} is none of {', '.join(known)}")
    return Strategy[name.upper()]

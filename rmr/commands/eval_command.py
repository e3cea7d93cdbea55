"""`rmr eval`: a program on robots without bodies, in virtual time; the report as JSON."""
# ruff: noqa: PLC0415 - see rmr.commands

import json
import signal
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from rmr.base.printable import counted
from rmr.commands import diagnosed
from rmr.commands.common import reason
from rmr.entry import JSON_VERSION, ExitCode
from rmr.entry.command_line import Command, CommandLineError, Parser, whole
from rmr.eval import options
from rmr.eval.options import COLUMNAR, OptionError

if TYPE_CHECKING:
    from rmr.bytecode.program import Program
    from rmr.eval.ensemble import Conditions, Sink
    from rmr.eval.eval_report import EvaluatedRun
    from rmr.eval.given import Given, Wanted
    from rmr.eval.options import Death
    from rmr.eval.topology import Topology

PROGRESS_AFTER_S = 2.0
"""Wall time before the progress line appears on a terminal, seconds."""
WARNINGS_MAX = 8
"""Number of warnings shown of one kind; thousands of robots may give the same one."""
LINE_WIDTH = 100
"""Columns of a line of the report; a text that is longer by itself stands on a line of its own."""

ABOUT = """\
Run a program on robots without bodies, in virtual time, until nothing is left to do.

The report is printed as JSON on stdout, messages on stderr. Durations: 500ms, 2s, 1.5min, or a number of seconds.
"""


def _declare(parser: Parser) -> None:
    parser.positional("program", "PROG.rmr")
    _declare_robots(parser)
    _declare_events(parser)
    _declare_run(parser)
    parser.option("--trace", metavar="FILE", read=Path, help="Write what happens as JSON lines.")
    parser.flag("--json", dest="one_line", help="The whole report on one line.")


def _declare_robots(parser: Parser) -> None:
    """Declare the robots, their topology and their initial facts."""
    parser.option(
        "--robots", metavar="N|IDS", read=options.robots, default="1", help="How many, with ids from 1, or ids: 0-5,9."
    )
    parser.option(
        "--topology",
        metavar="NAME|FILE",
        default="complete",
        help="Who is in radio range of whom: complete, line, ring, grid, star, or a file of pairs.",
    )
    parser.option("--edges", metavar="PRED", help="Give each robot A facts !PRED(A, B) for all B in range.")
    parser.option("--facts", metavar="FILE.rmr", read=Path, help="More initial facts.")


def _declare_events(parser: Parser) -> None:
    """Declare the events from outside: inserted facts, deaths and restarts."""
    parser.option(
        "--insert", dest="inserts", metavar="'T: FACT'", repeatable=True, help="A fact from outside at T; repeatable."
    )
    parser.option(
        "--kill",
        dest="kills",
        metavar="'T: @ID'",
        repeatable=True,
        help="Robots that die at T, as @2 or @2,@5; repeatable.",
    )
    parser.option(
        "--restart",
        dest="restarts",
        metavar="'T: @ID'",
        repeatable=True,
        help="Dead robots that start again at T; repeatable.",
    )


def _declare_run(parser: Parser) -> None:
    """Declare seed, durations, losses, failures and the engine of a run."""
    parser.option("--seed", metavar="S", read=whole(), default=0, help="Of all chance.")
    parser.option("--until", metavar="T", read=options.duration, default="60s", help="Virtual time at most.")
    parser.option("--loss", metavar="SHARE", read=options.share, default="0", help="Share of frames lost.")
    parser.option("--latency", metavar="T", read=options.duration, default="5ms", help="Of every frame.")
    parser.option(
        "--action-time",
        dest="times",
        metavar="[ACTION=]T",
        repeatable=True,
        help="Of every action, or of one: moveto=3s; repeatable. 0 by default; `wait` takes what it says.",
    )
    parser.option(
        "--fail",
        dest="fails",
        metavar="ACTION[@N]",
        repeatable=True,
        help="Actions that fail: 'charge', 'charge(@2, _)'; with @N the N-th that begins alone. Repeatable.",
    )
    parser.choice("--strategy", ["random", "textual", "deadline"], help="Instead of the program's own order.")
    parser.choice(
        "--engine",
        ["interpreter", "generated", COLUMNAR],
        default="generated",
        help="What runs the rules; the report is the same.",
    )


def _evaluate(
    program: Path,
    robots: tuple[int, ...],
    topology: str,
    edges: str | None,
    facts: Path | None,
    inserts: list[str],
    kills: list[str],
    restarts: list[str],
    seed: int,
    until: int,
    loss: float,
    latency: int,
    times: list[str],
    fails: list[str],
    strategy: str | None,
    engine: str,
    trace: Path | None,
    one_line: bool,
) -> int:
    """Run a program and print the report; return the exit code."""
    from rmr.eval.ensemble import Conditions
    from rmr.eval.given import Wanted

    ids = dict.fromkeys(robots)
    action_time, action_times = _action_times(times)
    wanted = Wanted(program, facts, edges, tuple(inserts), tuple(fails), tuple(action_times))
    deaths = _deaths(tuple(kills), tuple(restarts), ids)
    given, shape = _read(wanted, topology, ids)
    diagnosed.show(given.checked)
    if given.program is None:
        return diagnosed.exit_code(given.checked)
    _warn_of_strangers(given, given.program, ids)
    conditions = Conditions(ids, shape, seed, loss, latency, action_time, action_times, deaths)
    with _traced(trace, (program, facts)) as sink:
        run = _prepare(engine, _ordered(given.program, strategy), given, conditions, sink)
        interrupted = _run(run, until)
    _conclude(run, until, interrupted)
    _print(run, one_line)
    return ExitCode.FAILED if interrupted or run.unsendable else ExitCode.OK


command = Command(ABOUT, _declare, _evaluate)


# ---- before the run


def _action_times(texts: list[str]) -> tuple[int, dict[str, int]]:
    """Return the default duration of actions, and those of single actions by name."""
    try:
        return options.action_times(texts)
    except OptionError as error:
        raise CommandLineError(f"--action-time: {error}") from None


def _read(wanted: "Wanted", topology: str, ids: dict[int, None]) -> tuple["Given", "Topology"]:
    """Return the robots' input and their topology, or end the command with an error."""
    from rmr.eval.given import InvalidBytecodeError, check_size, read_given
    from rmr.eval.topology import read

    try:
        shape = read(topology, ids)
    except OptionError as error:
        raise CommandLineError(f"--topology: {error}") from None
    try:
        given = read_given(wanted)
        if given.program is not None:
            check_size(given, given.program, shape, ids)
    except OptionError as error:
        raise CommandLineError(str(error)) from None
    except InvalidBytecodeError as error:
        print(str(error), file=sys.stderr)
        sys.exit(ExitCode.INVALID)
    return given, shape


def _deaths(kills: tuple[str, ...], restarts: tuple[str, ...], ids: dict[int, None]) -> "tuple[Death, ...]":
    from rmr.eval.options import deaths

    try:
        return deaths(kills, restarts, ids)
    except OptionError as error:
        raise CommandLineError(str(error)) from None


def _ordered(program: "Program", strategy: str | None) -> "Program":
    from rmr.bytecode.program import Strategy

    return program if strategy is None else replace(program, strategy=Strategy[strategy.upper()])


def _warn_of_strangers(given: "Given", program: "Program", ids: dict[int, None]) -> None:
    from rmr.eval.given import strangers

    _warn(
        f"robot {robot} is not among the robots; `{name}` that is stated for it is dropped"
        for name, robot in strangers(given, program, ids)
    )


def _warn(texts: Iterable[str]) -> None:
    listed = list(texts)
    for text in listed[:WARNINGS_MAX]:
        print(f"rmr eval: warning: {text}", file=sys.stderr)
    if len(listed) > WARNINGS_MAX:
        print(f"rmr eval: warning: and {len(listed) - WARNINGS_MAX} more of that kind", file=sys.stderr)


@contextmanager
def _traced(path: Path | None, sources: tuple[Path | None, ...]) -> Iterator["Sink | None"]:
    """Yield the sink of a trace in `path`, or None without a path; the input files are never overwritten."""
    if path is None:
        yield None
        return
    if any(source is not None and path.exists() and path.samefile(source) for source in sources):
        raise CommandLineError(f"--trace: {path} is what is to be run")
    try:
        with path.open("w", encoding="utf-8") as file:
            yield lambda notes: _write_notes(file, notes)
    except (OSError, ValueError) as error:
        print(f"rmr eval: cannot write {path}: {reason(error)}", file=sys.stderr)
        sys.exit(ExitCode.USAGE)


def _write_notes(file: TextIO, notes: Iterable[dict[str, Any]]) -> None:
    file.writelines(json.dumps(note) + "\n" for note in notes)


# ---- the run


def _prepare(
    engine: str, program: "Program", given: "Given", conditions: "Conditions", sink: "Sink | None"
) -> "EvaluatedRun":
    """Return the run by an engine; a program unsuited for columns falls back to machines, with a message."""
    from rmr.eval.ensemble import Ensemble
    from rmr.vm.engines import Engine

    if engine == COLUMNAR:
        from rmr.eval.column_run import ColumnRun, hindrance

        found = hindrance(program, given, conditions, traced=sink is not None)
        if found is None:
            return ColumnRun(program, given, conditions)
        where = "" if found.place is None else f"{found.place.file}:{found.place.line}: "
        print(f"rmr eval: each robot by itself instead of columns: {where}{found.text}", file=sys.stderr)
        return Ensemble(program, given, conditions, sink)
    return Ensemble(program, given, replace(conditions, engine=Engine(engine)), sink)


def _run(run: "EvaluatedRun", until: int) -> bool:
    """Run; return whether Ctrl-C ended it.

    The first Ctrl-C stops the run and still prints its report; the second one ends the command at once.
    """
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        run.stop()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, interrupt)
    progress = ProgressLine(run, until)
    try:
        run.run(until, progress.refresh)
    finally:
        signal.signal(signal.SIGINT, before)
        progress.clear()
    return interrupted


class ProgressLine:
    """The progress of a long run, as one line on a terminal."""

    def __init__(self, run: "EvaluatedRun", until: int) -> None:
        self._run = run
        self._until = until
        self._next = time.monotonic() + PROGRESS_AFTER_S
        self._shown = False
        self._terminal = sys.stderr.isatty()

    def refresh(self) -> None:
        """Renew the line if its period has passed."""
        if not self._terminal or time.monotonic() < self._next:
            return
        self._next = time.monotonic() + 0.5  # refresh period of the progress line, seconds of wall time
        self._shown = True
        run = self._run
        at = f"{run.now / 1e9:.3f} s of {self._until / 1e9:g} s"
        what = f"{counted(run.firings, 'firing')}, {counted(run.busy, 'robot')} not idle"
        print(f"\r\x1b[K{at}, {what}", end="", file=sys.stderr)

    def clear(self) -> None:
        """Remove the line."""
        if self._shown:
            print("\r\x1b[K", end="", file=sys.stderr)


# ---- after the run


def _conclude(run: "EvaluatedRun", until: int, interrupted: bool) -> None:
    """Print warnings on stderr, and the outstanding work of a run that did not become quiescent."""
    from rmr.eval.eval_report import reasons

    for texts in run.warnings():
        _warn(texts)
    if run.quiescent:
        return
    at = f"{(run.now if interrupted or run.exhausted else until) / 1e9:g} s"
    if interrupted:
        why = f"interrupted at {at}"
    elif run.exhausted:
        frames = counted(run.frames, "frame")
        why = f"stopped at {at}, after {counted(run.firings, 'firing')} and {frames} without an end in sight"
    else:
        why = f"not quiescent at {at}"
    print(f"rmr eval: {why}:", file=sys.stderr)
    for line in reasons(run):
        print(f"  {line}", file=sys.stderr)


def _print(run: "EvaluatedRun", one_line: bool) -> None:
    from rmr.eval.eval_report import report

    values = {"version": JSON_VERSION, **report(run)}
    print(json.dumps(values) if one_line else laid_out(values))


def laid_out(value: Any, column: int = 0, indent: int = 0) -> str:
    """Return `value` as JSON for people, whose first line begins at `column` of a line that is indented by `indent`.

    What fits on a line stays on it, what does not has an item a line. It is the same on a terminal as in a file.
    """
    flat = json.dumps(value)
    if column + len(flat) <= LINE_WIDTH or not isinstance(value, dict | list) or not value:
        return flat
    inner = indent + 2
    if isinstance(value, dict):
        items = [_entry(key, each, inner) for key, each in value.items()]
        opening, closing = "{}"
    else:
        items = [laid_out(each, inner, inner) for each in value]
        opening, closing = "[]"
    pad = "\n" + " " * inner
    return f"{opening}{pad}{(',' + pad).join(items)}\n{' ' * indent}{closing}"


def _entry(key: str, value: Any, indent: int) -> str:
    name = f"{json.dumps(key)}: "
    return name + laid_out(value, indent + len(name), indent)

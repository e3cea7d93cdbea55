"""`rmr eval`: a program on robots without bodies, in virtual time; the report as JSON."""
# ruff: noqa: PLC0415 - see rmr.commands

import json
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from rmr.commands import diagnosed
from rmr.commands.common import EXIT_FAILED, EXIT_INVALID, EXIT_USAGE, PATH, SETTINGS, VERSION, counted, reason
from rmr.eval import options
from rmr.eval.options import OptionError

if TYPE_CHECKING:
    from rmr.bytecode.program import Program
    from rmr.eval.deaths import Death
    from rmr.eval.ensemble import Conditions, Sink
    from rmr.eval.eval_report import Run
    from rmr.eval.given import Given, Wanted
    from rmr.eval.topology import Topology

PROGRESS_AFTER_S = 2.0
"""A run that takes longer tells on a terminal how it is getting on ..."""
PROGRESS_EVERY_S = 0.5
"""... this often."""
COLUMNAR = "columnar"
"""The engine that takes all robots at once, where the program suits it."""
WARNINGS_MAX = 8
"""Warnings of one kind that are shown; thousands of robots may give the same."""


def _read_by(read: Callable[[Any], object]) -> Callable[[click.Context, click.Parameter, Any], object]:
    """Return the callback of an option whose value `read` reads; a wrong one ends the command with the reason."""

    def convert(ctx: click.Context, param: click.Parameter, value: Any) -> object:
        try:
            return read(value)
        except OptionError as error:
            raise click.BadParameter(str(error), ctx, param) from None

    return convert


_duration = _read_by(options.duration)


@click.command("eval", context_settings=SETTINGS, short_help="Run a program on robots without bodies.")
@click.argument("program", metavar="PROG.rmr", type=PATH)
@click.option(
    "--robots",
    metavar="N|IDS",
    callback=_read_by(options.robots),
    default="1",
    show_default=True,
    help="How many, with ids from 1, or ids: 0-5,9.",
)
@click.option(
    "--topology",
    metavar="NAME|FILE",
    default="complete",
    show_default=True,
    help="Who is in radio range of whom: complete, line, ring, grid, star, or a file of pairs.",
)
@click.option("--edges", metavar="PRED", help="Give each robot A facts !PRED(A, B) for all B in range.")
@click.option("--facts", metavar="FILE.rmr", type=PATH, help="More initial facts.")
@click.option("--insert", "inserts", metavar="'T: FACT'", multiple=True, help="A fact from outside at T; repeatable.")
@click.option(
    "--kill", "kills", metavar="'T: @ID'", multiple=True, help="Robots that die at T, as @2 or @2,@5; repeatable."
)
@click.option(
    "--restart", "restarts", metavar="'T: @ID'", multiple=True, help="Dead robots that start again at T; repeatable."
)
@click.option("--seed", metavar="S", type=click.IntRange(min=0), default=0, show_default=True, help="Of all chance.")
@click.option(
    "--until", metavar="T", callback=_duration, default="60s", show_default=True, help="Virtual time at most."
)
@click.option(
    "--loss",
    metavar="SHARE",
    callback=_read_by(options.share),
    default="0",
    show_default=True,
    help="Share of frames lost.",
)
@click.option("--latency", metavar="T", callback=_duration, default="5ms", show_default=True, help="Of every frame.")
@click.option(
    "--action-time",
    "times",
    metavar="[ACTION=]T",
    multiple=True,
    callback=_read_by(options.action_times),
    help="Of every action, or of one: moveto=3s; repeatable. 0 by default; `wait` takes what it says.",
)
@click.option(
    "--fail",
    "fails",
    metavar="ACTION[@N]",
    multiple=True,
    help="Actions that fail: 'charge', 'charge(@2, _)'; with @N the N-th that begins alone. Repeatable.",
)
@click.option("--strategy", type=click.Choice(["random", "textual"]), help="Instead of the program's own order.")
@click.option(
    "--engine",
    type=click.Choice(["interpreter", "generated", COLUMNAR]),
    default="generated",
    show_default=True,
    help="What runs the rules; the report is the same.",
)
@click.option("--trace", metavar="FILE", type=PATH, help="Write what happens as JSON lines.")
@click.option("--json", "one_line", is_flag=True, help="The whole report on one line.")
@VERSION
def command(
    program: Path,
    robots: tuple[int, ...],
    topology: str,
    edges: str | None,
    facts: Path | None,
    inserts: tuple[str, ...],
    kills: tuple[str, ...],
    restarts: tuple[str, ...],
    seed: int,
    until: int,
    loss: float,
    latency: int,
    times: tuple[int, dict[str, int]],
    fails: tuple[str, ...],
    strategy: str | None,
    engine: str,
    trace: Path | None,
    one_line: bool,
) -> None:
    """Run a program on robots without bodies, in virtual time, until nothing is left to do.

    The report is printed as JSON on stdout, messages on stderr. Durations: 500ms, 2s, 1.5min, or a number of seconds.
    """
    from rmr.eval.ensemble import Conditions
    from rmr.eval.given import Wanted

    ids = dict.fromkeys(robots)
    action_time, action_times = times
    wanted = Wanted(program, facts, edges, inserts, fails, tuple(action_times))
    befalls = _deaths(kills, restarts, ids)
    given, shape = _read(wanted, topology, ids)
    diagnosed.show(given.checked)
    if given.program is None:
        sys.exit(diagnosed.exit_code(given.checked))
    _warn_of_strangers(given, given.program, ids)
    conditions = Conditions(ids, shape, seed, loss, latency, action_time, action_times, befalls)
    with _traced(trace, (program, facts)) as sink:
        run = _prepare(engine, _ordered(given.program, strategy), given, conditions, sink)
        interrupted = _run(run, until)
    _conclude(run, until, interrupted)
    _print(run, one_line)
    sys.exit(EXIT_FAILED if interrupted else 0)


# ---- before the run


def _read(wanted: "Wanted", topology: str, ids: dict[int, None]) -> tuple["Given", "Topology"]:
    """Return what the robots are given and who is in range of whom, or end the command with what is wrong."""
    from rmr.eval.given import InvalidBytecodeError, check_size, read_given
    from rmr.eval.topology import read

    try:
        shape = read(topology, ids)
    except OptionError as error:
        raise click.BadParameter(str(error), param_hint="'--topology'") from None
    try:
        given = read_given(wanted)
        if given.program is not None:
            check_size(given, given.program, shape, ids)
    except OptionError as error:
        raise click.UsageError(str(error)) from None
    except InvalidBytecodeError as error:
        click.echo(str(error), err=True)
        sys.exit(EXIT_INVALID)
    return given, shape


def _deaths(kills: tuple[str, ...], restarts: tuple[str, ...], ids: dict[int, None]) -> "tuple[Death, ...]":
    from rmr.eval.deaths import deaths

    try:
        return deaths(kills, restarts, ids)
    except OptionError as error:
        raise click.UsageError(str(error)) from None


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
        click.echo(f"rmr eval: warning: {text}", err=True)
    if len(listed) > WARNINGS_MAX:
        click.echo(f"rmr eval: warning: and {len(listed) - WARNINGS_MAX} more of that kind", err=True)


@contextmanager
def _traced(path: Path | None, sources: tuple[Path | None, ...]) -> Iterator["Sink | None"]:
    """Yield what writes notes into `path`, or None without one; what was read is never overwritten."""
    if path is None:
        yield None
        return
    if any(source is not None and path.exists() and path.samefile(source) for source in sources):
        raise click.UsageError(f"--trace: {path} is what is to be run")
    try:
        with path.open("w", encoding="utf-8") as file:
            yield lambda notes: _write_notes(file, notes)
    except (OSError, ValueError) as error:
        click.echo(f"rmr eval: cannot write {path}: {reason(error)}", err=True)
        sys.exit(EXIT_USAGE)


def _write_notes(file: TextIO, notes: Iterable[dict[str, Any]]) -> None:
    file.writelines(json.dumps(note) + "\n" for note in notes)


# ---- the run


def _prepare(engine: str, program: "Program", given: "Given", conditions: "Conditions", sink: "Sink | None") -> "Run":
    """Return the run by an engine; what does not suit columns is run by machines, and it is said why."""
    from rmr.eval.ensemble import Ensemble
    from rmr.vm.engines import Engine

    if engine == COLUMNAR:
        from rmr.eval.column_run import ColumnRun, hindrance

        found = hindrance(program, given, conditions, traced=sink is not None)
        if found is None:
            return ColumnRun(program, given, conditions)
        where = "" if found.place is None else f"{found.place.file}:{found.place.line}: "
        click.echo(f"rmr eval: each robot by itself instead of columns: {where}{found.text}", err=True)
        return Ensemble(program, given, conditions, sink)
    return Ensemble(program, given, replace(conditions, engine=Engine(engine)), sink)


def _run(run: "Run", until: int) -> bool:
    """Run; return whether Ctrl-C ended it. The second Ctrl-C ends the command at once."""
    interrupted = False

    def interrupt(*_: object) -> None:
        nonlocal interrupted
        interrupted = True
        run.stop()
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, interrupt)
    progress = Progress(run, until)
    try:
        run.run(until, progress.look)
    finally:
        signal.signal(signal.SIGINT, before)
        progress.clear()
    return interrupted


class Progress:
    """One line on a terminal that says how a long run is getting on."""

    def __init__(self, run: "Run", until: int) -> None:
        self._run = run
        self._until = until
        self._next = time.monotonic() + PROGRESS_AFTER_S
        self._shown = False
        self._terminal = sys.stderr.isatty()

    def look(self) -> None:
        """Show the line anew if it is time."""
        if not self._terminal or time.monotonic() < self._next:
            return
        self._next = time.monotonic() + PROGRESS_EVERY_S
        self._shown = True
        run = self._run
        at = f"{run.now / 1e9:.3f} s of {self._until / 1e9:g} s"
        what = f"{counted(run.firings, 'firings')}, {counted(run.busy, 'robots')} not idle"
        click.echo(f"\r\x1b[K{at}, {what}", nl=False, err=True)

    def clear(self) -> None:
        """Take the line away."""
        if self._shown:
            click.echo("\r\x1b[K", nl=False, err=True)


# ---- after the run


def _conclude(run: "Run", until: int, interrupted: bool) -> None:
    """Say on stderr what did not arrive, and what still went on if the run did not become quiescent."""
    from rmr.eval.eval_report import reasons

    for texts in run.warnings():
        _warn(texts)
    if run.quiescent:
        return
    at = f"{(run.now if interrupted or run.exhausted else until) / 1e9:g} s"
    if interrupted:
        why = f"interrupted at {at}"
    elif run.exhausted:
        frames = counted(run.frames, "frames")
        why = f"stopped at {at}, after {counted(run.firings, 'firings')} and {frames} without an end in sight"
    else:
        why = f"not quiescent at {at}"
    click.echo(f"rmr eval: {why}:", err=True)
    for line in reasons(run):
        click.echo(f"  {line}", err=True)


def _print(run: "Run", one_line: bool) -> None:
    from rmr.eval.eval_report import report
    from rmr.eval.json_layout import laid_out

    told = report(run)
    click.echo(json.dumps(told) if one_line else laid_out(told))

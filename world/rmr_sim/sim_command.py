"""What `rmr sim LAB` does: a lab in virtual time, the same for the same seed; one run, or with `--seeds` many.

Standard output is the report's alone: what users' own actions and events print goes to standard error. Sweeps, hunts
and the recorder are loaded only where one is asked for.
"""
# ruff: noqa: PLC0415 - see above

import argparse
import sys
import time
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TextIO

from rmr.base.mistake import words
from rmr.base.time import in_seconds
from rmr.coord.timing import Order
from rmr.entry import ExitCode
from rmr.entry.files import unreadable
from rmr.entry.terminal import has_colour
from rmr.node.actions.dispatcher import INTERRUPTED
from rmr.node.trace import TraceLevel
from rmr_sim.event import EventError
from rmr_sim.interruption import Interruption, PoolError
from rmr_sim.run_setup import LoadedLab, Options, load, report_of
from rmr_sim.seed_run import BREAKDOWN_FILE, exit_code, row_of, write_trace
from rmr_sim.simulation import Simulation
from rmr_world.faults import fault_lines
from rmr_world.finding import LabError
from rmr_world.lab_file import lab_path
from rmr_world.lab_program import ProgramError
from rmr_world.run_folder import RunFolderError, make_run_folder
from rmr_world.run_report import REPORT_FILE, table_text, to_json, write
from rmr_world.run_warnings import missed_hint, run_warnings, view_hint

if TYPE_CHECKING:
    from rmr.record.record_writer import RecordWriter
    from rmr_sim.sim_recorder import SimulationRecorder

FAILURES_MAX = 5
"""Bound of the failed actions, and violations, that are printed: a program that retries does not fill the screen."""


class Viewer(Protocol):
    """Shows a run while it goes on (`rmr_view.sim_view`)."""

    def attach(self, simulation: Simulation, writer: "RecordWriter | None") -> None:
        """Show a run that is about to begin; `writer` is its recording."""

    def interrupt(self) -> None:
        """Let a run that is held up go on, since it is to end."""

    def over(self, report: dict[str, Any]) -> None:
        """Take note of the end of the run."""


def perform(arguments: argparse.Namespace, viewer: Viewer | None = None) -> int:
    """Carry out what is asked for; return the exit code. The second Ctrl-C raises KeyboardInterrupt.

    `viewer` is shown one run, with the trace at the level FACTS.
    """
    out = sys.stdout
    with redirect_stdout(sys.stderr):
        return _perform(arguments, out, viewer)


def _perform(arguments: argparse.Namespace, out: TextIO, viewer: Viewer | None) -> int:
    folder: Path | None = None
    if missing := unreadable((lab_path(arguments.lab), arguments.actions, arguments.events)):
        print("\n".join(f"rmr sim: {line}" for line in missing), file=sys.stderr)
        return ExitCode.USAGE
    try:
        loaded = load(arguments.lab, options_of(arguments))
        for text in loaded.warnings:
            print(text, end="", file=sys.stderr)
        if arguments.resume is not None:
            from rmr_sim.sweep import resume

            return resume(arguments, loaded, out)
        folder = make_run_folder(loaded.lab.name, arguments.run)
        if arguments.hunt:
            from rmr_sim.hunt.hunt_command import hunt

            return hunt(arguments, loaded, folder, out)
        if arguments.seeds is not None:
            from rmr_sim.sweep import sweep

            return sweep(arguments, loaded, folder, out)
        return _run(arguments, loaded, folder, out, viewer)
    except (LabError, ProgramError) as error:
        print(error, file=sys.stderr)
        return ExitCode.INVALID
    except (EventError, PoolError) as error:
        print("\n".join(f"rmr sim: {line}" for line in str(error).splitlines()), file=sys.stderr)
        return ExitCode.FAILED
    except BrokenPipeError:
        raise  # of the output: it is no mistake to have seen enough
    except (RunFolderError, OSError) as error:
        print(f"rmr sim: {_words_of(error)}", file=sys.stderr)
        return ExitCode.USAGE if folder is None else ExitCode.FAILED
    except Exception as error:
        return _broke_down(error, folder)


def _words_of(error: Exception) -> str:
    """Return what is wrong with a file or folder, without the number of the error."""
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    return error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"


def options_of(arguments: argparse.Namespace) -> Options:
    """Return what is asked of each run beside its seed."""
    return Options(
        robots=arguments.robots,
        loss=arguments.loss,
        actions=arguments.actions,
        event_file=arguments.events,
        chaos=arguments.chaos,
        hard_chaos=arguments.hard_chaos,
        durable=arguments.durable,
        order=Order(arguments.order),
    )


def _run(arguments: argparse.Namespace, loaded: LoadedLab, folder: Path, out: TextIO, viewer: Viewer | None) -> int:
    """One run."""
    recorder, simulation = _prepared(
        arguments, loaded, folder, traced=arguments.trace is not None or viewer is not None
    )
    if arguments.record is not None and recorder is not None and recorder.writer.failure:
        print(f"rmr sim: {recorder.writer.failure}", file=sys.stderr)
        return ExitCode.USAGE
    if arguments.chaos or arguments.hard_chaos:
        print("\n".join(["faults drawn from the seed:", *fault_lines(simulation.lab)]), file=sys.stderr)
    if arguments.trace is not None and not _writable(arguments.trace):
        if recorder is not None:
            recorder.writer.discard()
        return ExitCode.USAGE
    if viewer is not None:
        viewer.attach(simulation, None if recorder is None else recorder.writer)
    began = time.perf_counter()
    try:
        with Interruption() as interruption:
            interruption.ends(partial(_end, simulation, viewer))
            finished = simulation.run()
    finally:  # after a breakdown the trace tells what led to it
        trace = simulation.trace()
        unwritten = [] if arguments.trace is None else _attempt(partial(write_trace, trace, arguments.trace))
        if recorder is not None and sys.exception() is not None:
            recorder.close(None)
    wall_s = time.perf_counter() - began
    report = report_of(simulation, finished)
    if viewer is not None:
        viewer.over(report)
    unwritten += _attempt(partial(write, report, folder))
    going_on = [] if finished else under_way(simulation)
    warnings = [*failures(trace), *violation_lines(report), *run_warnings(report), *going_on]
    if recorder is not None:
        recorder.close(to_json(report).encode(), warnings)
        failed = recorder.writer.failure
        warnings += missed_hint(report, arguments.record or folder) if failed is None else [failed]
    for line in warnings:
        print(line, file=sys.stderr)
    print(to_json(report).rstrip() if arguments.json else table_text(report, color=has_colour(out)), file=out)
    speed = simulation.time_s / wall_s if wall_s > 0 else 0.0
    took = f"{simulation.time_s:.1f} s simulated in {wall_s:.2f} s ({speed:.0f} x real time)"
    for line in unwritten:
        print(f"rmr sim: {line}", file=sys.stderr)
    report_file = folder / REPORT_FILE
    where = f"the report is {report_file}" if report_file.is_file() else "there is no report"
    print(f"{'interrupted: ' if interruption.came else ''}{took}; {where}", file=sys.stderr)
    if recorder is not None and recorder.writer.failure is None:
        print(view_hint(arguments.record or folder), file=sys.stderr)
    return ExitCode.FAILED if unwritten else exit_code(row_of(report), strict=arguments.strict)


def _end(simulation: Simulation, viewer: Viewer | None) -> None:
    simulation.stop()
    if viewer is not None:
        viewer.interrupt()


def _prepared(
    arguments: argparse.Namespace, loaded: LoadedLab, folder: Path, *, traced: bool
) -> "tuple[SimulationRecorder | None, Simulation]":
    """Return the run, and its recording unless none is wanted."""
    level = TraceLevel.FACTS if traced else TraceLevel.NOTES
    if arguments.no_record:
        return None, loaded.simulation(arguments.seed, level)
    from rmr.record.recording import RUN_FILE
    from rmr_sim.sim_recorder import SimulationRecorder, simulation_writer

    writer = simulation_writer(loaded, arguments.seed, arguments.record or folder / RUN_FILE)
    try:
        simulation = loaded.simulation(arguments.seed, level, writer.mind)
    except BaseException:  # a run that does not begin leaves no recording
        writer.discard()
        raise
    return SimulationRecorder(simulation, loaded, writer), simulation


def _attempt(write_file: Callable[[], object]) -> list[str]:
    """Write a file; return a sentence if that was not possible."""
    try:
        write_file()
    except OSError as error:
        return [f"cannot write {_words_of(error)}"]
    return []


def _writable(trace: Path) -> bool:
    """Return whether the trace can be written: a failure is reported before the run."""
    try:
        write_trace([], trace)
    except OSError as error:
        print(f"rmr sim: {_words_of(error)}", file=sys.stderr)
        return False
    return True


def _broke_down(error: Exception, folder: Path | None) -> int:
    """Report an internal error on standard error and write its traceback to the run folder; return the exit code."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    where = f"in {last.name}, line {last.lineno} of {Path(last.filename).name}"
    if folder is not None:
        with suppress(OSError):
            (folder / BREAKDOWN_FILE).write_text("".join(traceback.format_exception(error)))
            where = f"where is told in {folder / BREAKDOWN_FILE}"
    print(f"rmr sim: broke down: {words(error)}; {where}", file=sys.stderr)
    return ExitCode.FAILED


def failures(trace: list[dict[str, object]]) -> list[str]:
    """Return a line for each action of `trace` that failed by itself, none twice, FAILURES_MAX at most."""
    lines: dict[str, None] = {}
    for entry in trace:
        if entry["what"] == "action_ended" and entry["failure"] not in (None, *INTERRUPTED):
            lines[f"robot {entry['robot']}: action {entry['action']} failed: {entry['failure']}"] = None
    return _first(list(lines), "failed; --trace FILE holds all")


def under_way(simulation: Simulation) -> list[str]:
    """Return a line for each action that has begun and not ended, the oldest first, FAILURES_MAX at most."""
    found = [
        (running.started or 0, robot.robot, running.text(robot.robot))
        for robot in simulation.robots
        if robot.alive
        for running in robot.node.actions.running
    ]
    texts = [
        f"robot {robot}: {text} is still under way, since {in_seconds(at):.3f} s" for at, robot, text in sorted(found)
    ]
    return _first(texts, "actions under way")


def violation_lines(report: dict[str, Any]) -> list[str]:
    """Return a line for each rule that did not hold, FAILURES_MAX at most."""
    lines = [f"violation at {each['t_s']:.3f} s: {each['check']}: {each['words']}" for each in report["violations"]]
    return _first(lines, "violations; the report holds all")


def _first(lines: list[str], more: str) -> list[str]:
    left = len(lines) - FAILURES_MAX
    return [*lines[:FAILURES_MAX], *([f"and {left} more {more}"] if left > 0 else [])]

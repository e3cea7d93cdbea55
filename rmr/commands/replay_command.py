"""`rmr replay`: executes the recorded minds of a run anew and checks that they do the same."""
# ruff: noqa: PLC0415 - see rmr.commands

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from rmr.base.printable import counted
from rmr.entry import ExitCode, print_json
from rmr.entry.command_line import Command, CommandLineError, Parser

if TYPE_CHECKING:
    from rmr.mind.replay_check import CheckOptions, MindCheck, ReplayCheck
    from rmr.record.recording import Recording

ABOUT = """Execute the recorded minds of a run anew, and check that they do the same.

Each robot is compared with its recording call by call: frames sent, wheel commands, trace, and a digest of its state
each second. A recording of another version of rmr, of Python or of the platform is not replayed.

With --step the past of one robot is gone through instead, by commands: to the next firing or input, to an instant, to a
fact, and back; `help` lists them. Commands may also come from a pipe."""

HOW_TO_GET_IT_RIGHT = (
    "replay it with the version that recorded it, or see with --anyway what this version does otherwise"
)


def _declare(parser: Parser) -> None:
    from rmr.base.ids import listed
    from rmr.eval.options import duration
    from rmr.vm.engines import Engine

    parser.positional("run", "RUN", help="the folder of a run, or a recording")
    parser.option("--robot", read=listed, metavar="N", help="which robots, such as 3 or 1-3,7 (default: all)")
    parser.option("--from", dest="begin", read=duration, metavar="T", help="check from this instant of lab time on")
    parser.option("--to", dest="end", read=duration, metavar="T", help="replay up to this instant of lab time")
    parser.choice("--engine", [engine.value for engine in Engine], help="run the program by another engine")
    parser.option("--trace", read=Path, metavar="FILE", help="write the replayed trace, facts included, as JSON lines")
    parser.flag("--step", help="go through the past of one robot by commands, such as next, back, facts, agenda")
    parser.flag("--anyway", help="replay also what another version has recorded")
    parser.flag("--json", help="the result as JSON on standard output")


def _replay(**values: Any) -> int:
    """Replay a recording; return the exit code."""
    from rmr.commands.replay_steps import check_options, step
    from rmr.record.mcap_scan import RecordingError
    from rmr.record.recording import open_recording

    arguments = argparse.Namespace(**values)
    if arguments.begin is not None and arguments.end is not None and arguments.begin > arguments.end:
        raise CommandLineError("--from lies after --to: nothing is in between")
    if arguments.step:
        check_options(arguments)
    if not arguments.run.exists():
        print(f"rmr replay: {arguments.run}: there is no such file or folder", file=sys.stderr)
        return ExitCode.USAGE
    try:
        recording = open_recording(arguments.run)
    except RecordingError as error:
        print(f"rmr replay: {error}", file=sys.stderr)
        return ExitCode.INVALID
    with recording:
        if arguments.step:
            return step(arguments, recording, Progress(recording.span[1]), HOW_TO_GET_IT_RIGHT)
        return _traced(arguments, recording)


def _traced(arguments: argparse.Namespace, recording: "Recording") -> int:
    if arguments.trace is None:
        return _checked(arguments, recording, None)
    try:
        with arguments.trace.open("w") as file:
            return _checked(arguments, recording, file)
    except OSError as error:
        print(f"rmr replay: cannot write {arguments.trace}: {error.strerror}", file=sys.stderr)
        return ExitCode.USAGE


def _checked(arguments: argparse.Namespace, recording: "Recording", trace: TextIO | None) -> int:
    from rmr.mind.mind_reader import MindLogError
    from rmr.mind.replay_check import ReplayCheck

    try:
        check = ReplayCheck(recording, _options(arguments, trace))
        with Progress(recording.span[1]) as progress:
            for at in check.run():
                progress.show(at)
    except MindLogError as error:
        print(f"rmr replay: {arguments.run}: {error}", file=sys.stderr)
        return ExitCode.INVALID
    for problem in recording.problems:
        print(f"warning: {problem}", file=sys.stderr)
    absent = [robot for robot in arguments.robot or () if robot not in check.present]
    if absent or not check.checks:
        return _nothing(arguments, recording, check, absent)
    _tell(arguments, recording, check)
    return _exit_code(check.checks)


def _options(arguments: argparse.Namespace, trace: TextIO | None) -> "CheckOptions":
    import json
    import time

    from rmr.base.time import NEVER
    from rmr.mind.replay_check import CheckOptions
    from rmr.vm.engines import Engine

    return CheckOptions(
        robots=arguments.robot or (),
        begin=arguments.begin or 0,
        end=NEVER if arguments.end is None else arguments.end,
        engine=None if arguments.engine is None else Engine(arguments.engine),
        anyway=arguments.anyway,
        trace=None if trace is None else lambda entry: print(json.dumps(entry), file=trace),
        clock=time.process_time,
    )


def _nothing(arguments: argparse.Namespace, recording: "Recording", check: "ReplayCheck", absent: Iterable[int]) -> int:
    """Say that there is nothing to replay; return the exit code."""
    from rmr.base.ids import spelled

    roster = recording.about.roster
    strangers = [robot for robot in absent if robot not in roster]
    if strangers:
        what = f"the run has no robot {spelled(strangers)}; its robots are {spelled(roster)}"
    elif check.present:
        what = f"it holds no mind of robot {spelled(list(absent))}"
    else:
        what = "it holds no mind"
    print(f"rmr replay: {arguments.run}: {what}", file=sys.stderr)
    return ExitCode.USAGE if strangers else ExitCode.INVALID


def _exit_code(checks: "Iterable[MindCheck]") -> int:
    checks = list(checks)
    if any(check.replay is not None and check.replay.difference is not None for check in checks):
        return ExitCode.FAILED
    return ExitCode.INVALID if any(check.problem for check in checks) else ExitCode.OK


def _tell(arguments: argparse.Namespace, recording: "Recording", check: "ReplayCheck") -> None:
    """Print what became of the minds."""
    from rmr.mind.mind_versions import is_compiled, versions

    checks = check.checks
    if arguments.json:
        about = recording.about
        print_json(
            {
                "recording": str(arguments.run),
                "lab": about.lab,
                "mode": about.mode,
                "seed": about.seed,
                "equal": _exit_code(checks) == ExitCode.OK,
                "minds": [each.as_dict() for each in checks],
                "problems": list(recording.problems),
                "versions": versions(),
                "compiled": is_compiled(),
            }
        )
        return
    for each in checks:
        print("\n".join(_lines(each, whole=arguments.end is None)))
    _tell_versions(checks)
    print(_summary(checks))


def _lines(check: "MindCheck", *, whole: bool) -> list[str]:
    """Return what became of one mind, in lines; `whole` if it was to be replayed to its end."""
    replay = check.replay
    if replay is None:
        return [f"{check.name}: not replayed: {check.problem}"]
    if replay.began is None and not check.problem:
        return [f"{check.name}: nothing happens to it in this stretch"]
    speed = f", {check.seconds / check.took_s:.0f} x real time" if check.took_s > 0 else ""
    measured = f"{check.seconds:.1f} s, {_number(replay.inputs, 'input')}, {_number(replay.outputs, 'output')}{speed}"
    difference = replay.difference
    if difference is not None:
        lines = [
            f"{check.name}: differs at {difference.at / 1e9:.6f} s: {difference.what}",
            f"  recorded: {difference.recorded}",
            f"  replayed: {difference.replayed}",
        ]
    elif check.problem:
        lines = [f"{check.name}: equal up to {replay.now / 1e9:.3f} s ({measured}); then {check.problem}"]
    else:
        lines = [f"{check.name}: equal ({measured})"]
    if whole and check.stop is not None:
        lines.append(f"  it was stopped at {check.stop / 1e9:.3f} s, as somebody asked for")
    elif whole and not replay.ended and not check.problem:
        lines.append(f"  its log ends at {replay.now / 1e9:.3f} s, not in good order: it was killed, or it still runs")
    samples, frames, refused = replay.not_delivered
    if samples or frames or refused:
        lost = [
            f"{_number(samples, 'sample')} and {_number(frames, 'frame')} dropped from full queues",
            f"{_number(refused, 'announcement')} refused",
        ]
        lines.append(f"  not delivered to it: {', '.join(lost)}")
    return lines


def _number(number: int, noun: str) -> str:
    """Return a number with thousands marked and its noun."""
    return counted(number, noun).replace(str(number), f"{number:,}", 1)


def _tell_versions(checks: "list[MindCheck]") -> None:
    stale = dict.fromkeys(row for check in checks for row in check.stale)
    for what, then, now in stale:
        print(f"another {what}: recorded with {then}, here it is {now}", file=sys.stderr)
    if stale:
        print(f"rmr replay: {HOW_TO_GET_IT_RIGHT}", file=sys.stderr)


def _summary(checks: "list[MindCheck]") -> str:
    from rmr.mind.mind_versions import is_compiled

    equal = sum(check.replay is not None and check.replay.difference is None and not check.problem for check in checks)
    seconds = sum(check.seconds for check in checks)
    took_s = sum(check.took_s for check in checks)
    speed = f" in {took_s:.1f} s ({seconds / took_s:.0f} x real time)" if took_s > 0 else ""
    forms = {check.header.compiled for check in checks if check.header is not None} - {is_compiled()}
    form = f"; recorded {_form(not is_compiled())}, replayed {_form(is_compiled())}" if forms else ""
    return f"{equal} of {counted(len(checks), 'mind')} equal: {seconds:.1f} s{speed}{form}"


def _form(compiled: bool) -> str:
    return "compiled" if compiled else "interpreted"


class Progress:
    """The instant that a replay has reached, of the recording's end, on a terminal."""

    def __init__(self, end: int) -> None:
        self._end_s = end // 1_000_000_000
        self._shown = -1

    def __enter__(self) -> "Progress":
        self.show(0)
        return self

    def show(self, at: int) -> None:
        """Show the instant, once a second of lab time."""
        second = at // 1_000_000_000
        if second != self._shown and sys.stderr.isatty():
            self._shown = second
            print(f"\rreplayed {second} of {self._end_s} s ", end="", file=sys.stderr, flush=True)

    def __exit__(self, *_: object) -> None:
        if self._shown >= 0:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


command = Command(
    ABOUT,
    _declare,
    _replay,
    "Exit codes: 0 equal, 1 a difference, 3 no valid recording, or of another version. With --step and a pipe: "
    "1 a command found nothing to go to, 2 a command was wrong.",
)

"""`rmr replay RUN --robot N --step`: reads commands from a terminal or a pipe, and prints what a session answers.

On a terminal an empty line repeats the last command. From a pipe each command is printed before its answer, so that the
output reads as the session does; a line that begins with ``#`` is a comment.
"""
# ruff: noqa: PLC0415 - see rmr.commands

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

from rmr.entry import ExitCode
from rmr.entry.command_line import CommandLineError

if TYPE_CHECKING:
    from rmr.mind.recorded_minds import RecordedMind
    from rmr.record.recording import Recording
    from rmr.why.step_session import StepSession

LINE_MAX = 10_000
"""Characters of a command at most."""


class ShownProgress(Protocol):
    """What shows on a terminal how far a replay is."""

    def __enter__(self) -> object: ...

    def show(self, at: int) -> None:
        """Show the instant that is reached."""

    def __exit__(self, *_: object) -> None: ...


def check_options(arguments: argparse.Namespace) -> None:
    """Raise CommandLineError for options that do not go with ``--step``."""
    for name, given in (("--trace", arguments.trace is not None), ("--json", arguments.json)):
        if given:
            raise CommandLineError(f"--step is a session: {name} does not go with it")
    if arguments.engine == "generated":
        raise CommandLineError(
            "--step executes the program by the interpreter, which can tell each firing: leave --engine out. "
            "Both engines do the same, whichever the robot had"
        )
    if arguments.robot is not None and len(arguments.robot) != 1:
        raise CommandLineError("--step follows one robot: give --robot one number")


def step(arguments: argparse.Namespace, recording: "Recording", progress: ShownProgress, advice: str) -> int:
    """Hold a session; return the exit code.

    `progress` shows how far the replay is, `advice` says what to do with a recording of another version.
    """
    from rmr.mind.mind_reader import MindLogError
    from rmr.why.replayed_histories import UnexplainableError

    try:
        session = _session(arguments, recording, progress, advice)
    except (MindLogError, UnexplainableError) as error:
        print(f"rmr replay: {arguments.run}: {error}", file=sys.stderr)
        return ExitCode.INVALID
    return ExitCode.INVALID if session is None else _converse(session)


def _session(
    arguments: argparse.Namespace, recording: "Recording", progress: ShownProgress, advice: str
) -> "StepSession | None":
    """Return the session; None if there is nothing to step through, which is told."""
    from rmr.base.time import NEVER
    from rmr.mind.mind_versions import differences
    from rmr.mind.recorded_minds import minds, program_of
    from rmr.why.replayed_histories import ReplayedHistories
    from rmr.why.step_session import StepSession
    from rmr.why.stops import Stops

    found = minds(recording)
    robot = _robot(arguments, recording, found)
    own = [mind for mind in found if mind.robot == robot]
    histories = ReplayedHistories(recording)
    stops = Stops(robot)
    until = NEVER if arguments.end is None else arguments.end
    for problem in recording.problems:
        print(f"warning: {problem}", file=sys.stderr)
    for mind in own:
        whose = f"life {mind.epoch} of robot {robot}" if mind.epoch else f"robot {robot}"
        if mind.header is None:
            print(f"rmr replay: {whose} cannot be replayed: {mind.problem}", file=sys.stderr)
            continue
        stale = list(differences(mind.header.versions))
        for what, then, now in stale:
            print(f"another {what}: recorded with {then}, here it is {now}", file=sys.stderr)
        if stale and not arguments.anyway:
            print(f"rmr replay: {advice}", file=sys.stderr)
            return None
        with progress:
            for at in stops.replay(mind, program_of(recording), until):
                progress.show(at)
    for problem in stops.problems:
        print(f"warning: {problem}", file=sys.stderr)
    if not stops.all:
        print(f"rmr replay: {arguments.run}: nothing of robot {robot} can be stepped through", file=sys.stderr)
        return None
    return StepSession(stops, histories, arguments.begin)


def _robot(arguments: argparse.Namespace, recording: "Recording", found: "list[RecordedMind]") -> int:
    """Return the robot that is meant. Raises CommandLineError, MindLogError."""
    from rmr.base.ids import spelled
    from rmr.mind.mind_reader import MindLogError

    present = list(dict.fromkeys(mind.robot for mind in found))
    if not present:
        raise MindLogError("it holds no mind")
    if arguments.robot is None:
        if len(present) > 1:
            raise CommandLineError(f"--step follows one robot of {spelled(present)}: give --robot {present[0]}")
        return present[0]
    [robot] = arguments.robot
    if robot in present:
        return int(robot)
    roster = recording.about.roster
    if robot in roster:
        raise MindLogError(f"it holds no mind of robot {robot}, but of {spelled(present)}")
    raise CommandLineError(f"the run has no robot {robot}; its robots are {spelled(roster)}")


# -- the conversation


def _converse(session: "StepSession") -> int:
    """Carry out commands up to the end of standard input, or to ``quit``; return the exit code."""
    from rmr.why.step_session import NowhereError, StepError

    person = sys.stdin.isatty()
    code = ExitCode.OK
    _say([*session.about(), *(["'help' lists the commands"] if person else [])])
    last = ""
    for line in _lines(session, person=person):
        command = line.strip() or (last if person else "")
        if not command or command.startswith("#"):
            continue
        last = command
        if not person:
            print(f"{session.prompt}{command}")
        try:
            _say(session.perform(command))
        except NowhereError as error:
            print(error)
            code = code or ExitCode.FAILED
        except StepError as error:
            print(f"error: {error}")
            code = ExitCode.USAGE
        if session.over:
            break
    return ExitCode.OK if person else code


def _say(lines: "Iterator[str] | list[str]") -> None:
    from rmr.base.printable import printable

    for line in lines:
        print(printable(line))


def _lines(session: "StepSession", *, person: bool) -> Iterator[str]:
    """Yield the lines of standard input; a person is asked for each."""
    if not person:
        for line in sys.stdin:
            yield line[:LINE_MAX]
        return
    from contextlib import suppress

    with suppress(ImportError):
        import readline  # noqa: F401 - gives `input` editing and a history
    while True:
        try:
            yield input(session.prompt)[:LINE_MAX]
        except EOFError:
            print()
            return

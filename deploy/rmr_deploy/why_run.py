"""`rmr why`: finds the recording, asks the question, prints the answer; `--missed`: what went into missed deadlines."""

import json
import shlex
import sys
from pathlib import Path

from rmr.base.ids import shown
from rmr.base.time import Instant
from rmr.entry import ExitCode, print_json
from rmr.entry.command_line import CommandLineError
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import Recording, open_recording
from rmr.why.absence import why_not
from rmr.why.delay_text import delay_data, delay_text, delays_text, undelivered_data, undelivered_text
from rmr.why.missed_jobs import FORM, asked_delay, missed_delays, undelivered
from rmr.why.past import Past
from rmr.why.question import WhyError, question
from rmr.why.replayed_histories import RecordedHistories, ReplayedHistories, UnexplainableError, run_history
from rmr.why.rule_words import seconds_text
from rmr.why.why_answer import why
from rmr.why.why_text import absence_dot, absence_text, why_dot, why_text
from rmr.why.why_tree import AbsenceAnswer, WhyAnswer
from rmr_deploy.run_choice import FleetError, chosen_run
from rmr_world.run_report import REPORT_FILE
from rmr_world.run_warnings import position_warnings


def perform(
    where: str | None,
    fact: str | None,
    absent: bool,
    at: Instant | None,
    depth: int,
    more: str | None,
    as_json: bool,
    as_dot: bool,
    missed: bool,
    timeline: bool,
    lab: str | None = None,
) -> int:
    """Answer the question; return the exit code."""
    if where is None or ("(" in where and not Path(where).exists()):
        again = f"rmr why RUN {'--missed' if missed else 'FACT' if where is None else shlex.quote(where)}"
        raise CommandLineError(f"RUN is missing, the run folder, which each run names at its end: {again}")
    if missed:
        for name, given in (("--not", absent), ("--dot", as_dot), ("--more", more is not None)):
            if given:
                raise CommandLineError(f"--missed explains the time of deadlines: {name} does not go with it")
        folder, robot = _run_of(where, lab)
        return explain_missed(folder, where, robot, fact, at, timeline=timeline, as_json=as_json)
    if timeline:
        raise CommandLineError("--timeline is a form of --missed crossing@3")
    if fact is None:
        raise CommandLineError("FACT is missing, such as 'at(@4, exit)'; or give --missed")
    if as_json and as_dot:
        raise CommandLineError("--json and --dot are two forms of the answer: give one of them")
    if absent and more is not None:
        raise CommandLineError("--more goes on with an answer of why; --not takes --depth")
    folder, robot = _run_of(where, lab)
    try:
        with open_recording(folder) as recording:
            return _answer(recording, folder, robot, fact, absent, at, depth, more, as_json, as_dot)
    except (RecordingError, UnexplainableError) as error:
        print(f"rmr why: {error}", file=sys.stderr)
        return ExitCode.INVALID
    except WhyError as error:
        print(f"rmr why: {error}", file=sys.stderr)
        return ExitCode.USAGE


def _run_of(where: str, lab: str | None) -> tuple[Path, int | None]:
    """Return the recording that is meant, and the robot if its id was given. Raises CommandLineError."""
    path = Path(where)
    try:
        if path.exists():
            return path, None
    except (OSError, ValueError):
        pass
    if not (where.isascii() and where.isdecimal() and len(where) < 6):
        raise CommandLineError(f"there is no run at {shown(where)}: give a run folder, such as runs/corridor-...")
    try:
        return chosen_run(None, lab).folder, int(where)
    except FleetError as error:
        raise CommandLineError(f"robot {where}: {error}") from None


def _answer(
    recording: Recording,
    folder: Path,
    robot: int | None,
    fact: str,
    absent: bool,
    at: Instant | None,
    depth: int,
    more: str | None,
    as_json: bool,
    as_dot: bool,
) -> int:
    histories = ReplayedHistories(recording)
    past = Past(histories, histories.variables)
    if robot is not None and robot not in past.robots:
        raise WhyError(f"robot {robot} is not in the lab that runs, {recording.about.lab}")
    asked = question(fact, past.program, list(past.robots), robot)
    if asked.owner is not None and not past.minds(asked.owner):
        raise UnexplainableError("; ".join(histories.problems) or f"what robot {asked.owner} did was not recorded")
    if not recording.complete and asked.owner is not None:
        histories.end_with(asked.owner)
    answer = why_not(past, asked, at, depth) if absent else why(past, asked, at, depth, more)
    if not recording.complete:
        whose = "the run" if asked.owner is None else f"robot {asked.owner}"
        until = seconds_text(past.known_until)
        answer.notes.append(f"the recording has not been finished: {whose} is known until {until}")
    answer.notes += _position_notes(folder, asked.owner)
    if as_json:
        print_json(answer.as_data() | {"lab": recording.about.lab, "problems": histories.problems})
        return ExitCode.OK
    print(_drawn(answer) if as_dot else _written(answer), end="")
    for problem in histories.problems:
        print(f"rmr why: {problem}", file=sys.stderr)
    return ExitCode.OK


def _position_notes(folder: Path, robot: int | None) -> list[str]:
    """Return what the run's report tells of how `robot`, or each robot, knew where it was, if that was amiss."""
    file = (folder if folder.is_dir() else folder.parent) / REPORT_FILE
    try:
        parts = json.loads(file.read_text("utf-8"))["robots"]
        told = [
            words for one, part in parts.items() for words in position_warnings(one, part) if robot in (None, int(one))
        ]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return []  # a run that goes on, or a recording without its folder
    return [f"localisation: {words}" for words in told]


def _drawn(answer: WhyAnswer | AbsenceAnswer) -> str:
    return why_dot(answer) if isinstance(answer, WhyAnswer) else absence_dot(answer)


def _written(answer: WhyAnswer | AbsenceAnswer) -> str:
    return why_text(answer) if isinstance(answer, WhyAnswer) else absence_text(answer)


# --- rmr why --missed


def explain_missed(
    folder: Path, where: str, robot: int | None, asked: str | None, at: Instant | None, *, timeline: bool, as_json: bool
) -> int:
    """Explain the job that is `asked` for, or list all missed deadlines (of `robot` alone); return the exit code."""
    if asked is None and (timeline or at is not None):
        raise CommandLineError(f"{'--timeline' if timeline else '--at'} is for one job: {FORM}")
    try:
        with open_recording(folder) as recording:
            run = run_history(recording)
    except (RecordingError, UnexplainableError) as error:
        print(f"rmr why: {error}", file=sys.stderr)
        return ExitCode.INVALID
    try:
        _show_delays(run, where, robot, asked, at, timeline=timeline, as_json=as_json)
    except WhyError as error:
        print(f"rmr why: {error}", file=sys.stderr)
        return ExitCode.USAGE
    for problem in run.problems:
        print(f"rmr why: {problem}", file=sys.stderr)
    return ExitCode.OK


def _show_delays(
    run: RecordedHistories,
    where: str,
    robot: int | None,
    asked: str | None,
    at: Instant | None,
    *,
    timeline: bool,
    as_json: bool,
) -> None:
    if asked is not None:
        job = asked if robot is None or "@" in asked else f"{asked}@{robot}"
        delays = [asked_delay(run, job, at)]
    else:
        delays = [delay for delay in missed_delays(run) if robot in (None, delay.robot)]
    lost = undelivered(run, 0 if asked is None else delays[0].job.start)
    if as_json:
        told = {
            "delays": [delay_data(delay) for delay in delays],
            "undelivered": undelivered_data(lost),
            "problems": list(run.problems),
        }
        print_json(told)
        return
    text = delays_text(delays, shlex.quote(where)) if asked is None else delay_text(delays[0], timeline=timeline)
    print(text + undelivered_text(lost), end="")

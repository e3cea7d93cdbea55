"""`rmr why RUN --missed`: what the time of missed deadlines went into."""

import json
import sys
from pathlib import Path
from shlex import quote

from rmr.base.time import Instant
from rmr.entry import ExitCode
from rmr.entry.command_line import CommandLineError
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import open_recording
from rmr.why.delay_text import delay_data, delay_text, delays_text, undelivered_data, undelivered_text
from rmr.why.missed_jobs import FORM, asked_delay, missed_delays, undelivered
from rmr.why.question import WhyError
from rmr.why.replayed_histories import RecordedHistories, UnexplainableError, run_history


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
        _answer(run, where, robot, asked, at, timeline=timeline, as_json=as_json)
    except WhyError as error:
        print(f"rmr why: {error}", file=sys.stderr)
        return ExitCode.USAGE
    for problem in run.problems:
        print(f"rmr why: {problem}", file=sys.stderr)
    return ExitCode.OK


def _answer(
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
        print(json.dumps(told, indent=2))
        return
    text = delays_text(delays, quote(where)) if asked is None else delay_text(delays[0], timeline=timeline)
    print(text + undelivered_text(lost), end="")

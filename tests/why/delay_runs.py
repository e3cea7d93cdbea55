"""Recorded runs whose delays are explained, and the property that holds of every explanation."""

import contextlib
import io
import json
from collections import Counter
from pathlib import Path
from typing import Any

from rmr.record.recording import open_recording
from rmr.why.critical_path import explained
from rmr.why.delay import Delay, TimeOwner, steps_of
from rmr.why.missed_jobs import is_missed, missed_delays
from rmr.why.replayed_histories import RecordedHistories, run_history
from rmr_sim.main import main as simulate

LABS = Path(__file__).parents[2] / "deploy" / "labs"
RUSH = LABS / "testbed" / "rush.yaml"


def recorded(lab: Path, folder: Path, *words: str) -> RecordedHistories:
    """Record a run of `lab` in `folder` and replay it."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        simulate([str(lab), *words, "--run", str(folder)])
    with open_recording(folder) as recording:
        run = run_history(recording)
    assert run.problems == ()
    return run


def check_exact(delay: Delay) -> None:
    """Check that the intervals of `delay` cover its time without gap or overlap, and that each has an owner."""
    at = delay.job.start
    for interval in delay.intervals:
        assert interval.begin == at, interval
        assert interval.end > interval.begin, interval
        assert interval.owner is not TimeOwner.UNKNOWN, (delay.robot, interval)
        at = interval.end
    assert at == delay.end
    late = sum(each.duration for each in delay.intervals if each.begin >= delay.job.deadline)
    assert late == max(0, delay.end - delay.job.deadline)
    check_steps(delay)


def check_steps(delay: Delay) -> None:
    """Check that the steps of `delay` cover its time without gap or overlap, and its owners' times exactly."""
    at = delay.job.start
    owners: Counter[TimeOwner] = Counter()
    for step in steps_of(delay):
        assert (step.begin, step.begin < step.end) == (at, True), step
        assert sum(time for *_, time in step.owners) == step.duration, step
        for owner, _, time in step.owners:
            owners[owner] += time
        at = step.end
    assert at == delay.end
    wanted: Counter[TimeOwner] = Counter()
    for interval in delay.intervals:
        wanted[interval.owner] += interval.duration
    assert owners == wanted


def check_reported(steps: list[dict[str, Any]], begin: int, end: int) -> None:
    """Check that the steps of a job in the report cover its time exactly, and that their times sum to it."""
    for step in steps:
        assert (step["begin_ns"], step["begin_ns"] < step["end_ns"]) == (begin, True), step
        assert sum(step["time_ns"].values()) == step["end_ns"] - step["begin_ns"], step
        assert all(time > 0 for time in step["time_ns"].values()), step
        begin = step["end_ns"]
    assert begin == end


def check_run(folder: Path, run: RecordedHistories) -> Counter[TimeOwner]:
    """Check all jobs of a run, and its missed deadlines against the report; return the nanoseconds of each owner."""
    owners: Counter[TimeOwner] = Counter()
    for robot, history in run.robots.items():
        for job, _ in history.jobs:
            delay = explained(run.robots, run.program, run.attempts, robot, job)
            check_exact(delay)
            if is_missed(history, job):
                owners.update({each.owner: 0 for each in delay.intervals})
                for each in delay.intervals:
                    owners[each.owner] += each.duration
    report = json.loads((folder / "report.json").read_text())
    reported = {
        (int(robot), job["name"], job["start_s"])
        for robot, part in report["robots"].items()
        for job in part["assertions"]
        if job["met"] is False
    }
    missed = {(d.robot, d.job.name, round(d.job.start / 1e9, 3)): d.job for d in missed_delays(run) if d.job.missed}
    assert set(missed) == reported
    for robot, part in report["robots"].items():
        for entry in part["assertions"]:
            if entry["met"] is False and entry["steps"]:
                job = missed[int(robot), entry["name"], entry["start_s"]]
                check_reported(entry["steps"], job.start, job.deadline if job.finish is None else job.finish)
    return owners

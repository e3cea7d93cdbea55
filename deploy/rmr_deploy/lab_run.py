"""`rmr up` from the checks before a run to its run_report.

1. Check lab and program (`preparation`), and make the run folder.
2. Run the lab's processes (`launch`).
3. Assemble the report of what each robot and the world said last, write ``report.json``, show the table.

The report is written whatever becomes of the run, in the form that all modes share. A robot that died has its last
known part; a world that died leaves the last truth that it told; a robot that was never heard of has done nothing.
Times are lab time, except `wall_s` and `ready_s`.
"""

import asyncio
import shlex
import sys
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from rmr.base.ids import named
from rmr.base.time import seconds
from rmr.entry import ExitCode
from rmr.entry.terminal import has_colour
from rmr.record.joining import join_run
from rmr.record.mcap_scan import RecordingError
from rmr.record.record_writer import RecordWriter
from rmr.record.run_about import LAUNCHER_PROCESS, about_run
from rmr_deploy.active_runs import write_end
from rmr_deploy.detached import DetachedOutput
from rmr_deploy.host_run import HostRun, join_hint, share_report
from rmr_deploy.launch import LabRun
from rmr_deploy.preparation import RunPlan, RunRefusedError, make_plan
from rmr_deploy.run_options import RunOptions
from rmr_deploy.run_outcome import RunOutcome
from rmr_deploy.screen import make_screen
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world import run_report
from rmr_world.faults import process_run_faults
from rmr_world.incarnations import merged_report
from rmr_world.lab import Lab
from rmr_world.quorum import ALL, NEVER_CAME, STOPPED, met_at
from rmr_world.run_warnings import missed_hint, run_warnings, unhandled_failures, unsendable_facts, view_hint


def perform(options: RunOptions, background: DetachedOutput | None = None) -> int:
    """Run a lab as `options` say, perhaps in the `background`; return the exit code."""
    try:
        plan = make_plan(options, color=has_colour(sys.stderr))
    except RunRefusedError as refusal:
        print(str(refusal).rstrip("\n"), file=sys.stderr)
        return refusal.exit_code
    for program in (plan.program, *(program for _, program in plan.loads)):
        if program.warnings:
            print(program.warnings.rstrip("\n"), file=sys.stderr)
    if plan.lab.events is not None:
        print(
            f"{plan.lab.path}: events: only rmr sim has events of your own; this run goes without them", file=sys.stderr
        )
    code: int = ExitCode.FAILED
    try:
        if background is not None:
            background.begin(plan.folder, plan.lab.name, len(plan.lab.roster))
        code = _run(plan, background)
    finally:
        if problem := write_end(plan.folder, code):
            print(f"rmr up: {problem}", file=sys.stderr)
    return code


def _run(plan: RunPlan, background: DetachedOutput | None) -> int:
    """Run, report and tell; return the exit code."""
    try:
        outcome, record = asyncio.run(run_and_report(plan, background))
    except OSError as error:
        print(f"rmr up: {error.filename or plan.folder}: {error.strerror}; the run has ended", file=sys.stderr)
        return ExitCode.FAILED
    tell(record, outcome, plan)
    code = exit_code(outcome, record, strict=plan.options.strict)
    return code if outcome.report_error is None else ExitCode.FAILED


async def run_and_report(plan: RunPlan, background: DetachedOutput | None = None) -> tuple[RunOutcome, dict[str, Any]]:
    """Run, and write the report while signals are still in the run's hands: an impatient Ctrl-C loses nothing.

    A report that cannot be written does not keep the table back. Raises OSError when a process cannot be started.
    """
    screen = make_screen(json=plan.options.as_json)
    run = LabRun(plan, screen) if plan.share is None else HostRun(plan, plan.share, screen)
    run.events.heard = None if background is None else background.heard
    outcome = await run.go()
    if isinstance(run, HostRun):
        outcome.elsewhere = run.elsewhere()
    record = make_report(plan, outcome, run.monitor)
    if not plan.has_world:
        return outcome, share_report(record, plan)
    try:
        run_report.write(record, plan.folder)
    except OSError as error:
        outcome.report_error = f"cannot write {error.filename}: {error.strerror}"
    if plan.share is not None and not plan.options.no_record:
        _record_faults(plan, outcome)  # of all hosts, before their parts are joined by hand
    elif not plan.options.no_record:
        outcome.recording = await asyncio.to_thread(join_recording, plan, outcome)
    return outcome, record


def join_recording(plan: RunPlan, outcome: RunOutcome) -> list[str]:
    """Join what the processes have recorded; return sentences on what is missing."""
    again = f"rmr record join {shlex.quote(str(plan.folder))}"
    if outcome.hurried:
        return [f"the recording is not joined; to join it: {again}"]
    _record_faults(plan, outcome)
    try:
        return list(join_run(plan.folder, plan.options.record).problems)
    except RecordingError as error:
        return [f"{error}; to join the recording: {again}"]


def _record_faults(plan: RunPlan, outcome: RunOutcome) -> None:
    """Write what befell the processes of robots into a part of the recording."""
    part = plan.part(f"{LAUNCHER_PROCESS}.1")
    entries = [*outcome.faults, *outcome.lives]
    entries += [entry for befell in outcome.elsewhere.befell for entry in (*befell.faults, *befell.lives)]
    if part is None or not entries:
        return
    writer = RecordWriter(part, about_run(plan.lab.name, "processes", plan.lab.seed, plan.lab.roster, LAUNCHER_PROCESS))
    for entry in entries:
        writer.write("/faults", seconds(entry.get("at", entry.get("from", 0.0))), {"fault": entry})
    writer.close()


def tell(record: Mapping[str, Any], outcome: RunOutcome, plan: RunPlan) -> None:
    """Show the table and the run in a few words, and where it is asked for the report as JSON."""
    as_json = plan.options.as_json
    if not plan.has_world and not outcome.elsewhere.report:
        print(f"rmr up: {outcome.reason}", file=sys.stderr)
        return
    where = f"the report is {plan.folder / run_report.REPORT_FILE}"
    if not plan.has_world:
        where = outcome.elsewhere.report
    if outcome.report_error is not None:
        print(f"rmr up: {outcome.report_error}", file=sys.stderr)
        where = "there is no report"
    stream = sys.stderr if as_json else sys.stdout
    who = "" if plan.has_world or plan.share is None else f"host {plan.share.here.name}, {named(plan.robots)}; lab "
    print(run_report.table_text(record, who, color=has_colour(stream)), file=stream)
    print(f"{outcome.reason}; {where}", file=stream)
    recorded = not plan.options.no_record and plan.share is None
    hint = [] if not recorded else missed_hint(record, plan.options.record or plan.folder)
    for line in (*run_warnings(record), *(f"recording: {problem}" for problem in outcome.recording), *hint):
        print(f"rmr up: {line}", file=sys.stderr)
    if as_json:
        print(run_report.to_json(record), end="")
    if plan.share is not None and plan.has_world and not plan.options.no_record:
        print(join_hint(plan, outcome), file=stream)
    if recorded:
        print(view_hint(plan.options.record or plan.folder), file=stream)


def exit_code(outcome: RunOutcome, record: Mapping[str, Any], *, strict: bool) -> int:
    """Return the exit code of a run."""
    if outcome.invalid and outcome.ready_s is None:
        return ExitCode.INVALID
    if not outcome.finished or (set(outcome.ended) - outcome.excused and record["quorum"] == ALL):
        return ExitCode.FAILED
    if unhandled_failures(record) or unsendable_facts(record):
        return ExitCode.FAILED
    imperfect = record["deadlines"]["missed"] or record["collisions"]
    return ExitCode.STRICT if strict and imperfect else ExitCode.OK


# --- the report


def _excess(buses: Iterable[Mapping[str, Any]]) -> list[list[int]]:
    """Return [sender, dropped beyond its rate by all receivers together] of the counters of all processes."""
    total: Counter[int] = Counter()
    for bus in buses:
        total.update(dict(bus.get("excess", ())))
    return [list(each) for each in sorted(total.items())]


def make_report(plan: RunPlan, outcome: RunOutcome, monitor: StatusMonitor | None) -> dict[str, Any]:
    """Return the report of a run that is over; `monitor` is None when nobody was ever heard."""
    parts = {robot: _part(monitor, robot) if monitor else {} for robot in plan.lab.roster}
    buses = [part.pop("bus", {}) for part in parts.values()]
    for part in parts.values():
        part.pop("log_cut_short", None)  # for people (`StatusMonitor.cut_logs`)
    told = run_report.assemble(
        plan.lab,
        mode="processes",
        seed=plan.lab.seed,
        finished=outcome.finished,
        time_s=time_s(plan.lab, parts, outcome, monitor),
        wall_s=outcome.wall_s,
        robots=parts,
        truth=truth(monitor),
        bus_lost=sum(bus.get("lost", 0) for bus in buses),
        dead=outcome.absent,
    )
    world = monitor.world.report if monitor and monitor.world else {}
    told["bus"]["excess"] = _excess([*buses, world.get("bus", {})])
    told["bus"]["late_commands"] = [list(each) for each in world.get("late_commands", ())]
    told["ros2"] = world.get("ros2", {})
    added = world.get("faults", ())
    disturbances = process_run_faults(plan.lab, added, monitor.now_s if monitor else 0.0)
    faults = [*outcome.faults, *(entry for befell in outcome.elsewhere.befell for entry in befell.faults)]
    for entry in faults:
        if "to" in entry:  # one that was to last to the end of the run
            entry["to"] = max(entry["from"], min(entry["to"], round(monitor.now_s, 3) if monitor else 0.0))
    told["faults"] = sorted([*disturbances, *faults], key=lambda entry: float(entry.get("at", entry.get("from"))))
    if outcome.loads:
        told["loads"] = outcome.loads
    ready_s = None if outcome.ready_s is None else round(outcome.ready_s, 3)
    absent = {
        key: [robot for robot, one in outcome.absent.items() if one == fate]
        for key, fate in (("stopped", STOPPED), ("never_came", NEVER_CAME))
    }
    died = outcome.died | {name: code for befell in outcome.elsewhere.befell for name, code in befell.died.items()}
    if plan.options.durable:
        told["world"] = {"restarts": outcome.world_restarts}
    return {**told, "ready_s": ready_s, "reason": outcome.reason, "died": died, **absent}


def _part(monitor: StatusMonitor, robot: int) -> dict[str, Any]:
    """Return a robot's part over all of its lives; of one that died and did not return, what it told last."""
    past = list(monitor.past(robot))
    present = monitor.report(robot)
    if not present and past:
        present = past.pop()
    return merged_report(past, present)


def time_s(
    lab: Lab, parts: Mapping[int, Mapping[str, Any]], outcome: RunOutcome, monitor: StatusMonitor | None
) -> float:
    """Return lab seconds from the first tick until the quorum was met, or to the end of a run where it was not."""
    finishes = {robot: part.get("finish_s") for robot, part in parts.items() if robot not in outcome.absent}
    met = met_at(lab.quorum, finishes) if outcome.finished else None
    if met is not None:
        return float(met)
    return monitor.now_s if monitor else 0.0


def truth(monitor: StatusMonitor | None) -> dict[str, Any]:
    """Return what the world saw, as the report wants it; empty when it told nothing."""
    told = monitor.truth if monitor else None
    if told is None:
        return {}
    ways = {robot: distance_m for robot, _x, _y, _theta, distance_m in told.robots}
    return {"collisions": told.collisions, "min_gap_m": told.min_gap_m, "distance_m": ways}

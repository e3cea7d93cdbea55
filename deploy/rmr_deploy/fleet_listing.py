"""What `rmr` shows of runs: labs (`ls`), processes and what they use (`ps`, `stats`), `facts`, and `config`.

The launcher tells how its robots are. Where it does not answer, because it is starting, ending or dead, the processes
of the record are shown, each looked up in the system. On Linux processor time and memory are read from /proc (proc(5));
elsewhere they are unknown.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rmr.entry import ExitCode, print_json
from rmr_deploy.active_runs import LAB_COPY, REPORT_FILE, LaunchedRun, active_runs, past_runs
from rmr_deploy.process_identity import stat_fields, usage_of
from rmr_deploy.run_choice import FleetError, Remote, Steered, check_robots, chosen_run, shown, where_it_looks
from rmr_deploy.run_requests import RequestError

PATIENCE_S = 1.5
"""Limit for the launcher's answer, which takes 0.1 s unless the machine is overloaded."""
PERIOD_S = 1.0
"""Pause between two samples of what processes use."""
USAGE_HEAD = ("NAME", "STATE", "PID", "UP", "CPU %", "CPU", "MEM MB", "LATE TICKS")
CLEAR = "\033[H\033[2J"
"""Moves to the first line of a terminal and clears it."""


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows of text under a head, in columns."""
    lines = [list(head), *([("" if cell is None else str(cell)) for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(head))]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)


def length(seconds: float | None) -> str:
    """Return a duration for people: ``42 s``, ``3 min``, ``2 h``."""
    if seconds is None:
        return ""
    for unit, size in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"


# --- ls


def list_labs(*, everything: bool, as_json: bool) -> int:
    """Print the labs that run on this machine, with `everything` those of ./runs that are over, too."""
    runs = [*(past_runs() if everything else ()), *active_runs()]
    rows = [_lab_row(run) for run in runs]
    if as_json:
        print_json({"labs": rows})
    elif rows:
        cells = [(row["lab"], row["state"], row["robots"], row["launcher"], row["folder"]) for row in rows]
        print(table(("LAB", "STATE", "ROBOTS", "LAUNCHER", "RUN"), cells))
    else:
        print("no lab runs on this machine; start one with rmr up LAB -d")
        print(f"looked in {where_it_looks()}; a lab that is not there is found by its run folder: rmr ps --run DIR")
    return ExitCode.OK


def _lab_row(run: LaunchedRun) -> dict[str, Any]:
    launcher = run.launcher
    if run.launched:
        state = "running"
    elif run.living:
        state = "stranded"  # its launcher is dead
    elif run.exit_code is None:
        state = "broken off"
    else:
        state = f"ended ({run.exit_code})"
    return {
        "lab": run.lab,
        "state": state if run.folder.is_dir() else f"{state}, folder removed",
        "robots": len(run.roster),
        "launcher": launcher.pid if launcher is not None and run.launched else None,
        "connect": run.endpoint if run.active else None,
        "folder": shown(run.folder),
    }


# --- ps


def list_processes(
    folder: Path | None, lab: str | None, *, everything: bool, as_json: bool, there: Remote | None = None
) -> int:
    """Print the processes of a run or of the lab that runs `there`, with `everything` also those that have ended.

    Raises FleetError.
    """
    run = there or chosen_run(folder, lab, past=everything)
    rows = process_rows(run, lambda why: print(f"rmr ps: {why}; shown is what the system tells", file=sys.stderr))
    if not everything:
        rows = [row for row in rows if row["exit_code"] is None and row["state"] != "ended"]
    if as_json:
        print_json({"processes": rows})
        return ExitCode.OK
    cells = [
        (row["name"], row["state"], row["pid"], length(row["up_s"]), row["restarts"], row["progress"]) for row in rows
    ]
    print(table(("NAME", "STATE", "PID", "UP", "RESTARTS", "DOING"), cells))
    return ExitCode.OK


def told_status(run: Steered, note: Callable[[str], None] = lambda _: None) -> dict[str, Any] | None:
    """Return what the launcher tells of its run (`rmr_deploy.robot_lives`).

    None if it is not there or does not answer; `note` is called with the reason for the latter.
    """
    if not run.launched:
        return None
    try:
        return run.ask({"do": "status"}, PATIENCE_S)
    except RequestError as error:
        note(str(error))
        return None


def process_rows(run: Steered, note: Callable[[str], None] = lambda _: None) -> list[dict[str, Any]]:
    """Return a row for each process of the run and robot in it; the launcher and the world come first.

    `note` is called with the reason why the launcher does not tell how its robots are, if it is there.
    """
    told = told_status(run, note)
    launcher = run.launcher
    rows = [] if launcher is None else [_recorded_row("launcher", launcher.pid, launcher.lives)]
    if told is None:
        return rows + [_recorded_row(one.name, one.pid, one.lives) for one in run.processes]
    present: dict[str, list[dict[str, Any]]] = {}
    for robot in told["robots"]:
        present.setdefault(robot["process"], []).append(robot)
    for process in told["processes"]:
        rows += [_row(process, robot) for robot in present.get(process["name"], [{}])]
    return rows


def _row(process: dict[str, Any], robot: dict[str, Any]) -> dict[str, Any]:
    """Return the row of a process, with the state of the `robot` in it; a paused one has no say about that."""
    says = robot.get("state") if process["state"] == "running" else None
    code = process["exit_code"]
    ended = None if code is None else f"ended ({code})" if code >= 0 else f"killed ({-code})"
    return {
        "name": process["name"],
        "robot": robot.get("robot"),
        "state": ended or says or process["state"],
        "progress": robot.get("progress", "") if code is None else "",
        "pid": process["pid"],
        "up_s": process["up_s"],
        "restarts": robot.get("restarts"),
        "ticks_late": robot.get("ticks_late"),
        "exit_code": code,
    }


def _recorded_row(name: str, pid: int, lives: bool) -> dict[str, Any]:
    return {
        "name": name,
        "robot": None,
        "state": "running" if lives else "ended",
        "progress": "",
        "pid": pid,
        "up_s": _age_s(pid) if lives else None,
        "restarts": None,
        "ticks_late": None,
        "exit_code": None,
    }


def _age_s(pid: int) -> float | None:
    fields = stat_fields(pid)
    if fields is None:
        return None
    return float(round(time.clock_gettime(time.CLOCK_BOOTTIME) - int(fields[19]) / os.sysconf("SC_CLK_TCK"), 1))


# --- stats


def show_usage(folder: Path | None, lab: str | None, *, once: bool, as_json: bool, there: Remote | None = None) -> int:
    """Print what the processes of a run use, or of the lab that runs `there`, each second until it is over.

    Only one time with `once`. Raises FleetError.
    """
    run = there or chosen_run(folder, lab)
    rows = usage_rows(run, {})
    on_terminal = sys.stdout.isatty() and not once and not as_json
    with suppress(KeyboardInterrupt):  # the usual way out
        while True:
            if as_json:
                print_json({"processes": rows}, indent=None)
            else:
                print(f"{CLEAR if on_terminal else ''}{_usage_text(rows)}")
            sys.stdout.flush()
            if once or not (run.active if isinstance(run, LaunchedRun) else run.launched):
                break
            time.sleep(PERIOD_S)
            rows = usage_rows(run, {row["name"]: row for row in rows})
    return ExitCode.OK


def usage_rows(run: LaunchedRun | Remote, before: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for each living process.

    `cpu_percent` is that since the rows `before`, or since the start of a process that is not among them.
    """
    rows = []
    told = {} if isinstance(run, LaunchedRun) else run.usage()
    for process in process_rows(run):
        if process["exit_code"] is not None or process["state"] == "ended" or process["pid"] is None:
            continue  # it has ended, or is another host's
        cpu_s, memory_mb, now_s = told.get(process["name"]) or usage_of(process["pid"])
        earlier = before.get(process["name"], {"cpu_s": 0.0, "sampled_s": now_s - (process["up_s"] or 0.0)})
        span_s = now_s - earlier["sampled_s"]
        percent = None if cpu_s is None or span_s <= 0.0 else 100.0 * (cpu_s - (earlier["cpu_s"] or 0.0)) / span_s
        rows.append(
            {
                **{key: process[key] for key in ("name", "robot", "state", "pid", "up_s", "ticks_late")},
                "cpu_s": cpu_s,
                "cpu_percent": None if percent is None else round(percent, 1),
                "memory_mb": memory_mb,
                "sampled_s": now_s,
            }
        )
    return rows


def _usage_text(rows: list[dict[str, Any]]) -> str:
    return table(
        USAGE_HEAD,
        [
            (
                *(row["name"], row["state"], row["pid"], length(row["up_s"])),
                *(row["cpu_percent"], length(row["cpu_s"]), row["memory_mb"], row["ticks_late"]),
            )
            for row in rows
        ],
    )


# --- facts, config


def show_facts(
    robots: Sequence[int],
    *,
    predicate: str | None,
    folder: Path | None,
    lab: str | None,
    as_json: bool,
    there: Remote | None = None,
) -> int:
    """Print the facts of robots, as the launcher heard last, or as the report has them. Raises FleetError."""
    run = there or chosen_run(folder, lab, past=True)
    check_robots(run, robots)
    wanted = robots or run.roster
    held = {str(robot): _facts(run, robot) for robot in wanted}
    if predicate is not None:
        held = {robot: [fact for fact in facts if _name(fact) == predicate] for robot, facts in held.items()}
    if as_json:
        print_json({"facts": held})
    elif len(wanted) == 1:
        print(*held[str(wanted[0])], sep="\n")
    else:
        print(*(f"{robot}: {fact}" for robot, facts in held.items() for fact in facts), sep="\n")
    return ExitCode.OK


def _name(fact: str) -> str:
    return fact.lstrip("!?").partition("(")[0]


def _facts(run: Steered, robot: int) -> list[str]:
    if run.launched or not isinstance(run, LaunchedRun):
        try:
            return _listed(run.ask({"do": "facts", "robot": robot}))
        except RequestError as error:
            raise FleetError(str(error), ExitCode.FAILED) from None
    path = run.folder / REPORT_FILE
    try:
        report = json.loads(path.read_text())
        return _listed(report["robots"][str(robot)])
    except (OSError, ValueError, KeyError, TypeError):
        message = f"what robot {robot} held is not known: {shown(path)} cannot be read or has no such robot"
        raise FleetError(message, ExitCode.FAILED) from None


def _listed(part: dict[str, Any]) -> list[str]:
    return [str(fact) for fact in part.get("facts", [])]


def show_config(source: Path | None, *, folder: Path | None, lab: str | None, there: Remote | None = None) -> int:
    """Print the lab of a run, of the lab that runs `there`, or the lab in `source`, with all defaults.

    Raises FleetError.
    """
    if source is not None:
        if folder is not None or lab is not None or there is not None:
            raise FleetError("LAB goes without --run, --lab and --connect")
        from rmr_deploy.resolved_lab import resolved_file  # noqa: PLC0415 - loads the checks of lab files

        found = resolved_file(source)
    elif there is not None:
        found = there.config()
    else:
        print(_lab_copy(chosen_run(folder, lab, past=True)), end="")
        return ExitCode.OK
    print(json.dumps(found, indent=2))
    return ExitCode.OK


def _lab_copy(run: LaunchedRun) -> str:
    """Return the resolved lab in the run folder. Raises FleetError."""
    path = run.folder / LAB_COPY
    try:
        return path.read_text()
    except OSError as error:
        message = f"the lab of this run is not known: {shown(path)}: {error.strerror}"
        raise FleetError(f"{message}; of a lab file: rmr config LAB", ExitCode.FAILED) from None

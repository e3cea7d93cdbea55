"""`rmr stats` and `rmr top`: processor time and memory of the processes of a run, and how late their ticks are.

On Linux they are read from /proc (proc(5)); elsewhere they are unknown.
"""

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from rmr.entry import ExitCode
from rmr_deploy.active_runs import LaunchedRun
from rmr_deploy.fleet_listing import length, process_rows, table
from rmr_deploy.process_identity import stat_fields
from rmr_deploy.run_choice import chosen_run

PERIOD_S = 1.0
"""Pause between two samples."""
HEAD = ("NAME", "STATE", "PID", "UP", "CPU %", "CPU", "MEM MB", "LATE TICKS")
CLEAR = "\033[H\033[2J"
"""Moves to the first line of a terminal and clears it."""


def show_usage(folder: Path | None, lab: str | None, *, once: bool, as_json: bool) -> int:
    """Print what the processes of a run use, again and again until it is over unless `once`. Raises FleetError."""
    run = chosen_run(folder, lab)
    rows = usage_rows(run, {})
    on_terminal = sys.stdout.isatty() and not once and not as_json
    with suppress(KeyboardInterrupt):  # the usual way out
        while True:
            print(f"{CLEAR if on_terminal else ''}{json.dumps(rows) if as_json else _text(rows)}", flush=True)
            if once or not run.active:
                break
            time.sleep(PERIOD_S)
            rows = usage_rows(run, {row["name"]: row for row in rows})
    return ExitCode.OK


def usage_rows(run: LaunchedRun, before: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return a row for each living process.

    `cpu_percent` is that since the rows `before`, or since the start of a process that is not among them.
    """
    rows = []
    for process in process_rows(run):
        if process["exit_code"] is not None or process["state"] == "ended":
            continue
        now_s = time.monotonic()
        fields = stat_fields(process["pid"])
        cpu_s = None if fields is None else (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        memory = None if fields is None else int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        earlier = before.get(process["name"], {"cpu_s": 0.0, "sampled_s": now_s - (process["up_s"] or 0.0)})
        span_s = now_s - earlier["sampled_s"]
        percent = None if cpu_s is None or span_s <= 0.0 else 100.0 * (cpu_s - (earlier["cpu_s"] or 0.0)) / span_s
        rows.append(
            {
                **{key: process[key] for key in ("name", "robot", "state", "pid", "up_s", "ticks_late")},
                "cpu_s": cpu_s,
                "cpu_percent": None if percent is None else round(percent, 1),
                "memory_mb": None if memory is None else round(memory, 1),
                "sampled_s": now_s,
            }
        )
    return rows


def _text(rows: list[dict[str, Any]]) -> str:
    return table(
        HEAD,
        [
            (
                *(row["name"], row["state"], row["pid"], length(row["up_s"])),
                *(row["cpu_percent"], length(row["cpu_s"]), row["memory_mb"], row["ticks_late"]),
            )
            for row in rows
        ],
    )

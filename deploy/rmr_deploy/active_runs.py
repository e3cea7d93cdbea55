"""The active runs on this machine, found by their run folders: there is no daemon.

`rmr up` leaves in the run folder where its world listens, the ids of its processes and, while it runs, the secret of
its bus. A run is under way while its launcher lives and no report has been written.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rmr.bus.secret import SECRET_FILE
from rmr_world.run_report import REPORT_FILE

PROCESSES_FILE = "processes.json"


def write_processes(folder: Path, endpoint: str, pids: dict[str, int], lab: Mapping[str, Any]) -> None:
    """Write the endpoint, the ids of the processes and what runs (`lab`) into the run folder. Raises OSError."""
    record: dict[str, Any] = {"launcher": os.getpid(), "connect": endpoint, "processes": pids, "lab": dict(lab)}
    (folder / PROCESSES_FILE).write_text(json.dumps(record, indent=1) + "\n")


def endpoint_of(folder: Path) -> str | None:
    """Return where the world of the run in `folder` listens, or listened; None if no processes ran there."""
    endpoint = _read(folder).get("connect")
    return endpoint if isinstance(endpoint, str) else None


def lab_of_run(folder: Path) -> dict[str, Any]:
    """Return what runs in `folder`: `file`, `robots` (their number), `seed`; empty if no processes ran there."""
    lab = _read(folder).get("lab")
    return lab if isinstance(lab, dict) else {}


def under_way(folder: Path) -> bool:
    """Return whether the run in `folder` goes on: its launcher lives, and there is no report yet."""
    return not (folder / REPORT_FILE).exists() and _lives(_read(folder).get("launcher"))


def secret_of(folder: Path) -> Path | None:
    """Return the file with the secret of the run in `folder`; None if it has none, or is over."""
    path = folder / SECRET_FILE
    return path if path.exists() else None


def newest_run(runs: Path) -> Path | None:
    """Return the folder of the newest run under way, of those in `runs`."""
    folders = [path.parent for path in runs.glob(f"*/{PROCESSES_FILE}")]
    for folder in sorted(folders, key=lambda folder: (_written(folder), folder), reverse=True):
        if under_way(folder):
            return folder
    return None


def _read(folder: Path) -> dict[str, Any]:
    try:
        record = json.loads((folder / PROCESSES_FILE).read_text())
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}


def _written(folder: Path) -> int:
    """Return when the folder's record was written; 0 if it has just been removed."""
    try:
        return (folder / PROCESSES_FILE).stat().st_mtime_ns
    except OSError:
        return 0


def _lives(pid: object) -> bool:
    if type(pid) is not int or not 0 < pid < 1 << 31:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True

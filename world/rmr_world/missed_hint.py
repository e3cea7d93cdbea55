"""The lines at the end of a run that name the commands to go on with: its page, and why deadlines were missed."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def view_hint(recording: Path) -> str:
    """Return the last line of a run that was recorded in a folder or a file: the command that shows it."""
    return f"see it: rmr view {shlex.quote(str(recording))}"


def missed_hint(report: Mapping[str, Any], recording: Path) -> list[str]:
    """Return the line to print for a run with this report, which was recorded in a folder or a file; or no line."""
    missed = [
        (job["deadline_s"], int(robot), job["name"])
        for robot, part in report["robots"].items()
        for job in part.get("assertions", ())
        if job["met"] is False
    ]
    if not missed:
        return []
    command = f"rmr why {shlex.quote(str(recording))} --missed"
    _, robot, name = min(missed)
    if len(missed) == 1:
        return [f"why a deadline was missed: {command} {name}@{robot}"]
    return [f"why {len(missed)} deadlines were missed: {command}; of one: {command} {name}@{robot}"]

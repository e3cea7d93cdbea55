"""A process that ended: said so that a person can act on it, with the last things that it said itself."""

import signal
from pathlib import Path

from rmr_deploy.process_group import Child

LAST_LINES = 8
"""Lines that are shown: a traceback's end with the error, or what led up to it."""

TAIL_OCTETS = 16_384
"""How much of the end is read to find them."""


def obituary(child: Child) -> str:
    """Return who ended, how, and the last lines that it wrote."""
    lines = "".join(f"\n    {line}" for line in last_lines(child.output))
    return f"{child.name} (pid {child.pid}) {how(child.exit_code())}" + (f"; its last words:{lines}" if lines else "")


def how(exit_code: int | None) -> str:
    """Return an exit code in words."""
    if exit_code is None:
        return "runs"
    if exit_code < 0:
        return f"was killed by {_signal_name(-exit_code)}"
    return f"ended with exit code {exit_code}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # a real-time signal has no name
        return f"signal {number}"


def last_lines(output: Path) -> list[str]:
    """Return the last lines of what a process has written."""
    try:
        with output.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(0, size - TAIL_OCTETS))
            text = file.read().decode(errors="replace")
    except OSError:  # the run folder has been removed
        return []
    return [line for line in text.splitlines() if line.strip()][-LAST_LINES:]

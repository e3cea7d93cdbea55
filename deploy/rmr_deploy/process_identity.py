"""The identity of a process beyond its id: the instant of its start.

The system gives the id of a process that has ended to another one. A record of processes therefore holds the start
with each id, and whoever signals a process by a record compares both first.
"""

import os
import sys
import time
from contextlib import suppress
from functools import cache
from pathlib import Path


def start_mark(pid: object) -> str | None:
    """Return a text that only this process of the id `pid` has; None if there is none, or it has ended.

    On Linux it is the boot's id and the start in clock ticks since the boot (proc(5)), elsewhere what ps(1) tells.
    """
    if type(pid) is not int or not 0 < pid < 1 << 31:
        return None
    if sys.platform == "linux":
        fields = stat_fields(pid)
        return None if fields is None or fields[0] in "ZX" else f"{_boot()}-{fields[19]}"
    import subprocess  # noqa: PLC0415 - not needed on Linux, where an answer should be quick

    words = ["ps", "-o", "stat=,lstart=", "-p", str(pid)]
    told = subprocess.run(words, capture_output=True, text=True, check=False).stdout.split(maxsplit=1)
    return None if len(told) < 2 or told[0].startswith("Z") else told[1].strip()


def stat_fields(pid: int) -> list[str] | None:
    """Return the fields of /proc/PID/stat from the third on, which is the state; None if there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None


def usage_of(pid: int) -> tuple[float | None, float | None, float]:
    """Return processor time (s) and memory (MB) of a process, where they are known, and when that was (monotonic)."""
    now_s = time.monotonic()
    fields = stat_fields(pid)
    if fields is None:
        return None, None, now_s
    cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return cpu_s, round(int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6, 1), now_s


def lives(pid: object, mark: object = None) -> bool:
    """Return whether the process `pid` runs, and is the one with the start `mark` (None: unknown)."""
    found = start_mark(pid)
    return found is not None and (mark is None or found == mark)


def signal_process(pid: int, mark: object, number: int, *, group: bool = False) -> bool:
    """Send a signal to the process `pid`, with its `group` if it leads one; return whether it is still that process.

    A process without a recorded `mark` gets none, for it cannot be told from another one, and neither does another
    user's: root could end that, too.
    """
    if mark is None or not lives(pid, mark) or not _is_ours(pid):
        return False
    with suppress(ProcessLookupError, PermissionError):
        if group and os.getpgid(pid) == pid:
            os.killpg(pid, number)
        else:
            os.kill(pid, number)
    return True


def _is_ours(pid: int) -> bool:
    """Return whether the process is this user's; elsewhere than on Linux the kernel alone decides."""
    if sys.platform != "linux":
        return True
    try:
        return Path(f"/proc/{pid}").stat().st_uid == os.getuid()
    except OSError:
        return False


@cache
def _boot() -> str:
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()[:8]
    except OSError:
        return "boot"

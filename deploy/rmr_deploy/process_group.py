"""The process group of one run: starts its processes, polls them, ends all of them, and reports how one ended.

Three mechanisms keep processes from outliving a run:

- *Order.* `ProcessGroup.stop` asks with SIGTERM, waits a bounded time and then sends SIGKILL. Signals go to the
  process by its id while it is still unreaped, so that an id that the system has given away again is never hit.
- *The lifeline.* Every process inherits the read end of a pipe whose only write end the launcher holds; its
  number stands in the environment as `RMR_LIFELINE`. However the launcher ends, even by ``kill -9``, the kernel
  closes the write end, and each process reads end-of-file and leaves.
- *The parent's death signal.* A process that is stopped, or stuck in an action that never returns, reads no
  pipe. On Linux the kernel is therefore asked to kill it with the thread that started it (prctl(2),
  PR_SET_PDEATHSIG). Hence: start processes from the main thread, and those with `threaded` that start after the
  bus was opened, which has threads.

Every process leads a session and a process group of its own, so that Ctrl-C in the terminal reaches the launcher alone,
which then stops the run in order. What a user's action has started is in its robot's group and ends with it, unless it
leads a session of its own.
"""

import asyncio
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rmr.bus.process import LIFELINE
from rmr.entry import ExitCode
from rmr_deploy.parent_death import PR_SET_PDEATHSIG

POLL_S = 0.02
"""Period with which a process that stops is polled; far below what a person notices."""

TERM_PATIENCE_S = 2.0
"""Limit for a process to exit after SIGTERM; leaving a bus whose router is gone takes about one second."""

KILL_PATIENCE_S = 2.0
"""Limit for a process to end after SIGKILL; only one inside an uninterruptible system call takes longer."""


LAST_LINES = 8
"""Lines of a process's output in its exit report: the end of a traceback, or what led to the exit."""


@dataclass(frozen=True, slots=True)
class Child:
    """One process of the run."""

    name: str
    """Its name in messages and file names: ``world``, ``robot-4``, ``robot-1-20``."""
    process: subprocess.Popen[bytes]
    output: Path
    """Where its standard output and standard error go."""
    began_s: float = field(default_factory=time.monotonic)
    """When it was started, on the monotonic clock."""

    @property
    def pid(self) -> int:
        """The process id."""
        return self.process.pid

    def exit_code(self) -> int | None:
        """Return the exit code, negative for the signal that ended it, or None while it runs.

        Once it has ended, so do the processes that it has left in its group.
        """
        if self.process.returncode is None and _has_ended(self.pid):
            # Until it is reaped its id, which is the group's, is given to nobody else.
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        return self.process.poll()


class ProcessGroup:
    """All processes of one run, in the order in which they were started."""

    def __init__(self) -> None:
        self.children: list[Child] = []
        self._read, self._write = os.pipe()

    def start(self, name: str, command: Sequence[str], output: Path, *, threaded: bool = False) -> Child:
        """Start `command`; what it writes is appended to `output`. Raises OSError if it cannot be started.

        `threaded` says that other threads run, as after the bus was opened.
        """
        if threaded and sys.platform == "linux":
            command = [sys.executable, "-P", "-m", "rmr_deploy.parent_death", str(os.getpid()), *command]
        with output.open("ab") as sink:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=sink,
                env=os.environ | {LIFELINE: str(self._read), "PYTHONUNBUFFERED": "1"},
                pass_fds=(self._read,),
                start_new_session=True,
                preexec_fn=None if threaded else _death_with_parent(),  # noqa: PLW1509 - no other thread runs
            )
        child = Child(name, process, output)
        self.children.append(child)
        return child

    def dead(self) -> list[Child]:
        """Return the processes that have ended, in the order in which they were started."""
        return [child for child in self.children if child.exit_code() is not None]

    async def left(self, children: Iterable[Child], patience_s: float) -> list[Child]:
        """Wait until `children` have ended, `patience_s` at most; return those that have not."""
        end = time.monotonic() + patience_s
        alive = _alive(children)
        while alive and time.monotonic() < end:
            await asyncio.sleep(POLL_S)
            alive = _alive(alive)
        return alive

    async def stop(self, children: Iterable[Child]) -> list[Child]:
        """End `children`: SIGTERM, then SIGKILL. Takes `TERM_PATIENCE_S` + `KILL_PATIENCE_S` at most.

        Returns those that had to be killed.
        """
        alive = _alive(children)
        _signal(alive, signal.SIGTERM)
        stubborn = await self.left(alive, TERM_PATIENCE_S)
        _signal(stubborn, signal.SIGKILL)
        await self.left(stubborn, KILL_PATIENCE_S)
        return stubborn

    def kill(self) -> None:
        """End every process at once and cut the lifeline. May be called at any time, and again."""
        _signal(_alive(self.children), signal.SIGKILL)
        end = time.monotonic() + KILL_PATIENCE_S
        while (alive := _alive(self.children)) and time.monotonic() < end:
            time.sleep(POLL_S)
        for child in alive:
            print(f"rmr up: {child.name} (pid {child.pid}) does not end", file=sys.stderr)
        self._cut()

    def _cut(self) -> None:
        for end in (self._read, self._write):
            if end >= 0:
                os.close(end)
        self._read = self._write = -1


def _has_ended(pid: int) -> bool:
    """Return whether a child process that has not been reaped has ended; it is not reaped by this."""
    try:
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:
        return False


def _alive(children: Iterable[Child]) -> list[Child]:
    return [child for child in children if child.exit_code() is None]


def _signal(children: Iterable[Child], number: int) -> None:
    for child in children:
        child.process.send_signal(number)


def _death_with_parent() -> Callable[[], None] | None:
    if sys.platform != "linux":
        return None
    prctl = ctypes.CDLL(None, use_errno=True).prctl
    parent = os.getpid()

    def ask() -> None:
        prctl(PR_SET_PDEATHSIG, int(signal.SIGKILL))
        if os.getppid() != parent:  # it died before the kernel was asked
            os._exit(ExitCode.FAILED)

    return ask


# --- exit reports


def exit_report(child: Child) -> str:
    """Return the name of the process, how it ended, and the last lines that it wrote."""
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
            file.seek(max(0, size - 16_384))  # enough to find those lines
            text = file.read().decode(errors="replace")
    except OSError:  # the run folder has been removed
        return []
    return [line for line in text.splitlines() if line.strip()][-LAST_LINES:]


def said(output: Path) -> list[str]:
    """Return the last lines of a process's plain output that report a failure or a refused process."""
    try:
        lines = output.read_text(errors="replace").splitlines()
    except OSError:
        return []
    # The last ones are enough: all are in the process's log.
    return [line for line in lines if " failed: " in line or "refused a process" in line][-5:]

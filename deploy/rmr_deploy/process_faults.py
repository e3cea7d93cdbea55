"""Faults of robot processes on request: kill, restart, stall. The launcher carries them out (`run_requests`).

A robot that was killed counts as died, as with ``--keep-going``: the run goes on without it, or with the process that
is started in its place. Its name gets a number: ``robot-3`` is followed by ``robot-3.1``.
"""

import signal
import time
from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any

from rmr_deploy.process_group import Child

STALL_S_MAX = 86_400.0
"""Length of a stall at most."""


class ProcessFaults:
    """The faults of one run's processes."""

    def __init__(
        self, robots: dict[int, Child], start: Callable[[int, str], Child], now_s: Callable[[], float]
    ) -> None:
        """`robots` are the processes by robot, also of later ones.

        `start` starts the process of a robot again under a name, `now_s` returns lab time in seconds.
        """
        self._robots = robots
        self._start = start
        self._now_s = now_s
        self.killed: set[str] = set()
        """Names of the processes that were killed on request."""
        self.entries: list[dict[str, Any]] = []
        """What was done, in the form of a lab file's faults."""
        self._stalled: dict[str, tuple[Child, float]] = {}

    def perform(self, request: Mapping[str, Any]) -> str:
        """Carry out a request; return why it is refused, or nothing."""
        robot = request.get("robot")
        if type(robot) is not int or robot not in self._robots:
            return "there is no such robot in this run"
        child = self._robots[robot]
        others = sum(one is child for one in self._robots.values()) - 1
        if others:
            return f"robot {robot} shares its process with {others} more: start the run without --processes"
        dead = child.exit_code() is not None
        match request.get("do"):
            case "kill":
                return f"robot {robot} is dead already" if dead else self._kill(robot, child)
            case "restart":
                return self._restart(robot, child) if dead else f"robot {robot} lives: kill it before it is restarted"
            case "stall":
                return f"robot {robot} is dead" if dead else self._stall(robot, child, request.get("for_s"))
        return "unknown request"

    def _kill(self, robot: int, child: Child) -> str:
        self.killed.add(child.name)
        child.process.send_signal(signal.SIGKILL)
        self.entries.append({"at": self._stamp(), "kill": robot})
        return ""

    def _restart(self, robot: int, child: Child) -> str:
        base, _, number = child.name.partition(".")
        try:
            self._robots[robot] = self._start(robot, f"{base}.{int(number or 0) + 1}")
        except OSError as error:
            return f"robot {robot} cannot be started: {error.strerror or error}"
        self.entries.append({"at": self._stamp(), "restart": robot})
        return ""

    def _stall(self, robot: int, child: Child, for_s: object) -> str:
        if not isinstance(for_s, int | float) or not (isfinite(for_s) and 0.0 < for_s <= STALL_S_MAX):
            return f"a stall lasts up to {STALL_S_MAX:g} s"
        until = max(time.monotonic() + for_s, self._stalled.get(child.name, (child, 0.0))[1])
        self._stalled[child.name] = (child, until)
        child.process.send_signal(signal.SIGSTOP)
        now_s = self._stamp()
        self.entries.append({"from": now_s, "to": round(now_s + for_s, 3), "stall": robot})
        return ""

    def _stamp(self) -> float:
        return round(self._now_s(), 3)

    def resume(self, *, everything: bool = False) -> None:
        """Let the processes go on whose stall is over, or `everything`."""
        now = time.monotonic()
        for name, (child, until) in list(self._stalled.items()):
            if everything or now >= until:
                del self._stalled[name]
                child.process.send_signal(signal.SIGCONT)

"""The processes of robots that are about to be started again by the restart policy of a run."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from rmr_deploy.process_group import Child
from rmr_deploy.restart_policy import RestartPolicy


class PendingRestart(NamedTuple):
    """A process that will follow one that has failed."""

    due: float
    """When to start it, on the monotonic clock."""
    robots: tuple[int, ...]
    name: str


def next_name(name: str) -> str:
    """Return the name of the process that follows `name`: ``robot-3``, ``robot-3.1``, ``robot-3.2``."""
    base, _, number = name.partition(".")
    return f"{base}.{int(number or 0) + 1}"


class Restarts:
    """Applies a policy to the processes of one run."""

    def __init__(self, policy: RestartPolicy | None, start: Callable[[Sequence[int], str], object]) -> None:
        """`start` starts the process of some robots under a name; it may raise OSError."""
        self._policy = policy
        self._start = start
        self._pending: list[PendingRestart] = []
        self._pauses: dict[tuple[int, ...], float] = {}
        """The last pause before a start, by the robots of the process."""
        self._counts: dict[tuple[int, ...], int] = {}

    def failed(self, child: Child, exit_code: int, robots: Sequence[int]) -> float | None:
        """Note that the process of `robots` has ended; return after how many seconds the next is started.

        None if it stays down.
        """
        if self._policy is None or not robots:
            return None
        crew = tuple(robots)
        count = self._counts.get(crew, 0)
        ran_s = time.monotonic() - child.began_s
        pause_s = self._policy.pause_s(exit_code, count, ran_s, self._pauses.get(crew))
        if pause_s is not None:
            self._pauses[crew] = pause_s
            self._counts[crew] = count + 1
            self._pending.append(PendingRestart(time.monotonic() + pause_s, crew, next_name(child.name)))
        return pause_s

    def waits(self, robot: int) -> bool:
        """Whether the process of `robot` is about to be started again."""
        return any(robot in one.robots for one in self._pending)

    def forget(self, robot: int) -> None:
        """Leave the start of `robot` to somebody else."""
        self._pending = [one for one in self._pending if robot not in one.robots]

    def start_due(self) -> list[str]:
        """Start the processes whose time has come; return why some could not be."""
        now = time.monotonic()
        problems = []
        for one in [one for one in self._pending if one.due <= now]:
            self._pending.remove(one)
            try:
                self._start(one.robots, one.name)
            except OSError as error:
                problems.append(f"{one.name} cannot be started: {error.strerror or error}")
        return problems

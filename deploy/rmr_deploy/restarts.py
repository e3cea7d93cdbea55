"""The restart policy of `rmr up`: whether, and how soon, a process that has failed is started again.

As in compose, ``on-failure`` is for processes that end by themselves with another exit code than 0, or by a signal.
What a person has killed or stopped stays down. The pause before each start doubles, and begins anew after a process
has run for a while: a robot that fails at once takes no processor time from the others. A durable world is under the
same rule, but not without an end: nothing goes on without it.

The policy is an option, so this module loads next to nothing.
"""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from rmr.entry import ExitCode

if TYPE_CHECKING:
    from rmr_deploy.process_group import Child

FIRST_PAUSE_S = 0.1
PAUSE_S_MAX = 10.0
STEADY_S = 10.0
"""A process that has run for so long is no sign that the next one will fail at once."""

POLICY = re.compile(r"on-failure(?::([1-9][0-9]{0,5}))?", re.ASCII)


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """When a robot is started again."""

    times: int | None = None
    """How often each robot is started again at most; None: as often as it fails."""
    in_a_row: bool = False
    """Whether those after a process that has run for `STEADY_S` are counted anew."""

    def pause_s(self, exit_code: int, restarts: int, ran_s: float, last_s: float | None) -> float | None:
        """Return after how many seconds to start a robot again; None if it stays down.

        `restarts` is how often it has been, `ran_s` how long it ran, `last_s` the pause of last time.
        """
        if exit_code in (ExitCode.OK, ExitCode.INVALID):  # the same program would be refused again
            return None
        if self.times is not None and restarts >= self.times and not (self.in_a_row and ran_s >= STEADY_S):
            return None
        if last_s is None or ran_s >= STEADY_S:
            return FIRST_PAUSE_S
        return min(2.0 * last_s, PAUSE_S_MAX)


def world_policy(given: RestartPolicy | None) -> RestartPolicy:
    """Return when a durable world is started again, where `given` says when robots are."""
    # A world that cannot live does not die six times by chance, with pauses of 3.1 s in all.
    return RestartPolicy(5, in_a_row=True) if given is None or given.times is None else given


def restart_policy(text: str) -> RestartPolicy | None:
    """Return the policy that ``no``, ``on-failure`` or ``on-failure:3`` names. Raises ValueError."""
    if text == "no":
        return None
    found = POLICY.fullmatch(text)
    if found is None:
        raise ValueError("should be no, on-failure, or on-failure:N with the number of restarts of each robot at most")
    return RestartPolicy(int(found[1]) if found[1] else None)


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

    def failed(self, child: "Child", exit_code: int, robots: Sequence[int]) -> float | None:
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
            self._counts[crew] = 1 if self._policy.in_a_row and ran_s >= STEADY_S else count + 1
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

"""The actions in a robot's report: those started last, their number, the failures, and the reason of the first failure.

An action that was ended by `stop`, by a later one of its name, or by a new program, has not failed: it is not counted.
"""

from collections import deque
from collections.abc import Iterator
from typing import Final

from rmr.base.time import Instant, in_seconds
from rmr.node.actions.dispatcher import INTERRUPTED
from rmr.node.actions.job_steps import JobSteps

ACTIONS_MAX: Final = 10_000
"""Started actions kept for the report; the oldest go first."""


class ActionLog:
    """One robot's actions, as (seconds of lab time, action in program syntax), in the order started."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, str]] = deque(maxlen=ACTIONS_MAX)
        self.started = 0
        self.failed = 0
        self.unhandled = 0
        """Failures of handlers of the user's own whose actions declare no `else`."""
        self.first_failure: tuple[float, str, str] | None = None
        """When the first one failed, which, and why."""
        self.steps = JobSteps()

    def __iter__(self) -> Iterator[tuple[float, str]]:
        return iter(self._kept)

    def __getitem__(self, index: int) -> tuple[float, str]:
        return self._kept[index]

    @property
    def omitted(self) -> int:
        """How many were started before those that are kept."""
        return self.started - len(self._kept)

    def begin(self, now: Instant, action: str) -> None:
        """Take note of an action that begins."""
        self.started += 1
        self._kept.append((round(in_seconds(now), 3), action))

    def end(self, now: Instant, action: str, failure: str | None, *, handled: bool) -> None:
        """Take note of an action that has ended, why it failed if it did, and whether the program handles failures."""
        if failure is None or failure in INTERRUPTED:
            return
        self.failed += 1
        self.unhandled += not handled
        if self.first_failure is None:
            self.first_failure = round(in_seconds(now), 3), action, str(failure)

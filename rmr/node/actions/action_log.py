"""The actions in a robot's report: those started last, their number, the failures, and the reason of the first failure.

The log, the trace and the provenance log learn of an action by the same three events (`RobotState.tell`). An action
that was ended by `stop`, by a later one of its name, or by a new program, has not failed: it is not counted.
"""

from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

from rmr.base.time import Instant, in_seconds
from rmr.node.actions.dispatcher import INTERRUPTED
from rmr.node.actions.job_steps import JobSteps

ACTIONS_MAX: Final = 10_000
"""Started actions kept for the report; the oldest go first."""


class ActionHeld(NamedTuple):
    """An action of this robot has to wait for its turn."""

    serial: int
    turn: str
    """At what, as the trace names it."""


class ActionBegun(NamedTuple):
    """An action of this robot has begun."""

    serial: int
    action: str
    """In program syntax."""
    turn: str | None
    """At what it goes by a turn: it may have asked for one only after it was held."""


class ActionEnded(NamedTuple):
    """An action of this robot is over, whether or not it had begun."""

    serial: int
    action: str
    failure: str | None
    """Why it failed; None: it completed."""
    handled: bool = True
    """Whether the program handles its failures."""


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

    def begun(self, now: Instant, event: ActionBegun) -> None:
        """Take note of an action that begins."""
        self.started += 1
        self._kept.append((round(in_seconds(now), 3), event.action))

    def ended(self, now: Instant, event: ActionEnded) -> None:
        """Take note of an action that has ended."""
        if event.failure is None or event.failure in INTERRUPTED:
            return
        self.failed += 1
        self.unhandled += not event.handled
        if self.first_failure is None:
            self.first_failure = round(in_seconds(now), 3), event.action, str(event.failure)

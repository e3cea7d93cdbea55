"""The values of a robot's history: its facts, actions, goals, messages and jobs, each with what became of it.

An item is whatever an explanation can name: a fact, an action, a goal, a message. Items are numbered in the order in
which they came, over all incarnations of a robot, so that a number means the same in every answer. A place is the
number of a record, over all incarnations, too: what happens within one call has one instant, and places tell it apart.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

from rmr.base.time import NEVER, Instant
from rmr.bytecode.program import Pattern
from rmr.vm.derive import Chain, DerivedKind
from rmr.vm.job import TimedJob
from rmr.vm.provenance import Cause, SentKey
from rmr.vm.store import Args


@dataclass(slots=True, eq=False)
class PastFact:
    """A fact of the robot, from its insertion to its removal."""

    number: int
    serial: int
    predicate: int
    args: Args
    at: Instant
    place: int
    cause: Cause
    until: Instant = NEVER
    """When it was removed; NEVER: it holds."""
    removal: Cause | None = None
    removed_place: int = 1 << 62

    def held_at(self, now: Instant) -> bool:
        """Return whether it held after all that happened at `now`."""
        return self.at <= now < self.until


EndedGoal = tuple[int, tuple[object, ...]]
"""Predicate and arguments (values, or ANY) of a goal that is no longer open."""


class TurnGate(NamedTuple):
    """From when on an action went by the turn of a resource."""

    at: Instant
    group: bytes
    """Names those that contend for the resource, of all robots alike."""
    asked: bool
    """Whether the robot had asked for a turn."""


@dataclass(slots=True, eq=False)
class PastAction:
    """An action that the robot executes, or whose end it awaits."""

    number: int
    serial: int
    predicate: int
    executor: int
    args: Args
    at: Instant
    place: int
    cause: Cause
    then: Chain
    held: Instant | None = None
    """Since when it waited for its turn; None: it never did."""
    group: str = ""
    begun: Instant | None = None
    ended: Instant | None = None
    failure: str | None = None
    cancelled_with: EndedGoal | None = None
    """The goal whose achievement or withdrawal ended it."""
    gates: list[TurnGate] = field(default_factory=list)
    """The resources for whose turn it waited, one after the other; empty if it needed none."""
    waits: list[tuple[Instant, str]] = field(default_factory=list)
    """Before it began, from when on it was ``held`` (for its turn) or ``queued`` (for the wheels)."""
    job: TimedJob | None = None
    """The one that had the turn by which it went."""
    due: Instant = NEVER
    """By when it had to end, so that the later steps of that job had their time."""

    def under_way_at(self, now: Instant) -> bool:
        """Return whether it had begun and not ended before `now`."""
        return self.begun is not None and self.begun <= now and (self.ended is None or self.ended >= now)


@dataclass(slots=True, eq=False, kw_only=True)
class PastDelivery:
    """What the sender knows of a message: of an item of its program, or of news of its own."""

    news: "PastFact | PastAction | None" = None
    """Of news: the finish fact, or the action that has ended; None: of an item, or of something outside."""
    key: SentKey | None = None
    """As its frames name it; None: it never left."""
    begun: Instant = NEVER
    """When it was taken up for the radio."""
    text: str = ""
    """In program syntax, as in the trace."""
    transmissions: list[tuple[Instant, int]] = field(default_factory=list)
    """When it was handed to the radio, each time, and the radio's handle of that, if the node tells of its frames."""
    repeated: list[Instant] = field(default_factory=list)
    acknowledged: Instant | None = None
    given_up: Instant | None = None
    why: str = ""


@dataclass(slots=True, eq=False)
class PastSend(PastDelivery):
    """A fact, goal or action that was sent to another robot."""

    number: int
    role: DerivedKind
    destination: int
    predicate: int
    args: Args
    at: Instant
    place: int
    cause: Cause


@dataclass(slots=True, eq=False)
class PastGoal:
    """A goal of the robot."""

    number: int
    predicate: int
    args: tuple[Pattern, ...]
    at: Instant
    place: int
    cause: Cause
    achieved: Instant | None = None
    withdrawn: Instant | None = None
    served: EndedGoal | None = None
    """Of a sub-goal that ended: the goal whose achievement or withdrawal ended it."""


PastItem = PastFact | PastAction | PastSend | PastGoal


@dataclass(slots=True, eq=False)
class PastJob:
    """A job of a time assertion, as of its last start."""

    job: TimedJob | None = None
    starts: list[PastFact] = field(default_factory=list)
    """The fact of each start."""
    learned: Instant | None = None
    """When the robot learned of its end."""


class PastArrival(NamedTuple):
    """When a delivery has taken effect."""

    at: Instant
    place: int

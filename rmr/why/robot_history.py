"""What one robot did, as far as the explanation of delays needs it: values, in the order of time.

Made by `rmr.why.history_listener` from a robot's mind, in a simulated run or in a replay of its log. All instants are
integer nanoseconds of lab time. What happens within one call of the node has the same instant; `order` tells it apart.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeVar

from rmr.base.time import NEVER, Instant
from rmr.base.values import Value
from rmr.node.standstill import Motion, MotionState
from rmr.vm.job import TimedJob

Args = tuple[Value, ...]
DeliveryKey = tuple[int, int, int, int]
"""Sender, destination, the sender's epoch, sequence number."""


class CauseKind:
    """What made something happen."""

    FIRING = "firing"
    DELIVERY = "delivery"
    ACTION = "action"
    """The end of an action: an effect, or the next step of a chain."""
    SENSED = "sensed"
    GIVEN = "given"
    """An initial fact, or one that somebody inserted from outside."""
    SENT = "sent"
    """A delivery of its own was acknowledged, or given up."""
    MISSED = "missed"
    """A missed deadline."""


class EventCause(NamedTuple):
    """What made something happen."""

    kind: str
    number: int = -1
    """The firing or the action, by its index in the history; of a missed deadline, or of a finish that is reported, the
    change that started the job, or ended it."""
    key: DeliveryKey | None = None


@dataclass(slots=True)
class TimedFiring:
    """A rule was applied."""

    at: Instant
    order: int
    rule: int
    text: str
    """Its place in the source."""
    premises: tuple[int, ...] = ()
    """The facts that its rule matched, by index among the changes."""


class Change(NamedTuple):
    """A fact came or went."""

    at: Instant
    order: int
    predicate: int
    args: Args
    came: bool
    cause: EventCause
    text: str


class TurnGate(NamedTuple):
    """From when on an action went by the turn of a resource."""

    at: Instant
    group: bytes
    """Names those that contend for the resource, of all robots alike."""
    asked: bool
    """Whether the robot had asked for a turn."""


@dataclass(slots=True)
class ActionSpan:
    """One derived action."""

    name: str
    text: str
    derived: Instant
    order: int
    cause: EventCause
    wheels: bool
    started: Instant | None = None
    ended: Instant = NEVER
    failure: str | None = None
    gates: list[TurnGate] = field(default_factory=list)
    """The resources for whose turn it waited, one after the other; empty if it needed none."""
    waits: list[tuple[Instant, str]] = field(default_factory=list)
    """Before its start, from when on it was ``held`` (for its turn) or ``queued`` (for the wheels)."""


@dataclass(slots=True)
class DeliverySpan:
    """What the sender knows of a delivery."""

    key: DeliveryKey
    begun: Instant
    order: int
    cause: EventCause
    text: str = ""
    transmissions: list[tuple[Instant, int]] = field(default_factory=list)
    """When it was handed to the radio, each time, and the radio's handle of that."""
    given_up: Instant | None = None


class LostDelivery(NamedTuple):
    """A delivery that its sender has given up, or could not send."""

    at: Instant
    robot: int
    """The sender."""
    destination: int
    text: str
    why: str


class PassageSpan(NamedTuple):
    """The robot used a shared resource."""

    group: bytes
    entered: Instant
    left: Instant


class KnownOrder(NamedTuple):
    """A schedule became known to the robot."""

    at: Instant
    group: bytes
    leader: int
    robots: tuple[int, ...]


T = TypeVar("T")


@dataclass(slots=True)
class RobotHistory:
    """One robot, over all its incarnations."""

    robot: int
    lives: list[tuple[Instant, Instant]] = field(default_factory=list)
    """From when to when its process lived; NEVER: to the end of the run."""
    stops: set[Instant] = field(default_factory=set)
    """Those of the ends of `lives` at which the process was stopped in order."""
    ends: Instant = 0
    """The last instant that is known."""
    jobs: list[tuple[TimedJob, Instant | None]] = field(default_factory=list)
    """Each with when the robot learned of its end."""
    motion: list[tuple[Instant, MotionState]] = field(default_factory=list)
    late: list[tuple[Instant, Instant]] = field(default_factory=list)
    """The robot was due from the one instant on, and was called at the other."""
    firings: list[TimedFiring] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    actions: list[ActionSpan] = field(default_factory=list)
    sent: dict[DeliveryKey, DeliverySpan] = field(default_factory=dict)
    received: dict[DeliveryKey, tuple[Instant, int]] = field(default_factory=dict)
    """When each delivery was taken up first, and its place in the order."""
    undelivered: list[LostDelivery] = field(default_factory=list)
    starts: list[tuple[str, int]] = field(default_factory=list)
    """The name of each job that has started, and the change that started it."""
    passages: list[PassageSpan] = field(default_factory=list)
    orders: list[KnownOrder] = field(default_factory=list)

    def motion_between(self, begin: Instant, end: Instant) -> list[tuple[Instant, Instant, MotionState]]:
        """Return what the wheels did, as parts of [begin, end) without gap."""
        states = self.motion
        first = max(0, bisect_right(states, begin, key=_at) - 1)
        parts: list[tuple[Instant, Instant, MotionState]] = []
        at = begin
        state = MotionState(Motion.IDLE)
        for since, new in states[first:]:
            if since >= end:
                break
            if since > at:
                parts.append((at, since, state))
                at = since
            state = new
        if at < end:
            parts.append((at, end, state))
        return parts

    def newest(self, at: Instant, order: int, accept: Callable[[Change], bool]) -> Change | None:
        """Return the newest change that is accepted, before `order` at the instant `at` or before that."""
        for change in reversed(self.changes[: bisect_right(self.changes, (at, order - 1), key=_place)]):
            if accept(change):
                return change
        return None

    def newest_fact(self, predicate: int, args: Args) -> int:
        """Return the index of the change by which a fact has come last; -1: it never did."""
        for index in range(len(self.changes) - 1, -1, -1):
            change = self.changes[index]
            if change.came and change.predicate == predicate and change.args == args:
                return index
        return -1


def _at(state: tuple[Instant, MotionState]) -> Instant:
    return state[0]


def _place(change: Change) -> tuple[Instant, int]:
    return change.at, change.order


def overlaps(spans: Sequence[tuple[Instant, Instant]], begin: Instant, end: Instant) -> list[tuple[Instant, Instant]]:
    """Return the parts of `spans`, which are in order and apart, within [begin, end)."""
    return [(max(b, begin), min(e, end)) for b, e in spans if b < end and e > begin]

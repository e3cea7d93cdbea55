"""What a coordination core hands up: frames for the radio, and what has happened, in the past tense."""

from dataclasses import dataclass
from typing import NamedTuple

from rmr.base.grid_path import GridPath
from rmr.base.time import Instant


class Send(NamedTuple):
    """A frame for the radio."""

    payload: bytes
    destination: int | None
    """None: broadcast."""
    handle: int
    """Names the frame when its outcome is reported; 0 when the outcome does not matter (broadcasts)."""
    at: Instant
    """Not before this instant."""


@dataclass(frozen=True, slots=True)
class JobRequest:
    """One robot's timed work on a shared place."""

    group_id: bytes
    """Six octets that name the group (a hash of program, assertion and finish arguments)."""
    trigger: Instant
    """When the job started; with the robot it is the job's identity."""
    release: Instant
    """The robot cannot be at its gate before."""
    duration: int
    """Nanoseconds inside, an upper bound."""
    deadline: Instant
    """By when it shall be outside again."""
    headway: int
    """Nanoseconds between two entries in the same direction."""
    direction: int
    """0..15: robots of different directions exclude each other."""
    inside: bool = False
    """The robot finds itself inside as the job starts, as after a restart: it is so, and needs no slot."""
    underway: bool = False
    """The robot has set out and was put off, so that others would have to pass it."""
    postpones: bool = False
    """The robot itself tells a later release when it cannot keep its slots, as on its way to a bottleneck: slots that
    it misses are no absence."""
    capacity: int = 1
    """How many robots may be inside at a time, of turns that exclude each other: the places of a station. The same for
    all robots of the group, so frames do not carry it."""


@dataclass(frozen=True, slots=True)
class SlotAssigned:
    """The job has a slot, or its slot or rank has changed."""

    group_id: bytes
    trigger: Instant
    rank: int
    """From 1: the robot is the rank-th of this event. Fixed from the frozen zone on."""
    place: int
    """From 1: the robot is the place-th of those of its direction."""
    start: Instant
    """The robot enters between this and the entry window later."""
    end: Instant
    leader: int
    term: int


@dataclass(frozen=True, slots=True)
class SlotLost:
    """The slot holds no more; another will follow."""

    group_id: bytes


@dataclass(frozen=True, slots=True)
class Entered:
    """The robot is inside: it may drive now."""

    group_id: bytes
    start: Instant
    end: Instant
    """By when it said it would be outside."""
    cautious: bool
    """Somebody may still be inside who was not heard of for longer than any stall."""


@dataclass(frozen=True, slots=True)
class EntryMissed:
    """The entry window has passed, or another robot went first; another slot will follow."""

    group_id: bytes


@dataclass(frozen=True, slots=True)
class LeadershipBegan:
    """This robot leads the event."""

    group_id: bytes
    term: int


@dataclass(frozen=True, slots=True)
class LeadershipEnded:
    """This robot leads the event no more."""

    group_id: bytes


@dataclass(frozen=True, slots=True)
class LeaderChanged:
    """This robot follows another leader than before."""

    group_id: bytes
    leader: int
    term: int


@dataclass(frozen=True, slots=True)
class ScheduleChanged:
    """The newest schedule known here has another order (not merely lost those that are done)."""

    group_id: bytes
    leader: int
    term: int
    order: tuple[int, ...]
    """Robots with a slot, by rank."""
    formed: Instant
    """When this order was issued."""


@dataclass(frozen=True, slots=True)
class PathReceived:
    """The leader's path for one direction is complete here."""

    group_id: bytes
    direction: int
    path: GridPath


CoordEvent = (
    SlotAssigned
    | SlotLost
    | Entered
    | EntryMissed
    | LeadershipBegan
    | LeadershipEnded
    | LeaderChanged
    | ScheduleChanged
    | PathReceived
)

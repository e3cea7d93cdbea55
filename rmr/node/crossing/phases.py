"""The phases of a crossing and the transitions between them, as data.

A crossing is one job's use of a resource that robots share, such as a narrow passage. Each phase is a record whose
fields exist in that phase alone. `TRANSITIONS` is the whole machine: an event leads to the phase that its row names.
`rmr.node.crossing.crossing.Crossing` is the one that enters phases. Events are those of the coordination core and
those below; which of the core's mean nothing in a phase, since they may come late, is said by `IGNORED`.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.coord.events import Entered, EntryMissed, SlotAssigned, SlotLost
from rmr.node.motion.route import Route


@dataclass(slots=True)
class Preparing:
    """Not yet requested: pose, goal or the places of the other robots are still to be learned."""

    polled_at: Instant = 0
    """When the robot has last found that it must go on listening."""


@dataclass(slots=True)
class Asking:
    """Requested, without a slot."""

    polled_at: Instant
    """When the robot's own estimate was last compared with what the leader has heard."""


@dataclass(slots=True)
class Slotted:
    """With a slot ahead."""

    start: Instant
    """When the slot begins, at the commit line."""
    polled_at: Instant
    """As in `Asking`."""


@dataclass(slots=True)
class Inside:
    """Entry was granted, and the robot is not clear yet."""

    end: Instant
    """By when it will be clear, as reported to the others."""
    route: Route | None
    """The route by which the robot entered; None until it has set out."""
    stepped_at: Instant = NEVER
    """The last call; NEVER before the first one."""


@dataclass(slots=True)
class Left:
    """Over, or not needed."""


Phase = Preparing | Asking | Slotted | Inside | Left


class OwnEvent(Enum):
    """What ends a phase besides events of the coordination core."""

    REQUESTED = "requested"
    """The request was handed to the coordination core."""
    EXCUSED = "excused"
    """No crossing is needed: the robot is beyond the resource that others of its group pass."""
    RENEWED = "renewed"
    """What was requested is given up, and a new request follows."""
    JOB_OVER = "job over"
    """The job has ended before the robot has entered."""
    ACTION_FAILED = "action failed"
    """The last action that serves the job has failed before the robot has entered."""
    CLEARED = "cleared"
    """The robot is clear of the resource."""


SlotEvent = SlotAssigned | SlotLost | EntryMissed | Entered
"""What the coordination core tells a crossing."""
TRANSITIONS: Final[dict[tuple[type, type | OwnEvent], type]] = {
    (Preparing, OwnEvent.REQUESTED): Asking,
    (Preparing, OwnEvent.RENEWED): Preparing,
    (Preparing, OwnEvent.EXCUSED): Left,
    (Preparing, OwnEvent.JOB_OVER): Left,
    (Preparing, OwnEvent.ACTION_FAILED): Left,
    (Asking, SlotAssigned): Slotted,
    (Asking, SlotLost): Asking,
    (Asking, EntryMissed): Asking,
    (Asking, Entered): Inside,
    (Asking, OwnEvent.RENEWED): Preparing,
    (Asking, OwnEvent.EXCUSED): Left,
    (Asking, OwnEvent.JOB_OVER): Left,
    (Asking, OwnEvent.ACTION_FAILED): Left,
    (Slotted, SlotAssigned): Slotted,
    (Slotted, SlotLost): Asking,
    (Slotted, EntryMissed): Asking,
    (Slotted, Entered): Inside,
    (Slotted, OwnEvent.RENEWED): Preparing,
    (Slotted, OwnEvent.EXCUSED): Left,
    (Slotted, OwnEvent.JOB_OVER): Left,
    (Slotted, OwnEvent.ACTION_FAILED): Left,
    (Inside, OwnEvent.CLEARED): Left,
    (Inside, OwnEvent.RENEWED): Preparing,
    (Left, OwnEvent.RENEWED): Preparing,
}
"""Phase and event -> the next phase."""
IGNORED: Final = frozenset(
    [(phase, event) for phase in (Preparing, Left) for event in (SlotAssigned, SlotLost, EntryMissed, Entered)]
    + [(Inside, SlotAssigned)]
)
"""Events of the coordination core that concern a request which has been given up, or has been granted meanwhile."""


def phase_name(phase: Phase) -> str:
    """Return the phase in a word; a request that is being prepared counts as asking."""
    return "asking" if isinstance(phase, Preparing) else type(phase).__name__.lower()

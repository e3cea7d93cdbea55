"""The phases of a crossing and the transitions between them, as data.

A crossing is one job's use of a resource that robots share, such as a narrow passage. Each phase is a record whose
fields exist in that phase alone. `TRANSITIONS` is the whole machine: an event leads to the phase that its row names.
`rmr.node.crossing.crossing.Crossing` is the one that enters phases. Events are those of the coordination core and
those below; which of the core's mean nothing in a phase, since they may come late, is said by `IGNORED`.
"""

from dataclasses import dataclass
from typing import Final

from rmr.base.time import Instant
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
    """By when it will be clear, as the others have been told."""
    route: Route | None
    """The route by which the robot entered; None until it has set out."""


@dataclass(slots=True)
class Left:
    """Over, or not needed."""


Phase = Preparing | Asking | Slotted | Inside | Left


class Requested:
    """The request was handed to the coordination core."""


class Excused:
    """No crossing is needed: the robot is beyond the resource that others of its group pass."""


class Renewed:
    """What was requested is given up, and a new request follows."""


class JobOver:
    """The job has ended before the robot has entered."""


class Cleared:
    """The robot is clear of the resource."""


TRANSITIONS: Final[dict[tuple[type, type], type]] = {
    (Preparing, Requested): Asking,
    (Preparing, Renewed): Preparing,
    (Preparing, Excused): Left,
    (Preparing, JobOver): Left,
    (Asking, SlotAssigned): Slotted,
    (Asking, SlotLost): Asking,
    (Asking, EntryMissed): Asking,
    (Asking, Entered): Inside,
    (Asking, Renewed): Preparing,
    (Asking, Excused): Left,
    (Asking, JobOver): Left,
    (Slotted, SlotAssigned): Slotted,
    (Slotted, SlotLost): Asking,
    (Slotted, EntryMissed): Asking,
    (Slotted, Entered): Inside,
    (Slotted, Renewed): Preparing,
    (Slotted, Excused): Left,
    (Slotted, JobOver): Left,
    (Inside, Cleared): Left,
    (Inside, Renewed): Preparing,
    (Left, Renewed): Preparing,
}
"""Phase and event -> the next phase."""
IGNORED: Final = frozenset(
    [
        *((Preparing, event) for event in (SlotAssigned, SlotLost, EntryMissed, Entered)),
        (Inside, SlotAssigned),
        *((Left, event) for event in (SlotAssigned, SlotLost, EntryMissed, Entered)),
    ]
)
"""Events of the coordination core that concern a request which has been given up, or has been granted meanwhile."""


def phase_name(phase: Phase) -> str:
    """Return the phase in a word; a request that is being prepared counts as asking."""
    return "asking" if isinstance(phase, Preparing) else type(phase).__name__.lower()

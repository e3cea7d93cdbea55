"""What one step of a crossing is given and what it returns: a situation, and commands. Values only."""

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from rmr.base.direction import EXCLUSIVE
from rmr.base.geometry import Pose
from rmr.base.time import Duration, Instant, milliseconds
from rmr.coord.events import JobRequest
from rmr.node.config import UNKNOWN_INSIDE
from rmr.node.motion.route import Route

EXTEND_BEFORE: Final[Duration] = milliseconds(200)
"""An announced end that comes nearer than this while the action goes on is moved."""
STATION_NOTICE: Final[Duration] = milliseconds(2000)
"""The same for a robot that stays at a station: longer than the frozen zone and a claim, so that nobody claims in
vain for a slot behind the announced end."""
STATION_AHEAD: Final[Duration] = milliseconds(3000)
"""From now to the end that such a robot announces."""


@dataclass(frozen=True, slots=True)
class CrossingPlan:
    """The times that a crossing needs, as the robot has estimated them last."""

    gated: bool = False
    """Whether the route passes an entrance, with a hold line; else entering is the action's beginning."""
    passage: str | None = None
    """Name of the passage, if the route passes an entrance."""
    direction: int = EXCLUSIVE
    """Direction through the resource; what is no passage of it excludes all others."""
    approach: Duration = 0
    """Until the robot can be at its commit line."""
    inside: Duration = UNKNOWN_INSIDE
    """From there until it is clear."""
    after: Duration = 0
    """From there to the goal: the robot must be clear so much before its deadline."""
    headway: Duration = UNKNOWN_INSIDE
    within: bool = False
    """Whether the robot is inside the resource already."""
    obstructs_exit: bool = False
    """Whether it stands where others come out: it sets out at once, so that it can make room."""
    notice: Duration = EXTEND_BEFORE
    """How long before its end the crossing is extended; 0 where its length is known, as without a drive."""


class Situation(NamedTuple):
    """One robot and one resource, as one step of one crossing sees them. What a phase does not ask is left out.

    A tuple rather than a frozen dataclass: one is made in each tick, and a dataclass sets its fields one by one.
    """

    pose: Pose | None = None
    late_goes_next: bool = False
    """Whether a late robot near its entrance goes next: in a crowd (`rmr.node.profile`)."""
    set_out: bool = False
    """Whether the action is under way."""
    ready: bool = False
    """Whether the robot would enter now: it is at its commit line, or its action waits."""
    excused: bool = False
    """Whether it is beyond the resource that others of its group are known to pass."""
    alone: bool = False
    """Whether the schedule is known to list nobody else: asked where a robot may have to let others go first."""
    # -- preparing, and polls of one that waits
    may_ask: bool = False
    """Whether the robot knows where it is, and need not listen first."""
    plan: CrossingPlan | None = None
    """A new estimate; None where none was due, or there is no route."""
    beyond: bool = False
    """Whether the robot has the resource behind it."""
    within: bool = False
    """Whether it finds itself inside the resource."""
    in_entrance: bool = False
    """Whether it stands in an entrance where no robot gets past it."""
    barred: bool = False
    """Whether robots that count as dead bar every way through the resource."""
    # -- inside
    route: Route | None = None
    """The route through the resource by which it has entered."""
    retreating: bool = False
    """Whether it drives away from the hold line that it has not passed."""
    before_hold_line: bool = False
    """Whether it has not passed the hold line of its route."""
    cleared: bool = False
    eta_clear: Duration = 0


@dataclass(frozen=True, slots=True)
class Revise:
    """Report another release to the leader, and, if given, the deadline by which it orders."""

    release: Instant
    deadline: Instant | None = None
    committed: bool | None = None


@dataclass(frozen=True, slots=True)
class Withdraw:
    """Give up what was requested."""


class SetReady(NamedTuple):
    """State whether the robot would enter now."""

    ready: bool


@dataclass(frozen=True, slots=True)
class InsideUntil:
    """Announce another end of the passage."""

    end: Instant


@dataclass(frozen=True, slots=True)
class Leave:
    """State that the robot is clear."""


@dataclass(frozen=True, slots=True)
class OpenHoldLine:
    """Tell the navigator when the hold line will open (None: unknown), and whether it is open."""

    opens_at: Instant | None
    opened: bool
    passage: str | None
    """The passage before which it lies."""


@dataclass(frozen=True, slots=True)
class ChangeRank:
    """Act on another place in the schedule."""


@dataclass(frozen=True, slots=True)
class TraceEntry:
    """Record an entry of the trace."""

    what: str
    fields: dict[str, Any]


@dataclass(frozen=True, slots=True)
class Unforeseen:
    """An event of the coordination core has no row for the phase: it is ignored, and a check of the run fails."""

    phase: str
    event: str


CoreCommand = JobRequest | Revise | Withdraw | SetReady | InsideUntil | Leave
"""Commands to the coordination core; a JobRequest requests a slot."""
RobotCommand = OpenHoldLine | ChangeRank | TraceEntry | Unforeseen
"""Commands to the robot itself."""
Command = CoreCommand | RobotCommand


def held_until(now: Instant, end: Instant, *, leaving: bool) -> Instant | None:
    """Return the end that a robot at a station announces instead of `end`; None: the same.

    While it stays, its end is not known, and is announced so far ahead that nobody claims in vain.
    """
    if leaving:
        soon = now + UNKNOWN_INSIDE
        return soon if not now + EXTEND_BEFORE <= end <= soon + EXTEND_BEFORE else None
    return now + STATION_AHEAD if end < now + STATION_NOTICE else None

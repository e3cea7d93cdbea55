"""Owners of time: what a job has waited for. Each interval of an explained delay has exactly one."""

from collections.abc import Mapping
from enum import Enum
from typing import NamedTuple

from rmr.base.time import Duration, Instant
from rmr.node.standstill import Motion


class TimeOwner(Enum):
    """What owns an interval. The values are the words of text and JSON."""

    RULE = "rule"
    TURN = "turn"
    DRIVE = "drive"
    STANDING = "standing"
    QUEUE = "queue"
    ACTION = "action"
    LOCALISATION = "localisation"
    OUTSIDE = "outside"
    RADIO_QUEUE = "radio queue"
    CHANNEL_ACCESS = "channel access"
    REPEATS = "repeats"
    LATE_TICK = "late tick"
    DEAD = "dead"
    STOPPED = "stopped"
    UNKNOWN = "unknown"


MEANINGS: dict[TimeOwner, str] = {
    TimeOwner.RULE: "until a rule fired; nothing that serves the job was under way",
    TimeOwner.TURN: "the robot waited for its turn of a shared resource, or drove slowly so as not to be there before "
    "its slot; one interval for each robot ahead, in the order in which they go",
    TimeOwner.DRIVE: "the robot drove, or turned in place, unhindered",
    TimeOwner.STANDING: "a hazard rule kept the robot standing, or an escape manoeuvre led it elsewhere; names the "
    "rule, and the robot or obstacle in the way",
    TimeOwner.QUEUE: "the robot lined up: it was on the way to a place in the queue, or robots before it in the queue "
    "had not left",
    TimeOwner.ACTION: "an action that is no drive was under way, or had the wheels",
    TimeOwner.LOCALISATION: "the robot did not know where it was, or was mistaken about it by more than 0.2 m",
    TimeOwner.OUTSIDE: "a fact that no rule derives had not come: from a sensor, from the robot's view of others, or "
    "from somebody outside",
    TimeOwner.RADIO_QUEUE: "a delivery waited behind other frames of its sender",
    TimeOwner.CHANNEL_ACCESS: "back-off, carrier sensing and first transmission of a delivery",
    TimeOwner.REPEATS: "retransmissions of a delivery, by the medium access or by the exchange of facts",
    TimeOwner.LATE_TICK: "the host called the robot more than one frame (1/60 s) after it was due (of one that drives "
    "0.1 s, for which its wheels turn on), or its samples were old",
    TimeOwner.DEAD: "the robot's process was dead, from its end to its restart",
    TimeOwner.STOPPED: "the robot's process had been stopped in order, until it was started again",
    TimeOwner.UNKNOWN: "none of these: a defect of the analysis; please report it with the recording",
}
"""What each owner means; docs/why-late.md shows the table."""

OWNER_OF: Mapping[Motion, TimeOwner] = {
    Motion.IDLE: TimeOwner.ACTION,
    Motion.LOCATES: TimeOwner.LOCALISATION,
    Motion.DRIVES: TimeOwner.DRIVE,
    Motion.GATED: TimeOwner.TURN,
    Motion.STANDS: TimeOwner.STANDING,
    Motion.UNWATCHED: TimeOwner.LATE_TICK,
}
"""Who owns the time of a drive, by what the wheels do."""


class Interval(NamedTuple):
    """A part of a job's time, with the one owner that the job waited for."""

    begin: Instant
    end: Instant
    owner: TimeOwner
    robot: int
    """Whose time it is."""
    whom: tuple[int, ...] = ()
    """The other robots that are the reason: those ahead, those stood for, the other end of a delivery."""
    detail: str = ""
    """Rule, action, place or delivery, in words."""

    @property
    def duration(self) -> Duration:
        """Nanoseconds."""
        return self.end - self.begin

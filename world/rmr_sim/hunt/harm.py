"""The faults of a hunt: one value for each fault of a lab file, with what may be varied about it.

Times are whole milliseconds, so that a list of harms can be written into a lab file without a change.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from enum import Enum
from itertools import pairwise
from math import inf
from typing import NamedTuple

from rmr.base.time import NS_PER_MS, Instant
from rmr.radio.links import DISTURBANCES_MAX, Disturbance, deafened, muted, partition
from rmr_world.lab import Fault, Kill, Lab, Outage, Restart, Slow, Stall


class HarmKind(Enum):
    """The kinds of faults."""

    LINK = "link"
    """Frames from the first robot to the second are cut off."""
    MUTE = "mute"
    DEAF = "deaf"
    PARTITION = "partition"
    """The robots are cut off from all others."""
    LOSS = "loss"
    """A share of all frames is lost."""
    STALL = "stall"
    SLOW = "slow"
    CRASH = "crash"
    """A robot is killed, and restarted at the end."""
    OUTAGE = "outage"


class Harm(NamedTuple):
    """One fault."""

    kind: HarmKind
    robots: tuple[int, ...]
    """Those concerned: two of a link, one side of a partition, none of a loss, else one."""
    since_ms: int
    until_ms: int
    amount: float = 0.0
    """Of a loss the share of frames, of a slow robot the milliseconds between two calls."""

    @property
    def length_ms(self) -> int:
        """Length of the fault, milliseconds."""
        return self.until_ms - self.since_ms


def faults_of(harm: Harm, roster: Sequence[int]) -> list[Fault | Disturbance]:
    """Return what a lab file says of `harm`."""
    since: Instant = harm.since_ms * NS_PER_MS
    until: Instant = harm.until_ms * NS_PER_MS
    robots = harm.robots
    match harm.kind:
        case HarmKind.LINK:
            return [Disturbance(since, until, ((robots[0],), (robots[1],)), one_way=True, attenuation_db=inf)]
        case HarmKind.MUTE:
            return [muted(robots[0], roster, since, until)]
        case HarmKind.DEAF:
            return [deafened(robots[0], roster, since, until)]
        case HarmKind.PARTITION:
            return [partition([robots, [robot for robot in roster if robot not in robots]], since, until)]
        case HarmKind.LOSS:
            return [Disturbance(since, until, loss=harm.amount)]
        case HarmKind.STALL:
            return [Stall(since, until, robots[0])]
        case HarmKind.SLOW:
            return [Slow(since, until, robots[0], round(harm.amount) * NS_PER_MS)]
        case HarmKind.CRASH:
            return [Kill(since, robots[0]), Restart(until, robots[0])]
        case HarmKind.OUTAGE:
            return [Outage(since, until, robots[0])]


def possible(harms: Sequence[Harm], lab: Lab) -> bool:
    """Return whether a lab file can have all of `harms` beside the faults of `lab`: no robot is killed while dead."""
    if len(harms) + len(lab.disturbances) > DISTURBANCES_MAX or not all(harm.length_ms > 0 for harm in harms):
        return False
    fated = {fault.robot for fault in lab.faults if isinstance(fault, Kill | Restart)}
    crashes = sorted((h for h in harms if h.kind is HarmKind.CRASH), key=lambda h: (h.robots, h.since_ms))
    if any(crash.robots[0] in fated for crash in crashes):
        return False
    return all(one.robots != other.robots or one.until_ms < other.since_ms for one, other in pairwise(crashes))


def with_harms(lab: Lab, harms: Iterable[Harm]) -> Lab:
    """Return `lab` with `harms` added to its faults, and its duration counted from the end of the last of them."""
    ordered = sorted(harms, key=lambda harm: harm.since_ms)
    added = [fault for harm in ordered for fault in faults_of(harm, lab.roster)]
    end = max((harm.until_ms for harm in ordered), default=0) * NS_PER_MS
    return replace(
        lab,
        faults=(*lab.faults, *(fault for fault in added if not isinstance(fault, Disturbance))),
        disturbances=(*lab.disturbances, *(fault for fault in added if isinstance(fault, Disturbance))),
        duration=end + lab.duration,
    )

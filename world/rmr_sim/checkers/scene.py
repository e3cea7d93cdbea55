"""What checkers know of a run: its robots, and what has gone wrong with them and between them.

Some rules hold only where nothing stood in the way: no protocol keeps robots apart that cannot hear each other, and
nobody acts on time who has been stopped. A rule asks here before it complains.
"""

import math
from collections.abc import Callable
from typing import Any

from rmr.base.time import NEVER, NS_PER_S, TICK_HZ, Duration, Instant
from rmr.node.node import Node
from rmr.radio.links import SHADOWING_SIGMAS, Disturbance
from rmr.radio.phy import path_loss_db
from rmr_sim.befallen import Befell
from rmr_sim.simulation import Simulation
from rmr_sim.violation import Violation
from rmr_world.lab import Kill, Restart

TICK: Duration = NS_PER_S // TICK_HZ + 1
"""A frame of 1/60 s, in which whatever is due in it may happen."""
LOSS_FAIR = 0.5
"""Links that lose more than this are taken for cut: of twelve beacons in a row not one may come through."""
MARGIN_DB = 6.0
"""A link this much above the receiver's sensitivity is no matter of luck."""
VIOLATIONS_MAX = 1000
"""Of one run; what is that wrong does not become clearer by more."""


class Scene:
    """A run, and what befell it."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._robots = {robot.robot: robot for robot in simulation.robots}
        self._known = -1
        self._healed_at: Instant = 0

    def hear(self, kind: type, hearer: Callable[[int, Instant, Any], None]) -> None:
        """Let `hearer` be told of each event of type `kind`: the robot, the instant, the event."""
        self.simulation.hearers.setdefault(kind, []).append(hearer)

    def violate(self, at: Instant, check: str, robots: tuple[int, ...], words: str) -> None:
        """Note that a rule did not hold."""
        if len(self.simulation.violations) < VIOLATIONS_MAX:
            self.simulation.violations.append(Violation(at, check, robots, words))
        else:
            self.simulation.violations_omitted += 1

    # -- robots -----------------------------------------------------------------------------------------------

    @property
    def robots(self) -> tuple[int, ...]:
        """All ids, ascending."""
        return tuple(self._robots)

    def node(self, robot: int) -> Node:
        """Return the mind of `robot`, which may be dead."""
        return self._robots[robot].node

    def alive(self, robot: int) -> bool:
        """Return whether the process of `robot` runs or is stopped, but is not dead."""
        return self._robots[robot].alive

    def life(self, robot: int) -> int:
        """Return how often `robot` has been started again."""
        return self._robots[robot].restarts

    def finished(self, robot: int) -> bool:
        """Return whether `robot` has ever held the finish fact in this life."""
        return self.node(robot).finish_at is not None

    def forgot(self, robot: int, since: Instant) -> bool:
        """Return whether `robot` has lost its memory after `since`."""
        return any(one.robot == robot and one.fault == "restarted" and one.at >= since for one in self._befell())

    def held_up(self, robot: int, since: Instant, until: Instant) -> Instant:
        """Return until when `robot` was stopped, slow or dead at some time from `since` to `until`; else 0.

        What begins before the last of it is over goes on with it; a restart ends all.
        """
        end: Instant = 0
        for one in self._befell():
            if one.robot != robot:
                continue
            if one.fault == "restarted":
                end = min(end, one.at)
            elif one.at > max(until, end):
                break
            elif one.fault == "killed":
                end = NEVER
            elif one.fault in {"stalled", "slowed"}:
                end = max(end, one.until)
        return end if end >= since else 0

    def _befell(self) -> list[Befell]:
        return [one for one in self.simulation.befallen if isinstance(one, Befell)]

    # -- between them -----------------------------------------------------------------------------------------

    def linked(self, a: int, b: int, since: Instant, now: Instant) -> bool:
        """Return whether the radio between two robots has been fair from `since` to `now`."""
        radio = self.simulation.lab.radio.config
        if radio.bursts is not None or not self._in_range(a, b):
            return False
        kept = 1.0 - radio.loss
        for one in self.simulation.befallen:
            if isinstance(one, Disturbance) and one.since <= now and one.until > since and _touches(one, a, b):
                if one.attenuation_db > 0.0:
                    return False
                kept *= 1.0 - one.loss
        return kept >= 1.0 - LOSS_FAIR

    def _in_range(self, a: int, b: int) -> bool:
        config, world = self.simulation.radio, self.simulation.world
        ax, ay, _ = world.pose(a)
        bx, by, _ = world.pose(b)
        loss = path_loss_db(math.hypot(ax - bx, ay - by), config.exponent)
        spread = SHADOWING_SIGMAS * config.shadowing_db
        return config.tx_power_dbm - loss - spread >= config.sensitivity_dbm + MARGIN_DB

    # -- healing ----------------------------------------------------------------------------------------------

    @property
    def healed_at(self) -> Instant:
        """When the last fault that is known of is over; NEVER where one lasts."""
        befallen = self.simulation.befallen
        if len(befallen) != self._known:
            self._known = len(befallen)
            faults = self.simulation.lab.faults
            ends = [fault.at if isinstance(fault, Kill | Restart) else fault.end for fault in faults]
            self._healed_at = max([0, *ends, *map(_end, befallen)])
        return self._healed_at


def _touches(disturbance: Disturbance, a: int, b: int) -> bool:
    """Return whether a disturbance concerns frames between two robots, one way at least."""
    group_of = {robot: index for index, group in enumerate(disturbance.groups) for robot in group}
    if not group_of:
        return True
    one, other = group_of.get(a), group_of.get(b)
    return one is not None and other is not None and one != other


def _end(one: Befell | Disturbance) -> Instant:
    """Return when something is over as far as healing goes: a link that is a little lossy for ever does not hinder."""
    if isinstance(one, Befell):
        return one.at if one.until == NEVER else one.until
    if one.until == NEVER and one.attenuation_db == 0.0 and one.loss <= LOSS_FAIR:
        return 0
    return one.until

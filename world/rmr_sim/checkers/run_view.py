"""The checkers' view of a run: its robots, their faults, and the state of the radio between them.

Some rules hold only in the absence of certain faults: no protocol keeps robots apart that cannot hear each other, and a
stopped robot does not act on time. A checker asks here before it reports a violation. What it remembers of events, jobs
and terms is bounded (`RecentTable`), so that a lab may run for days.
"""

import math
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, TypeVar

from rmr.base.time import NEVER, NS_PER_S, TICK_HZ, Duration, Instant
from rmr.node.motion.localiser import MISTAKEN_M
from rmr.node.node import Node
from rmr.radio.links import SHADOWING_SIGMAS, Disturbance
from rmr.radio.phy import NETWORK, path_loss_db
from rmr.vm.job import TimedJob
from rmr_sim.event import FaultRecord
from rmr_sim.simulation import Simulation
from rmr_sim.violation import Violation
from rmr_world.lab import Kill, Restart

TICK: Duration = NS_PER_S // TICK_HZ + 1
"""Length of a tick, rounded up: the tolerance of a rule about time."""
LOSS_FAIR = 0.5
"""Loss above which a link counts as cut: of twelve beacons in a row none may arrive."""
K = TypeVar("K")
V = TypeVar("V")

KEPT_MAX = 10_000
"""Bound of the entries of a table, more than any lab has events or terms at a time: older ones are settled."""


class RunView:
    """A run, its faults and its violations."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._robots = {robot.robot: robot for robot in simulation.robots}
        self._known = -1
        self._healed_at: Instant = 0

    def subscribe(self, kind: type, subscriber: Callable[[int, Instant, Any], None]) -> None:
        """Call `subscriber` with the robot, the instant and the event for each event of type `kind`."""
        self.simulation.subscribers.setdefault(kind, []).append(subscriber)

    def violate(self, at: Instant, check: str, robots: tuple[int, ...], words: str) -> None:
        """Record a violation."""
        self.simulation.violate(Violation(at, check, robots, words))

    # -- robots -----------------------------------------------------------------------------------------------

    @property
    def robots(self) -> tuple[int, ...]:
        """All ids, ascending."""
        return tuple(self._robots)

    def node(self, robot: int) -> Node:
        """Return the node of `robot`, which may be dead."""
        return self._robots[robot].node

    def alive(self, robot: int) -> bool:
        """Return whether the process of `robot` runs or is stopped, but is not dead."""
        return self._robots[robot].alive

    def off_m(self, robot: int) -> float:
        """Return how far the estimate of `robot` is off its true position, metres; 0 without one."""
        driver = self.node(robot).driver
        pose = None if driver is None else driver.localiser.pose
        if pose is None or not self.alive(robot):
            return 0.0
        x, y, _ = self.simulation.world.pose(robot)
        return math.hypot(pose.x - x, pose.y - y)

    def mistake(self, robot: int) -> str:
        """Return how far the estimate of `robot` is off, in words; empty if it is near, or there is none."""
        driver = self.node(robot).driver
        pose = None if driver is None else driver.localiser.pose
        off_m = self.off_m(robot)
        if pose is None or off_m <= MISTAKEN_M:
            return ""
        x, y, _ = self.simulation.world.pose(robot)
        return f"its estimate is ({pose.x:.2f}, {pose.y:.2f}), it is at ({x:.2f}, {y:.2f}), {off_m:.2f} m off"

    def life(self, robot: int) -> int:
        """Return the number of restarts of `robot` at which it lost its memory."""
        return 0 if self.simulation.durable else self._robots[robot].restarts

    def present(self, robot: int, job: TimedJob) -> TimedJob | None:
        """Return `job` as the node of `robot` has it now; None if a durable robot died before it was recorded."""
        if not self.simulation.durable:
            return job
        jobs = self.node(robot).machine.jobs
        return next((one for one in jobs if (one.serial, one.start) == (job.serial, job.start)), None)

    def finished(self, robot: int) -> bool:
        """Return whether `robot` has held the finish fact since its last start."""
        return self.node(robot).finish_at is not None

    def forgot(self, robot: int, since: Instant) -> bool:
        """Return whether `robot` was restarted, hence without memory, at or after `since`."""
        if self.simulation.durable:
            return False
        return any(one.robot == robot and one.fault == "restarted" and one.at >= since for one in self._robot_faults())

    def held_up(self, robot: int, since: Instant, until: Instant) -> Instant:
        """Return the end of the faults that held `robot` up (stopped, slow, dead) between `since` and `until`, else 0.

        Overlapping faults count as one; a restart ends all.
        """
        end: Instant = 0
        for one in self._robot_faults():
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

    def _robot_faults(self) -> list[FaultRecord]:
        return [one for one in self.simulation.fault_records if isinstance(one, FaultRecord)]

    # -- between them -----------------------------------------------------------------------------------------

    def linked(self, a: int, b: int, since: Instant, now: Instant) -> bool:
        """Return whether the radio between two robots has been fair from `since` to `now`."""
        radio = self.simulation.lab.radio.config
        if radio.bursts is not None or not self._in_range(a, b):
            return False
        kept = 1.0 - radio.loss
        for one in self.simulation.fault_records:
            if isinstance(one, Disturbance) and one.since <= now and one.until > since and _touches(one, a, b):
                if one.attenuation_db > 0.0:
                    return False
                kept *= 1.0 - one.loss
        return kept >= 1.0 - LOSS_FAIR

    def _in_range(self, a: int, b: int) -> bool:
        config = self.simulation.radio
        if config.mode == NETWORK:
            return True
        world = self.simulation.world
        ax, ay, _ = world.pose(a)
        bx, by, _ = world.pose(b)
        loss = path_loss_db(math.hypot(ax - bx, ay - by), config.exponent)
        spread = SHADOWING_SIGMAS * config.shadowing_db
        # Margin above the receiver's sensitivity with which a link counts as reliable.
        return config.tx_power_dbm - loss - spread >= config.sensitivity_dbm + 6.0

    # -- healing ----------------------------------------------------------------------------------------------

    @property
    def healed_at(self) -> Instant:
        """End of the last known fault; NEVER if one has no end."""
        records = self.simulation.fault_records
        if len(records) != self._known:
            self._known = len(records)
            faults = self.simulation.lab.faults
            ends = [fault.at if isinstance(fault, Kill | Restart) else fault.end for fault in faults]
            self._healed_at = max([0, *ends, *map(_end, records)])
        return self._healed_at


def _touches(disturbance: Disturbance, a: int, b: int) -> bool:
    """Return whether a disturbance affects frames between two robots, in at least one direction."""
    group_of = {robot: index for index, group in enumerate(disturbance.groups) for robot in group}
    if not group_of:
        return True
    one = group_of.get(a)
    other = group_of.get(b)
    return one is not None and other is not None and one != other


def _end(one: FaultRecord | Disturbance) -> Instant:
    """Return the end of a fault for `healed_at`: a permanent small loss is no fault."""
    if isinstance(one, FaultRecord):
        return one.at if one.until == NEVER else one.until
    if one.until == NEVER and one.attenuation_db == 0.0 and one.loss <= LOSS_FAIR:
        return 0
    return one.until


class RecentTable(OrderedDict[K, V]):
    """A table of the `KEPT_MAX` entries that were set last."""

    def __setitem__(self, key: K, value: V) -> None:
        """Set an entry and make it the newest."""
        super().__setitem__(key, value)
        self.move_to_end(key)
        if len(self) > KEPT_MAX:
            self.popitem(last=False)

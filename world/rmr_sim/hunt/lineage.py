"""The lineage of a run: on what its safety rested, when, and how close the call was.

A support is one dependence of one robot on another at one instant:

    ground       the robot ...                                    rests on
    near         had the other near, and the two closed in        what it saw and heard of it
    RULE         was slowed by the hazard rule RULE for the other  the same; RULE is a name of docs/motion.md
    entry        entered the bottleneck                            the schedule of the other, its leader
    inside       entered while the other was inside                the frames of the other
    slot         was given a slot                                  the schedule of the other, its leader
    leads        began to lead the others (`other` is itself)      the frames of all

The observer only reads: a run is the same with and without it. It is attached like a checker.
"""

import math
from typing import NamedTuple

from rmr.base.time import NS_PER_MS, TICK_HZ, Instant
from rmr.coord.events import Entered, LeadershipBegan, SlotAssigned
from rmr.node.crossing.phases import Inside
from rmr.node.standstill import Motion, motion_state
from rmr_sim.simulated_robot import SimulatedRobot
from rmr_sim.simulation import Simulation

SAMPLE_TICKS = 6
"""Period of the samples: ten a second, several for each hello."""
NEAR_M = 0.5
"""Gap of two hulls, metres, within which robots that close in depend on each other: 1.25 s of two that meet at full
speed, three times what they need to stand. The closest calls are tried first."""
APART_M = 1.0
"""Margin of a support whose robots are not near each other."""


class Support(NamedTuple):
    """One dependence of one robot on another."""

    at_ms: int
    robot: int
    other: int
    ground: str
    margin_m: float
    """Smallest gap of the two hulls, metres: while they were near, else at the instant."""
    heard_ms: int
    """When the robot had last heard the other; the instant itself if never."""


class LineageObserver:
    """Notes the supports of one run."""

    def __init__(self, simulation: Simulation) -> None:
        """Observe `simulation`, which has not run yet."""
        self._simulation = simulation
        self._robots = {robot.robot: robot for robot in simulation.robots}
        self._found: list[Support] = []
        self._near: dict[tuple[int, int], Support] = {}
        """Pairs that are near now, with the support of the closest instant so far."""
        self._slowed: dict[tuple[int, int], str] = {}
        """The rule that slows a robot for another now."""
        self._leaders: dict[tuple[int, bytes], int] = {}
        self._ticks = 0
        self._was: dict[int, tuple[float, float]] = {}
        simulation.subscribers.setdefault(SlotAssigned, []).append(self._slotted)
        simulation.subscribers.setdefault(Entered, []).append(self._entered)
        simulation.subscribers.setdefault(LeadershipBegan, []).append(self._leads)
        simulation.checkers.append(self._tick)

    def supports(self) -> tuple[Support, ...]:
        """Return the supports of the run so far, the closest calls first."""
        found = sorted({*self._found, *self._near.values()}, key=lambda one: (one.margin_m, *one))
        return tuple(found[:400])  # the closest calls

    @property
    def closest_m(self) -> float:
        """Smallest gap, metres, of two robots that closed in on each other."""
        near = [one.margin_m for one in (*self._found, *self._near.values()) if one.ground == "near"]
        return min(near, default=APART_M)

    # -- coordination -----------------------------------------------------------------------------------------

    def _slotted(self, robot: int, now: Instant, slot: SlotAssigned) -> None:
        self._leaders[robot, slot.group_id] = slot.leader
        self._note(now, robot, slot.leader, "slot")

    def _entered(self, robot: int, now: Instant, entered: Entered) -> None:
        self._note(now, robot, self._leaders.get((robot, entered.group_id), robot), "entry")
        for other in self._simulation.robots:
            crossing = other.node.crossings.current if other.alive and other.robot != robot else None
            if crossing is not None and isinstance(crossing.phase, Inside):
                self._note(now, robot, other.robot, "inside")

    def _leads(self, robot: int, now: Instant, _began: LeadershipBegan) -> None:
        self._note(now, robot, robot, "leads")

    def _note(self, now: Instant, robot: int, other: int, ground: str) -> None:
        self._found.append(self._support(now, robot, other, ground, self._gap(robot, other)))

    def _support(self, now: Instant, robot: int, other: int, ground: str, margin_m: float) -> Support:
        at_ms = now // NS_PER_MS
        peer = self._robots[robot].node.peers.known.get(other)
        heard_ms = at_ms if peer is None or peer.hello is None else peer.hello_at // NS_PER_MS
        return Support(at_ms, robot, other, ground, margin_m, heard_ms)

    # -- motion -----------------------------------------------------------------------------------------------

    def _tick(self, now: Instant) -> None:
        self._ticks += 1
        if self._ticks % SAMPLE_TICKS:
            return
        world = self._simulation.world
        places = {robot: (world.pose(robot).x, world.pose(robot).y) for robot in self._robots}
        self._look_at_pairs(now, places)
        for robot in self._simulation.robots:
            if robot.served:
                self._look_at_rules(now, robot)
        self._was = places

    def _look_at_pairs(self, now: Instant, places: dict[int, tuple[float, float]]) -> None:
        """Note the pairs that begin or cease to be near, and the closest instants of those that are."""
        period_s = SAMPLE_TICKS / TICK_HZ
        radius = self._simulation.lab.arena.shape.radius
        robots = list(places)
        for i, one in enumerate(robots):
            for other in robots[i + 1 :]:
                gap_m = math.dist(places[one], places[other]) - 2.0 * radius
                pair = (one, other)
                known = self._near.get(pair)
                # Growth of a gap, metres, after which two robots count as parting: what follows is another approach.
                if known is not None and gap_m > known.margin_m + 0.03:
                    self._found.append(self._near.pop(pair))
                elif gap_m < (NEAR_M if known is None else known.margin_m) and self._was:
                    speeds = [math.dist(self._was[robot], places[robot]) / period_s for robot in pair]
                    closes = math.dist(self._was[one], self._was[other]) - 2.0 * radius > gap_m
                    if closes and max(speeds) > 0.02:  # speed above which a robot counts as moving, m/s
                        mover, stander = pair if speeds[0] >= speeds[1] else (other, one)
                        self._near[pair] = self._support(now, mover, stander, "near", gap_m)

    def _look_at_rules(self, now: Instant, robot: SimulatedRobot) -> None:
        """Note the robots for which a rule begins to slow `robot`."""
        node = robot.node
        drive = node.actions.driving
        since = None if drive is None else drive.started
        state = motion_state(node.now, node.driver, node.peers, robot.robot, node.config.roster, since)
        if state is None:
            return
        others = state.why.robots if state.motion is Motion.STANDS else ()
        for other in others:
            if self._slowed.get((robot.robot, other)) != state.why.rule:
                self._note(now, robot.robot, other, state.why.rule)
        for other in [other for mine, other in self._slowed if mine == robot.robot and other not in others]:
            del self._slowed[robot.robot, other]
        self._slowed |= dict.fromkeys(((robot.robot, other) for other in others), state.why.rule)

    def _gap(self, robot: int, other: int) -> float:
        if robot == other:
            return APART_M
        world = self._simulation.world
        one = world.pose(robot)
        two = world.pose(other)
        return math.dist(one[:2], two[:2]) - 2.0 * self._simulation.lab.arena.shape.radius

"""One robot's speed control: which bodies are around, and what the speed law makes of them.

A body is known in three ways: it is in view, it has just left the view and is remembered, or its robot is near and has
said where it is (cooperative perception). The law treats all alike.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Final

from rmr.base.arena import ROUNDING_M, Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, hypot
from rmr.base.time import Instant
from rmr.node.motion.avoid import STILL_MPS, gives_way_late
from rmr.node.motion.body_memory import BodyMemory
from rmr.node.motion.braking import LeadIn, Wheels
from rmr.node.motion.follow import Follower
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.hazards import SILENCE_RULES, UNRANKED, HazardScene
from rmr.node.motion.hearing import BESIDE_M, Hearing
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.shield import Shield, TakenDisc
from rmr.node.motion.speed_law import SpeedLaw
from rmr.node.motion.ways import GAP_M, HEARD_GAP_M, HEARD_SIGMAS, WaysToStand
from rmr.node.ports import SeenBody

REVERSE_MPS: Final = 0.08
"""Speed of a reverse manoeuvre."""
REVERSE_GAP_M: Final = 0.03
"""Gap to other robots that a reverse manoeuvre keeps: it is done blind."""
REVERSE_POLL_M: Final = 0.03
"""How far behind the robot a reverse manoeuvre looks for walls and bodies; ahead, one that turns off a wall."""
REVERSE_TURN: Final = 0.5
"""Turn rate with which a robot turns its back away from a wall, rad/s."""
REVERSE_LOOK_RAD: Final = 0.3
"""How far to both sides it looks for more room."""
REVERSE_DIFFERENCE_M: Final = 0.001
"""Least difference of the room on both sides: less is in a corner, or straight before a wall."""

VIEW_SIGMA_M: Final = 0.003
"""Standard deviation of the distance to a body in view: it is measured as it is, by one sensor, not told by the other
robot; 2 mm by the sensor, and what both drive until it is used."""
SETTLED_SHARE: Final = 0.6
"""Standard deviation of the place of a robot that has stood for a second, as a share of that of one that drives there:
at most 0.5, but near the line through the beacons (docs/safety.md)."""

SIGHT_RADIUS_M: Final = 0.5
"""Least radius of an arc that leads only over floor that was in view just before, times the size of the robots."""

WAYS: Final = "ways"
"""The rule by which robots that drive keep their ways to stand apart."""
SHIELD: Final = "shield"
"""The rule that has the last word over each wheel command that drives."""
SILENCED: Final = "silence"
"""What keeps a robot that drives by hand or backs up from doing so while somebody is not heard."""


class SpeedControl:
    """Perception of bodies and the speed law, for one robot. Call `perceive` first in each tick."""

    __slots__ = (
        "_ages_s",
        "_clearance",
        "_measured_x",
        "_measured_y",
        "_memory",
        "_reverse_mps",
        "_seen",
        "_shield",
        "_switches",
        "_ways",
        "arena",
        "hearing",
        "law",
        "scene",
        "sigma_m",
        "wheels",
    )

    def __init__(self, arena: Arena, robots: int, switches: RuleSwitches) -> None:
        """`robots` is the size of the roster; `switches` says which rules are in force."""
        self.arena = arena
        self._switches = switches
        self.law = SpeedLaw(switches)
        self.scene = HazardScene(arena, switches)
        self._memory = BodyMemory(arena.shape, remembers=not switches.off("memory"))
        self._reverse_mps: Final = min(REVERSE_MPS, arena.shape.speed)
        self._seen: Sequence[SeenBody] = ()
        """The bodies in view, then those remembered."""
        self._ages_s: Sequence[float] = ()
        """The ages of the hellos behind the bodies of the scene that are heard, seconds."""
        self._shield = Shield(arena.shape.radius, arena.shape.speed)
        self._ways = WaysToStand(self.scene.scale)
        self.wheels = Wheels(arena.shape)
        self._clearance = -math.inf
        """Distance to the nearest wall, metres, from the place where that was measured last."""
        self._measured_x = self._measured_y = 0.0
        self.sigma_m = 0.0
        """Standard deviation of the estimated position, metres."""
        self.hearing = Hearing(arena.shape, robots)
        for flag, rule in SILENCE_RULES:
            if switches.off(rule):
                self.hearing.heeds &= ~flag

    def perceive(self, now: Instant, pose: Pose, bodies: Sequence[SeenBody]) -> None:
        """Take in the estimated pose and the bodies in view."""
        self._seen = self._memory.update(now, pose, bodies, self.hearing.fresh, self.hearing.misses_some)
        around = self.scene
        around.now = now
        around.pose = pose
        around.remembered_from = len(bodies)
        around.silence = self.hearing.forbids(now, pose, bodies)

    def silenced(self) -> bool:
        """Return whether a silence forbids a manoeuvre that is due."""
        if self.scene.silence:
            self.scene.count_silence()
        return self.scene.silence != 0

    def cap(
        self,
        follower: Follower,
        gate: EntryGate,
        right_of_way: float,
        parked: tuple[Point, ...],
        ahead: int,
        first_m: float,
    ) -> float:
        """Return the greatest speed with which the path may be followed now, m/s."""
        around = self.scene
        around.follower = follower
        around.gate = gate
        around.right_of_way = right_of_way
        around.parked = parked
        around.ahead = ahead
        around.first_m = first_m
        return self.law.cap(around)

    def slowed(self, twist: Twist, *, walls: bool = True) -> Twist:
        """Return `twist`, slowed as the bodies around and the shield demand; without `walls` it may touch those."""
        if twist.v <= 0.0:
            return twist
        if (
            self.hearing.by_sight
            and abs(twist.w) * SIGHT_RADIUS_M * self.scene.scale.size > twist.v
            and not self._switches.off("sight")
        ):
            self._switches.count("sight")
            self.law.limited_by = "sight"
            return Twist(0.0, twist.w)
        around = self.scene
        seen = self._seen
        # On an arc the inner flank sweeps over what is abeam, so those heard a little behind the axle count, too.
        around.bodies = [*seen, *self._heard(-BESIDE_M * around.scale.size if twist.w else 0.0)]
        around.heard_from = len(seen)
        self._ages_s = self.hearing.ages_s
        around.ranked = UNRANKED
        if not self._switches.off("order"):
            around.ranked = self.hearing.goes_before(around.now, around.pose, around.bodies)
        return self._shielded(twist, walls=walls)

    def by_hand(self, twist: Twist) -> Twist:
        """Return the command of an action that drives by itself: the speed law still has the last word.

        Walls are the action's affair: it may want to touch one, as to dock or to feel its way.
        """
        self.law.limited_by = ""
        if not self.silenced():
            return self.slowed(twist, walls=False)
        self.law.limited_by = SILENCED
        return Twist(0.0, twist.w)

    def reverse(self) -> Twist:
        """Return the command that drives straight back, or stands where something is known to be there."""
        if self._switches.off("reverse_guard"):
            return Twist(-self._reverse_mps, 0.0)
        around = self.scene
        pose = self.scene.pose
        if self.hearing.by_sight and not self._switches.off("sight"):
            self._switches.count("sight")
            self.law.limited_by = "sight"
            return STILL
        radius = self.arena.shape.radius
        x = pose.x - math.cos(pose.theta) * REVERSE_POLL_M
        y = pose.y - math.sin(pose.theta) * REVERSE_POLL_M
        free = True
        for index, body in enumerate([*self._seen, *self._heard(-math.inf)]):
            # A body ahead of the axle is left behind. The robot's centre will be at (-REVERSE_POLL_M, 0).
            if body.x <= 0.0 and hypot(body.x + REVERSE_POLL_M, body.y) <= 2.0 * radius + REVERSE_GAP_M:
                free = False
                around.heard_from = len(self._seen)
                around.count_body(index)
        if free and not self._switches.off("cooperation"):
            free = not self.hearing.may_reach(around.now, pose, REVERSE_POLL_M, 2.0 * radius + REVERSE_GAP_M)
        back = Twist(-self._reverse_mps, 0.0)
        if free and self.arena.clearance(x, y) > radius and self._shield.within(back, pose, self.arena, self.sigma_m):
            return self._shielded(back)
        self._switches.count("reverse_guard")
        self.law.limited_by = "reverse_guard"
        return Twist(0.0, REVERSE_TURN * self.off_wall(pose, -REVERSE_POLL_M)) if free else STILL

    def leads_to_wall(self, twist: Twist) -> bool:
        """Return whether a wall is what the shield slows `twist` for."""
        lead = self.wheels.lead(self.scene.now, twist)
        return self._before_walls(twist, self.scene.pose, lead) < 1.0

    def settles(self, twist: Twist) -> bool:
        """Return whether the error of the estimate alone makes the shield slow `twist`: it falls in standing."""
        pose = self.scene.pose
        lead = self.wheels.lead(self.scene.now, twist)
        return self._shield.within(twist, pose, self.arena, 0.0, lead) >= 1.0

    def off_wall(self, pose: Pose, ahead_m: float = REVERSE_POLL_M) -> float:
        """Return to which side a robot that cannot drive on for a wall turns, so that it comes to drive along it.

        1 to the left, -1 to the right, 0 in a corner. `ahead_m` is where it looks for room, negative behind it. A robot
        that stands askew in a passage as wide as itself gets out of it in no other way.
        """
        left, right = (
            self.arena.clearance(
                pose.x + math.cos(pose.theta + turn) * ahead_m,
                pose.y + math.sin(pose.theta + turn) * ahead_m,
            )
            for turn in (REVERSE_LOOK_RAD, -REVERSE_LOOK_RAD)
        )
        if abs(left - right) < REVERSE_DIFFERENCE_M:
            return 0.0
        return 1.0 if left > right else -1.0

    def off_robot(self, pose: Pose) -> float | None:
        """Return to which side the robot at `pose` turns off another one that stands within its margin; None: off none.

        1 to the left, -1 to the right. Each way that leads nearer to that one is barred, and so is the arc on which
        nearly every route begins.
        """
        near = [other for other in self._standing(pose) if hypot(other.x, other.y) < other.keep]
        if not near:
            return None
        nearest = min(near, key=lambda other: hypot(other.x, other.y) - other.keep)
        return -1.0 if nearest.y > 0.0 else 1.0

    def _shielded(self, twist: Twist, *, walls: bool = True) -> Twist:
        """Return `twist`, so slow that the robot stands before each robot that stands and each wall it knows of."""
        if twist.v == 0.0:
            return twist
        # A robot that brakes drives along the new arc at the speed that it still has, else it stays on the old one.
        now = self.scene.now
        arc = self.wheels.braking(now, twist)
        judged = twist if arc is None else arc
        lead = self.wheels.lead(now, judged)
        share = 1.0
        if not self._switches.off(WAYS) and (apart := self._apart(judged, lead)) < share:
            share = apart
            self._switches.count(WAYS)
            self.law.limited_by = WAYS
        if not self._switches.off(SHIELD) and (before := self._share(judged, lead, walls=walls)) < share:
            share = before
            self._switches.count(SHIELD)
            self.law.limited_by = SHIELD
        if share >= 1.0:
            return twist
        slower = Twist(share * twist.v, share * twist.w)
        if arc is not None or self.wheels.braking(now, slower) is not None:
            return STILL
        if lead is None or self._share(slower, self.wheels.lead(now, slower), walls=walls) >= 1.0:
            return slower
        return self.wheels.slow(slower, lead)

    def _apart(self, twist: Twist, lead: LeadIn | None) -> float:
        """Return the share of `twist`, to whose arc `lead` leads, that keeps clear of the ways of others.

        A robot that backs up is left to `reverse_guard`.
        """
        around = self.scene
        around.held_by = None
        share = 1.0
        if twist.v <= 0.0:
            return share
        ways = self._ways
        ranked = around.ranked
        ages_s = self._ages_s
        heard_from = around.heard_from
        for index, body in enumerate(around.bodies):
            age_s = 0.0
            gap = GAP_M
            if index >= heard_from:
                age_s = ages_s[index - heard_from]
                gap = max(HEARD_GAP_M, HEARD_SIGMAS * self.sigma_m)
            by_side = gives_way_late(body)
            first = ranked.get(body, by_side) if ranked else by_side
            free = ways.clear(twist, body, gap, age_s, first=first, lead=lead)
            if first != by_side and ways.clear(twist, body, gap, age_s, first=by_side, lead=lead) != free:
                self._switches.count("order")
            if free < share:
                share = free
                around.held_by = body
                around.count_body(index)
        return share

    def _share(self, twist: Twist, lead: LeadIn | None, *, walls: bool) -> float:
        """Return the share of `twist`, to whose arc `lead` leads, that the shield permits."""
        pose = self.scene.pose
        shield = self._shield
        share = self._before_walls(twist, pose, lead) if walls else 1.0
        share = min(share, shield.past(twist, self._standing(pose), lead))
        if twist.v <= shield.apart_from:
            return share
        around = self.scene
        bodies = around.bodies
        share = min(share, shield.apart(twist, bodies[: around.heard_from], VIEW_SIGMA_M, lead))
        return min(share, shield.apart(twist, bodies[around.heard_from :], math.sqrt(2.0) * self.sigma_m, lead))

    def _before_walls(self, twist: Twist, pose: Pose, lead: LeadIn | None) -> float:
        """Return the share of `twist` from which the robot at `pose` stands before each wall.

        The clearance changes by no more than the way between two places: while that of a place before is ample, less
        the way from there, it is not measured anew.
        """
        ample = self._shield.ample(twist, self.sigma_m) + ROUNDING_M
        if self._clearance - hypot(pose.x - self._measured_x, pose.y - self._measured_y) >= ample:
            return 1.0
        self._clearance = self.arena.clearance(pose.x, pose.y)
        self._measured_x = pose.x
        self._measured_y = pose.y
        if self._clearance >= ample:
            return 1.0
        return self._shield.within(twist, pose, self.arena, self.sigma_m, lead)

    def _standing(self, pose: Pose) -> list[TakenDisc]:
        """Return the robots near that stand: those in view as they are seen, the others as they were heard."""
        shield = self._shield
        seen = self._seen[: self.scene.remembered_from]
        standing = [
            shield.parked(body.x, body.y, VIEW_SIGMA_M) for body in seen if hypot(body.vx, body.vy) <= STILL_MPS
        ]
        # The others locate themselves by the same beacons: their estimates are taken to be as good as the own, and
        # better where they have stood while this robot drove.
        as_good = math.sqrt(2.0) * self.sigma_m
        settled = hypot(1.0, SETTLED_SHARE) * self.sigma_m
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        radius = self.arena.shape.radius
        for other in self.hearing.fresh:
            # A robot under way that stands may set out again; where it stands is what is known of it.
            if not other.parked and hypot(other.vx, other.vy) > STILL_MPS:
                continue
            dx = other.x - pose.x
            dy = other.y - pose.y
            x = dx * cos + dy * sin
            y = dy * cos - dx * sin
            if all(hypot(body.x - x, body.y - y) > radius for body in seen):
                standing.append(shield.parked(x, y, settled if other.settled else as_good))
        return standing

    def others(self, standing: Iterable[Point]) -> list[Point]:
        """Return where bodies are now, on the floor: those seen, and those heard to be `standing`."""
        seen = self._memory.places(self.scene.now)
        if len(seen) > self.scene.remembered_from:
            self._switches.count("memory")
        radius = self.arena.shape.radius
        # A robot that is seen is heard as well: within a radius both are the same.
        return [*seen, *(p for p in standing if all(hypot(p.x - q.x, p.y - q.y) > radius for q in seen))]

    def _heard(self, beyond_m: float) -> Sequence[SeenBody]:
        """Return the bodies that are heard but not seen, farther ahead than `beyond_m`, in the robot's frame."""
        if self._switches.off("cooperation"):
            return ()
        around = self.scene
        heard = self.hearing.around(around.now, around.pose, self._seen, beyond_m, around.remembered_from)
        if self.hearing.hides_remembered:
            self._switches.count("memory")
        return heard

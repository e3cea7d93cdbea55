"""Robots with the shield alone: no hulls overlap, whatever is commanded, heard or forgotten.

Kinematic bodies on random floors with walls. Each robot is commanded at random, or straight at another one. Of their
reports some are lost, late or out of order; robots fall silent, stop and begin anew without memory. Estimates of place
and heading are off, anew in each step, by up to their bounds. `test_shield.py` has a little of it. Run as a program for
a long campaign: ``python shield_campaign.py FIRST LAST [PART]``; each run with an overlap is printed by its number.
`PART` is a part of the invariant that is left out, one of `PARTS`.
"""

import math
import sys
from random import Random

from rmr.base.arena import Arena, Obstacle, Polygon
from rmr.base.geometry import Point, Pose, Twist
from rmr.base.time import Duration, Instant, milliseconds
from rmr.node.motion.shield import BRAKE, LAG_S, SIGMAS, Shield, TakenDisc

PARTS = ("braking", "uncertainty", "unheard", "walls", "age")
"""What is left out: the way until the wheels stand, the error of estimates, robots that were never heard, walls, and
the age of a report."""
RADIUS = 0.07
SPEED = 0.2
TURN = 2.0
STEP = milliseconds(50)
STEP_S = 0.05
STEPS = 60
WATCHDOG_STEPS = 2
"""Wheels brake 0.1 s after the last command."""
SIGMA_M = 0.003
"""Standard deviation of the distance of two robots."""
ERROR_M = 0.5 * SIGMAS * SIGMA_M
"""Bound of the error of one estimate, so that two are off by the margin at most."""
HEADING_ERROR = 0.03
ROUNDING_M = 1e-5
"""The steps of the search along the arc, and of the wheels."""


class Report:
    """What a robot has said."""

    def __init__(self, x: float, y: float, at: Instant, stays_until: Instant) -> None:
        self.x = x
        self.y = y
        self.at = at
        self.stays_until = stays_until


class Body:
    """One robot: hull, wheels, and what it has heard."""

    def __init__(self, x: float, y: float, theta: float) -> None:
        self.x = x
        self.y = y
        self.theta = theta
        self.v = 0.0
        self.bend = 0.0
        """Curvature of the arc on which it drives, 1/m of way."""
        self.command = Twist(0.0, 0.0)
        self.commanded = 0
        """Steps since the last command."""
        self.stalled = 0
        self.mute = 0
        self.stays_until: Instant = 0
        self.target = -1
        self.wish = Twist(0.0, 0.0)
        self.heard: dict[int, Report] = {}
        self.inbox: list[tuple[Instant, int, Report]] = []

    def drive(self) -> None:
        """Move by one step; the wheels brake when no command has come for long."""
        if self.commanded >= WATCHDOG_STEPS:
            self.command = Twist(0.0, 0.0)
        self.commanded += 1
        if self.command.v and abs(self.v) <= abs(self.command.v) and self.v * self.command.v >= 0.0:
            self.bend = self.command.w / abs(self.command.v)  # else it brakes first, on the arc of before
        change = BRAKE * STEP_S
        was = self.v
        self.v += min(change, max(-change, self.command.v - self.v))
        way = 0.5 * (was + self.v) * STEP_S
        turn = self.bend * abs(way) if way else self.command.w * STEP_S
        self.x += way * math.cos(self.theta + 0.5 * turn)
        self.y += way * math.sin(self.theta + 0.5 * turn)
        self.theta += turn


class Floor:
    """One run."""

    def __init__(self, number: int, without: str = "") -> None:
        self.rng = rng = Random(f"shield/{number}")
        self.without = without
        self.side = rng.uniform(0.5, 1.5)
        self.loss = rng.choice((0.0, 0.1, 0.5))
        self.delay = rng.choice((0, 2, 10))
        self.faults = rng.choice((0.0, 0.01, 0.05))
        walls: list[Obstacle] = []
        for _ in range(rng.randrange(3)):
            x = rng.uniform(0.0, self.side)
            y = rng.uniform(0.0, self.side)
            x1 = x + rng.uniform(0.02, 0.4)
            y1 = y + rng.uniform(0.02, 0.4)
            walls.append(Polygon((Point(x, y), Point(x1, y), Point(x1, y1), Point(x, y1))))
        self.arena = Arena(self.side, self.side, 0.05, tuple(walls))
        self.seen_arena = Arena(1e3, 1e3, 0.05) if without == "walls" else self.arena
        self.shield = Shield(RADIUS, SPEED, 0.0, 1e9) if without == "braking" else Shield(RADIUS, SPEED, LAG_S, BRAKE)
        self.sigma = 0.0 if without == "uncertainty" else SIGMA_M
        self.bodies: list[Body] = []
        wanted = rng.choice((2, 2, 2, 3, 4, 6, 12))
        for _ in range(20 * wanted):
            body = Body(rng.uniform(0.0, self.side), rng.uniform(0.0, self.side), rng.uniform(-math.pi, math.pi))
            apart = all(math.hypot(body.x - o.x, body.y - o.y) >= 2 * RADIUS for o in self.bodies)
            if apart and self.arena.clearance(body.x, body.y) >= RADIUS and len(self.bodies) < wanted:
                self.bodies.append(body)

    def overlap(self) -> bool:
        """Run; return whether hulls overlap, or a hull and a wall."""
        for now in range(0, STEPS * STEP, STEP):
            for index, body in enumerate(self.bodies):
                self._fault(now, body)
                self._report(now, index, body)
            for index, body in enumerate(self.bodies):
                if not body.stalled:
                    self._command(now, index, body)
            for body in self.bodies:
                body.drive()
            if self._overlaps():
                return True
        return False

    def _overlaps(self) -> bool:
        bodies = self.bodies
        for i, a in enumerate(bodies):
            if self.arena.clearance(a.x, a.y) < RADIUS - ROUNDING_M:
                return True
            for b in bodies[:i]:
                if math.hypot(a.x - b.x, a.y - b.y) < 2 * RADIUS - ROUNDING_M:
                    return True
        return False

    def _fault(self, now: Instant, body: Body) -> None:
        rng = self.rng
        body.stalled = max(0, body.stalled - 1)
        body.mute = max(0, body.mute - 1)
        if rng.random() < self.faults:
            body.stalled = rng.randrange(1, 20)
            if rng.random() < 0.3:  # it begins anew
                body.heard.clear()
        if rng.random() < self.faults:
            body.mute = rng.randrange(1, 40)
        # A promise is made standing. It outlives the robot's memory: one that begins anew stands for as long.
        if body.v == 0.0 and body.stays_until <= now and rng.random() < 0.05:
            body.stays_until = now + STEP * rng.randrange(5, 40)

    def _estimate(self, body: Body) -> Pose:
        rng = self.rng
        error = rng.uniform(0.0, ERROR_M)
        angle = rng.uniform(-math.pi, math.pi)
        heading = body.theta + rng.uniform(-HEADING_ERROR, HEADING_ERROR)
        return Pose(body.x + error * math.cos(angle), body.y + error * math.sin(angle), heading)

    def _report(self, now: Instant, index: int, body: Body) -> None:
        rng = self.rng
        if body.stalled or body.mute or (now // STEP + index) % 4:
            return
        pose = self._estimate(body)
        report = Report(pose.x, pose.y, now, body.stays_until)
        for other in self.bodies:
            if other is not body and rng.random() >= self.loss:
                other.inbox.append((now + STEP * rng.randint(0, self.delay), index, report))

    def _command(self, now: Instant, index: int, body: Body) -> None:
        rng = self.rng
        for due, source, report in body.inbox:
            if due <= now and (source not in body.heard or body.heard[source].at < report.at):
                body.heard[source] = report
        body.inbox = [mail for mail in body.inbox if mail[0] > now]
        pose = self._estimate(body)
        twist = self._wish(index, body)
        if body.stays_until > now:
            twist = Twist(0.0, twist.w)
        others = self._others(now, index, body, pose)
        share = 0.0
        if others is not None:
            share = min(self.shield.past(twist, others), self.shield.within(twist, pose, self.seen_arena, self.sigma))
        body.command = Twist(share * twist.v, share * twist.w)
        body.commanded = 0
        if rng.random() < 0.02:
            body.target = -1

    def _others(self, now: Instant, index: int, body: Body, pose: Pose) -> list[TakenDisc] | None:
        """Return where the others may be; None: anywhere."""
        if len(body.heard) < len(self.bodies) - 1 and self.without != "unheard":
            return None
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        taken = []
        for report in body.heard.values():
            dx = report.x - pose.x
            dy = report.y - pose.y
            unknown: Duration = now - max(report.at, report.stays_until)
            if self.without == "age":
                unknown = 0 if report.stays_until <= report.at else report.at - report.stays_until
            taken.append(self.shield.taken(dx * cos + dy * sin, dy * cos - dx * sin, self.sigma, unknown))
        return taken

    def _wish(self, index: int, body: Body) -> Twist:
        """Return a command: at random for a while, or straight at another robot or the wall."""
        rng = self.rng
        if body.target < 0:
            body.target = rng.randrange(2 * len(self.bodies) + 1)
            body.wish = Twist(rng.uniform(-SPEED, SPEED), rng.uniform(-TURN, TURN) if rng.random() < 0.5 else 0.0)
        if body.target >= len(self.bodies) or body.target == index:
            return body.wish
        other = self.bodies[body.target]
        error = math.remainder(math.atan2(other.y - body.y, other.x - body.x) - body.theta, math.tau)
        if abs(error) > 0.3:
            return Twist(0.0, math.copysign(TURN, error))
        return Twist(SPEED, 2.0 * error)


def overlapping(first: int, last: int, without: str = "") -> list[int]:
    """Return the runs from `first` to `last` in which hulls overlap."""
    return [number for number in range(first, last + 1) if Floor(number, without).overlap()]


if __name__ == "__main__":
    print(*overlapping(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:4]) or ["none"])

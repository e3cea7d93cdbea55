"""Two and three robots with the law of ways alone: no hulls overlap, whichever way they are sent.

Kinematic bodies on open floor, seen within the view and heard otherwise. Each drives to places drawn at random near
the others, so that their ways cross, turns on the spot to the next one, and sets out again. Of their hellos some are
lost or late, estimates of place and heading drift, and processes stop for a while, so that the wheels brake late. A
robot that has not heard another one for long stands, as by the rule `overdue`. `test_ways_apart.py` has a little of it.
Run as a program for a long campaign: ``python ways_campaign.py FIRST LAST [PART]``; each run with an overlap is printed
by its number. `PART` is a part of the law that is left out, one of `PARTS`.
"""

import math
import sys
from random import Random

from rmr.base.arena import BRAKE, RobotShape
from rmr.base.geometry import Twist
from rmr.base.motion_scale import scale_of
from rmr.node.motion.avoid import gives_way_late
from rmr.node.motion.ways import GAP_M, HEARD_GAP_M, HEARD_SIGMAS, WaysToStand
from rmr.node.ports import SeenBody

PARTS = ("law", "gap", "hearing")
"""What is left out: the law itself, the gap between hulls, and those out of view."""
SHAPE = RobotShape()
TOUCH = 2.0 * SHAPE.radius
TICK_S = 1.0 / 60.0
TICKS = 900
LAG_TICKS = 6
"""Wheels brake this long after the last command."""
HELLO_TICKS = 12
OVERDUE_TICKS = 36
SIGMA_M = 0.003
"""Standard deviation of a place, each axis; drifts over a second."""
HEADING_SIGMA = 0.01
VIEW_SIGMA_M = 0.002
TURN = 3.0
TURN_ACCELERATION = 12.0
FLOOR_M = 0.5


class Hello:
    """What a robot has said."""

    def __init__(self, tick: int, x: float, y: float, v: float, theta: float) -> None:
        self.tick = tick
        self.x = x
        self.y = y
        self.v = v
        self.theta = theta


class Body:
    """One robot: hull, wheels, where it wants to, and what it has heard."""

    def __init__(self, x: float, y: float, theta: float) -> None:
        self.x = x
        self.y = y
        self.theta = theta
        self.v = 0.0
        self.w = 0.0
        self.command = Twist(0.0, 0.0)
        self.commanded = 0
        self.stalled = 0
        self.target = (x, y)
        self.kept = 0
        self.error = [0.0, 0.0, 0.0]
        self.heard: dict[int, Hello] = {}
        self.inbox: list[tuple[int, int, Hello]] = []

    def drive(self) -> None:
        """Move by one tick; the wheels brake when no command has come for long."""
        self.commanded += 1
        command = Twist(0.0, 0.0) if self.commanded > LAG_TICKS else self.command
        change = BRAKE * TICK_S
        self.v += min(change, max(-change, command.v - self.v))
        change = TURN_ACCELERATION * TICK_S
        self.w += min(change, max(-change, command.w - self.w))
        self.theta += self.w * TICK_S
        self.x += self.v * math.cos(self.theta) * TICK_S
        self.y += self.v * math.sin(self.theta) * TICK_S


class Floor:
    """One run."""

    def __init__(self, number: int, without: str = "") -> None:
        self.rng = rng = Random(f"ways/{number}")
        self.without = without
        self.loss = rng.choice((0.0, 0.1, 0.3))
        self.late = rng.choice((0, 2, 6))
        self.faults = rng.choice((0.0, 0.0005, 0.002))
        self.ways = WaysToStand(scale_of(SHAPE))
        self.bodies: list[Body] = []
        self.least_m = math.inf
        wanted = rng.choice((2, 2, 3))
        while len(self.bodies) < wanted:
            body = Body(rng.uniform(0.0, FLOOR_M), rng.uniform(0.0, FLOOR_M), rng.uniform(-math.pi, math.pi))
            if all(math.hypot(body.x - o.x, body.y - o.y) >= TOUCH + 0.05 for o in self.bodies):
                self.bodies.append(body)

    def overlap(self) -> bool:
        """Run; return whether hulls overlap while one moves."""
        for tick in range(TICKS):
            for index, body in enumerate(self.bodies):
                self._err(body)
                self._say(tick, index, body)
            for index, body in enumerate(self.bodies):
                if body.stalled:
                    body.stalled -= 1
                else:
                    self._command(tick, index, body)
                    if self.rng.random() < self.faults:
                        body.stalled = self.rng.randrange(1, 60)
            for body in self.bodies:
                body.drive()
            for index, a in enumerate(self.bodies):
                for b in self.bodies[:index]:
                    self.least_m = min(self.least_m, math.hypot(a.x - b.x, a.y - b.y) - TOUCH)
            if self.least_m < 0.0:
                return True
        return False

    def _err(self, body: Body) -> None:
        keep = math.exp(-TICK_S)
        kick = math.sqrt(1.0 - keep * keep)
        for axis, sigma in enumerate((SIGMA_M, SIGMA_M, HEADING_SIGMA)):
            body.error[axis] = body.error[axis] * keep + self.rng.gauss(0.0, sigma) * kick

    def _say(self, tick: int, index: int, body: Body) -> None:
        rng = self.rng
        if body.stalled or (tick + 5 * index) % HELLO_TICKS:
            return
        ex, ey, turned = body.error
        hello = Hello(tick, body.x + ex, body.y + ey, body.v, body.theta + turned)
        for other in self.bodies:
            if other is not body and rng.random() >= self.loss:
                other.inbox.append((tick + rng.randint(1, 1 + self.late), index, hello))

    def _command(self, tick: int, index: int, body: Body) -> None:
        for due, source, hello in body.inbox:
            if due <= tick and (source not in body.heard or body.heard[source].tick < hello.tick):
                body.heard[source] = hello
        body.inbox = [mail for mail in body.inbox if mail[0] > tick]
        twist = self._wish(index, body)
        share = self._share(tick, index, body, twist)
        body.command = Twist(share * twist.v, share * twist.w)
        body.commanded = 0
        body.kept = body.kept + 1 if twist.v and share < 0.2 else 0

    def _share(self, tick: int, index: int, body: Body, twist: Twist) -> float:
        """Return how much of `twist` the law permits."""
        if twist.v == 0.0 or self.without == "law":
            return 1.0
        share = 1.0
        for source, other in enumerate(self.bodies):
            if other is body:
                continue
            seen = self._seen(body, other)
            age_s = 0.0
            gap = GAP_M
            if seen is None:
                if self.without == "hearing":
                    continue
                hello = body.heard.get(source)
                if hello is None or tick - hello.tick > OVERDUE_TICKS:
                    return 0.0
                age_s = (tick - hello.tick) * TICK_S
                ex, ey, turned = body.error
                x = hello.x + hello.v * math.cos(hello.theta) * age_s
                y = hello.y + hello.v * math.sin(hello.theta) * age_s
                seen = _in_frame(x, y, hello.v, hello.theta, body.x + ex, body.y + ey, body.theta + turned)
                gap = max(HEARD_GAP_M, HEARD_SIGMAS * SIGMA_M)
            if self.without == "gap":
                gap = 0.0
            first = index < source if self.ranked else gives_way_late(seen)
            share = min(share, self.ways.clear(twist, seen, gap, age_s, first=first))
        return share

    @property
    def ranked(self) -> bool:
        """Whether the robots have an order."""
        return len(self.bodies) == 3

    def _seen(self, body: Body, other: Body) -> SeenBody | None:
        dx = other.x - body.x
        dy = other.y - body.y
        away = math.hypot(dx, dy)
        if away - SHAPE.radius > SHAPE.view_depth:
            return None
        bearing = abs(math.remainder(math.atan2(dy, dx) - body.theta, math.tau))
        if bearing - math.asin(min(1.0, SHAPE.radius / away)) > SHAPE.view_angle / 2:
            return None
        seen = _in_frame(other.x, other.y, other.v, other.theta, body.x, body.y, body.theta)
        noise = self.rng.gauss
        return SeenBody(seen.x + noise(0.0, VIEW_SIGMA_M), seen.y + noise(0.0, VIEW_SIGMA_M), seen.vx, seen.vy)

    def _wish(self, index: int, body: Body) -> Twist:
        """Return the command towards the robot's place; there, or kept standing for long, it draws another one."""
        rng = self.rng
        x, y = body.target
        if math.hypot(x - body.x, y - body.y) < 0.03 or body.kept > 60 + 20 * index:
            body.kept = 0
            near = rng.choice(self.bodies)
            body.target = (near.x + rng.uniform(-0.4, 0.4), near.y + rng.uniform(-0.4, 0.4))
            x, y = body.target
        error = math.remainder(math.atan2(y - body.y, x - body.x) - body.theta, math.tau)
        if abs(error) > 0.6:
            return Twist(0.0, math.copysign(TURN, error))
        return Twist(SHAPE.speed, 2.0 * error)


def _in_frame(x: float, y: float, v: float, theta: float, own_x: float, own_y: float, own_theta: float) -> SeenBody:
    """Return a body at (x, y) that drives at `v` m/s, in the frame of a robot."""
    dx = x - own_x
    dy = y - own_y
    cos = math.cos(own_theta)
    sin = math.sin(own_theta)
    turn = theta - own_theta
    return SeenBody(dx * cos + dy * sin, dy * cos - dx * sin, v * math.cos(turn), v * math.sin(turn))


def overlapping(first: int, last: int, without: str = "") -> list[int]:
    """Return the runs from `first` to `last` in which hulls overlap."""
    return [number for number in range(first, last + 1) if Floor(number, without).overlap()]


if __name__ == "__main__":
    print(*overlapping(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:4]) or ["none"])

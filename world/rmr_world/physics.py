"""The physics: robots as round bodies with two wheels on a flat floor, seen from above (pymunk, no gravity).

The world alone knows where everything is. It is stepped by whoever owns the lab clock, once per tick, and
advances in equal sub-steps, so that the same commands give the same bits. A wheel command asks for a twist;
the wheels follow it with bounded acceleration and grip the floor, so the body cannot slide sideways, but it can
be stopped or pushed, and it slips a little at random. Commands that are old, out of order or not finite are
dropped and counted: a robot's mistake never stops the world (paper IV.E, V.B.2).

Per-tick code works on plain floats and touches pymunk's bodies once each, those of robots that stand and are not
touched not at all: they have not moved. Readings of a robot are drawn from its own random streams (`sensors`).
"""

import math
from operator import attrgetter
from typing import Any, NamedTuple

import pymunk

from rmr.base.arena import Disc
from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.streams import Normals, stream
from rmr.base.time import NS_PER_MS, TICK_S, Instant, tick_index, tick_start
from rmr.node.ports import SeenBody, Sensed
from rmr_world.lab import Lab
from rmr_world.sensors import BODY_POSITION_SIGMA, BODY_VELOCITY_SIGMA, Sensors

SUBSTEPS = 2
"""Per tick; at 0.2 m/s a robot moves 1.7 mm in one, far below its radius."""
MASS_KG = 0.5
ACCELERATION = 0.8
"""m/s^2, of the wheels."""
TURN_ACCELERATION = 12.0
"""rad/s^2."""
SLIP_SIGMA = 0.01
"""Of the commanded speed, per tick."""
TURN_SLIP_SIGMA = 0.02
"""Of the commanded turn rate, per tick."""
COMMAND_AGE_MAX = 100 * NS_PER_MS
"""Older commands describe another situation."""
COMMAND_LEAD_MAX = 100 * NS_PER_MS
"""A stamp further in the future is no time of this lab, and would shut out all later commands."""
WATCHDOG = 100 * NS_PER_MS
"""Without a command for so long the wheels brake: a robot whose process dies or is held up at full speed goes another
2 cm until then and 2.5 cm while it brakes. A shorter gap costs nothing, a slightly longer one a little speed."""
CONTACTS_MAX = 10_000
"""Records kept; contacts are counted beyond it."""

_WALL_M = 0.1
"""Thickness of the walls, outside of the arena."""
_SLOP_M = 0.0002
"""How far bodies may overlap in contact (pymunk's own default is 0.1 units)."""
_DV, _DW = ACCELERATION * TICK_S, TURN_ACCELERATION * TICK_S
"""What the wheels can do in one tick."""
_STEP_S = TICK_S / SUBSTEPS
_set = object.__setattr__
_NARROW = math.radians(59.0)
"""Sets a body's property, past pymunk's own `__setattr__`, which does the same in twice the time."""
_ROBOT, _FIXED = 1, 2
"""Collision types, and categories of shapes (a bit each)."""
_x = attrgetter("x")
_OPAQUE = pymunk.ShapeFilter(mask=_FIXED)
"""What hides a robot from another one."""


class Contact(NamedTuple):
    """The beginning of a contact."""

    at: Instant
    """Beginning of the tick in which it happened."""
    robot: int
    other: int | None
    """The other robot's id; None: an obstacle or a wall."""
    x: float
    """Metres."""
    y: float


class _Robot:
    """One robot's body, and what it was last told."""

    __slots__ = (
        "active", "body", "contacts", "cos", "distance_m", "heard", "id", "near", "sensors", "sin", "slip", "stamp",
        "target", "theta", "v", "view", "vx", "vy", "w", "x", "y",
    )  # fmt: skip

    def __init__(self, robot: int, pose: Pose, body: pymunk.Body, seed: int, sensors: Sensors) -> None:
        self.id = robot
        self.body = body
        self.slip = Normals(stream(f"{seed}/robot{robot}/wheels"))
        self.view = Normals(stream(f"{seed}/robot{robot}/view"))
        self.sensors = sensors
        self.x, self.y, self.theta = pose
        self.cos, self.sin = math.cos(pose.theta), math.sin(pose.theta)
        self.vx = self.vy = self.v = self.w = 0.0
        self.target: Twist = STILL
        self.stamp: Instant = -COMMAND_AGE_MAX
        self.heard: Instant = -WATCHDOG
        self.contacts = 0
        self.active = False
        """Whether its body may move in this tick."""
        self.distance_m = 0.0
        self.near: list[_Robot] = []


class World:
    """The physical world of one lab."""

    def __init__(self, lab: Lab, seed: int) -> None:
        """Put the lab's robots and obstacles on the floor; `seed` names all streams of chance."""
        self._shape = lab.arena.shape
        self._tick = 0
        self._space = pymunk.Space()
        self._space.collision_slop = _SLOP_M
        self._extents: list[tuple[float, float, float, float]] = []
        """Left, bottom, right and top of each obstacle."""
        self._static(lab)
        self._hulls: dict[pymunk.Shape, _Robot] = {}
        self._robots: dict[int, _Robot] = {}
        for start in sorted(lab.robots, key=lambda robot: robot.id):
            self._robots[start.id] = self._robot(lab, seed, start.id, start.pose)
        self._list = list(self._robots.values())
        self._by_x = self._list.copy()
        self._awake: dict[int, _Robot] = {}
        """The robots that have been told to move, or pushed, and do not stand again, by id."""
        self._active: list[_Robot] = []
        """Those whose bodies may move in this tick."""
        self._in_view_m = self._shape.view_depth + self._shape.radius
        self.collisions = 0
        """How many contacts of robots with robots, obstacles or walls have begun."""
        self.contacts: list[Contact] = []
        """The first CONTACTS_MAX of them."""
        self.dropped = 0
        """Wheel commands that were too old, out of order or not finite."""
        self._least_centres = math.inf
        self._space.on_collision(_ROBOT, _ROBOT, begin=self._begin, separate=self._separate)
        self._space.on_collision(_ROBOT, _FIXED, begin=self._begin, separate=self._separate)
        self._pairs()

    def _static(self, lab: Lab) -> None:
        """Add walls and obstacles."""
        space, arena = self._space, lab.arena
        shapes: list[pymunk.Shape] = []
        for obstacle in arena.obstacles:
            if isinstance(obstacle, Disc):
                shapes.append(pymunk.Circle(space.static_body, obstacle.radius, (obstacle.centre.x, obstacle.centre.y)))
            else:
                shapes.append(pymunk.Poly(space.static_body, [(x, y) for x, y in obstacle.corners]))
        w, h, t = arena.width, arena.height, _WALL_M
        corners = [(-t, -t), (w + t, -t), (w + t, h + t), (-t, h + t)]
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            shapes.append(pymunk.Segment(space.static_body, a, b, t))
        for shape in shapes:
            shape.collision_type = _FIXED
            shape.friction = 0.3
            shape.filter = pymunk.ShapeFilter(categories=_FIXED)
        space.add(*shapes)
        self._extents = [
            (bb.left, bb.bottom, bb.right, bb.top) for bb in (shape.bb for shape in shapes[: len(arena.obstacles)])
        ]

    def _robot(self, lab: Lab, seed: int, robot: int, pose: Pose) -> _Robot:
        radius = self._shape.radius
        body = pymunk.Body(MASS_KG, pymunk.moment_for_circle(MASS_KG, 0.0, radius))
        body.position = (pose.x, pose.y)
        body.angle = pose.theta
        hull = pymunk.Circle(body, radius)
        hull.collision_type = _ROBOT
        hull.friction = 0.3
        hull.filter = pymunk.ShapeFilter(categories=_ROBOT)
        self._space.add(body, hull)
        localisation = lab.localisation
        sensors = Sensors(
            stream(f"{seed}/robot{robot}/sensors"),
            lab.arena.beacons,
            localisation.rate,
            localisation.sigma,
            localisation.dropout,
        )
        state = _Robot(robot, pose, body, seed, sensors)
        self._hulls[hull] = state
        return state

    # Commands and clock

    def act(self, robot: int, twist: Twist, stamp: Instant, now: Instant) -> None:
        """Let `robot`'s wheels follow `twist`, which its mind decided at `stamp`.

        Speed and turn rate are cut to what the wheels can do. Raises KeyError for a robot that is not there.
        """
        state = self._robots[robot]
        v, w = twist
        stale = stamp < state.stamp or not -COMMAND_LEAD_MAX <= now - stamp <= COMMAND_AGE_MAX
        if stale or not (math.isfinite(v) and math.isfinite(w)):
            self.dropped += 1
            return
        speed, turn = self._shape.speed, self._shape.turn
        if abs(v) > speed or abs(w) > turn:
            twist = Twist(max(-speed, min(speed, v)), max(-turn, min(turn, w)))
        state.target = twist
        state.stamp = stamp
        state.heard = now
        self._awake[robot] = state

    def silence(self, robot: int, until: Instant) -> None:
        """Let `robot` hear no beacon `until` then; an outage that lasts longer already is not cut short."""
        sensors = self._robots[robot].sensors
        sensors.silent_until = max(sensors.silent_until, until)

    def step(self, now: Instant) -> None:
        """Advance to the tick that contains `now` (an instant before that is no step)."""
        index = tick_index(now)
        while self._tick < index:
            self._tick += 1
            self._advance(tick_start(self._tick))

    def _advance(self, now: Instant) -> None:
        """One tick."""
        active = self._active
        active.clear()
        for robot in list(self._awake.values()):
            robot.active = self._steer(robot, now) or robot.contacts > 0
            if robot.active:
                active.append(robot)
            else:
                del self._awake[robot.id]
        if not active:
            return
        step = self._space.step
        for _ in range(SUBSTEPS):
            step(_STEP_S)
        for robot in active:
            _read(robot)
        self._pairs()

    def _steer(self, robot: _Robot, now: Instant) -> bool:
        """Bring the body's velocity nearer to the commanded twist, as far as the wheels can in one tick.

        Returns False for a robot that stands and shall.
        """
        target_v, target_w = robot.target
        if now - robot.heard > WATCHDOG:
            target_v = target_w = 0.0
        if target_v == 0.0 == target_w and robot.v == 0.0 == robot.w and robot.vx == 0.0 == robot.vy:
            return False
        if target_v != 0.0:
            target_v *= 1.0 + robot.slip() * SLIP_SIGMA
        if target_w != 0.0:
            target_w *= 1.0 + robot.slip() * TURN_SLIP_SIGMA
        dv, dw = _DV, _DW
        v, w = robot.v, robot.w
        v = v + dv if target_v > v + dv else v - dv if target_v < v - dv else target_v
        w = w + dw if target_w > w + dw else w - dw if target_w < w - dw else target_w
        heading = robot.theta + 0.5 * w * TICK_S  # the middle of the arc that the wheels roll along in this tick
        _set(robot.body, "velocity", (v * math.cos(heading), v * math.sin(heading)))
        _set(robot.body, "angular_velocity", w)
        return True

    # Contacts and gaps

    def _begin(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:  # noqa: ARG002
        """Note the beginning of a contact."""
        robots = self._touching(arbiter)
        for robot in robots:
            robot.contacts += 1
            if not robot.active:  # it stood, and is pushed
                robot.active = True
                self._active.append(robot)
                self._awake[robot.id] = robot
        self.collisions += 1
        if len(self.contacts) < CONTACTS_MAX:
            points = arbiter.contact_point_set.points
            x, y = points[0].point_a if points else (robots[0].x, robots[0].y)
            other = robots[1].id if len(robots) > 1 else None
            self.contacts.append(Contact(self._now(), robots[0].id, other, x, y))

    def _separate(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:  # noqa: ARG002
        for robot in self._touching(arbiter):
            robot.contacts -= 1

    def _touching(self, arbiter: pymunk.Arbiter) -> list[_Robot]:
        """Return the robots in a contact, the lower id first."""
        found = [robot for shape in arbiter.shapes if (robot := self._hulls.get(shape)) is not None]
        return sorted(found, key=lambda robot: robot.id)

    def _now(self) -> Instant:
        return tick_start(self._tick)

    def _pairs(self) -> None:
        """Find who is near whom, and the smallest distance of two robots so far; one sweep along x."""
        for robot in self._list:
            if robot.near:
                robot.near = []
        order = self._by_x
        order.sort(key=_x)  # from tick to tick they hardly change places
        in_view = self._in_view_m
        least = self._least_centres
        reach = max(in_view, least)
        for after, a in enumerate(order, 1):
            ax, ay = a.x, a.y
            for b in order[after:]:
                dx = b.x - ax
                if dx > reach:
                    break
                dy = b.y - ay
                if -reach < dy < reach:
                    centres = math.sqrt(dx * dx + dy * dy)
                    if centres < least:
                        least = centres
                        reach = max(in_view, least)
                    if centres <= in_view:
                        a.near.append(b)
                        b.near.append(a)
        self._least_centres = least

    @property
    def min_gap_m(self) -> float:
        """Smallest gap between two robots' hulls so far, metres, 0 when they touched; infinite for one robot."""
        return max(0.0, self._least_centres - 2.0 * self._shape.radius)

    # What is seen

    def pose(self, robot: int) -> Pose:
        """Return the true pose of `robot`; the heading is in [-pi, pi]."""
        state = self._robots[robot]
        return Pose(state.x, state.y, math.remainder(state.theta, math.tau))

    def distance_m(self, robot: int) -> float:
        """Return the length of the way that `robot`'s centre has gone."""
        return self._robots[robot].distance_m

    def sense(self, robot: int, now: Instant) -> Sensed:
        """Return what `robot` senses as of the last step; `now` stamps it."""
        state = self._robots[robot]
        sensors = state.sensors
        theta = math.remainder(state.theta, math.tau)
        return Sensed(
            now,
            sensors.left_m,
            sensors.right_m,
            sensors.gyro(state.w),
            sensors.compass(theta),
            sensors.ranges(now, state.x, state.y),
            self._bodies(state) if state.near else (),
            state.contacts > 0,
            (state.x, state.y, theta),
        )

    def _hidden(self, robot: _Robot, other: _Robot) -> bool:
        """Return whether something stands between the centres of two robots."""
        x0, x1 = (robot.x, other.x) if robot.x < other.x else (other.x, robot.x)
        y0, y1 = (robot.y, other.y) if robot.y < other.y else (other.y, robot.y)
        for left, bottom, right, top in self._extents:
            if x0 <= right and x1 >= left and y0 <= top and y1 >= bottom:
                a, b = (robot.x, robot.y), (other.x, other.y)
                return self._space.segment_query_first(a, b, 0.0, _OPAQUE) is not None
        return False

    def _bodies(self, robot: _Robot) -> tuple[SeenBody, ...]:
        """Return the robots whose hull reaches into the field of view, nearest first (paper IV.E)."""
        seen = []
        cos, sin, radius = robot.cos, robot.sin, self._shape.radius
        half, normal = 0.5 * self._shape.view_angle, robot.view
        for other in robot.near:
            dx, dy = other.x - robot.x, other.y - robot.y
            ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
            centres = math.hypot(dx, dy)
            if ahead <= 0.0 and half < _NARROW and centres >= 2.0 * radius:
                continue  # behind, where half of a hull's width is 30 degrees at most
            half_width = math.asin(min(1.0, radius / centres)) if centres > 0.0 else math.pi
            if abs(math.atan2(left, ahead)) - half_width > half:
                continue
            if self._hidden(robot, other):
                continue
            body = SeenBody(
                ahead + normal() * BODY_POSITION_SIGMA,
                left + normal() * BODY_POSITION_SIGMA,
                cos * other.vx + sin * other.vy + normal() * BODY_VELOCITY_SIGMA,
                cos * other.vy - sin * other.vx + normal() * BODY_VELOCITY_SIGMA,
            )
            seen.append((centres, other.id, body))
        return tuple([body for _, _, body in sorted(seen)]) if seen else ()


def _read(robot: _Robot) -> None:
    """Take the body's state over, and let the encoders count what the wheels rolled."""
    body = robot.body
    x, y = body.position
    theta = body.angle
    dx, dy, turned = x - robot.x, y - robot.y, theta - robot.theta
    if dx == 0.0 == dy and turned == 0.0:
        robot.vx = robot.vy = robot.v = robot.w = 0.0
        return
    middle = robot.theta + 0.5 * turned
    way = dx * math.cos(middle) + dy * math.sin(middle)
    robot.sensors.moved(way, turned)
    robot.distance_m += math.sqrt(dx * dx + dy * dy)
    robot.x, robot.y, robot.theta = x, y, theta
    robot.vx, robot.vy = dx / TICK_S, dy / TICK_S
    robot.cos, robot.sin = math.cos(theta), math.sin(theta)
    robot.v, robot.w = way / TICK_S, turned / TICK_S

"""The physics: robots as round bodies with two wheels on a flat floor, seen from above, without gravity.

The world alone knows where everything is. It is stepped by whoever owns the lab clock, once per tick, and advances in
equal sub-steps, so that the same commands give the same bits. A wheel command asks for a twist; the wheels follow it
with bounded acceleration and grip the floor, so the body cannot slide sideways, but it can be stopped or pushed, and it
slips a little at random. Commands that are old, out of order or not finite are dropped and counted: a robot's mistake
never stops the world (paper IV.E, V.B.2).

A body that can touch nothing within a tick *rolls*: its velocity is added in each sub-step, as the engine (`engine`)
would, to the bit. The engine moves all in those ticks alone in which a hull comes near to another one, an obstacle or a
wall. Robots that stand cost nothing. Readings of a robot are drawn from its own random streams (`sensors`).
"""

import math
from operator import attrgetter
from typing import Final

from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.streams import Normals, stream
from rmr.base.time import NS_PER_MS, TICK_S, Instant, tick_index, tick_start
from rmr.node.ports import SeenBody, Sensed
from rmr_world.contact_engine import Contact, ContactEngine
from rmr_world.lab import Lab
from rmr_world.sensors import BODY_POSITION_SIGMA, BODY_VELOCITY_SIGMA, Sensors

SUBSTEPS: Final = 2
"""Per tick; at 0.2 m/s a robot moves 1.7 mm in one, far below its radius."""
ACCELERATION: Final = 0.8
"""m/s^2, of the wheels."""
TURN_ACCELERATION: Final = 12.0
"""rad/s^2."""
SLIP_SIGMA: Final = 0.01
"""Of the commanded speed, per tick."""
TURN_SLIP_SIGMA: Final = 0.02
"""Of the commanded turn rate, per tick."""
COMMAND_AGE_MAX: Final = 100 * NS_PER_MS
"""Older commands describe another situation."""
COMMAND_LEAD_MAX: Final = 100 * NS_PER_MS
"""A stamp further in the future is no time of this lab, and would shut out all later commands."""
WATCHDOG: Final = 100 * NS_PER_MS
"""So long after the last command was decided, however late it has arrived, the wheels brake: a robot whose process dies
or is held up at full speed goes another 2 cm until then and 2.5 cm while it brakes. A shorter gap costs nothing, a
slightly longer one a little speed."""
CONTACTS_MAX: Final = 10_000
"""Records kept; contacts are counted beyond it."""
FASTEST: Final = 2.0
"""No body goes faster than so many times what its wheels can: they slip by hundredths, and only equals push them."""
SETTLED_TICKS: Final = 3
"""How long the engine goes on when no hull is near to anything any more: it corrects overlaps in the step that follows
a contact and remembers it for three. As long it looks at the beginning, for who has been put into a wall."""

_DV: Final = ACCELERATION * TICK_S
_DW: Final = TURN_ACCELERATION * TICK_S
"""What the wheels can do in one tick."""
_STEP_S: Final = TICK_S / SUBSTEPS
_NARROW: Final = math.radians(59.0)
_x: Final = attrgetter("x")


class _Robot:
    """One robot's body, and what it was last told."""

    __slots__ = (
        "active", "contacts", "cos", "decided", "distance_m", "free_until_m", "goes_vx", "goes_vy", "goes_w", "id",
        "near", "rolled", "sensors", "sin", "slip", "stamp", "steered", "target", "theta", "v", "view", "vx", "vy", "w",
        "x", "y",
    )  # fmt: skip

    def __init__(self, robot: int, pose: Pose, seed: int, sensors: Sensors) -> None:
        self.id = robot
        self.slip = Normals(stream(f"{seed}/robot{robot}/wheels"))
        self.view = Normals(stream(f"{seed}/robot{robot}/view"))
        self.sensors = sensors
        self.x, self.y, self.theta = pose
        self.cos = math.cos(pose.theta)
        self.sin = math.sin(pose.theta)
        self.vx = self.vy = self.v = self.w = 0.0
        self.goes_vx = self.goes_vy = self.goes_w = 0.0
        """The velocity that the wheels give the body in this tick."""
        self.steered = False
        """Whether they give it one."""
        self.rolled = False
        """Whether it has moved since the engine was asked last."""
        self.target: Twist = STILL
        self.stamp: Instant = -COMMAND_AGE_MAX
        self.decided: Instant = -WATCHDOG
        """When what it was told was decided, as far as that is past."""
        self.contacts = 0
        self.active = False
        """Whether its body may move in this tick."""
        self.distance_m = 0.0
        self.free_until_m = 0.0
        """Until it has gone so far it comes to no wall and no obstacle."""
        self.near: list[_Robot] = []


class World:
    """The physical world of one lab."""

    def __init__(self, lab: Lab, seed: int) -> None:
        """Put the lab's robots and obstacles on the floor; `seed` names all streams of chance."""
        arena = lab.arena
        service = lab.localisation
        self._shape = shape = arena.shape
        self._width = arena.width
        self._height = arena.height
        self._tick = 0
        self._engine = ContactEngine(arena, self._begin, self._separate)
        self._robots: dict[int, _Robot] = {}
        for start in sorted(lab.robots, key=lambda robot: robot.id):
            rng = stream(f"{seed}/robot{start.id}/sensors")
            sensors = Sensors(rng, arena.beacons, service.rate, service.sigma, service.dropout)
            self._robots[start.id] = _Robot(start.id, start.pose, seed, sensors)
            self._engine.add(start.id, start.pose)
        self._list = list(self._robots.values())
        self._by_x = self._list.copy()
        self._awake: dict[int, _Robot] = {}
        """The robots that have been told to move, or pushed, and do not stand again, by id."""
        self._active: list[_Robot] = []
        """Those whose bodies may move in this tick."""
        self._in_view_m = shape.view_depth + shape.radius
        self._alone_m = shape.radius + FASTEST * shape.speed * TICK_S
        """A robot whose centre is farther than that from a wall does not touch it in this tick; two, twice as far."""
        self._asked = SETTLED_TICKS
        """For how many ticks the engine is asked still."""
        self.touching = 0
        """Contacts at present."""
        self.collisions = 0
        """How many contacts of robots with robots, obstacles or walls have begun."""
        self.contacts: list[Contact] = []
        """The first CONTACTS_MAX of them."""
        self.dropped = 0
        """Wheel commands that were too old, out of order or not finite."""
        self._least_centres = self._closest = math.inf
        """The smallest distance of two robots so far, and now."""
        self._pairs()

    # Commands and clock

    def act(self, robot: int, twist: Twist, stamp: Instant, now: Instant) -> None:
        """Let `robot`'s wheels follow `twist`, which its mind decided at `stamp`.

        Speed and turn rate are cut to what the wheels can do. Raises KeyError for a robot that is not there.
        """
        state = self._robots[robot]
        v = twist.v
        w = twist.w
        stale = stamp < state.stamp or not -COMMAND_LEAD_MAX <= now - stamp <= COMMAND_AGE_MAX
        if stale or not (math.isfinite(v) and math.isfinite(w)):
            self.dropped += 1
            return
        speed = self._shape.speed
        turn = self._shape.turn
        if abs(v) > speed or abs(w) > turn:
            twist = Twist(max(-speed, min(speed, v)), max(-turn, min(turn, w)))
        state.target = twist
        state.stamp = stamp
        state.decided = min(stamp, now)
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
            robot.steered = self._steer(robot, now)
            robot.active = robot.steered or robot.contacts > 0
            if robot.active:
                active.append(robot)
            else:
                del self._awake[robot.id]
        if not active:
            return
        if self._near_something():
            self._asked = SETTLED_TICKS
        if self._asked:
            self._asked -= 1
            self._ask()
        else:
            for robot in active:
                _roll(robot)
        self._pairs()

    def _near_something(self) -> bool:
        """Return whether some hull may touch another one, an obstacle or a wall in this tick, or does already."""
        if self.touching or self._closest <= 2.0 * self._alone_m:
            return True
        for robot in self._active:
            if robot.distance_m >= robot.free_until_m:
                free_m = self._free_m(robot.x, robot.y) - self._alone_m
                if free_m <= 0.0:
                    return True
                robot.free_until_m = robot.distance_m + free_m
        return False

    def _free_m(self, x: float, y: float) -> float:
        """Return how far it is from (x, y) to the nearest wall or box around an obstacle, at least."""
        free = min(x, y, self._width - x, self._height - y)
        for left, bottom, right, top in self._engine.extents:
            free = min(free, max(left - x, x - right, bottom - y, y - top))
        return free

    def _ask(self) -> None:
        """Let the engine move all for one tick."""
        engine = self._engine
        for robot in self._list:
            if robot.rolled:
                engine.place(robot.id, robot.x, robot.y, robot.theta)
            if robot.rolled or robot.steered:
                engine.drive(robot.id, robot.goes_vx, robot.goes_vy, robot.goes_w)
                robot.rolled = False
        for _ in range(SUBSTEPS):
            engine.step(_STEP_S)
        for robot in self._active:
            x, y, theta = engine.where(robot.id)
            _moved(robot, x, y, theta)

    def _steer(self, robot: _Robot, now: Instant) -> bool:
        """Bring the body's velocity nearer to the commanded twist, as far as the wheels can in one tick.

        Returns False for a robot that stands and shall.
        """
        target_v = robot.target.v
        target_w = robot.target.w
        if now - robot.decided > WATCHDOG:
            target_v = target_w = 0.0
        if target_v == 0.0 == target_w and robot.v == 0.0 == robot.w and robot.vx == 0.0 == robot.vy:
            return False
        if target_v != 0.0:
            target_v *= 1.0 + robot.slip.draw() * SLIP_SIGMA
        if target_w != 0.0:
            target_w *= 1.0 + robot.slip.draw() * TURN_SLIP_SIGMA
        dv = _DV
        dw = _DW
        v = robot.v
        w = robot.w
        v = v + dv if target_v > v + dv else v - dv if target_v < v - dv else target_v
        w = w + dw if target_w > w + dw else w - dw if target_w < w - dw else target_w
        heading = robot.theta + 0.5 * w * TICK_S  # the middle of the arc that the wheels roll along in this tick
        robot.goes_vx = v * math.cos(heading)
        robot.goes_vy = v * math.sin(heading)
        robot.goes_w = w
        return True

    # Contacts and gaps

    def _begin(self, ids: list[int], where: tuple[float, float] | None) -> None:
        """Note the beginning of a contact."""
        robots = [self._robots[robot] for robot in ids]
        for robot in robots:
            robot.contacts += 1
            if not robot.active:  # it stood, and is pushed
                robot.active = True
                self._active.append(robot)
                self._awake[robot.id] = robot
        self.touching += 1
        self.collisions += 1
        if len(self.contacts) < CONTACTS_MAX:
            x, y = (robots[0].x, robots[0].y) if where is None else where
            other = ids[1] if len(ids) > 1 else None
            self.contacts.append(Contact(self._now(), ids[0], other, x, y))

    def _separate(self, ids: list[int], _where: tuple[float, float] | None) -> None:
        self.touching -= 1
        for robot in ids:
            self._robots[robot].contacts -= 1

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
        closest = math.inf
        wanted = max(in_view, 2.0 * self._alone_m)
        reach = max(wanted, least)
        for i in range(len(order)):
            a = order[i]
            ax = a.x
            ay = a.y
            for j in range(i + 1, len(order)):
                b = order[j]
                dx = b.x - ax
                if dx > reach:
                    break
                dy = b.y - ay
                if -reach < dy < reach:
                    centres = math.sqrt(dx * dx + dy * dy)
                    if centres < closest:
                        closest = centres
                        if closest < least:
                            least = closest
                            reach = max(wanted, least)
                    if centres <= in_view:
                        a.near.append(b)
                        b.near.append(a)
        self._least_centres = least
        self._closest = closest

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
        for left, bottom, right, top in self._engine.extents:
            if x0 <= right and x1 >= left and y0 <= top and y1 >= bottom:
                return self._engine.hides((robot.x, robot.y), (other.x, other.y))
        return False

    def _bodies(self, robot: _Robot) -> tuple[SeenBody, ...]:
        """Return the robots whose hull reaches into the field of view, nearest first (paper IV.E)."""
        seen = []
        cos = robot.cos
        sin = robot.sin
        radius = self._shape.radius
        half = 0.5 * self._shape.view_angle
        normal = robot.view
        for other in robot.near:
            dx = other.x - robot.x
            dy = other.y - robot.y
            ahead = cos * dx + sin * dy
            left = cos * dy - sin * dx
            centres = math.hypot(dx, dy)
            if ahead <= 0.0 and half < _NARROW and centres >= 2.0 * radius:
                continue  # behind, where half of a hull's width is 30 degrees at most
            half_width = math.asin(min(1.0, radius / centres)) if centres > 0.0 else math.pi
            if abs(math.atan2(left, ahead)) - half_width > half:
                continue
            if self._hidden(robot, other):
                continue
            body = SeenBody(
                ahead + normal.draw() * BODY_POSITION_SIGMA,
                left + normal.draw() * BODY_POSITION_SIGMA,
                cos * other.vx + sin * other.vy + normal.draw() * BODY_VELOCITY_SIGMA,
                cos * other.vy - sin * other.vx + normal.draw() * BODY_VELOCITY_SIGMA,
            )
            seen.append((centres, other.id, body))
        return tuple([body for _, _, body in sorted(seen)]) if seen else ()


def _roll(robot: _Robot) -> None:
    """Let a body that touches nothing go on for one tick."""
    x = robot.x
    y = robot.y
    theta = robot.theta
    dx = robot.goes_vx * _STEP_S
    dy = robot.goes_vy * _STEP_S
    turn = robot.goes_w * _STEP_S
    for _ in range(SUBSTEPS):
        x = x + dx
        y = y + dy
        theta = theta + turn
    robot.rolled = True
    _moved(robot, x, y, theta)


def _moved(robot: _Robot, x: float, y: float, theta: float) -> None:
    """Take over where a body has got to, and let the encoders count what the wheels rolled."""
    dx = x - robot.x
    dy = y - robot.y
    turned = theta - robot.theta
    if dx == 0.0 == dy and turned == 0.0:
        robot.vx = robot.vy = robot.v = robot.w = 0.0
        return
    middle = robot.theta + 0.5 * turned
    way = dx * math.cos(middle) + dy * math.sin(middle)
    robot.sensors.moved(way, turned)
    robot.distance_m += math.sqrt(dx * dx + dy * dy)
    robot.x = x
    robot.y = y
    robot.theta = theta
    robot.vx = dx / TICK_S
    robot.vy = dy / TICK_S
    robot.cos = math.cos(theta)
    robot.sin = math.sin(theta)
    robot.v = way / TICK_S
    robot.w = turned / TICK_S

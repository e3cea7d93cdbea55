"""The physics: robots as round bodies with differential drive on a flat floor, seen from above, without gravity.

Only the world holds the ground truth. The owner of the lab clock steps it once per tick. It advances in equal
sub-steps, so that equal commands give bitwise equal runs. A wheel command is a target twist. The wheels follow it with
bounded acceleration and grip the floor: the body does not slide sideways, but it can be stopped or pushed, and the
wheels slip a little at random. Commands that are old, out of order or not finite are dropped and counted, so that no
robot's mistake stops the world (paper IV.E, V.B.2).

A body that can touch nothing within a tick is integrated here, bitwise as the contact engine (`contact_engine`) would
do it. The engine runs only in ticks in which a hull comes near another one, an obstacle or a wall. Robots at rest cost
nothing. The readings of a robot are drawn from its own random streams (`sensors`).
"""

import math
from collections.abc import Mapping
from operator import attrgetter
from typing import Any, Final

from rmr.base.arena import BRAKE, TURN_ACCELERATION
from rmr.base.geometry import Pose, Twist
from rmr.base.streams import stream
from rmr.base.time import NS_PER_MS, TICK_S, Instant, tick_index, tick_start
from rmr.node.ports import SeenBody, Sensed
from rmr_world.contact_engine import Contact, ContactEngine
from rmr_world.lab import Lab
from rmr_world.robot_body import COMMAND_AGE_MAX, STEP_S, SUBSTEPS, WATCHDOG, RobotBody, moved, roll
from rmr_world.sensors import BODY_POSITION_SIGMA, BODY_VELOCITY_SIGMA, Sensors, pulse_phases

SLIP_SIGMA: Final = 0.01
"""Standard deviation of the slip of the speed in one tick, as a share of the commanded speed."""
TURN_SLIP_SIGMA: Final = 0.02
"""Standard deviation of the slip of the turn rate in one tick, as a share of the commanded rate."""
COMMAND_LEAD_MAX: Final = 100 * NS_PER_MS
"""Greatest lead of a command's stamp. One further ahead is wrong, and would make all later commands out of order."""
CONTACTS_MAX: Final = 10_000
"""Contacts that are recorded; beyond it they are only counted."""
CONTACTS_KEPT: Final = 100
"""Contacts that outlive the process: as many as the report of a world lists."""
FASTEST: Final = 2.0
"""Bound of a body's speed, in multiples of the wheels' top speed: slip adds hundredths, and only equal bodies push."""
SETTLED_TICKS: Final = 3
"""Ticks for which the engine runs on after the last hull was near anything: it corrects overlaps in the step after a
contact, and caches contacts for three steps. It also runs for as long at the start, for robots placed in contact."""

_DV: Final = BRAKE * TICK_S
_DW: Final = TURN_ACCELERATION * TICK_S
"""Bounds of the change of speed (m/s) and turn rate (rad/s) in one tick."""
_NARROW: Final = math.radians(59.0)
"""Half view angle below which a body behind a robot cannot be in its view: a hull that does not overlap has a half
width of at most 30 degrees, so its edge is at least 60 degrees off the heading."""
_x: Final = attrgetter("x")


class World:
    """The physical world of one lab."""

    def __init__(self, lab: Lab, seed: int) -> None:
        """Put the lab's robots and obstacles on the floor; `seed` names all random streams."""
        arena = lab.arena
        service = lab.localisation
        self._shape = shape = arena.shape
        self._width = arena.width
        self._height = arena.height
        self._tick = 0
        self._engine = ContactEngine(arena, self._begin, self._separate)
        self._robots: dict[int, RobotBody] = {}
        pulses = pulse_phases(stream(f"{seed}/beacons"), len(arena.beacons), service.rate)
        for start in sorted(lab.robots, key=lambda robot: robot.id):
            rng = stream(f"{seed}/robot{start.id}/sensors")
            sensors = Sensors(rng, arena.beacons, service.rate, service.sigma, service.dropout, pulses)
            self._robots[start.id] = RobotBody(start.id, start.pose, seed, sensors)
            self._engine.add(start.id, start.pose)
        self.bodies = list(self._robots.values())
        """All robots by id, for others to look at."""
        self._by_x = self.bodies.copy()
        self.awake: dict[int, RobotBody] = {}
        """By id, the robots that have been commanded or pushed and are not at rest again."""
        self._active: list[RobotBody] = []
        """The robots whose bodies may move in this tick."""
        self._in_view_m = shape.view_depth + shape.radius
        self._alone_m = shape.radius + FASTEST * shape.speed * TICK_S
        """Distance from a wall beyond which a centre cannot reach it in this tick; for two robots, twice that."""
        self._carried = False  # whether there are bodies that are not simulated
        self._asked = SETTLED_TICKS
        """Ticks for which the engine still runs."""
        self.touching = 0
        """Number of present contacts."""
        self.collisions = 0
        """Number of contacts of robots with robots, obstacles or walls that have begun."""
        self.contacts: list[Contact] = []
        """The first CONTACTS_MAX of them."""
        self.dropped = 0
        """Number of wheel commands that were too old, out of order or not finite."""
        self._least_centres = self._closest = math.inf
        """Smallest distance of two centres, metres: so far, and in this tick."""
        self._pairs()

    # Durability

    def kept(self) -> dict[str, Any]:
        """Return the state that outlives the process as plain data, which `bring_back` takes; speeds are not in it."""
        bodies = [
            (one.id, one.x, one.y, one.theta, one.sensors.left_m, one.sensors.right_m, one.distance_m,
             one.sensors.silent_until)
            for one in self.bodies
        ]  # fmt: skip
        least = self._least_centres
        closest = least if math.isfinite(least) else None
        return {
            "bodies": bodies,
            "collisions": self.collisions,
            "contacts": self.contacts[:CONTACTS_KEPT],
            "closest_m": closest,
        }

    def bring_back(self, tick: int, kept: Mapping[str, Any]) -> None:
        """Go on from what was `kept`, at `tick`: the bodies stand. The lab is the same, the noise drawn anew."""
        self._tick = tick
        for robot, x, y, theta, left_m, right_m, distance_m, silent_until in kept["bodies"]:
            self._robots[robot].put(x, y, theta, distance_m)
            sensors = self._robots[robot].sensors
            sensors.left_m = left_m
            sensors.right_m = right_m
            sensors.silent_until = silent_until
            self._engine.place(robot, x, y, theta)
        self._asked = SETTLED_TICKS
        self.collisions = kept["collisions"]
        self.contacts = [Contact(*contact) for contact in kept["contacts"]]
        self._least_centres = math.inf if kept["closest_m"] is None else kept["closest_m"]
        self._pairs()

    # Commands and clock

    def act(self, robot: int, twist: Twist, stamp: Instant, now: Instant) -> None:
        """Command the wheels of `robot` to `twist`, which its node decided at `stamp`.

        Speed and turn rate are clamped to the robot's limits. Raises KeyError for an unknown robot.
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
        self.awake[robot] = state

    def carry(self, robot: int, pose: Pose, twist: Twist, distance_m: float) -> None:
        """Put a body that is not simulated where it is now, after a path of `distance_m`; others may touch it."""
        state = self._robots[robot]
        state.put(pose.x, pose.y, pose.theta, distance_m)
        state.v = twist.v
        state.w = state.goes_w = twist.w
        state.vx = state.goes_vx = twist.v * state.cos
        state.vy = state.goes_vy = twist.v * state.sin
        state.rolled = True  # the engine takes its place from here
        self._carried = True

    def silence(self, robot: int, until: Instant) -> None:
        """Let `robot` receive no localisation pulse until `until`; a longer outage under way is not shortened."""
        sensors = self._robots[robot].sensors
        sensors.silent_until = max(sensors.silent_until, until)

    def step(self, now: Instant) -> None:
        """Advance to the tick that contains `now` (an instant before that is no step)."""
        index = tick_index(now)
        while self._tick < index:
            self._tick += 1
            self._advance(tick_start(self._tick))

    def _advance(self, now: Instant) -> None:
        """Advance by one tick, which begins at `now`."""
        active = self._active
        active.clear()
        for robot in list(self.awake.values()):
            robot.steered = self._steer(robot, now)
            robot.active = robot.steered or robot.contacts > 0
            if robot.active:
                active.append(robot)
            else:
                del self.awake[robot.id]
        if not active:
            if self._carried:
                self._pairs()
            return
        if self._near_something():
            self._asked = SETTLED_TICKS
        if self._asked:
            self._asked -= 1
            self._ask()
        else:
            for robot in active:
                roll(robot)
        self._pairs()

    def _near_something(self) -> bool:
        """Return whether a hull touches another one, an obstacle or a wall, or may in this tick."""
        if self.touching or self._closest <= 2.0 * self._alone_m:
            return True
        for robot in self._active:
            if robot.distance_m >= robot.free_until_m:
                # The next free_m metres of driving, in any direction, need no further look.
                free_m = self._free_m(robot.x, robot.y) - self._alone_m
                if free_m <= 0.0:
                    return True
                robot.free_until_m = robot.distance_m + free_m
        return False

    def _free_m(self, x: float, y: float) -> float:
        """Return a lower bound of the distance from (x, y) to the nearest wall or obstacle (by bounding boxes)."""
        free = min(x, y, self._width - x, self._height - y)
        for left, bottom, right, top in self._engine.extents:
            free = min(free, max(left - x, x - right, bottom - y, y - top))
        return free

    def _ask(self) -> None:
        """Move all bodies for one tick by the contact engine."""
        engine = self._engine
        for robot in self.bodies:
            if robot.rolled:
                engine.place(robot.id, robot.x, robot.y, robot.theta)
            if robot.rolled or robot.steered:
                engine.drive(robot.id, robot.goes_vx, robot.goes_vy, robot.goes_w)
                robot.rolled = False
        for _ in range(SUBSTEPS):
            engine.step(STEP_S)
        for robot in self._active:
            x, y, theta = engine.where(robot.id)
            moved(robot, x, y, theta)

    def _steer(self, robot: RobotBody, now: Instant) -> bool:
        """Set the velocity of this tick: a step from the present towards the commanded twist, bounded by acceleration.

        Returns False for a robot at rest without a command to move.
        """
        target_v = robot.target.v
        target_w = robot.target.w
        if now - robot.decided > WATCHDOG:
            target_v = target_w = 0.0  # the watchdog brakes
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
        # Midpoint rule: along an arc the chord of this tick has the heading of the arc's middle.
        heading = robot.theta + 0.5 * w * TICK_S
        robot.goes_vx = v * math.cos(heading)
        robot.goes_vy = v * math.sin(heading)
        robot.goes_w = w
        return True

    # Contacts and gaps

    def _begin(self, ids: list[int], where: tuple[float, float] | None) -> None:
        """Record the beginning of a contact."""
        robots = [self._robots[robot] for robot in ids]
        for robot in robots:
            robot.contacts += 1
            if not robot.active:  # it was at rest, and is pushed
                robot.active = True
                self._active.append(robot)
                self.awake[robot.id] = robot
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
        """Update each robot's neighbours in view range and the smallest distances: sweep and prune along x."""
        for robot in self.bodies:
            if robot.near:
                robot.near = []
        order = self._by_x
        order.sort(key=_x)  # nearly sorted from the last tick, so this takes linear time
        in_view = self._in_view_m
        least = self._least_centres
        closest = math.inf
        wanted = max(in_view, 2.0 * self._alone_m)
        # Pairs beyond `reach` are neither in view, nor near contact, nor a new smallest distance.
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

    # Sensing

    def pose(self, robot: int) -> Pose:
        """Return the true pose of `robot`; the heading is in [-pi, pi]."""
        state = self._robots[robot]
        return Pose(state.x, state.y, math.remainder(state.theta, math.tau))

    def distance_m(self, robot: int) -> float:
        """Return the length of the path of `robot`'s centre, metres."""
        return self._robots[robot].distance_m

    def sense(self, robot: int, now: Instant) -> Sensed:
        """Return the sample of `robot` as of the last step, stamped `now`."""
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
            self.in_view(robot) if state.near else (),
            state.contacts > 0,
            (state.x, state.y, theta),
        )

    def _hidden(self, robot: RobotBody, other: RobotBody) -> bool:
        """Return whether an obstacle lies between two robots' centres (bounding boxes first, then a ray cast)."""
        x0, x1 = (robot.x, other.x) if robot.x < other.x else (other.x, robot.x)
        y0, y1 = (robot.y, other.y) if robot.y < other.y else (other.y, robot.y)
        for left, bottom, right, top in self._engine.extents:
            if x0 <= right and x1 >= left and y0 <= top and y1 >= bottom:
                return self._engine.hides((robot.x, robot.y), (other.x, other.y))
        return False

    def in_view(self, robot_id: int) -> tuple[SeenBody, ...]:
        """Return the robots whose hull reaches into the field of view, nearest first (paper IV.E)."""
        robot = self._robots[robot_id]
        seen = []
        cos = robot.cos
        sin = robot.sin
        radius = self._shape.radius
        half = 0.5 * self._shape.view_angle
        normal = robot.view
        for other in robot.near:
            dx = other.x - robot.x
            dy = other.y - robot.y
            # The other's centre in the robot's frame: x ahead, y to the left.
            ahead = cos * dx + sin * dy
            left = cos * dy - sin * dx
            centres = math.hypot(dx, dy)
            if ahead <= 0.0 and half < _NARROW and centres >= 2.0 * radius:
                continue  # entirely behind, see _NARROW
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

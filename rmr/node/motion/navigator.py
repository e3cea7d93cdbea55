"""Joins planning, following and avoidance for one robot.

One order of precedence each tick: the path's wish, cut by the gate (not before the slot, never while it is
closed), cut by stop-if-dangerous, which has the last word. The gate has a line: the place where the hull's
front is far enough before the gate point to brake from full speed. Slots mean that line: a robot that crosses
it at full speed as the slot opens loses nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, distance, wrap
from rmr.base.gridpath import GridPath
from rmr.base.time import NEVER, Duration, Instant, in_seconds, seconds
from rmr.node.motion.avoid import limit_twist
from rmr.node.motion.follow import BRAKE, Follower, braking_speed, turn_towards
from rmr.node.motion.grid import discs_around
from rmr.node.motion.route import Route, follower_route, leader_route, shared_part
from rmr.node.ports import SeenBody

GATE_MARGIN_M = 0.01
"""Between the hull's front and the gate when the robot waits there."""
START_S = 0.15
"""What speeding up from standstill costs against full speed, seconds."""
EARLY_S = 0.25
"""A robot leaves this much earlier than just in time and makes up for it by driving slower, seconds."""
RETRY_S = 0.5
"""Between two tries to find a way when blocked."""
SAME_PLACE_M = 0.03
"""A parked robot that is reported this near to where it was has not moved."""
FACED = 0.03
"""Heading error that counts as facing, radians."""


class Estimate(NamedTuple):
    """What a drive would take."""

    approach: Duration
    """Until the robot is at the gate's line at full speed (to the goal, when there is no gate)."""
    inside: Duration
    """From there until it is clear of the narrow section; 0 without a gate."""
    way: int
    """Direction through the gate."""


class Navigator:
    """Moves one robot. `step` is called each tick while it is active."""

    __slots__ = (
        "_blocked_since",
        "_driven",
        "_face",
        "_follower",
        "_gate_open",
        "_goal",
        "_holding",
        "_next_try",
        "_opens_at",
        "_parked",
        "_pose",
        "_replan_due",
        "_shared",
        "_through",
        "arena",
        "replans",
        "robot",
        "status",
    )

    def __init__(self, arena: Arena, robot: int) -> None:
        self.arena = arena
        self.robot = robot
        self.status = "idle"
        self.replans = 0
        self._follower: Follower | None = None
        self._goal: Point | None = None
        self._face: float | None = None
        self._driven: Twist | None = None
        self._parked: tuple[Point, ...] = ()
        self._shared: GridPath | None = None
        self._through = False
        self._opens_at: Instant | None = None
        self._gate_open = False
        self._next_try: Instant = 0
        self._blocked_since: Instant = NEVER
        self._replan_due = False
        self._holding = False
        self._pose = Pose(0.0, 0.0, 0.0)

    # -- orders ---------------------------------------------------------------------------------------------

    def go(
        self,
        now: Instant,
        pose: Pose,
        goal: Point,
        *,
        final_heading: float | None = None,
        parked: Sequence[Point] = (),
        shared: GridPath | None = None,
        through_gate: bool = False,
    ) -> bool:
        """Plan a way to `goal` and begin. Returns False, with status blocked, when there is none yet."""
        self._goal, self._face, self._driven = goal, final_heading, None
        self._parked, self._shared, self._through = tuple(parked), shared, through_gate
        self._opens_at, self._gate_open = None, False
        self._holding = through_gate
        self._pose = pose
        return self._replan(now, pose)

    def gate(self, opens_at: Instant | None, opened: bool) -> None:
        """Tell when the slot at the gate begins (None: unknown, wait before it) and whether entering is allowed."""
        self._opens_at, self._gate_open = opens_at, opened

    def update_parked(self, points: Sequence[Point]) -> None:
        """Tell where robots are parked now; a blocked robot tries again at its next step."""
        parked = tuple(points)
        if _same(parked, self._parked):
            return
        self._parked = parked
        self._next_try = 0
        if self._follower is not None and (self.parked or self._obstructed()):
            self._replan_due = True

    def face(self, now: Instant, theta: float) -> None:  # noqa: ARG002
        """Turn in place to the heading `theta`, radians."""
        self._clear()
        self._face, self.status = theta, "moving"

    def drive(self, v: float, w: float) -> None:
        """Drive by hand at `v` m/s and `w` rad/s until another order; stop-if-dangerous still holds."""
        self._clear()
        self._driven, self.status = Twist(v, w), "moving"

    def stop(self) -> None:
        """Forget every order and stand still."""
        self._clear()
        self.status = "idle"

    def _clear(self) -> None:
        self._follower = self._goal = self._face = self._driven = None
        self._opens_at, self._gate_open = None, False

    # -- each tick ------------------------------------------------------------------------------------------

    def step(self, now: Instant, pose: Pose, sigma: float, bodies: Sequence[SeenBody], bumped: bool) -> Twist:
        """Return the wheel command of this tick for the estimated `pose` (its sigma in metres)."""
        self._pose = pose
        if self._driven is not None:
            return limit_twist(self._driven, bodies, self.arena.shape.radius)
        if self.status in ("idle", "arrived"):
            return STILL
        if self._follower is None and self._goal is not None and (now < self._next_try or not self._replan(now, pose)):
            return STILL
        if self._replan_due:
            self._replan_due = False
            self._replan(now, pose, keep=True)
        follower = self._follower
        if follower is None:
            return self._turn(pose)
        follower.locate(pose)
        if follower.arrived:
            return self._turn(pose)
        wish = follower.steer(pose, self._gate_limit(now, follower))
        return limit_twist(wish, bodies, self.arena.shape.radius)

    def _turn(self, pose: Pose) -> Twist:
        """Turn to the heading that was ordered; without one the robot has arrived."""
        error = 0.0 if self._face is None else wrap(self._face - pose.theta)
        if abs(error) < FACED:
            self.status = "arrived"
            return STILL
        return Twist(0.0, turn_towards(error, self.arena.shape))

    def _gate_limit(self, now: Instant, follower: Follower) -> float:
        """Return the speed that the gate allows, m/s."""
        speed = self.arena.shape.speed
        gate = follower.route.gate_m
        if gate is None or self._gate_open or self.passed_gate:
            self._holding = False
            return speed
        hold = braking_speed(gate - self._stop_before() - follower.s)
        if self._opens_at is None:
            return min(speed, hold)
        left = in_seconds(self._opens_at - now)
        to_line = self._line(follower.route) - follower.s
        if to_line <= 0.0 or left <= 0.0:
            return min(speed, hold)
        self._holding = self._holding and self._standing_wait(to_line, left)
        if self._holding:
            return 0.0
        return min(speed, hold, max(0.02, to_line / left))

    def _standing_wait(self, to_line: float, left: float) -> bool:
        """Return whether it is too early to leave: driving now would mean creeping."""
        return left > to_line / self.arena.shape.speed + START_S + EARLY_S + 0.1 * left

    def _stop_before(self) -> float:
        return self.arena.shape.radius + GATE_MARGIN_M

    def _line(self, route: Route) -> float:
        """Return the arc length of the gate's line."""
        speed = self.arena.shape.speed
        brake = speed * speed / (2.0 * BRAKE)
        return max(0.0, (route.gate_m or 0.0) - self._stop_before() - brake)

    def _obstructed(self) -> bool:
        """Return whether a parked robot now stands on the rest of the route."""
        follower = self._follower
        if follower is None or self._goal is None:
            return False
        start = Point(self._pose.x, self._pose.y)
        discs = discs_around(self._parked, self.arena.shape.radius, start, self._goal)
        return follower.route.meets(follower.s, discs)

    def _replan(self, now: Instant, pose: Pose, *, keep: bool = False) -> bool:
        """Plan from `pose`. With `keep` the old route stays when there is no other."""
        assert self._goal is not None
        self.replans += 1
        self._next_try = now + seconds(RETRY_S)
        route = self._route(Point(pose.x, pose.y), self._goal, self._parked, self._shared, self._through)
        if route is None and keep:
            return False
        if route is None:
            self._follower, self.status = None, "blocked"
            return False
        self._follower, self.status = Follower(route, self.arena.shape), "moving"
        return True

    def _route(
        self, start: Point, goal: Point, parked: Sequence[Point], shared: GridPath | None, through: bool
    ) -> Route | None:
        if through and shared is not None:
            return follower_route(self.arena, start, goal, parked, shared)
        return leader_route(self.arena, start, goal, parked, through_gate=through)

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def route(self) -> Route | None:
        """Return the route being followed."""
        return None if self._follower is None else self._follower.route

    @property
    def parked(self) -> bool:
        """Return whether the robot stands for a while: idle, arrived, blocked, or not yet due to leave."""
        return self.status != "moving" or self._holding

    @property
    def remaining_m(self) -> float:
        """Return the way that is left in metres; 0 without a route."""
        return 0.0 if self._follower is None else max(0.0, self._follower.route.length_m - self._follower.s)

    @property
    def passed_gate(self) -> bool:
        """Return whether the robot's front is beyond the gate's stopping place."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None:
            return False
        return follower.s > max(0.0, follower.route.gate_m - self._stop_before()) + 0.02

    @property
    def cleared(self) -> bool:
        """Return whether the hull is out of the narrow section."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None:
            return False
        return follower.s >= follower.route.clear_m or follower.arrived

    def eta_gate(self, now: Instant) -> Duration:  # noqa: ARG002
        """Return how long the robot needs at least to the gate's line; 0 when passed or without a gate."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None or self.passed_gate:
            return 0
        way = self._line(follower.route) - follower.s
        if way <= 0.0:
            return 0
        return self._drive_time(way, abs(follower.heading_error(self._pose)))

    def eta_clear(self, now: Instant) -> Duration:  # noqa: ARG002
        """Return how long the robot needs at least until it is clear; 0 when it is or without a gate."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None or self.cleared:
            return 0
        return self._drive_time(follower.route.clear_m - follower.s, abs(follower.heading_error(self._pose)))

    def _drive_time(self, way: float, turn: float) -> Duration:
        pivot = turn / self.arena.shape.turn + 0.2 if turn > 0.35 else 0.0
        return seconds(pivot + way / self.arena.shape.speed + START_S)

    def estimate(
        self,
        pose: Pose,
        goal: Point,
        parked: Sequence[Point] = (),
        *,
        shared: GridPath | None = None,
        through_gate: bool = True,
    ) -> Estimate | None:
        """Return what driving from `pose` to `goal` would take, without moving; None when there is no way."""
        route = self._route(Point(pose.x, pose.y), goal, parked, shared, through_gate)
        if route is None:
            return None
        turn = abs(Follower(route, self.arena.shape).heading_error(pose))
        if route.gate_m is None:
            return Estimate(self._drive_time(route.length_m, turn), 0, 0)
        line = self._line(route)
        inside = seconds((route.clear_m - line) / self.arena.shape.speed + START_S)
        return Estimate(self._drive_time(line, turn), inside, route.way)

    def shared_path(self) -> GridPath | None:
        """Return the part of the robot's route that it shares when it leads; None without a gate."""
        route = self.route
        return None if route is None else shared_part(self.arena, route)


def _same(a: Sequence[Point], b: Sequence[Point]) -> bool:
    """Return whether two lists of parked robots mean the same but for the noise of their estimates."""
    return len(a) == len(b) and all(any(distance(*p, *q) < SAME_PLACE_M for q in b) for p in a)

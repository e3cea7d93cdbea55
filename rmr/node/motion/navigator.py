"""Joins planning, following and avoidance for one robot.

Each tick asks in order of precedence: the path's wish, cut by the gate (not before the slot, never while it is
closed), cut by stop-if-dangerous, which has the last word. A robot that stands in a stand-off for longer than
its patience gets a detour.

A route around parked robots is made anew when they change: at once while the robot still stands, on the way
only when one of them is now in the way. Robots parked at the gate or before this one in the gate's queue go
first: the route leads over their places, and the robot waits until they have left.
"""

from collections.abc import Sequence
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, wrap
from rmr.base.grid_path import GridPath
from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr.node.motion.avoid import EARLY_PATIENCE, BodyMemory, DeadlockDetector, limit_twist, way_back_s, with_heard
from rmr.node.motion.estimate import Estimate, estimate_of, time_left
from rmr.node.motion.follow import FACED, Follower, turn_towards
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.grid import discs_around, off_goal, same_places
from rmr.node.motion.hearing import BESIDE_M, Hearing
from rmr.node.motion.priority import Heard, Standing, order_key, share_of_speed
from rmr.node.motion.queueing import Queueing
from rmr.node.motion.route import DriveOrder, Route, follower_route, gated_again, leader_route, off_queue, shared_part
from rmr.node.motion.standoff.refuge import (
    Aside,
    Side,
    back,
    for_a_moment,
    retreat,
    side_of,
    stay,
    walk_away,
    way_aside,
    ways_of,
)
from rmr.node.ports import SeenBody

RETRY_S: Final = 0.5
"""Between two tries to find a way when blocked."""
LOST_SIGMA_M: Final = 0.1
"""A robot less sure of its place than this drives at half speed."""


class Navigator:
    """Moves one robot. `step` is called each tick while it is active."""

    __slots__ = (
        "_aside", "_back_until", "_driven", "_driving", "_face", "_follower", "_gate", "_next_try", "_order", "_parked",
        "_pose", "_queue", "_replan_due", "_share", "_stand_off", "_standing", "_v", "_watch", "arena", "hearing",
        "replans", "robot", "status",
    )  # fmt: skip

    def __init__(self, arena: Arena, robot: int, robots: int = 1) -> None:
        self.arena = arena
        self.robot = robot
        self.status = "idle"
        """``idle``, ``moving``, ``arrived`` or ``blocked`` (no way; tried again when parked robots change)."""
        self.replans = 0
        self._order: DriveOrder | None = None
        self._follower: Follower | None = None
        self._gate = EntryGate(arena.shape, holding=False)
        self._face: float | None = None
        self._driven: Twist | None = None
        self._parked: tuple[Point, ...] = ()
        self._next_try: Instant = 0
        self._replan_due = False
        self._queue = Queueing()
        self._back_until: Instant = 0
        self._aside: Aside | None = None
        self._share, self._v = 1.0, 0.0
        self._watch = BodyMemory(arena.shape)
        self._stand_off = DeadlockDetector(robot)
        self._driving: Sequence[Heard] = ()
        """What others that drive said last."""
        self._standing = Standing()
        self._pose = Pose(0.0, 0.0, 0.0)
        self.hearing = Hearing(arena.shape, robots)
        """What the others have said about themselves."""

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
        if self._order is None or self.status not in ("moving", "blocked"):
            self._stand_off.reset()  # else it is the same drive by another way, in the same stand-off
        self._clear()
        self._order = DriveOrder(goal, shared, through_gate)
        self._face, self._parked, self._pose = final_heading, tuple(parked), pose
        self._gate = EntryGate(self.arena.shape, holding=through_gate)
        return self._replan(now, pose)

    def gate(self, opens_at: Instant | None, opened: bool) -> None:
        """Tell when the slot at the gate begins (None: unknown, wait before it) and whether entering is allowed."""
        self._gate.opens_at, self._gate.opened = opens_at, opened

    def update_parked(self, points: Sequence[Point]) -> None:
        """Tell where robots are parked now; a blocked robot tries again at its next step."""
        parked = tuple(points)
        if same_places(parked, self._parked):
            return
        self._parked = parked
        self._next_try = 0
        if self._follower is not None and not self._follower.arrived and (self.parked or self._obstructed()):
            self._replan_due = True

    def update_moving(self, now: Instant, rank: int, others: Sequence[Heard]) -> None:
        """Tell what robots that drive said about themselves, and this robot's own rank (0: none).

        A few times a second. On a drive without a gate the robot keeps clear of those that go first, seen or not.
        """
        mine = self.hearing.order = order_key(rank, self.robot)
        self._driving = others
        self._standing.update(now, others)
        follower, stands = self._follower, self._standing.points
        if follower is None or (follower.route.gate_m is not None and not self._gate.cleared):
            self._share = 1.0
            return
        first = [other for other in others if other.robot not in stands and order_key(other.rank, other.robot) < mine]
        self._share = share_of_speed(now, follower.route, follower.s, self.arena.shape, first)

    def face(self, theta: float) -> None:
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
        self._order = self._follower = self._face = self._driven = self._aside = None
        self._gate, self._queue = EntryGate(self.arena.shape, holding=False), Queueing()
        self._replan_due = False
        self._back_until = 0
        self._share, self._v = 1.0, 0.0

    def step(self, now: Instant, pose: Pose, sigma: float, bodies: Sequence[SeenBody], bumped: bool) -> Twist:
        """Return the wheel command of this tick for the estimated `pose` (its sigma in metres)."""
        self._pose = pose
        seen = self._watch.update(now, pose, bodies, self.hearing.fresh)
        wait = self.hearing.forbids(now, pose, bodies)
        if self._driven is not None:
            return self._safe(now, pose, Twist(0.0, self._driven.w) if wait else self._driven, seen)
        if self.status in ("idle", "arrived") or not self._ready(now, pose):
            return STILL
        follower = self._follower
        if follower is None:
            return self._turn(pose)
        follower.locate(pose)
        if self._aside is not None and self._aside.over(now, follower.arrived):
            self._come_back(now, pose)
            return STILL
        self._gate.locate(follower.route, follower.s, follower.arrived)
        if follower.arrived:
            return self._turn(pose) if self._aside is None else STILL
        route, standing = follower.route, self._standing.points.values()
        if self._gate.blocks(now, route, follower.s, standing) and self._leave_mouth(now, pose, route):
            return STILL
        if now < self._back_until and not wait:
            return back(self.arena, pose, [*seen, *self.hearing.around(now, pose, seen)])
        speed = self.arena.shape.speed
        limit = min(self._gate.limit(now, follower.route, follower.s), self._share * speed)
        if wait or (self._parked and self._queued(now)):
            limit = 0.0
        if sigma > LOST_SIGMA_M:
            limit = min(limit, 0.5 * speed)
        wish = follower.steer(pose, limit)
        allowed = self._safe(now, pose, wish, seen)
        stuck = STILL if bumped else allowed  # wheels that turn against a hull get nowhere
        early = stuck is not wish and not bumped and self._gate.waiting(now, follower.route)
        if self._stand_off.blocked(now, wish, stuck, EARLY_PATIENCE if early else 0):
            self._detour(now, pose)
        self._v = allowed.v
        return allowed

    def _safe(self, now: Instant, pose: Pose, twist: Twist, seen: Sequence[SeenBody]) -> Twist:
        """Return `twist`, slowed as the bodies that are seen or heard demand."""
        if twist.v <= 0.0:
            return twist
        bodies = [*seen, *self.hearing.around(now, pose, seen, -BESIDE_M if twist.w else 0.0)]
        return limit_twist(twist, bodies, self.arena.shape.radius, self.hearing.goes_before(now, pose, bodies))

    def _ready(self, now: Instant, pose: Pose) -> bool:
        """Return whether there is something to follow or to face, planning when that is due."""
        if self._order is None:
            return True
        follower = self._follower
        if follower is None:
            return now >= self._next_try and self._replan(now, pose)
        if self._replan_due and self._aside is None and not self._gate.holds_for_long(now, follower.route, follower.s):
            self._replan_due = False
            self._replan(now, pose, keep=True)
        return True

    def _turn(self, pose: Pose) -> Twist:
        """Turn to the heading that was ordered; without one the robot has arrived."""
        error = 0.0 if self._face is None else wrap(self._face - pose.theta)
        if abs(error) < FACED:
            self.status = "arrived"
            return STILL
        return Twist(0.0, turn_towards(error, self.arena.shape))

    def _detour(self, now: Instant, pose: Pose) -> None:
        """Leave a stand-off: around the others, a little way back, or far away where nothing else has helped."""
        stand_off, places = self._stand_off, self._others(now)
        stand_off.mark(now, pose, places, self.arena.shape.radius)
        if stand_off.endures(now, pose, walks=self._aside is not None) and self._walk_away(now, pose, places):
            return
        if stand_off.tries % 2 == 0 and self._step_aside(now, pose, places):
            return
        found = self._replan(now, pose, keep=True)
        self._back_until = now + seconds(way_back_s(stand_off.tries, found, self._gate.met_by(self.route)))

    def _others(self, now: Instant) -> list[Point]:
        return with_heard(self._watch.places(now), self._standing.points.values(), self.arena.shape.radius)

    def _come_back(self, now: Instant, pose: Pose) -> None:
        """Drive to the goal again. Where others bar the way wait, but not for ever: they may stand aside as well."""
        found = self._replan(now, pose, keep=True)
        self._aside = None if found else Aside(self._next_try, stays=True)
        if not found and self._stand_off.endures(now, pose, walks=False):
            self._walk_away(now, pose, self._others(now))

    def _step_aside(self, now: Instant, pose: Pose, places: list[Point]) -> bool:
        """Make room for one that stands on the goal; return whether there is one, and room.

        Not before the end of the bottleneck: on a way without a gate the robot would count as out of it.
        """
        assert self._order is not None
        if self.route is not None and self.route.gate_m is not None and not self._gate.cleared:
            return False
        start, goal = Point(pose.x, pose.y), self._order.goal
        if off_goal(places, goal, self.arena.shape.radius) == places:
            return False
        return self._go_aside(way_aside(self.arena, start, goal, self._parked, places), for_a_moment(now))

    def _leave_mouth(self, now: Instant, pose: Pose, route: Route) -> bool:
        """Drive out of the way of those that come out of the bottleneck; return whether there is room."""
        start, others, room = Point(pose.x, pose.y), self._others(now), self._gate.room(route)
        out = way_aside(self.arena, start, route.points[-1], self._parked, others, route.mouth, room)
        return self._go_aside(out, for_a_moment(now))

    def _walk_away(self, now: Instant, pose: Pose, places: list[Point]) -> bool:
        """Drive out of a jam that nothing else dissolves, to free floor, or back out of the bottleneck."""
        assert self._order is not None
        start, goal, tries = Point(pose.x, pose.y), self._order.goal, self._stand_off.walks
        side = side_of(self.arena, start, goal)
        if side is Side.WITHIN:
            self._back_until = now + retreat(self.robot, tries)
            return self._back_until > now
        ways = ways_of(self.arena, start, self._driving, self._parked)
        route = walk_away(self.arena, start, goal, (*self._parked, *places), self.robot, tries, ways)
        self._gate.passed = self._gate.passed and (route is None or side is Side.BEYOND)
        return self._go_aside(route, stay(now, self.robot, tries))

    def _go_aside(self, route: Route | None, how: Aside) -> bool:
        if route is None:
            return False
        self._follower, self._aside = Follower(route, self.arena.shape), how
        return True

    def _obstructed(self) -> bool:
        """Return whether a parked robot now stands on the rest of the route."""
        follower, start = self._follower, Point(self._pose.x, self._pose.y)
        if follower is None or self._order is None:
            return False
        discs = discs_around(self._parked, self.arena.shape.radius, start, self._order.goal)
        return follower.route.meets(follower.s, discs)

    def _replan(self, now: Instant, pose: Pose, *, keep: bool = False) -> bool:
        """Plan from `pose`. With `keep` the old route stays when there is no other."""
        assert self._order is not None
        self.replans += 1
        self._next_try = now + seconds(RETRY_S)
        goal, shared, through = self._order
        start = Point(pose.x, pose.y)
        parked = (*self._parked, *self._stand_off.around(now, self._standing.points.values()))
        through = through and not self._gate.passed
        route = self._route(start, goal, parked, shared, through)
        if route is None and keep:  # who stands at the goal may be gone by then
            route = self._route(start, goal, off_goal(parked, goal, self.arena.shape.radius), shared, through)
        elif route is None and parked != self._parked:  # as may who stands on the way
            route = self._route(start, goal, self._parked, shared, through)
        if route is None:
            if not keep:
                self._follower, self.status = None, "blocked"
            return False
        if self._gate.passed and not self._gate.cleared:
            route = gated_again(self.arena, route)
        self._follower, self.status = Follower(route, self.arena.shape), "moving"
        return True

    def _route(
        self, start: Point, goal: Point, parked: Sequence[Point], shared: GridPath | None, through: bool
    ) -> Route | None:
        if through and not self._queue.overtakes:
            parked = off_queue(self.arena, start, parked)
        if through and shared is not None:
            return follower_route(self.arena, start, goal, parked, shared)
        return leader_route(self.arena, start, goal, parked, through_gate=through)

    def _queued(self, now: Instant) -> bool:
        """Return whether a robot that goes first still stands on the route before the gate."""
        route, queue = self.route, self._queue
        if route is None or (route.gate_m or 0.0) < self.arena.shape.radius or self._gate.passed or queue.overtakes:
            return False  # where the gate is so near, nobody has room before it
        opens_at = now - 1 if self._gate.opened else self._gate.opens_at
        waits = queue.waits(now, self.arena, Point(self._pose.x, self._pose.y), self._parked, opens_at)
        self._replan_due = self._replan_due or queue.overtakes
        return waits

    # -- what others ask ------------------------------------------------------------------------------------

    @property
    def goal(self) -> Point | None:
        """Return where the robot has been ordered to go."""
        return None if self._order is None else self._order.goal

    @property
    def route(self) -> Route | None:
        """Return the route being followed."""
        return None if self._follower is None else self._follower.route

    @property
    def parked(self) -> bool:
        """Return whether the robot stands for a while: idle, arrived, blocked, or not yet due to leave."""
        return self.status != "moving" or self._gate.holding

    @property
    def remaining_m(self) -> float:
        """Return the way that is left in metres; 0 without a route."""
        return 0.0 if self._follower is None else max(0.0, self._follower.route.length_m - self._follower.s)

    @property
    def passed_gate(self) -> bool:
        """Return whether the robot has gone beyond the gate's stopping place during this drive."""
        return self._gate.passed

    @property
    def aside(self) -> bool:
        """Return whether the robot makes room for others."""
        return self._aside is not None

    @property
    def cleared(self) -> bool:
        """Return whether the hull is out of the narrow section."""
        return self._gate.cleared

    def reaches_gate(self, within: Duration) -> bool:
        """Return whether the robot drives through a gate and needs at most `within` to its line."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None:
            return False
        way = self._gate.line_m(follower.route) - follower.s
        # The way alone, at full speed, rules it out nearly always: then the turn need not be known.
        return way <= in_seconds(within) * self.arena.shape.speed and self.eta_gate() <= within

    def eta_gate(self) -> Duration:
        """Return how long the robot needs at least to the gate's line; 0 when passed or without a gate."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None or self._gate.passed:
            return 0
        way = self._gate.line_m(follower.route) - follower.s
        return 0 if way <= 0.0 else time_left(self.arena.shape, follower, self._pose, way, self._v)

    def eta_clear(self) -> Duration:
        """Return how long the robot needs at least until it is clear; 0 when it is or without a gate."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None or self._gate.cleared:
            return 0
        way = max(0.0, follower.route.clear_m - follower.s)
        return time_left(self.arena.shape, follower, self._pose, way, self._v)

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
        return estimate_of(self.arena.shape, route, self._gate.line_m(route), turn)

    def plan_shared(self, pose: Pose, goal: Point) -> GridPath | None:
        """Return the part of the way from `pose` to `goal` that the robot shares when it leads (paper IV.D.1)."""
        route = self._route(Point(pose.x, pose.y), goal, (), None, True)
        return None if route is None else shared_part(self.arena, route)

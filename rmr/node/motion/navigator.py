"""Joins planning, following, the speed law and the escapes for one robot.

Each tick: the speed law caps the speed along the path (gate, right of way, silence, queue), the path follower steers,
and the speed law slows its command for the bodies around, which has the last word. When others keep the robot standing,
or another symptom of getting nowhere shows, the first escape that serves returns a manoeuvre (`standoff`): an excursion
to another place, a reverse manoeuvre, or a new route.

A route around parked robots is planned anew when they change: at once while the robot still stands, on the way only
when one of them now obstructs it. Robots parked at the gate or before this one in its queue go first: the route leads
over their places until they have left. The dead do not leave: routes lead around them.
"""

from collections.abc import Collection, Sequence
from math import inf
from typing import Final

from rmr.base.arena import REFERENCE, Arena
from rmr.base.geometry import STILL, Point, Pose, Twist, distance, wrap
from rmr.base.grid_path import GridPath
from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr.node.motion.estimate import time_left
from rmr.node.motion.follow import CLOSE_AHEAD_M, FACED, LOOK_AHEAD_M, Follower, turn_towards
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.goal_queue import WAITING_RADII, is_one_goal, robots_ahead
from rmr.node.motion.grid import PATH_MARGIN_M, discs_around, same_places
from rmr.node.motion.priority import Heard, Standing, order_key, share_of_speed
from rmr.node.motion.queueing import room_for_first
from rmr.node.motion.replanning import is_barred, ordered_route, route_as_if_left
from rmr.node.motion.route import DriveOrder, Route, gated_again, leader_route, still_behind
from rmr.node.motion.rule_switches import RuleSwitches
from rmr.node.motion.speed_control import SHIELD, SpeedControl
from rmr.node.motion.standoff.detector import DeadlockDetector
from rmr.node.motion.standoff.escapes import DeadlockCause, Excursion, Impasse
from rmr.node.motion.standoff.policy import EscapePolicy, check_names
from rmr.node.ports import SeenBody

TURNS_SHARE: Final = 0.5
"""A robot that a wall, or one that stands, slows to less than this share of its speed, or of the reference robot's,
turns off it."""
OFF_TURN: Final = 1.5
"""Turn rate with which it does, rad/s."""
RETRY_S: Final = 0.5
"""Retry interval of planning while there is no route."""


class Navigator:
    """Moves one robot. `step` is called each tick."""

    __slots__ = (
        "_ahead", "_as_if_left", "_driven", "_driving", "_excursion", "_face", "_first_m", "_follower", "_gate",
        "_lost", "_next_try", "_open_way", "_order", "_parked", "_pose", "_queueing", "_replan_due", "_reverse_until",
        "_right_of_way", "_stand_off", "_standing", "_v", "arena", "control", "hearing", "outside", "policy", "replans",
        "robot", "status",
    )  # fmt: skip

    def __init__(self, arena: Arena, robot: int, robots: int = 1, switches: RuleSwitches | None = None) -> None:
        """`robots` is the size of the roster; `switches` says which rules are in force, by default all."""
        self.arena = arena
        self.robot = robot
        self.status = "idle"
        """``idle``, ``moving``, ``arrived`` or ``blocked`` (no route; planned again from time to time)."""
        self.replans = 0
        self.outside = False
        """Whether somebody else drives, by what `heads_for` says, until `stop`."""
        switches = RuleSwitches() if switches is None else switches
        if switches.without:
            check_names(switches.without)
        self._order: DriveOrder | None = None
        self._follower: Follower | None = None
        self._gate = EntryGate(arena.shape, holding=False)
        self._face: float | None = None
        self._driven: Twist | None = None
        self._parked: tuple[Point, ...] = ()
        self._lost: frozenset[Point] = frozenset()
        self._queueing: tuple[Point, ...] = ()
        self._next_try: Instant = 0
        self._replan_due = False
        self._as_if_left = False
        """Whether no route led around all robots when one was planned last."""
        self._open_way = False
        """Whether the way to the goal that was planned last leads through no passage."""
        self._reverse_until: Instant = 0
        self._excursion: Excursion | None = None
        self._right_of_way = 1.0
        """The share of full speed that keeps clear of robots that go first."""
        self._ahead = 0
        """How many robots have the goal first."""
        self._first_m = inf
        """Where on its route the robot waits for those that come to the gate first, metres; infinite: for none."""
        self._v = 0.0
        """The speed of the last command, m/s."""
        self._stand_off = DeadlockDetector(robot, arena.shape)
        self.policy = EscapePolicy(switches)
        self._driving: Sequence[Heard] = ()
        """The newest hellos of driving robots."""
        self._standing = Standing(arena.shape)
        self._pose = Pose(0.0, 0.0, 0.0)
        self.control = SpeedControl(arena, robots, switches)
        self.hearing = self.control.hearing
        """What the others have said about themselves."""

    def go(
        self,
        now: Instant,
        pose: Pose,
        goal: Point,
        *,
        final_heading: float | None = None,
        parked: Sequence[Point] = (),
        lost: Collection[Point] = (),
        shared: GridPath | None = None,
        through_gate: bool = False,
    ) -> bool:
        """Plan a route to `goal` and begin. Returns False, with status blocked, if there is none yet.

        A robot on an excursion ends that first: with another place in the same area it is still in the same jam.
        """
        goes_on = self._order is not None and self.status in ("moving", "blocked")
        aside = goes_on and self._excursion is not None
        if not goes_on:
            self._stand_off.reset()  # else it is the same drive by another route, in the same deadlock
        if not aside:
            self._clear()
            self._gate = EntryGate(self.arena.shape, holding=through_gate)
        self._order = DriveOrder(goal, shared, through_gate)
        self._face = final_heading
        self._park(tuple(parked), frozenset(lost))
        self._pose = pose
        return aside or self._replan(now, pose)

    def gate(self, opens_at: Instant | None, opened: bool, passage: str | None = None) -> None:
        """Set when the slot at the gate begins (None: unknown, wait before it) and whether entering is allowed.

        It concerns the gate of `passage` alone; None: the gate of any.
        """
        gate = self._gate
        gate.opens_at = opens_at
        gate.opened = opened
        if not gate.passed:
            gate.passage = passage
        if self._order is not None:
            self._order = self._order._replace(via=passage)

    def _park(self, parked: tuple[Point, ...], lost: frozenset[Point]) -> None:
        self._parked = parked
        self._lost = lost
        self._queueing = tuple([place for place in parked if place not in lost])

    def update_parked(self, points: Sequence[Point], lost: Collection[Point] = ()) -> None:
        """Set where robots are parked now, and of these the dead; a blocked robot tries again at its next step."""
        parked = tuple(points)
        if same_places(parked, self._parked) and self._lost == frozenset(lost):
            return
        self._park(parked, frozenset(lost))
        self._next_try = 0
        if self._follower is not None and not self._follower.arrived and (self.parked or self._obstructed()):
            self._replan_due = True

    def update_moving(self, now: Instant, rank: int, others: Sequence[Heard]) -> None:
        """Take in the hellos of robots that drive, and this robot's own rank (0: none); a few times a second.

        On a drive without a gate the robot keeps clear of those that go first, seen or not.
        """
        mine = self.hearing.order = order_key(rank, self.robot)
        self._driving = others
        self._standing.update(now, others)
        follower = self._follower
        stands = self._standing.points
        order = self._order
        at = Point(self._pose.x, self._pose.y)
        self._ahead = 0
        self._first_m = inf
        if order is not None and self._excursion is None:
            self._ahead = robots_ahead(order.goal, at, mine, self.arena.shape, others, self._parked)
        # Before and within the bottleneck the schedule decides who goes first, not this rule.
        if follower is None or (follower.route.gate_m is not None and not self._gate.cleared):
            self._right_of_way = 1.0
            self._first_m = self._room_for_first(mine, others)
            return
        first = [other for other in others if other.robot not in stands and order_key(other.rank, other.robot) < mine]
        if not self._ahead:  # of those that drive to one place the queue before it decides
            first = [other for other in first if not is_one_goal(other.goal, self.goal, self.arena.shape)]
        self._right_of_way = share_of_speed(now, follower.route, follower.s, self.arena.shape, first)

    def _room_for_first(self, mine: int, others: Sequence[Heard]) -> float:
        """Return where on its route to the gate the robot waits for those that go there first; infinite: for none."""
        follower = self._follower
        if follower is None or self._gate.passed or self._excursion is not None:
            return inf
        first = [other for other in others if other.rank and order_key(other.rank, other.robot) < mine]
        hold_m = self._gate.hold_line_m(follower.route)
        return room_for_first(follower.route, follower.s, hold_m, self.arena.shape, first)

    def face(self, theta: float) -> None:
        """Turn in place to the heading `theta`, radians."""
        self._clear()
        self._face = theta
        self.status = "moving"

    def drive(self, v: float, w: float) -> None:
        """Drive by hand at `v` m/s and `w` rad/s until another order; stop-if-dangerous still holds."""
        self._clear()
        self._driven = Twist(v, w)
        self.status = "moving"

    def relocate(self, now: Instant, pose: Pose) -> None:
        """Plan the drive under way anew from `pose`: the robot has found out that it is elsewhere."""
        self._pose = pose
        if self._order is not None and self.status in ("moving", "blocked"):
            self._excursion = None
            self._reverse_until = 0
            self._replan(now, pose)

    def stop(self) -> None:
        """Forget every order and stand still."""
        self._clear()
        self.outside = False
        self.status = "idle"

    def _clear(self) -> None:
        self._order = self._follower = self._face = self._driven = self._excursion = None
        self._gate = EntryGate(self.arena.shape, holding=False)
        self._replan_due = self._as_if_left = self._open_way = False
        self._reverse_until = 0
        self._right_of_way = 1.0
        self._ahead = 0
        self._first_m = inf
        self._v = 0.0

    def step(self, now: Instant, pose: Pose, bodies: Sequence[SeenBody], bumped: bool) -> Twist:
        """Return the wheel command of this tick for the estimated `pose`."""
        self._pose = pose
        control = self.control
        control.perceive(now, pose, bodies)
        if self._driven is not None:
            return control.by_hand(self._driven)  # no route: only the rules for bodies apply
        if self.status in ("idle", "arrived") or not self._ready(now, pose):
            return STILL
        follower = self._follower
        if follower is None:
            return self._turn(pose)  # `face`: there is a heading, but no route
        follower.locate(pose)
        excursion = self._excursion
        if excursion is not None and (now >= excursion.until or (follower.arrived and not excursion.stays)):
            self._come_back(now, pose)
            return STILL
        self._gate.locate(follower.route, follower.s, follower.arrived)
        if self._gate.cleared and not follower.arrived and self._goes_on_to_next_gate(now, pose):
            return STILL
        if follower.arrived:
            return self._turn(pose) if excursion is None else STILL
        # A waiting robot does not wish to drive, so the detector of deadlocks misses that it blocks an entrance.
        standing = self._standing.points.values()
        if self._gate.blocks(now, follower.route, follower.s, standing) and self._escape(
            now, pose, DeadlockCause.ENTRANCE
        ):
            return STILL
        if self._reverse_until and now >= self._reverse_until:
            self._end_reverse(now, pose)
            return STILL
        if self._reverse_until and not control.silenced():  # reversing is blind: a silence forbids it
            return control.reverse()
        return self._follow(now, pose, follower, bumped)

    def _end_reverse(self, now: Instant, pose: Pose) -> None:
        """Plan the way around the others from here: they may have followed up, and the old route begins elsewhere."""
        self._reverse_until = 0
        if self._excursion is None and now < self._stand_off.ghosts_until:
            self._stand_off.mark(now, pose, self._others(), self.arena.shape.radius)
            self._replan(now, pose, keep=True)

    def _others(self) -> list[Point]:
        """Return where bodies are now: those seen, and the robots that drive and stand."""
        return self.control.others(self._standing.points.values())

    def _follow(self, now: Instant, pose: Pose, follower: Follower, bumped: bool) -> Twist:
        """Return the command along the path, as fast as the speed law allows; notice when others prevent it."""
        control = self.control
        ahead = 0 if self._excursion is not None else self._ahead
        cap = control.cap(follower, self._gate, self._right_of_way, self._queueing, ahead, self._first_m)
        if self.outside:
            return STILL  # the cap has told the gate whether it is time to leave
        wish = follower.steer(pose, cap)
        allowed = control.slowed(wish)
        if control.law.limited_by == SHIELD and self.remaining_m > LOOK_AHEAD_M:
            off = control.off_wall(pose) if control.leads_to_wall(wish) else control.off_robot(pose)
            if off is not None:
                allowed = self._past(pose, follower, wish, allowed, off)
        # Wheels that turn against a hull get nowhere, so a robot that bumps counts as standing.
        stuck = STILL if bumped else allowed
        # Before its slot a robot may well stand: patience is longer then.
        early = stuck is not wish and not bumped and self._gate.waiting(now, follower.route)
        stand_off = self._stand_off
        more = stand_off.early if early else 0
        if not bumped and control.law.limited_by == SHIELD and control.leads_to_wall(wish) and control.settles(wish):
            more = stand_off.settling
        if stand_off.blocked(now, wish, stuck, more):
            self._escape(now, pose, DeadlockCause.DEADLOCK)
        self._v = allowed.v
        return allowed

    def _past(self, pose: Pose, follower: Follower, wish: Twist, allowed: Twist, off: float) -> Twist:
        """Return the fastest of `allowed` and of commands that keep closer to the path or to the heading than `wish`.

        The arc of pure pursuit cuts corners, and a path may lead along the margin that the shield keeps. Where the
        robot could hardly drive it turns to the side `off`, off what it is near to, until driving leads away from it: a
        turn moves no hull.
        """
        control = self.control
        for ahead_m in CLOSE_AHEAD_M:
            closely = control.slowed(follower.steer_closely(pose, wish.v, ahead_m))
            if closely.v > allowed.v:
                allowed = closely
        straight = control.slowed(Twist(wish.v, 0.0))
        if straight.v > allowed.v:
            allowed = straight
        hardly = TURNS_SHARE * min(wish.v, REFERENCE.speed)
        return Twist(0.0, OFF_TURN * off) if allowed.v < hardly else allowed

    def _ready(self, now: Instant, pose: Pose) -> bool:
        """Return whether there is a route to follow or a heading to face; plan if that is due."""
        if self._order is None:
            return True
        follower = self._follower
        if follower is None:
            return now >= self._next_try and (self._replan(now, pose) or self._leaves_goal(now, pose))
        if not self._replan_due or self._excursion is not None:
            return True  # an excursion ends with a new plan anyway
        # A robot that will stand for long replans later: others will have moved by then, and a plan takes milliseconds.
        if not self._gate.holds_for_long(now, follower.route, follower.s):
            self._replan_due = False
            self._replan(now, pose, keep=True)
        return True

    def heads_for(self) -> Pose | None:
        """Return where another driver is to drive: the end of the route, or the hold line of a gate that is closed.

        None: it is to stand, for it is too early to leave, or the robot is at the line already.
        """
        follower = self._follower
        if not self.outside or self.status != "moving" or follower is None or self._gate.holding:
            return None
        route = follower.route
        s = route.length_m
        if route.gate_m is not None and not self._gate.passed and not self._gate.open_to(route):
            s = min(self._gate.hold_line_m(route), self._first_m)
            if follower.s >= s:
                return None
        elif self._face is not None:
            return Pose(*route.point(s), self._face)
        return Pose(*route.point(s), route.heading(s - LOOK_AHEAD_M))

    def reached(self, target: Pose) -> None:
        """Take in that another driver has come to `target`: the drive ends there, or goes on from the hold line."""
        follower = self._follower
        if follower is not None and distance(target.x, target.y, *follower.route.points[-1]) < LOOK_AHEAD_M:
            follower.arrived = True
            self._face = None

    def waits(self, now: Instant) -> bool:
        """Return whether the robot stands before a gate until its turn."""
        route = self.route
        return route is not None and not self.aside and self._v == 0.0 and self._gate.waiting(now, route)

    def leave_place(self, now: Instant) -> None:
        """Drive to free floor for a while, since another robot needs the place: the order stays."""
        self._escape(now, self._pose, DeadlockCause.ON_A_GOAL)

    def _leaves_goal(self, now: Instant, pose: Pose) -> bool:
        """Begin to drive off another one's goal, if this robot has no route and stands there; return whether it does.

        Else two or more would stand for good on each other's goals.
        """
        reach = 2.0 * self.arena.shape.radius + PATH_MARGIN_M
        stand = self._standing.points
        goals = [other.goal for other in self._driving if other.robot in stand and other.goal is not None]
        if not any(distance(*goal, pose.x, pose.y) < reach for goal in goals):
            return False
        if not self._escape(now, pose, DeadlockCause.ON_A_GOAL):
            return False
        self.status = "moving"
        return True

    def _goes_on_to_next_gate(self, now: Instant, pose: Pose) -> bool:
        """Plan the rest of the drive behind a passage, where there are others; return whether that was due.

        Without a route the robot stands: the old one would lead it past the gate of the next passage. A robot that has
        backed out by the entrance by which it came has the passage still before it, and its turn.
        """
        order = self._order
        left = self._gate.passage
        if order is None or left is None or left in order.behind or not order.through_gate:
            return False
        if self._gate.backed_out(self.arena.passage(left), pose):
            self._gate.step_back()
            self._replan(now, pose)
            return True
        behind = order.behind | {left}
        self._order = order._replace(behind=behind, shared=None)
        if all(passage.name in behind for passage in self.arena.passages):
            return False
        self._excursion = None
        self._gate = EntryGate(self.arena.shape, holding=False)
        self._replan(now, pose)
        return True

    def _turn(self, pose: Pose) -> Twist:
        """Turn to the heading that was ordered; without one the robot has arrived."""
        error = 0.0 if self._face is None else wrap(self._face - pose.theta)
        if abs(error) < FACED:
            self.status = "arrived"
            return STILL
        return Twist(0.0, turn_towards(error, self.arena.shape))

    def _escape(self, now: Instant, pose: Pose, symptom: DeadlockCause) -> bool:
        """Begin the first escape that applies; return whether there is one."""
        assert self._order is not None
        stand_off = self._stand_off
        arena = self.arena
        others = self._others()
        endures = False
        if symptom is DeadlockCause.DEADLOCK:
            stand_off.mark(now, pose, others, arena.shape.radius)
        # A deadlock that endures, or an excursion without a way back, is a jam: then the robot retreats or backs out.
        if symptom in (DeadlockCause.DEADLOCK, DeadlockCause.NO_WAY_BACK):
            walks = symptom is DeadlockCause.DEADLOCK and self._excursion is not None
            endures = stand_off.endures(now, pose, self._order.goal, walks=walks)
        manoeuvre = self.policy.choose(
            Impasse(
                symptom=symptom,
                now=now,
                robot=self.robot,
                arena=arena,
                at=Point(pose.x, pose.y),
                goal=self._order.goal,
                parked=self._parked,
                others=others,
                driving=self._driving,
                route=self.route,
                gate=self._gate,
                tries=stand_off.tries,
                endured=stand_off.walks if endures else 0,
                replan=lambda: self._replan(now, pose, keep=True),
            )
        )
        if manoeuvre is None:
            return False
        if manoeuvre.excursion is not None:
            self._excursion = manoeuvre.excursion
            self._follower = Follower(manoeuvre.excursion.route, arena.shape)
            self._first_m = inf
        if manoeuvre.reverse:
            self._reverse_until = now + manoeuvre.reverse
        return True

    def _come_back(self, now: Instant, pose: Pose) -> None:
        """Drive to the goal again. If others block the route, wait for a bounded time: they may yield too."""
        found = self._replan(now, pose, keep=True)
        follower = self._follower
        assert follower is not None
        # Without a route it stands at the end of its excursion until the next try.
        self._excursion = None if found else Excursion(follower.route, self._next_try, stays=True)
        if not found:
            self._escape(now, pose, DeadlockCause.NO_WAY_BACK)

    def _obstructed(self) -> bool:
        """Return whether a parked robot now stands on the rest of the route."""
        follower = self._follower
        start = Point(self._pose.x, self._pose.y)
        if follower is None or self._order is None:
            return False
        discs = discs_around(self._parked, self.arena.shape.radius, start, self._order.goal)
        return follower.route.meets(follower.s, discs)

    def _replan(self, now: Instant, pose: Pose, *, keep: bool = False) -> bool:
        """Plan from `pose`; return whether there is a route. With `keep` the old route is kept if there is no other."""
        assert self._order is not None
        self.replans += 1
        self._next_try = now + seconds(RETRY_S)
        start = Point(pose.x, pose.y)
        if self._order.behind:
            self._order = self._order._replace(behind=still_behind(self.arena, self._order.behind, start))
        around = (*self._parked, *self._stand_off.around(now, self._standing.points.values()))
        order = self._ordered(self._order)
        # Robots that go first, in the queue, are waited for and not driven around.
        route = ordered_route(self.arena, start, order, around)
        self._as_if_left = route is None
        if route is None:
            route = route_as_if_left(self.arena, start, order, self._parked, around, at_goal=keep)
        if keep and route is not None and (self._loses_turn(route) or self._queues_for_others(route, around)):
            return False
        if route is None:
            if not keep:
                self._follower = None
                self.status = "blocked"
            return False
        # A route that begins inside does not pass the gate behind it. Until the robot is clear, it still has its turn.
        inside = self.arena.passage(self._gate.passage)
        if inside is not None and self._gate.passed and not self._gate.cleared:
            route = gated_again(self.arena, inside, route)
        self._open_way = route.gate_m is None
        self._follower = Follower(route, self.arena.shape)
        self._first_m = inf
        self.status = "moving"
        return True

    def _ordered(self, order: DriveOrder) -> DriveOrder:
        """Return `order` as a plan needs it that is made now."""
        return order._replace(through_gate=order.through_gate and not self._gate.passed, lost=self._lost)

    def _loses_turn(self, route: Route) -> bool:
        """Return whether a robot that may enter a passage would leave it for another one, or for none, by `route`."""
        gate = self._gate
        bound = gate.opened and not gate.passed and self.arena.has_shared_passages
        if not bound or gate.passage is None or gate.passage in self.behind:
            return False
        return route.passage != gate.passage

    def _queues_for_others(self, route: Route, around: tuple[Point, ...]) -> bool:
        """Return whether `route` leads to a passage, from a way without any, around robots that will drive on.

        The turn is still to come: a crowd before a wide door would stand in it, each waiting for the narrow one.
        """
        return self._open_way and route.gate_m is not None and around != self._parked

    @property
    def may_be_barred(self) -> bool:
        """Return whether the newest plan has found no route around all others: `barred` knows whether they stand."""
        return self._order is not None and (self._as_if_left or self.status == "blocked")

    def barred(self, pose: Pose) -> bool:
        """Return whether robots that stand bar every way from `pose` to the goal.

        Then the robot stands, or follows a route as if they had left, to and fro: that is no way.
        """
        order = self._order
        if order is None or not self.may_be_barred:
            return False
        return is_barred(self.arena, Point(pose.x, pose.y), self._ordered(order), self._parked)

    # -- state and estimates ---------------------------------------------------------------------------------

    @property
    def goal(self) -> Point | None:
        """Return the goal of the present order."""
        return None if self._order is None else self._order.goal

    @property
    def behind(self) -> frozenset[str]:
        """Return the names of the passages that the drive under way has behind it."""
        return frozenset() if self._order is None or self.status != "moving" else self._order.behind

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
        """Return the remaining length of the route in metres; 0 without a route."""
        return 0.0 if self._follower is None else max(0.0, self._follower.route.length_m - self._follower.s)

    @property
    def waits_for_goal(self) -> Point | None:
        """Return the goal for which the robot queues, since others have it first; None: for none."""
        near = self.remaining_m < WAITING_RADII * self.arena.shape.radius
        return self.goal if self._ahead and near else None

    @property
    def passed_gate(self) -> bool:
        """Return whether the robot has gone beyond the gate's stopping place during this drive."""
        return self._gate.passed

    def leads_back(self, place: Point) -> bool:
        """Return whether a robot that is in a passage, or has passed one, would pass one on its way to `place`.

        One that has no passage before it where only jobs of one event take turns is taken for such a robot: its drive
        would ask for no turn.
        """
        route = self.route
        order = self._order
        gate = self._gate
        before = route is not None and route.gate_m is not None and not (route.within or gate.passed)
        if route is None or order is None or before or not self.arena.passages:
            return False
        start = Point(self._pose.x, self._pose.y)
        to = leader_route(self.arena, start, place, (), through_gate=order.through_gate)
        passage = None if to is None else self.arena.passage(to.passage)
        if to is None or passage is None or passage.one_way:
            return False  # of a passage with one entrance it is not known on which side of it a place lies
        if gate.cleared or order.behind:
            return True
        if route.gate_m is None and not self.arena.has_shared_passages:
            return True
        return route.gate_m is not None and to.way != route.way

    @property
    def aside(self) -> bool:
        """Return whether the robot is on an excursion."""
        return self._excursion is not None

    @property
    def cleared(self) -> bool:
        """Return whether the hull is out of the narrow section."""
        return self._gate.cleared

    def reaches_gate(self, within: Duration) -> bool:
        """Return whether the robot drives through a gate and needs at most `within` to its line."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None:
            return False
        way = self._gate.commit_line_m(follower.route) - follower.s
        # The distance alone, at full speed, rules it out nearly always. The costlier estimate follows only otherwise.
        return way <= in_seconds(within) * self.arena.shape.speed and self.eta_gate() <= within

    def eta_gate(self) -> Duration:
        """Return the least time to the gate's commit line; 0 if it is passed, or without a gate."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None or self._gate.passed:
            return 0
        way = self._gate.commit_line_m(follower.route) - follower.s
        return 0 if way <= 0.0 else time_left(self.arena.shape, follower, self._pose, way, self._v)

    def eta_clear(self) -> Duration:
        """Return the least time until the robot is clear of the narrow section; 0 if it is, or without a gate."""
        follower = self._follower
        if follower is None or follower.route.gate_m is None or self._gate.cleared:
            return 0
        way = max(0.0, follower.route.clear_m - follower.s)
        return time_left(self.arena.shape, follower, self._pose, way, self._v)

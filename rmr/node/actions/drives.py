"""The provided actions that drive somewhere.

Like `rmr.node.actions.handle` this module is never compiled.
"""

import math
from typing import Final

from rmr.base.arena import Area
from rmr.base.geometry import Point, distance
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, Instant, seconds
from rmr.node.actions.dispatcher import Permit
from rmr.node.actions.handle import ActionFailed, Pause
from rmr.node.actions.node_handle import LocatedSteps, NodeHandle
from rmr.node.config import STUCK
from rmr.node.motion.grid import segment_clearance
from rmr.node.motion.obstruction import near_polyline, robots_named, robots_near, solid_between, what_bars
from rmr.node.motion.straight_drive import Straight
from rmr.node.parts import ActionHost

LOOK_EVERY: Final = seconds(1)
"""How often a robot looks whether others that stand bar its way."""
FREE_AFTER: Final = seconds(5)
"""They bar it no longer when no look has found so for this long."""


class Drive(LocatedSteps):
    """A drive to a goal, until it is idle.

    It fails when there has been no way for too long, whatever the robot tries meanwhile.
    """

    __slots__ = ("_barred", "_goal", "_heading", "_looks", "_permit")

    def __init__(self, robot: NodeHandle) -> None:
        super().__init__(robot)
        self._heading: float | None = None
        self._permit: Permit | None = None
        self._looks = Pause(condition=self._ends)

    def goal(self) -> Point:
        """Return where to drive to; the robot knows its pose."""
        raise NotImplementedError

    def is_idle(self) -> bool:
        """Return whether there is nothing to drive for any more."""
        return False

    def begin(self) -> Pause | None:
        """Set out."""
        node = self._robot.node
        self._goal = self.goal()
        node.depart(self._goal, final_heading=self._heading, permit=self._permit)
        self._drives = True
        self._barred = BarredDrive(node)
        return self.go_on()

    def _ends(self) -> bool:
        node = self._robot.node
        drives = node.motion.status in ("moving", "blocked") and node.pose is not None
        return not drives or self.is_idle() or self._barred.due

    def go_on(self) -> Pause | None:
        """Look how the drive goes. Raises ActionFailed."""
        node = self._robot.node
        if self.is_idle() or (node.motion.status == "arrived" and not node.goes_on()):
            return None
        self._barred.look(node.motion.goal or self._goal, before_turn=self._robot.waits_for_turn)
        return self._looks


class Lasting:
    """For how long something has been found at each look, moments aside in which it was not."""

    __slots__ = ("_found_at", "since")

    def __init__(self) -> None:
        self.since: Instant | None = None
        self._found_at: Instant = 0

    def note(self, now: Instant, found: bool) -> Duration:
        """Take in a look; return for how long it has been found, 0 if it is not."""
        if found:
            self._found_at = now
            self.since = now if self.since is None else self.since
            return now - self.since
        if self.since is not None and now - self._found_at > FREE_AFTER:
            self.since = None
        return 0


class BarredDrive:
    """Looks whether robots that stand bar the way of one drive, which then fails: the living, or the dead alone.

    To and fro before a body the way may seem free for a moment: so near to the start margins are less.
    """

    __slots__ = ("_by_dead", "_by_standing", "_look_at", "_node", "_on_goal", "_waited_until")

    def __init__(self, node: ActionHost) -> None:
        self._node = node
        self._by_dead = Lasting()
        self._by_standing = Lasting()
        self._look_at: Instant = 0
        """When to look next."""
        self._on_goal: int | None = None
        """The robot that stood on the goal last."""
        self._waited_until: Instant = 0
        """When it was not yet the robot's turn, at the last such look."""

    @property
    def due(self) -> bool:
        """Whether it is time to look again: there is a reason to, or was at the last look."""
        node = self._node
        return node.now >= self._look_at and (
            self._by_dead.since is not None
            or self._by_standing.since is not None
            or node.motion.may_be_barred
            or bool(node.peers.lost(node.now))
        )

    def look(self, goal: Point, *, before_turn: bool) -> None:
        """Look whether there is a way to `goal`, if that is due.

        Raises ActionFailed when the dead have barred the way for STUCK, or those that stand: `before_turn` for that
        long for each robot of the roster, for those that go first may be in its way, and then anew.
        """
        if not self.due:
            return
        node = self._node
        now = node.now
        for lasting in (self._by_dead, self._by_standing):
            if lasting.since is not None and now - self._look_at > FREE_AFTER:
                # The robot itself was stopped. It heard nobody meanwhile, so this time says nothing of the others.
                lasting.since += now - self._look_at
        self._look_at = now + LOOK_EVERY
        node.blocked = node.barred_by_lost(goal)
        told = self._by_dead.since is not None
        dead_for = self._by_dead.note(now, bool(node.blocked))
        if node.blocked and not told:
            node.trace(now, "blocked", reason=node.blocked)
        if dead_for > STUCK:
            raise ActionFailed(f"no way there: {node.blocked}")
        pose = node.pose
        self._note_goal(goal)
        barred_for = self._by_standing.note(now, pose is not None and node.motion.barred(pose))
        if before_turn:
            self._waited_until = now
            allowed = STUCK * len(node.config.roster)
        else:
            barred_for = min(barred_for, now - self._waited_until)
            allowed = STUCK
        # Inside a passage a robot drives on: where it stood for another turn, nobody could pass.
        inside = node.motion.passed_gate and not node.motion.cleared
        if barred_for > allowed and not inside:
            raise ActionFailed(_no_way(node, goal))

    def _note_goal(self, goal: Point) -> None:
        """Begin anew when another robot than before stands on the goal: they come and go, and none keeps it."""
        node = self._node
        reach = 2.0 * node.arena.shape.radius
        on_goal = [robot for robot, at in node.peers.standing(node.now).items() if distance(*at, *goal) < reach]
        if on_goal and on_goal[0] != self._on_goal:
            self._by_standing = Lasting() if self._on_goal is not None else self._by_standing
            self._on_goal = on_goal[0]


def _no_way(node: ActionHost, goal: Point) -> str:
    """Return why a drive to `goal` has failed, with who or what is in the way."""
    pose = node.pose
    bars = "" if pose is None else what_bars(node.arena, Point(pose.x, pose.y), goal, node.peers.standing(node.now))
    return f"no way there: {bars}" if bars else "no way there"


class MoveTo(Drive):
    """A drive to an area."""

    __slots__ = ("_area", "_area_name")

    def __init__(self, robot: NodeHandle, area_name: str) -> None:
        super().__init__(robot)
        self._area_name = area_name
        self._area: Area | None = None

    def prepare(self) -> bool:
        """Look for the area. Raises ActionFailed."""
        self._area = self._robot.node.arena.area(self._area_name)
        if self._area is None:
            raise ActionFailed(f"no area is called {self._area_name}")
        return True

    def goal(self) -> Point:
        """Take a place: only a robot with a pose does, for what others say may send it to another one."""
        assert self._area is not None
        self._permit = self._robot.permit
        return self._robot.node.take_place(self._area, self._permit)


class Navigate(MoveTo):
    """A drive to an area by the body's own driver, if it has one: it ends and fails as that does."""

    __slots__ = ("_navigates",)

    def __init__(self, robot: NodeHandle, area_name: str) -> None:
        super().__init__(robot, area_name)
        self._navigates = False

    def begin(self) -> Pause | None:
        """Set out."""
        self._navigates = self._robot.node.let_navigate()
        return super().begin()

    def _ends(self) -> bool:
        return bool(self._failure) or super()._ends()

    @property
    def _failure(self) -> str:
        return self._robot.node.navigation_failure if self._navigates else ""

    def go_on(self) -> Pause | None:
        """Look how the drive goes. Raises ActionFailed."""
        if self._failure:
            raise ActionFailed(self._failure)
        return super().go_on()


class LineUp(Drive):
    """A drive to a place of a queue."""

    __slots__ = ("_area_name", "_place", "_spot")

    def __init__(self, robot: NodeHandle, area_name: str, place: int) -> None:
        super().__init__(robot)
        self._area_name = area_name
        self._place = place

    def prepare(self) -> bool:
        """Look for the place. Raises ActionFailed."""
        robot = self._robot
        place = self._place
        if robot.needs_no_queue():
            return False
        area = robot.node.arena.area(self._area_name)
        if area is None or not area.queue:
            raise ActionFailed(f"no area with a queue is called {self._area_name}")
        if place < 1:
            raise ActionFailed(f"there is no place {place} in a queue; the first is 1")
        self._spot = spot = area.queue[min(place, len(area.queue)) - 1]
        ahead = area.queue[0] if place > 1 else area.places[0]
        self._heading = _heading(spot, ahead) if spot != ahead else _queue_heading(area.queue)
        return True

    def goal(self) -> Point:
        """Return the place."""
        return self._spot

    def is_idle(self) -> bool:
        """Return whether the robot need not line up."""
        return self._robot.needs_no_queue()


def _heading(a: Point, b: Point) -> float:
    return math.atan2(b.y - a.y, b.x - a.x)


def _queue_heading(queue: tuple[Point, ...]) -> float | None:
    return _heading(queue[1], queue[0]) if len(queue) > 1 else None


class GoTo(Drive):
    """A drive to a point."""

    __slots__ = ("_point",)

    def __init__(self, robot: NodeHandle, x: float, y: float) -> None:
        super().__init__(robot)
        self._point = Point(x, y)

    def goal(self) -> Point:
        """Return the point."""
        return self._point


class ReachDrive(LocatedSteps):
    """A straight drive by the clock."""

    __slots__ = ("_begins", "_ends", "_goal", "_overdue", "_pose", "_start", "_straight")

    def __init__(self, robot: NodeHandle, x: float, y: float, begins_s: float, ends_s: float) -> None:
        super().__init__(robot)
        self._goal = Point(x, y)
        self._begins = begins_s
        self._ends = ends_s

    def begin(self) -> Pause | None:
        """Look whether the way is free. Raises ActionFailed."""
        node = self._robot.node
        pose = node.pose
        started = node.now
        assert pose is not None
        self._pose = pose
        self._start = start = Point(pose.x, pose.y)
        goal = self._goal
        begins = _instant(self._begins)
        ends = _instant(self._ends)
        # Tolerance of the distance to an obstacle: a robot beside one may seem to stand this far inside it.
        if segment_clearance(node.arena, start, goal) < node.arena.shape.radius - 0.01:
            bars = solid_between(node.arena, start, goal) or "an obstacle"
            raise ActionFailed(f"{bars} is in the straight way there")
        self._straight = Straight(start, goal, begins, ends, node.arena.shape)
        # Lateness at which a straight drive fails: it does not drive around what is in its way.
        self._overdue = max(ends, started + ends - begins) + seconds(5.0)
        self._drives = True
        return self._steer()

    def go_on(self) -> Pause | None:
        """Steer by the newest pose. Raises ActionFailed."""
        pose = self._robot.node.pose
        assert pose is not None
        self._pose = pose
        return self._steer()

    def _steer(self) -> Pause | None:
        node = self._robot.node
        if self._straight.ended(self._pose) and node.now >= _instant(self._ends) - scale_of(node.arena.shape).ramp:
            self.close()
            if self._straight.astray(self._pose):
                raise ActionFailed("the robot has missed the point")
            return None
        if node.now > self._overdue:
            bars = _in_straight_way(node, self._start, self._goal) or "something is"
            raise ActionFailed(f"{bars} in the straight way there")
        twist = self._straight.steer(node.now, self._pose)
        self._robot.drive(twist.v, twist.w)
        return Pause(condition=_at_once)


def _at_once() -> bool:
    return True


def _in_straight_way(node: ActionHost, start: Point, goal: Point) -> str:
    """Return who is in the straight way, subject and verb: those that stand there, else those that drive there."""
    standing = robots_near(node.arena, (start, goal), node.peers.standing(node.now))
    if standing:
        return standing
    places = {heard.robot: Point(heard.pose.x, heard.pose.y) for heard in node.peers.driving(node.now)}
    driving = near_polyline(node.arena, (start, goal), places)
    return robots_named(driving, "drive") if driving else ""


def _instant(at_s: float) -> Instant:
    """Return an instant of lab time, from seconds of any size."""
    # Larger numbers are cut off: no lab runs for so long.
    return seconds(min(max(0.0, at_s), 1e9))

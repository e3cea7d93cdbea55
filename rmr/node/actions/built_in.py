"""The actions that every robot provides, written as a user would write them.

Like `rmr.node.actions.handle` this module is never compiled.
"""

import math
from collections.abc import Callable
from typing import Final

from rmr.base.geometry import Point
from rmr.base.time import Instant, milliseconds, seconds
from rmr.base.values import Symbol
from rmr.bytecode.provided import ACTIONS
from rmr.node.actions.dispatcher import Handler, Permit, RunningAction
from rmr.node.actions.handle import ActionFailed, Pause, RobotHandle, wait
from rmr.node.motion.grid import off_goal, segment_clearance
from rmr.node.motion.obstruction import near_polyline, robots_named, robots_near, solid_between, what_bars
from rmr.node.motion.straight_drive import RAMP, Straight
from rmr.node.parts import ActionHost

FAILURE_REPEATS: Final = 3
"""Copies of a failure broadcast, which is not acknowledged: at 20 % loss one of three arrives in 99 of 100 cases."""
STUCK_S: Final = 20.0
"""Time without a way, or without a known position, after which a drive fails."""
LOOK_EVERY: Final = seconds(1)
"""How often a robot without a way looks whether the dead bar it."""
FREE_AFTER: Final = seconds(5)
"""The dead bar the way no longer when no look has found so for this long."""
NEAR_M: Final = 1.0
"""Distance to the goal from which a robot that stands on it counts as blocking it."""
OVERDUE_S: Final = 5.0
"""Lateness at which a straight drive fails: it does not drive around what is in its way."""
LAST_S: Final = 1e9
"""Largest instant of a program, seconds; larger numbers are cut to it. No lab runs for so long."""
CLOSE_M: Final = 0.01
"""Tolerance of the distance to an obstacle: a robot beside one may seem to stand this far inside it."""


class NodeHandle(RobotHandle):
    """What rmr's own actions may do beyond a user's."""

    __slots__ = ("_action",)

    def __init__(self, node: ActionHost, action: RunningAction) -> None:
        super().__init__(lambda: node.now, node, action)
        self._action = action

    @property
    def node(self) -> ActionHost:
        """The robot."""
        node: ActionHost = self._node
        return node

    def needs_no_queue(self) -> bool:
        """Return whether the robot need not line up: it has entered since, wasted a slot, or is beyond."""
        return self.node.needs_no_queue(self._action.derived)

    @property
    def permit(self) -> Permit | None:
        """The crossing by which the action goes."""
        return self._action.permit

    @property
    def missed(self) -> int | None:
        """The assertion whose missed deadline derived the action."""
        return self._action.missed


async def _drive(
    robot: NodeHandle,
    goal: Point,
    *,
    final_heading: float | None = None,
    gated: bool = False,
    taken: Callable[[], bool] | None = None,
    idle: Callable[[], bool] | None = None,
) -> None:
    """Drive to `goal` until the drive is `idle`.

    Raises ActionFailed when there has been no way, or the goal has been `taken`, for too long; before its turn that is
    longer by as much for each other robot, for those that go first may be in its way until then.
    """
    node = robot.node
    permit = robot.permit if gated else None
    await _located(robot)
    node.depart(goal, final_heading=final_heading, permit=permit)
    try:
        await _under_way(robot, goal, permit, taken, idle)
    finally:  # a handler of which this is one step may go on
        node.halt()


async def _under_way(
    robot: NodeHandle,
    goal: Point,
    permit: Permit | None,
    taken: Callable[[], bool] | None,
    idle: Callable[[], bool] | None,
) -> None:
    """Wait for the end of a drive to `goal` that has begun. Raises ActionFailed as `_drive` does."""
    node = robot.node
    navigator = robot.node.motion
    blocked_since: Instant | None = None
    barred = BarredDrive(node, goal)

    def is_taken() -> bool:
        return taken is not None and taken()

    def is_idle() -> bool:
        return idle is not None and idle()

    def ends() -> bool:
        return navigator.status != "moving" or blocked_since is not None or is_taken() or is_idle() or barred.due

    looks = Pause(condition=ends)
    while navigator.status != "arrived" and not is_idle():
        barred.look()
        if navigator.status == "blocked" or is_taken():
            blocked_since = blocked_since or node.now
            robots = len(node.config.roster) if permit is not None and permit.waits else 1
            if node.now - blocked_since > seconds(STUCK_S) * robots:
                raise ActionFailed(_no_way(node, goal))
        else:
            blocked_since = None
        await looks


class BarredDrive:
    """Looks whether the dead bar the way of one drive, which then fails although others may be in the way as well."""

    __slots__ = ("_barred_at", "_goal", "_look_at", "_node", "_since")

    def __init__(self, node: ActionHost, goal: Point) -> None:
        self._node = node
        self._goal = goal
        self._since: Instant | None = None
        """Since when they bar it."""
        self._barred_at: Instant = 0
        self._look_at: Instant = 0

    @property
    def due(self) -> bool:
        """Whether it is time to look again: there are dead robots, or were at the last look."""
        node = self._node
        return node.now >= self._look_at and (self._since is not None or bool(node.peers.lost(node.now)))

    def look(self) -> None:
        """Look, if that is due. Raises ActionFailed when they have barred the way for STUCK_S."""
        if not self.due:
            return
        node = self._node
        now = node.now
        self._look_at = now + LOOK_EVERY
        node.blocked = node.barred_by_lost(self._goal)
        if not node.blocked:
            # To and fro before a body the way may seem free for a moment: so near to the start margins are less.
            if self._since is not None and now - self._barred_at > FREE_AFTER:
                self._since = None
            return
        self._barred_at = now
        if self._since is None:
            self._since = now
            node.trace(now, "blocked", reason=node.blocked)
        if now - self._since > seconds(STUCK_S):
            raise ActionFailed(f"no way there: {node.blocked}")


def _no_way(node: ActionHost, goal: Point) -> str:
    """Return why a drive to `goal` has failed, with who or what is in the way."""
    pose = node.pose
    bars = "" if pose is None else what_bars(node.arena, Point(pose.x, pose.y), goal, node.peers.standing(node.now))
    return f"no way there: {bars}" if bars else "no way there"


async def _located(robot: NodeHandle) -> None:
    """Wait until the robot knows where it is. Raises ActionFailed when it does not find out."""
    node = robot.node
    if node.pose is None:
        await Pause(node.now + seconds(STUCK_S), lambda: node.pose is not None)
    if node.pose is None:
        raise ActionFailed("the robot does not know where it is")


async def moveto(robot: NodeHandle, area_name: str) -> None:
    """Drive to an area: the robot's own place of a slotted one, a free spot of a box, the point otherwise."""
    area = robot.node.arena.area(area_name)
    if area is None:
        raise ActionFailed(f"no area is called {area_name}")
    await _located(robot)  # a place is taken only by a robot with a pose: what others say may send it to another one
    await _drive(robot, robot.node.take_place(area, robot.permit), gated=True)


async def lineup(robot: NodeHandle, area_name: str, place: int) -> None:
    """Drive to the `place`-th place (from 1) of an area's queue and face the way it moves.

    A later `lineup` takes over from this one at once: the robot's turn has changed while it was on its way. It is over
    as soon as the robot has its turn, or has let one pass for it could not get there: then it no longer lines up.
    """
    if robot.needs_no_queue():
        return
    area = robot.node.arena.area(area_name)
    if area is None or not area.queue:
        raise ActionFailed(f"no area with a queue is called {area_name}")
    if place < 1:
        raise ActionFailed(f"there is no place {place} in a queue; the first is 1")
    spot = area.queue[min(place, len(area.queue)) - 1]
    ahead = area.queue[0] if place > 1 else area.places[0]
    heading = _heading(spot, ahead) if spot != ahead else _queue_heading(area.queue)
    await _drive(robot, spot, final_heading=heading, idle=robot.needs_no_queue)


def _heading(a: Point, b: Point) -> float:
    return math.atan2(b.y - a.y, b.x - a.x)


def _queue_heading(queue: tuple[Point, ...]) -> float | None:
    return _heading(queue[1], queue[0]) if len(queue) > 1 else None


async def goto(robot: NodeHandle, x: float, y: float) -> None:
    """Drive to a point of the floor, metres.

    The places of an area are assigned; a point is not, so another robot may stand there permanently. Then a robot that
    is near gives up.
    """
    node = robot.node
    goal = Point(x, y)

    def taken() -> bool:
        if not 0.0 < node.motion.remaining_m < NEAR_M:
            return False
        parked = node.peers.parked(node.now)
        return len(off_goal(parked, goal, node.arena.shape.radius)) < len(parked)

    await _drive(robot, goal, taken=taken)


async def reach(robot: NodeHandle, x: float, y: float, begins_s: float, ends_s: float) -> None:
    """Drive straight to a point of the floor, metres, leaving and arriving at instants of lab time, seconds.

    It turns before it leaves. Several robots that do so keep apart on certain conditions
    (`rmr.node.motion.straight_drive`).
    """
    node = robot.node
    await _located(robot)
    pose = node.pose
    started = node.now
    assert pose is not None
    start = Point(pose.x, pose.y)
    goal = Point(x, y)
    begins = _instant(begins_s)
    ends = _instant(ends_s)
    if segment_clearance(node.arena, start, goal) < node.arena.shape.radius - CLOSE_M:
        raise ActionFailed(f"{solid_between(node.arena, start, goal) or 'an obstacle'} is in the straight way there")
    drive = Straight(start, goal, begins, ends, node.arena.shape)
    overdue = max(ends, started + ends - begins) + seconds(OVERDUE_S)
    try:
        while not (drive.ended(pose) and node.now >= ends - RAMP):
            if node.now > overdue:
                raise ActionFailed(f"{_in_straight_way(node, start, goal) or 'something is'} in the straight way there")
            twist = drive.steer(node.now, pose)
            robot.drive(twist.v, twist.w)
            await Pause(condition=lambda: True)
            pose = node.pose or pose
    finally:
        node.halt()
    if drive.astray(pose):
        raise ActionFailed("the robot has missed the point")


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
    return seconds(min(max(0.0, at_s), LAST_S))


async def face(robot: NodeHandle, degrees: float) -> None:
    """Turn to a heading, degrees counter-clockwise from the x axis."""
    navigator = robot.node.motion
    await _located(robot)
    navigator.face(math.radians(math.fmod(degrees, 360.0)))
    try:
        await Pause(condition=lambda: navigator.status == "arrived")
    finally:
        robot.node.halt()


async def stop(_robot: NodeHandle) -> None:
    """Stop the wheels; the dispatcher has done so already."""


async def broadcast(robot: NodeHandle) -> None:
    """Tell every robot in range that a deadline was missed (paper III.E)."""
    for _ in range(FAILURE_REPEATS):
        robot.node.broadcast_failure(robot.missed)
        await Pause(robot.node.now + milliseconds(100))


async def say(robot: NodeHandle, text: str) -> None:
    """Write `text` into the trace."""
    robot.say(text)


async def light(robot: NodeHandle, colour: Symbol) -> None:
    """Show a colour."""
    robot.node.trace(robot.node.now, "light", colour=str(colour))


HANDLERS: Final[dict[str, Handler]] = {
    handler.run.__name__: handler
    for handler in (
        Handler("moveto", moveto, wheels=True, to_area=True),
        Handler("lineup", lineup, wheels=True, takes_over=True),
        Handler("goto", goto, wheels=True),
        Handler("reach", reach, wheels=True),
        Handler("face", face, wheels=True),
        Handler("stop", stop, at_once=True),
        Handler("wait", wait),
        Handler("broadcast", broadcast),
        Handler("say", say),
        Handler("light", light),
    )
}
"""By the names that the rows of `rmr.bytecode.provided.ACTIONS` give to handlers."""

PROVIDED: Final[dict[str, Handler]] = {name: HANDLERS[action.handler] for name, action in ACTIONS.items()}
"""By action."""

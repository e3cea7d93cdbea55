"""Rule of liveness: when all faults are over, each robot with something to do makes progress.

A robot makes progress when it moves away by its own width (motion to and fro is none), when its machine reports
anything but a missed deadline, while one of its actions sleeps for a second or longer, or when other robots use what it
waits for: an event, by entering or by progress inside; the goal that they have first, by coming there or leaving it.

A robot that drives, or waits for its turn, and has made no progress for `STILL` stands still. So do all robots together
when none has made progress for so long and none waits for a time. A lab without a finish fact has nothing to do.

A robot that moves may get nowhere as well: to and fro, or from one way to another. So may one whose program orders
anew each drive that has failed. So each drive to a goal also has to near it, whatever the machine reports; a drive that
follows a failed one to the same goal goes on with it. Hence a drive arrives, is given up, or is told.
"""

import math
from dataclasses import dataclass, field
from typing import Final

from rmr.base.geometry import Point, distance
from rmr.base.time import NEVER, NS_PER_S, Duration, Instant, in_seconds, seconds
from rmr.coord.events import Entered
from rmr.node.actions.action_log import ActionEnded
from rmr.node.actions.dispatcher import INTERRUPTED, RunningAction
from rmr.node.crossing.phases import Inside
from rmr.node.motion.astar import plan
from rmr.node.motion.hindrance import hindrance_words
from rmr.node.motion.obstruction import closest_solid, robots_named
from rmr.node.standstill import Motion, motion_state, neighbourhood
from rmr.vm.machine_events import FactSent, GoalAchieved, JobFinished, RuleFired
from rmr_sim.checkers.run_view import RecentTable, RunView

STANDS_STILL = "stands still"
NO_NEARER = "no nearer"
"""The names of the two checks."""
STILL: Duration = seconds(30)
"""Time without progress: longer than a drive without a way takes to fail (20 s), and than a silent robot is presumed
inside (10 s)."""
EVERY: Duration = NS_PER_S
"""Period of the check. An action that sleeps for less may be polling, and counts as no progress."""


class ProgressChecker:
    """Checks the progress of all robots once a second."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._look_at: Instant = 0
        world = view.simulation.world
        self._where = {robot: (pose.x, pose.y) for robot in view.robots for pose in [world.pose(robot)]}
        self._progress_at: dict[int, Instant] = dict.fromkeys(view.robots, 0)
        self._nearings = Nearings(view)
        self._used: RecentTable[bytes, Instant] = RecentTable()
        """By event, the last entry or the last progress of a robot inside."""
        self._goal_users: dict[int, tuple[Point, frozenset[int]]] = {}
        """By robot, the goal for which it waits and who is there."""
        self._goal_used: dict[int, Instant] = {}
        """By robot, when others came to the goal for which it waits, or left it, for the last time."""
        self._waited: dict[int, Instant] = {}
        """By robot, when others used what it waited for, for the last time."""
        for kind in (RuleFired, FactSent, GoalAchieved, JobFinished):
            view.subscribe(kind, self._reported)
        view.subscribe(Entered, self._entered)

    def _reported(self, robot: int, now: Instant, _event: object) -> None:
        self._progress_at[robot] = now

    def _entered(self, robot: int, now: Instant, entered: Entered) -> None:
        self._progress_at[robot] = self._used[entered.group_id] = now

    def __call__(self, now: Instant) -> None:
        """Check all robots, once a second."""
        if now < self._look_at:
            return
        self._look_at = now + EVERY
        view = self._view
        for robot in view.robots:
            if view.alive(robot):
                self._look_at_drive(robot, now)
        busy = [robot for robot in view.robots if view.alive(robot) and not view.finished(robot)]
        for robot in busy:
            self._look(robot, now)
            self._note_use(robot)
            self._look_at_goal(robot, now)
        if not busy or not view.simulation.lab.finish or now < view.healed_at + STILL:
            return
        long = [robot for robot in busy if now - self._progress_of(robot) > STILL]
        still = [robot for robot in long if self._has_to(robot)]
        for robot in still:
            words = f"robot {robot} has stood still for {in_seconds(STILL):g} s"
            self._tell(now, STANDS_STILL, (robot,), "; ".join([words, *self._reasons(robot)]))
        if not still and long == busy and not any(self._waits(robot) for robot in busy):
            words = f"no robot has got on for {in_seconds(STILL):g} s; not finished: {', '.join(map(str, busy))}"
            reasons = [f"robot {robot}: {', '.join(found)}" for robot in busy if (found := self._reasons(robot))]
            self._tell(now, STANDS_STILL, tuple(busy), "; ".join([words, *reasons]))

    def _look_at_drive(self, robot: int, now: Instant) -> None:
        """Look whether the drive of `robot`, if it has one, nears its goal."""
        self._nearings.look(robot, now)
        words = self._nearings.overdue(robot, now, self._used_at(robot))
        if words:
            self._tell(now, NO_NEARER, (robot,), "; ".join([words, *self._reasons(robot)]))

    def _tell(self, now: Instant, check: str, robots: tuple[int, ...], words: str) -> None:
        """Report a violation, and another one only after the same time again."""
        self._view.violate(now, check, robots, words)
        for robot in robots:
            self._progress_at[robot] = now
            self._nearings.neared(robot, now)

    def _reasons(self, robot: int) -> list[str]:
        """Return what keeps the robot, as the world sees it: who has the turn, and what its hull stands close to."""
        view = self._view
        driver = view.node(robot).driver
        lost = "it does not know where it is" if driver is not None and driver.localiser.pose is None else ""
        reasons = list(filter(None, [lost, view.mistake(robot), view.node(robot).services.blocked]))
        world = view.simulation.world
        arena = view.simulation.lab.arena
        for crossing in [each for each in view.node(robot).crossings.all_current if each.waits]:
            inside = [other for other in view.robots if other != robot and self._inside(other, crossing.group_id)]
            holders = f", held by robot {', '.join(map(str, inside))}" if inside else ""
            what = crossing.passage or crossing.job.name
            reasons.append(f"it waits for its turn of {what}{holders}")
        x, y, _ = world.pose(robot)
        radius = arena.shape.radius
        others = {other: world.pose(other) for other in view.robots if other != robot}
        # Gap between two hulls, metres, within which one robot counts as in the way of the other.
        near = [other for other, at in others.items() if math.hypot(x - at.x, y - at.y) < 2.0 * radius + 0.05]
        if near:
            reasons.append(f"{robots_named(near)} in its way")
        # Gap between a hull and an obstacle, metres, that counts as touching.
        if arena.clearance(x, y) < radius + 0.005:
            reasons.append(f"it touches {closest_solid(arena, x, y)}")
        return [*reasons, *self._hindrance(robot, near)]

    def _hindrance(self, robot: int, named: list[int]) -> list[str]:
        """Return the hazard rule that keeps the robot, as it knows the others, unless these are `named` already."""
        node = self._view.node(robot)
        drive = node.actions.driving
        since = None if drive is None else drive.started
        state = motion_state(node.now, node.driver, node.peers, robot, node.config.roster, since)
        if (
            state is None
            or state.motion is not Motion.STANDS
            or (state.why.robots and set(state.why.robots) <= {*named})
        ):
            return []
        return list(filter(None, [hindrance_words(state.why)]))

    def _inside(self, robot: int, event: bytes) -> bool:
        """Return whether `robot` holds `event`."""
        held = self._view.node(robot).crossings.all_current if self._view.alive(robot) else []
        return any(crossing.group_id == event and not crossing.waits for crossing in held)

    def _look(self, robot: int, now: Instant) -> None:
        x, y, _ = self._view.simulation.world.pose(robot)
        was_x, was_y = self._where[robot]
        if math.hypot(x - was_x, y - was_y) > 2.0 * self._view.simulation.lab.arena.shape.radius:
            self._where[robot] = (x, y)
            self._progress_at[robot] = now

        if any(now + EVERY < running.pause.until < NEVER for running in self._view.node(robot).actions.running):
            self._progress_at[robot] = now

    def _note_use(self, robot: int) -> None:
        """Count the progress of a robot inside as use of what it has entered, for the robots that wait for that.

        It may itself wait for what others use. Robots that wait for each other in a circle make no progress.
        """
        for crossing in self._view.node(robot).crossings.all_current:
            if isinstance(crossing.phase, Inside):
                self._used[crossing.group_id] = max(self._used.get(crossing.group_id, 0), self._progress_of(robot))

    def _look_at_goal(self, robot: int, now: Instant) -> None:
        """Note whether others have come to the goal for which `robot` waits, or have left it."""
        driver = self._view.node(robot).driver
        goal = None if driver is None else driver.navigator.waits_for_goal
        if goal is None:
            self._goal_users.pop(robot, None)
            return
        view = self._view
        reach = 3.0 * view.simulation.lab.arena.shape.radius
        places = {other: view.simulation.world.pose(other) for other in view.robots if other != robot}
        here = frozenset(other for other, at in places.items() if math.hypot(at.x - goal.x, at.y - goal.y) < reach)
        if self._goal_users.get(robot, (goal, here)) != (goal, here):  # others came, or left
            self._goal_used[robot] = now
        self._goal_users[robot] = goal, here

    def _progress_of(self, robot: int) -> Instant:
        """Return the last progress of the robot, its own or by other robots' use of what it waits for."""
        return max(self._progress_at[robot], self._used_at(robot))

    def _used_at(self, robot: int) -> Instant:
        """Return when others used what the robot waits for, or waited for last, for the last time; 0 for nothing.

        One that no longer waits, since it needs no turn any more, had no cause to move until then.
        """
        crossings = self._view.node(robot).crossings.all_current
        used = [self._used.get(crossing.group_id, 0) for crossing in crossings if crossing.waits]
        self._waited[robot] = max([self._waited.get(robot, 0), self._goal_used.get(robot, 0), *used])
        return self._waited[robot]

    def _has_to(self, robot: int) -> bool:
        """Return whether the robot drives, or waits for a turn."""
        node = self._view.node(robot)
        return node.crossings.current is not None or node.actions.driving is not None

    def _waits(self, robot: int) -> bool:
        """Return whether an action without wheels is running: it ends by itself."""
        return any(not running.handler.wheels for running in self._view.node(robot).actions.running)


# ---- how near each robot has come to the goal of its drive: to and fro is no progress
#
# The measure is the length of the way that the planner finds from where the robot really is, around those that
# stand as the robot knows them. A drive *nears* its goal when this length falls below its least so far by a robot's
# width. Between two such instants a robot may have to drive around others that have come to stand in its way, so it
# has the more time the longer its way has become.

LOOK_EVERY: Final[Duration] = seconds(10)
"""How often the way to a goal is planned: a plan costs milliseconds."""
SHORT: Final[Duration] = seconds(30)
"""Most drives end within this, so nothing is planned for them."""
NEARER_WITHIN: Final[Duration] = seconds(60)
"""Time for a robot's width of way, that of driving aside. Escapes from a jam take 8 to 20 s each."""
TIMES_OF_WAY: Final = 2.0
"""The time in which the robot can drive the whole way counts this often: others slow it down."""


@dataclass(slots=True)
class _Nearing:
    """What is known of one drive."""

    action: RunningAction
    goal: Point
    near_at: Instant
    """When it neared its goal last."""
    driven_m: float
    """How far the robot had driven by then, by odometry."""
    look_at: Instant
    least_m: float | None = None
    """Infinite: no way at all has been found."""
    failed: bool = False
    """Whether the action has failed: the drive goes on if the next one has the same goal."""
    longest_m: float = field(default=0.0)
    """The longest way since `near_at`."""


class Nearings:
    """The drives under way, of all robots."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._drives: dict[int, _Nearing] = {}
        view.subscribe(ActionEnded, self._ended)

    def _ended(self, robot: int, _now: Instant, ended: ActionEnded) -> None:
        drive = self._drives.get(robot)
        if drive is not None and drive.action.serial == ended.serial:
            drive.failed = ended.failure is not None and ended.failure not in INTERRUPTED

    def look(self, robot: int, now: Instant) -> None:
        """Take in where `robot` is; call once a second."""
        node = self._view.node(robot)
        driver = node.driver
        action = node.actions.driving
        navigator = None if driver is None else driver.navigator
        goal = None if navigator is None or navigator.status not in ("moving", "blocked") else navigator.goal
        drive = self._drives.get(robot)
        if driver is None or action is None or goal is None:
            if drive is not None and drive.failed:
                drive.near_at += EVERY  # what the program does meanwhile takes its own time
            else:
                self._drives.pop(robot, None)
            return
        if drive is not None and drive.failed:
            drive.action = action
            drive.failed = False
        # A drive that is sent to another goal within this, such as the next slot of an area, remains the same.
        if drive is None or drive.action is not action or distance(*drive.goal, *goal) > 1.0:
            driven_m = driver.localiser.travelled_m
            self._drives[robot] = _Nearing(action, goal, now, driven_m, now + SHORT)
        elif now >= drive.look_at:
            drive.look_at = now + LOOK_EVERY
            self._measure(robot, now, drive, goal)

    def _measure(self, robot: int, now: Instant, drive: _Nearing, goal: Point) -> None:
        view = self._view
        node = view.node(robot)
        arena = view.simulation.lab.arena
        pose = view.simulation.world.pose(robot)
        start = Point(pose.x, pose.y)
        standing = neighbourhood(now, node.peers, robot, node.config.roster).standing
        found = plan(arena, start, goal, (*standing.values(),)) or plan(arena, start, goal)
        way_m = math.inf if found is None else found.length_m
        if drive.least_m is None or way_m < drive.least_m - 2.0 * arena.shape.radius:
            self.neared(robot, now)
            drive.least_m = way_m
            drive.longest_m = 0.0
        if found is not None:
            drive.longest_m = max(drive.longest_m, way_m)

    def neared(self, robot: int, now: Instant) -> None:
        """Count from now on whether `robot` nears its goal."""
        driver = self._view.node(robot).driver
        drive = self._drives.get(robot)
        if drive is not None and driver is not None:
            drive.near_at = now
            drive.driven_m = driver.localiser.travelled_m

    def overdue(self, robot: int, now: Instant, used_at: Instant) -> str:
        """Return in words that the drive of `robot` has not neared its goal in time; empty if it has, or has time left.

        `used_at`: when others used the event for which it waits, for the last time.
        """
        drive = self._drives.get(robot)
        if drive is None or drive.least_m is None:
            return ""
        shape = self._view.simulation.lab.arena.shape
        since = max(drive.near_at, used_at, self._view.healed_at)
        allowed = NEARER_WITHIN + seconds(TIMES_OF_WAY * drive.longest_m / shape.speed)
        if now - since <= allowed:
            return ""
        driver = self._view.node(robot).driver
        driven_m = 0.0 if driver is None else driver.localiser.travelled_m - drive.driven_m
        lasted_s = (now - drive.near_at) // seconds(1)
        text = drive.action.text(robot)
        return f"robot {robot} has come no nearer to the goal of {text} for {lasted_s} s and {driven_m:.1f} m driven"

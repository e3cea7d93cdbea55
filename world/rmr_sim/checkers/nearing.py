"""How near each robot has come to the goal of its drive: to and fro is no progress.

The measure is the length of the way that the planner finds from where the robot really is, around those that stand as
the robot knows them. A drive *nears* its goal when this length falls below its least so far by a robot's width. Between
two such instants a robot may have to drive around others that have come to stand in its way, so it has the more time
the longer its way has become.
"""

from dataclasses import dataclass, field
from typing import Final

from rmr.base.geometry import Point, distance
from rmr.base.time import Duration, Instant, seconds
from rmr.node.actions.dispatcher import RunningAction
from rmr.node.motion.astar import plan
from rmr.node.standstill import neighbourhood
from rmr_sim.checkers.run_view import RunView

LOOK_EVERY: Final[Duration] = seconds(10)
"""How often the way to a goal is planned: a plan costs milliseconds."""
SHORT: Final[Duration] = seconds(30)
"""Most drives end within this, so nothing is planned for them."""
NO_NEARER: Final[Duration] = seconds(60)
"""Time for a robot's width of way, that of driving aside. Escapes from a jam take 8 to 20 s each."""
TIMES_OF_WAY: Final = 2.0
"""The time in which the robot can drive the whole way counts this often: others slow it down."""
SAME_GOAL_M: Final = 1.0
"""A drive that is sent to another goal within this, such as the next slot of an area, remains the same."""


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
    longest_m: float = field(default=0.0)
    """The longest way since `near_at`."""


class Nearings:
    """The drives under way, of all robots."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._drives: dict[int, _Nearing] = {}

    def look(self, robot: int, now: Instant) -> None:
        """Take in where `robot` is; call once a second."""
        node = self._view.node(robot)
        driver = node.driver
        action = node.actions.driving
        navigator = None if driver is None else driver.navigator
        goal = None if navigator is None or navigator.status not in ("moving", "blocked") else navigator.goal
        if driver is None or action is None or goal is None:
            self._drives.pop(robot, None)
            return
        drive = self._drives.get(robot)
        if drive is None or drive.action is not action or distance(*drive.goal, *goal) > SAME_GOAL_M:
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
        if found is None:
            return
        way_m = found.length_m
        if drive.least_m is None or way_m < drive.least_m - 2.0 * arena.shape.radius:
            self.neared(robot, now)
            drive.least_m = way_m
            drive.longest_m = way_m
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
        allowed = NO_NEARER + seconds(TIMES_OF_WAY * drive.longest_m / shape.speed)
        if now - since <= allowed:
            return ""
        driver = self._view.node(robot).driver
        driven_m = 0.0 if driver is None else driver.localiser.travelled_m - drive.driven_m
        lasted_s = (now - drive.near_at) // seconds(1)
        text = drive.action.text(robot)
        return f"robot {robot} has come no nearer to the goal of {text} for {lasted_s} s and {driven_m:.1f} m driven"

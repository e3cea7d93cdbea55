"""One robot of ROS 2 as a body: odometry and poses in, samples of sensors and an estimate of its pose out.

Nothing here imports ROS: messages come as numbers, instants as nanoseconds, so that tests need neither a network nor a
clock. The stamps are those of the robot's own clock; they are only compared with each other.

* Odometry becomes the ways of two wheels. A step that no such robot can make is a jump: the odometry has begun anew,
  and nothing is added to the ways.
* A pose was true when it was measured. It is carried on by the odometry since then to the instant of the sample, so a
  late pose is as good as a prompt one.
* The estimate is that of the mind's own localiser, fed with the same samples.
"""

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from typing import Final, Protocol

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Pose, Twist, wrap
from rmr.base.time import NS_PER_S, Duration, Instant, milliseconds, seconds
from rmr.node.motion.ekf import TRACK_M
from rmr.node.motion.localiser import FASTEST, GYRO_NOISE, WAY_NOISE_M, Localiser
from rmr.node.ports import PoseFix, SeenBody, Sensed
from rmr_ros.scan_bodies import ScanBodies

ODOMETRY_AGE_MAX: Final[Duration] = milliseconds(300)
"""Age of the newest odometry beyond which a robot gets no samples: its driver hangs, and it stands."""
COMMAND_AGE_MAX: Final[Duration] = milliseconds(100)
"""Age at which a command is dropped, and time after the last one until the bridge says zero, as in the physics."""
HISTORY: Final[Duration] = seconds(3)
"""For how long odometry is remembered: poses older than this are refused."""


class BodyTopics(Protocol):
    """What the lab file says of the body of one robot."""

    @property
    def robot(self) -> int:
        """Its id."""

    @property
    def odom(self) -> str:
        """The topic of its odometry, from the root."""

    @property
    def cmd_vel(self) -> str:
        """The topic of its commands."""

    @property
    def pose(self) -> str:
        """The topic of its poses."""

    @property
    def scan(self) -> str:
        """The topic of its laser scans; empty: they are not read."""

    @property
    def scan_at(self) -> Pose:
        """Pose of the lidar on the robot."""

    @property
    def navigate(self) -> str:
        """The action of Nav2 by which it drives; empty: it has none."""

    @property
    def sigma_m(self) -> float:
        """Standard deviation of a pose that has no covariance, metres ..."""

    @property
    def sigma_rad(self) -> float:
        """... and of its heading, radians."""

    @property
    def origin(self) -> Pose:
        """Pose of the floor's lower left corner in the frame of the poses."""


def heading(x: float, y: float, z: float, w: float) -> float | None:
    """Return the heading of a quaternion; None if it is none, or not about the vertical axis to 15 degrees."""
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(norm - 1.0) < 0.1 or 1.0 - 2.0 * (x * x + y * y) / (norm * norm) < math.cos(math.radians(15.0)):
        return None
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def deviations(covariance: Sequence[float], sigma_m: float, sigma_rad: float) -> tuple[float, float]:
    """Return the standard deviations of position (its worst axis) and heading of a covariance of 6 by 6.

    A diagonal of zeros means in ROS that nothing is known: then the lab's hold.
    """
    xx, xy, yx, yy, tt = (covariance[k] for k in (0, 1, 6, 7, 35))
    mean = 0.5 * (xx + yy)
    worst = mean + math.hypot(0.5 * (xx - yy), 0.5 * (xy + yx))
    return math.sqrt(worst) if worst > 0.0 else sigma_m, math.sqrt(tt) if tt > 0.0 else sigma_rad


def onward(pose: Pose, begin: Pose, end: Pose) -> Pose:
    """Return `pose` after the motion from `begin` to `end`, which another frame has."""
    turn = pose.theta - begin.theta
    cos = math.cos(turn)
    sin = math.sin(turn)
    dx = end.x - begin.x
    dy = end.y - begin.y
    return Pose(pose.x + cos * dx - sin * dy, pose.y + sin * dx + cos * dy, wrap(pose.theta + end.theta - begin.theta))


class RosBody:
    """The body of one robot."""

    def __init__(self, spec: BodyTopics, arena: Arena, start: Pose) -> None:
        self.spec = spec
        self._arena = arena
        self._localiser = Localiser(arena)
        self._seen = ScanBodies(arena)
        self._history: deque[tuple[Instant, Pose]] = deque()
        """Odometry by its stamp, the oldest first."""
        self._left_m = self._right_m = 0.0
        self._rate = 0.0
        self._scanned_at: Instant | None = None
        self._heard_at: Instant | None = None
        """When the newest odometry arrived, in nanoseconds of the bridge's clock."""
        self._fix: tuple[Pose, Pose, float, float] | None = None
        """The newest pose, with the odometry of its instant and its deviations, until the mind has got it ..."""
        self._own_fix: tuple[Pose, Pose, float, float] | None = None
        """... and until the estimate has."""
        self.pose = start
        """The estimate; the start, then the last one, while there is none."""
        self.twist = STILL
        """What the wheels do by odometry."""
        self.stamp: Instant = -COMMAND_AGE_MAX
        """Of the last command."""
        self.counts = dict.fromkeys(("odometry", "poses", "scans", "commands", "refused", "jumps", "dropped"), 0)
        self.trouble = ""
        """Why its newest odometry or pose was refused; empty when it was not."""

    @property
    def located(self) -> bool:
        """Whether the robot has a pose."""
        return self._localiser.pose is not None

    @property
    def travelled_m(self) -> float:
        """Way of its centre by odometry, metres."""
        return self._localiser.travelled_m

    # -- in -----------------------------------------------------------------------------------------------------

    def odometry(self, arrived: Instant, stamp: Instant, pose: Pose, twist: Twist) -> None:
        """Take in a message of odometry."""
        if not all(map(math.isfinite, (*pose, twist.v, twist.w))):
            self._refuse("odometry holds a number that is none (NaN or infinite)")
            return
        last = self._history[-1] if self._history else None
        if last is not None and stamp <= last[0]:
            if stamp > last[0] - NS_PER_S:
                self._refuse("odometry goes back in time")  # two messages changed places
                return
            self._jump()  # the driver or its clock was started again
            last = None
        elif last is not None and stamp > last[0] + ODOMETRY_AGE_MAX:
            self._jump()  # whatever it did in the meantime is not known
            last = None
        if last is not None:
            self._roll(last[1], pose, (stamp - last[0]) / NS_PER_S)
        self._history.append((stamp, pose))
        while self._history[0][0] < stamp - HISTORY:
            self._history.popleft()
        self.twist = twist
        self._rate = twist.w
        self._heard_at = arrived
        self.counts["odometry"] += 1
        self.trouble = ""

    def _jump(self) -> None:
        """Forget where odometry had the robot, and the poses that were measured before."""
        self._history.clear()
        self._fix = self._own_fix = None
        self.counts["jumps"] += 1

    def _roll(self, before: Pose, now: Pose, dt: float) -> None:
        """Add the motion between two messages to the ways of the wheels."""
        turned = wrap(now.theta - before.theta)
        middle = before.theta + 0.5 * turned
        dx = now.x - before.x
        dy = now.y - before.y
        way = dx * math.cos(middle) + dy * math.sin(middle)
        shape = self._arena.shape
        # Half a radian between two messages beyond what the robot can is no jump yet: it is noise.
        if (
            math.hypot(dx, dy) > FASTEST * shape.speed * dt + WAY_NOISE_M
            or abs(turned) > FASTEST * shape.turn * dt + 0.5
        ):
            self._jump()
            return
        half = 0.5 * TRACK_M * turned
        self._left_m += way - half
        self._right_m += way + half

    def measured(self, stamp: Instant, pose: Pose, sigma_m: float, sigma_rad: float) -> None:
        """Take in a pose in the frame of the map, of the instant `stamp` (0: of now)."""
        if not all(map(math.isfinite, (*pose, sigma_m, sigma_rad))):
            self._refuse("a pose holds a number that is none (NaN or infinite)")
            return
        if not self._history:
            return
        newest = self._history[-1][0]
        if stamp and not -HISTORY < stamp - newest < NS_PER_S:
            ahead = (stamp - newest) / NS_PER_S
            self._refuse(f"its pose is stamped {ahead:+.1f} s beside its odometry: synchronise the clocks")
            return
        placed = onward(Pose(0.0, 0.0, 0.0), self.spec.origin, pose)
        slack = 10.0 * sigma_m
        if not (-slack <= placed.x <= self._arena.width + slack and -slack <= placed.y <= self._arena.height + slack):
            self._refuse(
                f"its pose ({placed.x:.2f}, {placed.y:.2f}) is not on the floor of the lab: see bodies, origin"
            )
            return
        self._fix = self._own_fix = placed, self._odometry_at(stamp or newest), sigma_m, sigma_rad
        self.counts["poses"] += 1
        self.trouble = ""

    def scan(self, arrived: Instant, stamp: Instant, angle: float, step: float, ranges: Sequence[float]) -> None:
        """Take in a scan of the instant `stamp` (0: of now): its first angle, the step between rays, their ways."""
        if not (math.isfinite(angle) and math.isfinite(step)):
            self._refuse("a scan holds an angle that is none (NaN or infinite)")
            return
        self._scanned_at = arrived
        self.counts["scans"] += 1
        if not self.located or not self._history:
            return  # it does not know what of it is a wall
        newest = self._history[-1]
        robot = onward(self.pose, newest[1], self._odometry_at(stamp or newest[0]))
        self._seen.scan(arrived, onward(robot, Pose(0.0, 0.0, 0.0), self.spec.scan_at), angle, step, ranges)

    def _odometry_at(self, stamp: Instant) -> Pose:
        """Return where odometry had the robot at `stamp`, between two messages on the straight line."""
        history = self._history
        k = bisect_left(history, stamp, key=lambda each: each[0])
        if k == 0 or k == len(history):
            return history[min(k, len(history) - 1)][1]
        (t0, a), (t1, b) = history[k - 1], history[k]
        share = (stamp - t0) / (t1 - t0)
        return Pose(a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), a.theta + share * wrap(b.theta - a.theta))

    def _refuse(self, why: str) -> None:
        self.counts["refused"] += 1
        self.trouble = why

    # -- out ----------------------------------------------------------------------------------------------------

    def heard(self, clock: Instant) -> bool:
        """Return whether there is odometry, and the newest one is not old."""
        return self._heard_at is not None and clock - self._heard_at <= ODOMETRY_AGE_MAX

    def sees(self, clock: Instant) -> bool:
        """Return whether its newest scan is not old, if it is to have any."""
        return not self.spec.scan or (self._scanned_at is not None and clock - self._scanned_at <= NS_PER_S)

    def step(self, now: Instant, clock: Instant) -> None:
        """Bring the estimate up to lab time `now`."""
        if not self.heard(clock):
            self.twist = STILL
            return
        self._localiser.feed(now, self._sample(now, self._own_fix, ()))
        self._own_fix = None
        if self._localiser.pose is not None:
            self.pose = self._localiser.pose

    def sense(self, now: Instant, clock: Instant, bodies: tuple[SeenBody, ...]) -> Sensed | None:
        """Return a sample for the mind, with the robots in view, and what its scans show beside these.

        None while there is no odometry.
        """
        if not self.heard(clock):
            return None
        others = self._seen.in_view(clock, self.pose, bodies) if self.spec.scan and self.located else ()
        sample = self._sample(now, self._fix, bodies + others)
        self._fix = None
        return sample

    def _sample(
        self, now: Instant, fix: tuple[Pose, Pose, float, float] | None, bodies: tuple[SeenBody, ...]
    ) -> Sensed:
        measured = None
        if fix is not None:
            placed, odometry, sigma_m, sigma_rad = fix
            x, y, theta = onward(placed, odometry, self._history[-1][1])
            measured = PoseFix(x, y, theta, sigma_m, sigma_rad)
        x, y, theta = self.pose
        most = FASTEST * self._arena.shape.turn + GYRO_NOISE
        rate = max(-most, min(most, self._rate))
        return Sensed(now, self._left_m, self._right_m, rate, None, (), bodies, False, (x, y, theta), measured)

    def command(self, twist: Twist, stamp: Instant, now: Instant) -> Twist | None:
        """Return what a command decided at `stamp` makes the wheels do, within the robot's limits; None: nothing."""
        stale = stamp < self.stamp or not -COMMAND_AGE_MAX <= now - stamp <= COMMAND_AGE_MAX
        if stale or not (math.isfinite(twist.v) and math.isfinite(twist.w)):
            self.counts["dropped"] += 1
            return None
        self.stamp = stamp
        self.counts["commands"] += 1
        speed = self._arena.shape.speed
        turn = self._arena.shape.turn
        return Twist(max(-speed, min(speed, twist.v)), max(-turn, min(turn, twist.w)))

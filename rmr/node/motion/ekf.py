"""Where the robot is: an extended Kalman filter over odometry, gyro, compass and beacon ranges.

State: x, y (metres) and heading (radians) with a symmetric covariance of six numbers. Plain floats, written
out, because a 3x3 product in numpy costs ten times more than all of this.

* Prediction: the mean of both wheels gives the way, gyro and wheels together the turn (the gyro slips not, the
  wheels drift not). Slip makes the variance grow with the way and the turn.
* Correction: a compass reading, the distance to one beacon, or a fix, which is a whole pose. A reading that lies more
  than GATE sigmas off is an outlier and dropped. Many wrong compass readings widen the covariance of the heading, so
  that they count again.
* Innovation gate: a cumulative sum (Page, "Continuous inspection schemes", 1954) over the squared innovations of the
  ranges and fixes, in units of their variance. When it passes its limit, `contradicted` says that the position is
  wrong: the robot was pushed, or is at the mirror image of the estimate.
"""

import math
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose, hypot, wrap
from rmr.node.ports import PoseFix

TRACK_M: Final = 0.1
"""Distance between the wheels."""
SLIP: Final = 0.03
"""Sigma of the way, as a share of its square root in metres: 3 % after 1 m."""
TURN_SLIP: Final = 0.03
"""Likewise of the turn in radians."""
WANDER: Final = 0.002
"""What the position is doubted for each second, whatever the wheels say, metres per square root of a second."""
GYRO_SIGMA: Final = 0.02
"""Noise of the gyro, rad/s."""
GYRO_SHARE: Final = 0.8
"""Weight of the gyro against the wheels in the turn."""
COMPASS_SIGMA: Final = 0.06
"""Noise of the compass, radians; more than its datasheet's 2 degrees, because readings at 60 Hz are not alone."""
RANGE_SIGMA: Final = 0.007
"""Noise of an ultrasonic range, metres."""
FIX_SIGMA_MIN: Final = 0.005
"""Least noise of a fix that is believed, metres: services state less than they have."""
FIX_HEADING_MIN: Final = 0.01
"""Likewise of its heading, radians."""
GATE: Final = 4.0
"""A reading farther off than this many sigmas is an outlier."""
REJECTED_MAX: Final = 4
"""Number of wrong compass readings in a row that shows that the heading is wrong."""
CUSUM_DRIFT: Final = 3.0
"""Squared innovation, in units of its variance, above which a range adds to the sum. Its mean is 1."""
CUSUM_MAX: Final = 40.0
"""Sum that chance does not explain: with normal noise it is passed once in 10^8 ranges, 50 days of two beacons. Four
outliers in a row pass it."""


class Ekf:
    """The estimate of one robot's pose."""

    __slots__ = (
        "_compass_bad",
        "_ptt",
        "_pxt",
        "_pxx",
        "_pxy",
        "_pyt",
        "_pyy",
        "_surprise",
        "range_sigma",
        "rejected",
        "theta",
        "x",
        "y",
    )

    def __init__(
        self, x: float, y: float, theta: float, *, sigma: float = 0.05, range_sigma: float = RANGE_SIGMA
    ) -> None:
        self.x = x
        self.y = y
        self.theta = theta
        self.range_sigma = range_sigma
        self.rejected = 0
        self._compass_bad = 0
        self._surprise = 0.0
        """The cumulative sum of the innovation gate."""
        self._pxx = self._pyy = sigma * sigma
        self._ptt = COMPASS_SIGMA * COMPASS_SIGMA
        self._pxy = self._pxt = self._pyt = 0.0

    @property
    def pose(self) -> Pose:
        """Return the estimate."""
        return Pose(self.x, self.y, wrap(self.theta))

    @property
    def position_sigma(self) -> float:
        """Return the standard deviation of the position along its worst axis, metres."""
        mean = 0.5 * (self._pxx + self._pyy)
        half = 0.5 * (self._pxx - self._pyy)
        return math.sqrt(mean + math.sqrt(half * half + self._pxy * self._pxy))

    @property
    def contradicted(self) -> bool:
        """Whether ranges contradict the position by more than chance explains."""
        return self._surprise > CUSUM_MAX

    def doubt(self, pxx: float, pxy: float, pyy: float) -> None:
        """Set the covariance of the position, square metres."""
        self._pxx = pxx
        self._pxy = pxy
        self._pyy = pyy

    def keep_within(self, arena: Arena) -> None:
        """Move the estimate to where a hull can be, within the walls of `arena`.

        Beacons stand on walls. On their very line a range tells nothing of the way across it, and beyond it ranges hold
        the estimate at the mirrored place.
        """
        margin = arena.shape.radius
        self.x = max(margin, min(arena.width - margin, self.x))
        self.y = max(margin, min(arena.height - margin, self.y))

    def predict(self, left_delta_m: float, right_delta_m: float, gyro: float, dt: float) -> None:
        """Move the estimate by what the wheels (metres) and the gyro (rad/s) felt during `dt` seconds."""
        way = 0.5 * (left_delta_m + right_delta_m)
        turn = GYRO_SHARE * gyro * dt + (1.0 - GYRO_SHARE) * (right_delta_m - left_delta_m) / TRACK_M
        mid = self.theta + 0.5 * turn
        cos = math.cos(mid)
        sin = math.sin(mid)
        self.x += way * cos
        self.y += way * sin
        self.theta += turn
        a = -way * sin
        b = way * cos
        ptt = self._ptt
        pxt = self._pxt
        pyt = self._pyt
        slip = SLIP * SLIP * abs(way) + WANDER * WANDER * dt
        self._pxx += a * (2.0 * pxt + a * ptt) + slip
        self._pxy += a * pyt + b * pxt + a * b * ptt
        self._pyy += b * (2.0 * pyt + b * ptt) + slip
        self._pxt = pxt + a * ptt
        self._pyt = pyt + b * ptt
        self._ptt = ptt + TURN_SLIP * TURN_SLIP * abs(turn) + GYRO_SIGMA * GYRO_SIGMA * dt * dt

    def compass(self, theta: float, sigma: float = COMPASS_SIGMA) -> bool:
        """Correct by a compass reading in radians. Returns False when it was an outlier."""
        if self._correct_heading(wrap(theta - self.theta), sigma):
            self._compass_bad = 0
            return True
        self._compass_bad += 1
        if self._compass_bad >= REJECTED_MAX:
            self._compass_bad = 0
            self._ptt = 4.0 * self._ptt + sigma * sigma
        return False

    def fix(self, measured: PoseFix) -> None:
        """Correct by a pose that was measured from outside."""
        sigma = max(FIX_SIGMA_MIN, measured.sigma_m)
        self._correct_place(1.0, 0.0, measured.x - self.x, sigma)
        self._correct_place(0.0, 1.0, measured.y - self.y, sigma)
        self.compass(measured.theta, max(FIX_HEADING_MIN, measured.sigma_rad))

    def range(self, beacon: Point, metres: float) -> bool:
        """Correct by the distance to `beacon`. Returns False when it was an outlier."""
        dx = self.x - beacon.x
        dy = self.y - beacon.y
        away = hypot(dx, dy)
        if away < 1e-6:
            return False
        return self._correct_place(dx / away, dy / away, metres - away, self.range_sigma)

    def _correct_heading(self, residual: float, sigma: float) -> bool:
        """Apply a measurement of the heading: its Jacobian is (0, 0, 1)."""
        return self._apply(self._pxt, self._pyt, self._ptt, self._ptt + sigma * sigma, residual)

    def _correct_place(self, hx: float, hy: float, residual: float, sigma: float) -> bool:
        """Apply one scalar measurement of the place with the Jacobian (hx, hy, 0)."""
        kx = self._pxx * hx + self._pxy * hy
        ky = self._pxy * hx + self._pyy * hy
        kt = self._pxt * hx + self._pyt * hy
        variance = hx * kx + hy * ky + sigma * sigma
        squared = min(GATE * GATE, residual * residual / variance)
        self._surprise = max(0.0, self._surprise + squared - CUSUM_DRIFT)
        return self._apply(kx, ky, kt, variance, residual)

    def _apply(self, kx: float, ky: float, kt: float, variance: float, residual: float) -> bool:
        """Correct by a `residual` of `variance`, with which the state covaries by (kx, ky, kt)."""
        if residual * residual > GATE * GATE * variance:
            self.rejected += 1
            return False
        gain = residual / variance
        self.x += kx * gain
        self.y += ky * gain
        self.theta += kt * gain
        self._pxx -= kx * kx / variance
        self._pxy -= kx * ky / variance
        self._pxt -= kx * kt / variance
        self._pyy -= ky * ky / variance
        self._pyt -= ky * kt / variance
        self._ptt -= kt * kt / variance
        return True

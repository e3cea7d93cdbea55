"""Localisation of one robot: from samples of its sensors to a pose, or to none (paper V.B.1).

Two states. A robot that *searches* has no pose: it keeps its newest ranges and looks which positions on the floor
explain them (`multilateration`). It is located when one position does and no other one: a mirror image lives as long
as the ranges do not tell it apart. A robot that is *located* runs an extended Kalman filter (`ekf`). When the ranges
contradict the filter by more than chance explains, the estimate is dropped and the robot searches again. Without a
pose the wheels stand.

A robot without a compass is localised from outside, by fixes. It is located when `FIXES_AGREE` of them in a row agree
with each other and with its odometry. One that drives and gets no fix any more searches again.

A sample is looked at before anything is made of it: by its change since the last one, given the time between them and
the robot's limits, not by size alone. One that no body can produce is dropped and counted. If many of these in a row
agree with each other, it is the last accepted sample that was wrong: the newest is taken, and the estimate is dropped.

The ground truth in a sample is for the radio shim and is never read here.
"""

import math
from collections import deque
from typing import Final

from rmr.base.arena import Arena
from rmr.base.geometry import Pose, wrap
from rmr.base.time import NS_PER_S, Duration, Instant, milliseconds, seconds
from rmr.node.motion.ekf import RANGE_SIGMA, TRACK_M, Ekf
from rmr.node.motion.multilateration import Echo, hypotheses
from rmr.node.ports import PoseFix, Sensed

NOISE_SHARE: Final = 1.4
"""What the filter takes the noise of a range for, in multiples of what the service states."""
ECHOES_MAX: Final = 48
"""Ranges with which a robot searches: 2.4 s of two beacons."""
DECIDES: Final = 25.0
"""Difference of two misfits that rules out the worse position: five standard deviations."""
LOCATED_M: Final = 0.1
"""Standard deviation of a first position, at most; unless no more ranges are kept."""
SETTLED_M: Final = 0.01
"""What a first position is doubted in addition: ranges that were heard in turns."""

FIXES_AGREE: Final = 3
"""Fixes in a row that must agree before the first position. A service that is itself mistaken jumps about."""
FIX_SLACK_M: Final = 0.03
"""What two fixes may differ beyond four standard deviations: odometry between them slips."""
FIX_SLACK_RAD: Final = 0.1
"""Likewise their headings."""
FIX_AGE_MAX: Final[Duration] = seconds(1)
"""Age of the last fix beyond which a robot does not drive on, if it has driven ..."""
FIX_WAY_MAX: Final = 0.1
"""... more than this since, metres of a wheel: services that correct a robot in motion alone are silent while it
stands."""

FASTEST: Final = 3.0
"""Bound of what a body does, in multiples of the robot's limits: others push it, wheels slip."""
WAY_NOISE_M: Final = 0.05
"""Way of a wheel beyond that bound: a blow, and the noise of the encoders."""
GYRO_NOISE: Final = 1.0
"""Turn rate beyond that bound, rad/s."""
RANGE_NOISES: Final = 10.0
"""Range beyond the diagonal of the floor, in standard deviations."""
AHEAD_MAX: Final[Duration] = milliseconds(500)
"""How far ahead of the robot's clock a sample may be stamped: clocks agree within milliseconds."""
MISTAKEN_M: Final = 0.2
"""Distance between estimate and truth from which checkers and explanations count localisation as the cause."""
REFUSED_MAX: Final = 10
"""Refused samples in a row, each possible after the one before, that show that the last accepted one was wrong."""


def range_sigma(arena: Arena) -> float:
    """Return what is taken for the standard deviation of a range, metres."""
    return max(RANGE_SIGMA, NOISE_SHARE * arena.range_sigma)


class Localiser:
    """Turns samples into a pose."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self._range_sigma = range_sigma(arena)
        self._range_max = math.hypot(arena.width, arena.height) + RANGE_NOISES * self._range_sigma
        self._ekf: Ekf | None = None
        self._heard: deque[tuple[int, float, float, float]] = deque(maxlen=ECHOES_MAX)
        """Ranges since the search began: beacon, metres, and where odometry had the robot then."""
        self._x = self._y = 0.0
        """Where odometry has the robot since the search began."""
        self._candidate: PoseFix | None = None
        """The last fix while the robot searches, carried on by odometry."""
        self._agreed = 0
        """Number of fixes in a row that agree."""
        self._fixed_at: Instant = 0
        """When the last fix came, and how far the wheels have gone since."""
        self._unfixed_m = 0.0
        self._last: Sensed | None = None
        self._refused: Sensed | None = None
        """The newest sample, if it was refused."""
        self._in_a_row = 0
        self.pose: Pose | None = None
        """The estimated pose; None while the robot searches. The same object until the next sample."""
        self.travelled_m = 0.0
        """Way of the robot's centre by odometry, metres."""
        self.located = 0
        """Number of first positions, of this search and of those before."""
        self.refused = 0
        """Number of samples that no body can produce."""
        self.dropped = 0
        """Number of estimates that ranges or fixes have contradicted, or that were given up for want of fixes."""

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position, metres; infinite while the robot searches."""
        return math.inf if self._ekf is None else self._ekf.position_sigma

    def feed(self, now: Instant, sample: Sensed) -> bool:
        """Take in one sample at `now`; return whether a body can have produced it."""
        last = self._last
        if not self._possible(now, sample) or (last is not None and not self._follows(last, sample)):
            self.refused += 1
            if not self._supersedes(now, sample):
                return False
            self._search()  # the wheels have been somewhere else than was believed
            last = None
        self._in_a_row = 0
        self._refused = None
        self._last = sample
        left = right = dt = 0.0
        if last is not None:
            left = sample.left_m - last.left_m
            right = sample.right_m - last.right_m
            dt = (sample.stamp - last.stamp) / NS_PER_S
            self.travelled_m += abs(left + right) / 2
        if self._ekf is None:
            if sample.compass is None:
                self._locate_by_fixes(sample, left, right)
            else:
                self._locate(sample, sample.compass, 0.5 * (left + right))
        else:
            self._track(self._ekf, sample, left, right, dt)
        return True

    # -- what a body can produce ----------------------------------------------------------------------------------

    def _possible(self, now: Instant, sample: Sensed) -> bool:
        """Return whether a body on this floor can produce `sample` by itself."""
        if sample.stamp > now + AHEAD_MAX or (sample.compass is not None and abs(sample.compass) > math.tau):
            return False
        if abs(sample.gyro) > FASTEST * self._arena.shape.turn + GYRO_NOISE:
            return False
        beacons = len(self._arena.beacons)
        for beacon, metres in sample.ranges:  # noqa: SIM110 - for each sample: a generator costs more
            if not (0 <= beacon < beacons and 0.0 <= metres <= self._range_max):
                return False
        return True

    def _follows(self, last: Sensed, sample: Sensed) -> bool:
        """Return whether a body can produce `sample` after `last`."""
        dt = (sample.stamp - last.stamp) / NS_PER_S
        shape = self._arena.shape
        way_max = FASTEST * (shape.speed + 0.5 * TRACK_M * shape.turn) * dt + WAY_NOISE_M
        return (
            dt >= 0.0 and abs(sample.left_m - last.left_m) <= way_max and abs(sample.right_m - last.right_m) <= way_max
        )

    def _supersedes(self, now: Instant, sample: Sensed) -> bool:
        """Return whether refused samples have agreed with each other for so long that they count."""
        before, self._refused = self._refused, sample
        agrees = before is None or self._follows(before, sample)
        self._in_a_row = self._in_a_row + 1 if agrees and self._possible(now, sample) else 0
        return self._in_a_row >= REFUSED_MAX

    # -- searching ------------------------------------------------------------------------------------------------

    def _search(self) -> None:
        """Begin to search: there is no pose any more."""
        self._ekf = None
        self.pose = None
        self._heard.clear()
        self._x = self._y = 0.0
        self._candidate = None
        self._agreed = 0

    def _locate_by_fixes(self, sample: Sensed, left: float, right: float) -> None:
        """Take in a sample after the ways of the wheels, and look whether fixes agree with each other and with them."""
        before = self._candidate
        if before is not None:
            turn = (right - left) / TRACK_M
            middle = before.theta + 0.5 * turn
            way = 0.5 * (left + right)
            x = before.x + way * math.cos(middle)
            y = before.y + way * math.sin(middle)
            self._candidate = before = PoseFix(x, y, before.theta + turn, before.sigma_m, before.sigma_rad)
        fix = sample.fix
        if fix is None:
            return
        self._agreed = self._agreed + 1 if before is not None and _agree(before, fix) else 1
        self._candidate = fix
        if self._agreed < FIXES_AGREE:
            return
        self._ekf = ekf = Ekf(fix.x, fix.y, fix.theta)
        doubted = fix.sigma_m * fix.sigma_m + SETTLED_M * SETTLED_M
        ekf.doubt(doubted, 0.0, doubted)
        self._set_out(ekf)
        self._fixed_at = sample.stamp
        self._unfixed_m = 0.0

    def _set_out(self, ekf: Ekf) -> None:
        """Begin to track from a first position."""
        ekf.keep_within(self._arena)
        self.located += 1
        self.pose = ekf.pose

    def _locate(self, sample: Sensed, compass: float, way_m: float) -> None:
        """Take in a sample after `way_m` metres, and look whether one position explains all ranges."""
        self._x += way_m * math.cos(compass)
        self._y += way_m * math.sin(compass)
        if not sample.ranges:
            return
        heard = self._heard
        for beacon, metres in sample.ranges:
            heard.append((beacon, metres, self._x, self._y))
        beacons = self._arena.beacons
        echoes = [
            Echo(beacon, beacons[beacon].x + self._x - x, beacons[beacon].y + self._y - y, metres)
            for beacon, metres, x, y in heard
        ]
        found = hypotheses(echoes, self._arena, self._range_sigma)
        if not found:
            return
        best = found[0]
        full = len(heard) == ECHOES_MAX
        degrees = len(heard)
        if best.misfit > degrees + DECIDES + 5.0 * math.sqrt(2.0 * degrees):
            if full:
                heard.clear()  # a wrong range, or the robot was carried: what comes next may agree
            return
        if any(other.misfit - best.misfit < DECIDES for other in found[1:]):
            return
        if best.sigma_m > LOCATED_M and not full:
            return
        self._ekf = ekf = Ekf(best.x, best.y, compass, range_sigma=self._range_sigma)
        settled = SETTLED_M * SETTLED_M
        ekf.doubt(best.pxx + settled, best.pxy, best.pyy + settled)
        heard.clear()
        self._set_out(ekf)

    # -- tracking -------------------------------------------------------------------------------------------------

    def _track(self, ekf: Ekf, sample: Sensed, left: float, right: float, dt: float) -> None:
        ekf.predict(left, right, sample.gyro, dt)
        if sample.compass is not None:
            ekf.compass(sample.compass)
        if sample.fix is not None:
            ekf.fix(sample.fix)
        for beacon, metres in sample.ranges:
            ekf.range(self._arena.beacons[beacon], metres)
        if ekf.contradicted or (sample.compass is None and self._unheard(sample, left, right)):
            self.dropped += 1
            self._search()
            return
        ekf.keep_within(self._arena)
        self.pose = ekf.pose

    def _unheard(self, sample: Sensed, left: float, right: float) -> bool:
        """Return whether a robot that is localised by fixes has driven for too long without one."""
        if sample.fix is not None:
            self._fixed_at = sample.stamp
            self._unfixed_m = 0.0
            return False
        self._unfixed_m += max(abs(left), abs(right))
        return self._unfixed_m > FIX_WAY_MAX and sample.stamp - self._fixed_at > FIX_AGE_MAX


def _agree(a: PoseFix, b: PoseFix) -> bool:
    """Return whether two fixes may be of one pose."""
    apart = math.hypot(a.x - b.x, a.y - b.y)
    turned = abs(wrap(a.theta - b.theta))
    return apart <= 4.0 * math.hypot(a.sigma_m, b.sigma_m) + FIX_SLACK_M and (
        turned <= 4.0 * math.hypot(a.sigma_rad, b.sigma_rad) + FIX_SLACK_RAD
    )

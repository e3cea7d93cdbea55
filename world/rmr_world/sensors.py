"""What one robot senses of the world: odometry, gyro, compass, ultrasonic ranges (paper V.B.1, V.B.2).

The model is that of a cheap two-wheeled robot. Each wheel's encoder has a scale error of its own, drawn once,
and a slip that grows with the square root of the way; the gyro has a bias and noise, the compass noise. Each
ultrasonic beacon sends at its own regular instants, in turn, so that two pulses never meet; a pulse is lost
with the lab's `dropout`, a range carries noise of `sigma`.

Every number comes from the robot's own stream, in an order that only its own samples fix: what a robot senses
is the same whether other robots are there or not, as long as it moves the same way.
"""

import math
from random import Random
from typing import Final

from rmr.base.geometry import Point
from rmr.base.streams import Normals
from rmr.base.time import NEVER, NS_PER_S, Instant

TRACK_M: Final = 0.1
"""Distance between the wheels."""
ENCODER_SCALE_SIGMA: Final = 0.005
"""Error of a wheel's measured way: tyre wear, fixed per wheel."""
ENCODER_SLIP_SIGMA: Final = 0.002
"""Noise of the way of one wheel, in metres per square root of a metre."""
GYRO_BIAS_SIGMA: Final = 0.005
"""rad/s, fixed per robot."""
GYRO_SIGMA: Final = 0.01
"""rad/s."""
COMPASS_SIGMA: Final = math.radians(2.0)
BODY_POSITION_SIGMA: Final = 0.002
"""Metres, of another robot's position in the field of view."""
BODY_VELOCITY_SIGMA: Final = 0.005
"""m/s."""


class Sensors:
    """The sensors of one robot, apart from the field of view."""

    __slots__ = (
        "_dropout",
        "_gyro_bias",
        "_left_scale",
        "_next_pulse",
        "_normal",
        "_period",
        "_phases",
        "_random",
        "_right_scale",
        "_sigma",
        "beacons",
        "left_m",
        "right_m",
        "silent_until",
    )

    def __init__(self, rng: Random, beacons: tuple[Point, ...], rate: float, sigma: float, dropout: float) -> None:
        self.beacons = beacons
        self._normal = normal = Normals(rng)
        self._random = rng.random
        self._left_scale = 1.0 + normal.draw() * ENCODER_SCALE_SIGMA
        self._right_scale = 1.0 + normal.draw() * ENCODER_SCALE_SIGMA
        self._gyro_bias = normal.draw() * GYRO_BIAS_SIGMA
        self._period = round(NS_PER_S / rate)
        self._phases = tuple(self._period * index // max(1, len(beacons)) for index in range(len(beacons)))
        self._next_pulse: Instant = 0 if beacons else NEVER
        self._sigma = sigma
        self._dropout = dropout
        self.left_m = 0.0
        """Measured way of the left wheel since power-on."""
        self.right_m = 0.0
        self.silent_until: Instant = 0
        """Pulses before that instant are not heard: an outage of the localisation service."""

    def moved(self, way_m: float, turned: float) -> None:
        """Take note that the robot went `way_m` forwards and turned by `turned` radians."""
        half = 0.5 * TRACK_M * turned
        left = way_m - half
        right = way_m + half
        normal = self._normal
        self.left_m += left * self._left_scale + normal.draw() * ENCODER_SLIP_SIGMA * math.sqrt(abs(left))
        self.right_m += right * self._right_scale + normal.draw() * ENCODER_SLIP_SIGMA * math.sqrt(abs(right))

    def gyro(self, rate: float) -> float:
        """Return a reading of the turn rate `rate`, rad/s."""
        return rate + self._gyro_bias + self._normal.draw() * GYRO_SIGMA

    def compass(self, theta: float) -> float:
        """Return a reading of the heading `theta`, radians in [-pi, pi]."""
        return math.remainder(theta + self._normal.draw() * COMPASS_SIGMA, math.tau)

    def ranges(self, now: Instant, x: float, y: float) -> tuple[tuple[int, float], ...]:
        """Return (beacon, metres) for every beacon that sent since the last call and was heard at (x, y)."""
        if now < self._next_pulse:
            return ()
        heard = []
        due = self._next_pulse
        self._next_pulse = NEVER
        period = self._period
        for index, phase in enumerate(self._phases):
            last = now - (now - phase) % period  # the latest pulse of this beacon up to now
            self._next_pulse = min(self._next_pulse, last + period)
            if last >= due and last >= phase:
                bx, by = self.beacons[index]
                metres = math.hypot(x - bx, y - by) + self._normal.draw() * self._sigma
                if self._random() >= self._dropout and last >= self.silent_until:
                    heard.append((index, max(0.0, metres)))
        return tuple(heard)

"""Sensor models of one robot: odometry, gyro, compass, ultrasonic ranges (paper V.B.1, V.B.2).

The model is that of a low-cost robot with differential drive. Each wheel encoder has a scale error, drawn once, and
slip noise that grows with the square root of the distance. The gyro has a bias and noise, the compass noise. The
ultrasonic beacons send in turn at regular instants, so that no two pulses overlap; in which order, and at which instant
the first one sends, is drawn (`pulse_phases`): a process begins to hear them at any instant. A pulse is lost with the
probability `dropout` of the lab; a range has noise of `sigma`.

All other numbers are drawn from the robot's own stream, in an order fixed by its own samples: the readings of a robot
with the same motion are the same whether other robots are present or not.
"""

import math
from collections.abc import Sequence
from random import Random
from typing import Final

from rmr.base.geometry import Point
from rmr.base.streams import Normals
from rmr.base.time import NEVER, NS_PER_S, Duration, Instant

TRACK_M: Final = 0.1
"""Distance between the wheels, metres."""
ENCODER_SCALE_SIGMA: Final = 0.005
"""Standard deviation of the relative scale error of an encoder (tyre wear), fixed per wheel."""
ENCODER_SLIP_SIGMA: Final = 0.002
"""Noise of an encoder, metres per square root of a metre: independent slips add up as a random walk."""
GYRO_BIAS_SIGMA: Final = 0.005
"""Standard deviation of the gyro's bias, rad/s, fixed per robot."""
GYRO_SIGMA: Final = 0.01
"""Standard deviation of the gyro's noise, rad/s."""
COMPASS_SIGMA: Final = math.radians(2.0)
"""Standard deviation of the compass's noise, radians."""
BODY_POSITION_SIGMA: Final = 0.002
"""Noise of another robot's position in the field of view, metres."""
BODY_VELOCITY_SIGMA: Final = 0.005
"""Noise of another robot's velocity in the field of view, m/s."""


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

    def __init__(
        self,
        rng: Random,
        beacons: tuple[Point, ...],
        rate: float,
        sigma: float,
        dropout: float,
        phases: tuple[Duration, ...] | None = None,
    ) -> None:
        """`phases`: when each beacon sends within a period; None: in their order, evenly spaced."""
        self.beacons = beacons
        self._normal = normal = Normals(rng)
        self._random = rng.random
        self._left_scale = 1.0 + normal.draw() * ENCODER_SCALE_SIGMA
        self._right_scale = 1.0 + normal.draw() * ENCODER_SCALE_SIGMA
        self._gyro_bias = normal.draw() * GYRO_BIAS_SIGMA
        self._period = round(NS_PER_S / rate)
        self._phases = _spaced(self._period, range(len(beacons))) if phases is None else phases
        self._next_pulse: Instant = 0 if beacons else NEVER
        self._sigma = sigma
        self._dropout = dropout
        self.left_m = 0.0
        """Distance of the left wheel as its encoder measures it, metres since power-on."""
        self.right_m = 0.0
        """The same for the right wheel."""
        self.silent_until: Instant = 0
        """End of the present outage of the localisation service: earlier pulses are not received."""

    def moved(self, way_m: float, turned: float) -> None:
        """Add a motion to the encoders: `way_m` metres forwards and `turned` radians."""
        half = 0.5 * TRACK_M * turned  # differential drive: the outer wheel goes farther by this, the inner one less
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
        """Return (beacon, metres) for each beacon with a pulse since the last call that was received at (x, y)."""
        if now < self._next_pulse:
            return ()
        heard: list[tuple[Instant, int, float]] = []
        due = self._next_pulse
        self._next_pulse = NEVER
        period = self._period
        for index, phase in enumerate(self._phases):
            last = now - (now - phase) % period  # the latest pulse of this beacon up to now
            self._next_pulse = min(self._next_pulse, last + period)
            if last >= due and last >= phase:
                bx, by = self.beacons[index]
                metres = math.hypot(x - bx, y - by) + self._normal.draw() * self._sigma
                # The noise above and this number are drawn for lost pulses, too: the stream keeps its order.
                if self._random() >= self._dropout and last >= self.silent_until:
                    heard.append((last, index, max(0.0, metres)))
        return tuple([(index, metres) for _, index, metres in sorted(heard)])


def pulse_phases(rng: Random, beacons: int, rate: float) -> tuple[Duration, ...]:
    """Return when each of `beacons` sends within a period: in an order and from an instant that `rng` draws."""
    period = round(NS_PER_S / rate)
    order = list(range(beacons))
    rng.shuffle(order)
    first = rng.randrange(period)
    return tuple([(phase + first) % period for phase in _spaced(period, order)])


def _spaced(period: Duration, order: Sequence[int]) -> tuple[Duration, ...]:
    """Return the instants at which beacons send that follow each other in `order`, evenly spaced over a period."""
    return tuple([period * place // max(1, len(order)) for place in order])

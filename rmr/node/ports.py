"""The seam between one robot's mind and whatever hosts it, a process or the simulator.

Inputs are values that the host hands over, outputs are values that it takes away; nothing here sleeps,
polls or reads a clock.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, final

from rmr.base.geometry import Pose, Twist
from rmr.base.time import NEVER, Duration, Instant
from rmr.base.values import Value
from rmr.radio.air import Confirmed, Received

__all__ = ["BodyPort", "Confirmed", "Ports", "PoseFix", "RadioPort", "Received", "SeenBody", "Sensed", "Spoken"]

SAMPLES_MAX: Final = 240
"""Sensor samples that wait for a node, of whatever host, four seconds of a moving robot; the oldest are dropped."""
FRAMES_MAX: Final = 512
"""Frames that wait for a node, and outcomes; the oldest are dropped."""
NAVIGATED: Final = "navigated"
"""The fact in a sample by which a driver outside of the mind tells how an order of `BodyPort.head` ended: its serial,
and why it failed, an empty text if it did not."""


@final
class SeenBody:
    """Another robot inside the field of view, as a tracking range finder reports it. It is never changed.

    Like a pose it can be unpacked, for actions that users write.
    """

    __slots__ = ("vx", "vy", "x", "y")

    def __init__(self, x: float, y: float, vx: float, vy: float) -> None:
        self.x: Final = x
        """Metres ahead of the robot's centre (robot frame)."""
        self.y: Final = y
        """Metres to the left."""
        self.vx: Final = vx
        """Velocity of the other body over the ground, m/s, along the robot's x axis."""
        self.vy: Final = vy
        """Likewise along the robot's y axis."""

    def __iter__(self) -> Iterator[float]:
        return iter(self._values())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SeenBody) and self._values() == other._values()

    def __hash__(self) -> int:
        return self._values().__hash__()

    def __repr__(self) -> str:
        return f"SeenBody(x={self.x!r}, y={self.y!r}, vx={self.vx!r}, vy={self.vy!r})"

    def __reduce__(self) -> tuple[type["SeenBody"], tuple[float, ...]]:
        return SeenBody, self._values()

    def _values(self) -> tuple[float, float, float, float]:
        return self.x, self.y, self.vx, self.vy


@final
class PoseFix:
    """A pose that a localisation outside of the robot's mind has measured, as of the sample it stands in."""

    __slots__ = ("sigma_m", "sigma_rad", "theta", "x", "y")

    def __init__(self, x: float, y: float, theta: float, sigma_m: float, sigma_rad: float) -> None:
        self.x: Final = x
        """Metres, on the floor of the lab."""
        self.y: Final = y
        self.theta: Final = theta
        """Heading, radians."""
        self.sigma_m: Final = sigma_m
        """Standard deviation of the position along its worst axis, as the service states it, metres."""
        self.sigma_rad: Final = sigma_rad
        """Likewise of the heading, radians."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PoseFix) and self.values() == other.values()

    def __hash__(self) -> int:
        return self.values().__hash__()

    def __repr__(self) -> str:
        return f"PoseFix{self.values()!r}"

    def __reduce__(self) -> tuple[type["PoseFix"], tuple[float, ...]]:
        return PoseFix, self.values()

    def values(self) -> tuple[float, float, float, float, float]:
        """Return its arguments."""
        return self.x, self.y, self.theta, self.sigma_m, self.sigma_rad


@final
class Sensed:
    """One sample of everything that a robot senses. It is never changed."""

    __slots__ = ("bodies", "bumped", "compass", "facts", "fix", "gyro", "left_m", "ranges", "right_m", "stamp", "truth")

    def __init__(
        self,
        stamp: Instant,
        left_m: float,
        right_m: float,
        gyro: float,
        compass: float | None,
        ranges: tuple[tuple[int, float], ...],
        bodies: tuple[SeenBody, ...],
        bumped: bool,
        truth: tuple[float, float, float],
        fix: PoseFix | None = None,
        facts: tuple[tuple[str, tuple[Value, ...]], ...] | None = None,
    ) -> None:
        self.stamp: Final = stamp
        self.left_m: Final = left_m
        """Way of the left wheel since power-on, metres (odometry, with slip)."""
        self.right_m: Final = right_m
        self.gyro: Final = gyro
        """Turn rate, rad/s."""
        self.compass: Final = compass
        """Heading, radians; None: the robot has no compass, and is localised by fixes."""
        self.ranges: Final = ranges
        """(beacon index, metres) for each ultrasonic pulse that arrived since the last sample; mostly empty."""
        self.bodies: Final = bodies
        """Robots in the field of view."""
        self.bumped: Final = bumped
        """Whether the hull touches anything."""
        self.truth: Final = truth
        """Ground truth for the radio shim alone: x, y in metres, heading. Never visible to the robot's mind."""
        self.fix: Final = fix
        """A pose measured from outside that arrived since the last sample."""
        self.facts: Final = facts
        """All facts that hold by what was said outside, without their owner; None: nothing was said."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sensed) and self._values() == other._values()

    def __hash__(self) -> int:
        return self._values().__hash__()

    def telling(self, facts: tuple[tuple[str, tuple[Value, ...]], ...]) -> "Sensed":
        """Return the same sample with `facts`."""
        felt = (self.stamp, self.left_m, self.right_m, self.gyro, self.compass, self.ranges, self.bodies)
        return Sensed(*felt, self.bumped, self.truth, self.fix, facts)

    def _values(self) -> tuple[object, ...]:
        felt = (self.stamp, self.left_m, self.right_m, self.gyro, self.compass, self.ranges)
        return (*felt, self.bodies, self.bumped, self.truth, self.fix, self.facts)


class Spoken(NamedTuple):
    """A frame that a robot has handed to its radio; an event for checkers."""

    payload: bytes
    destination: int | None = None
    """None: everybody."""
    handle: int = 0
    """The number by which the radio tells the outcome."""


class RadioPort(Protocol):
    """The radio as the robot sees it: IEEE 802.15.4 data frames."""

    @property
    def payload_max(self) -> int:
        """Octets of payload that a frame holds: 116, fewer where the radio secures frames. It never changes."""

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Queue `payload` for `destination` (None: broadcast). A `Confirmed` with `handle` follows.

        Frames with a deadline `due` change places in the queue among each other: earliest deadline first.

        Raises `ValueError` for a payload of more than `payload_max` octets.
        """

    def receive(self) -> list[Received]:
        """Return what has arrived since the last call, oldest first."""

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known since the last call."""


class BodyPort(Protocol):
    """Wheels and sensors."""

    def sense(self) -> list[Sensed]:
        """Return the samples since the last call, oldest first."""

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Command the wheels. The body drops commands older than 100 ms and brakes 0.1 s after the last was decided."""

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Let a driver outside of the mind drive to `target` (None: no more); said again while it is on its way.

        How it ended is told by a fact `NAVIGATED` in a sample. Only bodies that the configuration says to have such a
        driver are asked.
        """


@dataclass(frozen=True, slots=True)
class Ports:
    """What a host gives a node."""

    link: RadioPort
    body: BodyPort | None
    """None: a robot without a body (logic only). It sends no hellos, having no position. It has no senses, so the
    effects of an action on sensed predicates hold when it ends."""
    spent: Callable[[], Duration] | None = None
    """Processor time used since the current call of `tick` began; None: virtual time, which uses none."""
    neighbors: Callable[[], Sequence[tuple[int, float]]] | None = None
    """(robot, metres) of those in range, where the host knows; the same object while nothing has changed. None: the
    robot estimates it from the frames that it hears."""

"""Schedule of hellos: every 0.2 to 0.35 s while the robot moves, 0.5 to 1 s while it is parked, at once on a change.

A robot that drives elsewhere than its last hello lets others expect says so at once: as it sets out, turns or brakes.

Among few it speaks sooner while it waits for its turn, and for half a second when it begins (`rmr.node.profile`).

Others plan around parked robots and keep off places that are taken. A robot without a body has no position to report.

In a crowd a robot that will stand for a while promises to stay: robots that drive by need not hear it again so soon.
"""

from math import copysign, cos, sin
from random import Random
from typing import Final, final

from rmr.base.geometry import Pose, hypot
from rmr.base.motion_scale import way_to_stand
from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds
from rmr.node.payloads import Hello
from rmr.node.profile import CHANGE, HELLO_SPREAD, Profile

EAGER_FOR: Final[Duration] = milliseconds(500)
"""Start-up: for so long after it has begun a robot speaks often. The others wait until they have heard it, and should
not miss their turns where a frame in ten is lost."""
STAYS: Final[Duration] = seconds(3)
"""A promise to stay holds for so long: a parked robot of a crowd says three hellos meanwhile."""
STAYS_SPARE: Final[Duration] = milliseconds(500)
"""The robot stays so much longer than it has promised: a hello takes a while to be sent and read."""


@final
class ExpectedStand:
    """Where others that have heard a hello expect its robot to come to stand (dead reckoning, IEEE 1278).

    They take it that it goes on along its line.
    """

    __slots__ = ("_vx", "_vy", "_x", "_y")

    def __init__(self, hello: Hello) -> None:
        along = cos(hello.theta)
        aside = sin(hello.theta)
        way = copysign(way_to_stand(abs(hello.v)), hello.v)
        self._x: Final = hello.x + way * along
        self._y: Final = hello.y + way * aside
        self._vx: Final = hello.v * along
        self._vy: Final = hello.v * aside

    def astray_m(self, age_s: float, pose: Pose, v: float) -> float:
        """Return how far from there the robot would come to stand, metres.

        The hello is `age_s` seconds old; the robot is at `pose` and drives at `v` m/s.
        """
        way = copysign(way_to_stand(abs(v)), v)
        x = pose.x + way * cos(pose.theta) - self._x - self._vx * age_s
        y = pose.y + way * sin(pose.theta) - self._y - self._vy * age_s
        return hypot(x, y)


class HelloClock:
    """Says when the next hello is due; it does not know what a hello says."""

    def __init__(self, rng: Random, profile: Profile) -> None:
        self._rng = rng
        self._profile = profile
        self._eager_until: Instant = 0
        self.due: Instant = NEVER
        self.parked = True
        self._back = False

    def start(self, now: Instant) -> None:
        """Plan the first hello."""
        self.due = now + milliseconds(60) + round(self._rng.random() * self._profile.first_spread)
        self._eager_until = now + EAGER_FOR

    def begin(self, now: Instant) -> None:
        """Plan the first hello of a robot that knows from now on where it is, and had none to say when it was due."""
        self.due = now + round(self._rng.random() * self._profile.change_spread)
        self._eager_until = now + EAGER_FOR

    def soon(self, now: Instant) -> None:
        """Something that matters to the others has changed."""
        self.due = min(self.due, now + round(self._rng.random() * self._profile.change_spread))

    def at_once(self, now: Instant) -> None:
        """The robot alone has changed what it does: no others speak at the same time."""
        self.due = min(self.due, now + round(self._rng.random() * CHANGE))

    def poll(self, now: Instant, *, parked: bool, back: bool = False) -> None:
        """Notice a change between parked and moving, and between driving `back` and not: others reckon with it."""
        if parked != self.parked or back != self._back:
            self.parked = parked
            self._back = back
            self.soon(now)

    def rewind(self, now: Instant, *, waits: bool = False, leaves: bool = False, driving: int | None = None) -> None:
        """Plan the hello after the one that is said now by a robot that stands, or `waits` for its turn.

        In a crowd `driving` robots drive beside this one, and it may be about to drive, too: it `leaves`.
        """
        profile = self._profile
        period = profile.moving if driving is None else profile.moving_beside(driving)
        if self.parked and not leaves:
            period = profile.waiting if waits else profile.parked
        if now < self._eager_until:
            period = profile.eager
        self.due = now + round(period * self._rng.uniform(1.0 - HELLO_SPREAD, 1.0 + HELLO_SPREAD))

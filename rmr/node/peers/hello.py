"""Schedule of hellos: every 0.2 to 0.35 s while the robot moves, 0.5 to 1 s while it is parked, at once on a change.

A small group speaks more often: while waiting for a slot, and for half a second after boot. Others plan around parked
robots and keep off places that are taken. A robot without a body has no place to tell.

In a crowd most robots stand, and each frame is heard by all. A robot that will stand for a while says so (`STAYS`), and
need not be heard again so soon. Robots that drive, or are about to, share the rate among themselves alone.
"""

from random import Random
from typing import Final

from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds

PERIOD_MOVING: Final[Duration] = milliseconds(200)
"""Least period of a moving robot."""
PERIOD_MOVING_MAX: Final[Duration] = milliseconds(350)
"""Greatest period of a moving robot: two lost hellos in a row do not yet make it silent (`motion.hearing`)."""
MOVING_APART: Final[Duration] = milliseconds(8)
"""Period of a moving robot per robot of the roster, between least and greatest: all share one channel."""
PERIOD_PARKED: Final[Duration] = milliseconds(500)
"""Least period of a parked robot."""
PERIOD_PARKED_MAX: Final[Duration] = seconds(1)
"""Greatest period of a parked robot: one lost hello does not yet make it silent (`motion.hearing`)."""
PARKED_APART: Final[Duration] = milliseconds(20)
"""Period of a parked robot per robot of the roster; longer than `MOVING_APART`, so that the channel is left to those
that drive."""
FIRST_AFTER: Final[Duration] = milliseconds(60)
"""Delay of the first hello after boot, before its random spread."""
FIRST_SPREAD: Final[Duration] = milliseconds(20)
"""Random spread of the first hello per robot of the roster, one second at most where `ANSWER_SPREAD` allows."""
EAGER: Final[Duration] = milliseconds(500)
"""Start-up: time after boot with the period `PERIOD_EAGER`; others wait until they have heard the robot."""
PERIOD_EAGER: Final[Duration] = milliseconds(80)
"""Start-up: least period of hellos, so that one gets through soon where a frame in ten is lost."""
STAYS: Final[Duration] = seconds(3)
"""Time for which a robot that says that it stays does so: three hellos of one parked in a crowd."""
STAYS_SPARE: Final[Duration] = milliseconds(500)
"""Time beyond `STAYS` that the robot stands: its hello takes a while to be sent and read."""
SPREAD: Final = 0.1
"""Random share of a period, either way, so that two robots do not keep speaking at the same instants."""
CHANGE_SPREAD: Final[Duration] = milliseconds(20)
"""Random delay of a hello that tells a change, in a small group."""
ANSWER_SPREAD: Final[Duration] = milliseconds(5)
"""Random delay of a hello that tells a change, per robot of the roster: a new schedule concerns all at once."""


class HelloClock:
    """Says when the next hello is due; it does not know what a hello says."""

    def __init__(self, rng: Random, robots: int) -> None:
        self._rng = rng
        self._robots = robots
        self._moving_period = _period(robots, parked=False)
        self._parked_period = _period(robots, parked=True)
        self._waiting_period = min(max(PERIOD_MOVING, PARKED_APART * robots), self._parked_period)
        self._eager_period = min(max(PERIOD_EAGER, MOVING_APART * robots), self._moving_period)
        self._eager_until: Instant = 0
        self.due: Instant = NEVER
        self.parked = True
        self._back = False

    def start(self, now: Instant) -> None:
        """Plan the first hello."""
        spread = max(min(FIRST_SPREAD * self._robots, seconds(1)), ANSWER_SPREAD * self._robots)
        self.due = now + FIRST_AFTER + round(self._rng.random() * spread)
        self._eager_until = now + EAGER

    def soon(self, now: Instant) -> None:
        """Something that matters to the others has changed."""
        spread = max(CHANGE_SPREAD, ANSWER_SPREAD * self._robots)
        self.due = min(self.due, now + round(self._rng.random() * spread))

    def look(self, now: Instant, *, parked: bool, back: bool = False) -> None:
        """Notice a change between parked and moving, and between driving `back` and not: others reckon with it."""
        if parked != self.parked or back != self._back:
            self.parked = parked
            self._back = back
            self.soon(now)

    def rewind(self, now: Instant, *, waits: bool = False, leaves: bool = False, driving: int | None = None) -> None:
        """Plan the hello after the one that is said now by a robot that stands for good, or `waits` for its turn.

        In a crowd `driving` robots drive beside this one, and it may be about to drive, too: it `leaves`.
        """
        period = self._moving_period
        if driving is not None:
            period = min(period, max(PERIOD_MOVING, MOVING_APART * (driving + 1)))
        if self.parked and not leaves:
            period = self._waiting_period if waits else self._parked_period
        if now < self._eager_until:
            period = self._eager_period
        self.due = now + round(period * self._rng.uniform(1.0 - SPREAD, 1.0 + SPREAD))


def _period(robots: int, *, parked: bool) -> Duration:
    if parked:
        return min(max(PERIOD_PARKED, PARKED_APART * robots), PERIOD_PARKED_MAX)
    return min(max(PERIOD_MOVING, MOVING_APART * robots), PERIOD_MOVING_MAX)


def period_max(robots: int, *, parked: bool) -> Duration:
    """Return the longest time between two hellos of one of so many robots."""
    return round(_period(robots, parked=parked) * (1.0 + SPREAD))

"""When a robot says where it stands: every 0.2 to 0.35 s while it moves, 0.5 to 1 s while parked, at once on a change.

Among few it speaks sooner while it waits for its turn, and for half a second when it begins.

Others plan around parked robots and keep off places that are taken. A robot without a body has no place to tell.

In a crowd most robots stand, and each frame is heard by all. Who will stand for a while says that it stays: whoever
drives by need not hear it again so soon. Those that drive, or are about to, speak as often as so few of them may.
"""

from random import Random
from typing import Final

from rmr.base.time import NEVER, Duration, Instant, milliseconds, seconds

PERIOD_MOVING: Final[Duration] = milliseconds(200)
PERIOD_MOVING_MAX: Final[Duration] = milliseconds(350)
MOVING_APART: Final[Duration] = milliseconds(8)
PERIOD_PARKED: Final[Duration] = milliseconds(500)
PERIOD_PARKED_MAX: Final[Duration] = seconds(1)
PARKED_APART: Final[Duration] = milliseconds(20)
"""Per robot of the roster a period is so long, between its least and its greatest: many robots share one air, and those
that stand leave it to those that drive. At the longest period a robot of which two hellos in a row are lost while it
moves, or one while it is parked, is not yet taken for silent (`motion.hearing`)."""
FIRST_AFTER: Final[Duration] = milliseconds(60)
FIRST_SPREAD: Final[Duration] = milliseconds(20)
"""The first hellos are spread over this much per robot of the roster, at most one second where that is enough."""
EAGER: Final[Duration] = milliseconds(500)
PERIOD_EAGER: Final[Duration] = milliseconds(80)
"""For so long a robot that begins speaks that often, or as one that moves where that is no more often: the others wait
until they have heard it, and should not miss their turns where a frame in ten is lost."""
STAYS: Final[Duration] = seconds(3)
"""Who says that it stays does so for this long: one that is parked in a crowd says three hellos meanwhile."""
STAYS_SPARE: Final[Duration] = milliseconds(500)
"""And so much longer, for what it says takes a while to be sent and read."""
SPREAD: Final = 0.1
"""Share by which a period is shorter or longer, so that two robots do not speak at once for ever."""
CHANGE_SPREAD: Final[Duration] = milliseconds(20)
"""A change is told within this, where that is enough."""
ANSWER_SPREAD: Final[Duration] = milliseconds(5)
"""Per robot of the roster, enough: what matters to several, as a new schedule does, may change for all at once."""


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

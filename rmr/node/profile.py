"""What robots do differently in groups of different sizes: one value, chosen in one place from the size of the roster.

All robots share one channel, and each frame is heard by all. So the time between two hellos grows with the number of
robots, from a least to a greatest value, and those that stand leave the channel to those that drive. The kinks lie
where a period begins to grow: at 5 robots (spread of a change), 11 (waiting and eager robots), 26 (all others).

A roster of `CROWD_FROM` robots is a crowd: robots promise to stay, so that those that drive by need not hear them
often, and what costs time for each of many is left out.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from rmr.base.time import Duration, milliseconds, seconds

CROWD_FROM: Final = 21
"""Size of a roster from which it is a crowd. With more robots the first hellos take longer (with fifty 2.8 s) than
agreeing on slots, and each frame is heard by so many that to call them all costs more than all else."""
MOVING: Final[Duration] = milliseconds(200)
"""Least time between two hellos of a robot that drives, divided by its pace, `EAGER` at least: faster robots
are heard as often on the same way."""
MOVING_MAX: Final[Duration] = milliseconds(350)
"""Greatest time between two hellos of a robot that drives: if two in a row are lost it is not yet taken for silent."""
MOVING_PER_ROBOT: Final[Duration] = milliseconds(8)
"""Time between two hellos of a robot that drives, for each robot that speaks as often."""
PARKED: Final[Duration] = milliseconds(500)
"""Least time between two hellos of a parked robot."""
PARKED_MAX: Final[Duration] = seconds(1)
"""Greatest time between two hellos of a parked robot: if one is lost it is not yet taken for silent."""
PARKED_PER_ROBOT: Final[Duration] = milliseconds(20)
"""Time between two hellos of a parked robot, for each robot of the roster."""
EAGER: Final[Duration] = milliseconds(80)
"""Least time between two hellos of a robot that has just begun."""
FIRST_PER_ROBOT: Final[Duration] = milliseconds(20)
"""The first hellos are spread over this for each robot of the roster."""
FIRST_MAX: Final[Duration] = seconds(1)
"""The first hellos are spread over no more than this, where that is enough."""
CHANGE: Final[Duration] = milliseconds(20)
"""A change is announced within this, where that is enough."""
ANSWER_PER_ROBOT: Final[Duration] = milliseconds(5)
"""Time that suffices for each robot of the roster to say something: a new schedule changes things for all at once."""
HELLO_SPREAD: Final = 0.1
"""Share by which the time between two hellos is shorter or longer, so that no two robots speak at once repeatedly."""


@dataclass(frozen=True, slots=True)
class Profile:
    """The behaviour of the robots of a group of some size."""

    moving_least: Duration
    """Least time between two hellos of a robot that drives, beside few others that do."""
    moving: Duration
    """Time between two hellos of a robot that drives."""
    parked: Duration
    """Time between two hellos of a robot that is parked."""
    waiting: Duration
    """Time between two hellos of a parked robot that waits for its turn."""
    eager: Duration
    """Time between two hellos of a robot that has just begun."""
    first_spread: Duration
    """The first hellos are spread over this."""
    change_spread: Duration
    """A change is announced within this."""
    promises_to_stay: bool
    """A robot that will stand for a while says so. The others, being few, send often."""
    listens_first: bool
    """A robot asks for a turn only when it has heard where the others are."""
    late_goes_next: bool
    """A robot that comes too late for its slot, near the gate, goes next: the others would have to pass it."""
    finishes_in_order: bool
    """Entries lie so far apart that robots finish in the order in which they enter."""
    overhears_passing: bool
    """What a robot in the bottleneck says is taken in as it arrives, without a call of the node."""

    @property
    def moving_max(self) -> Duration:
        """The longest time between two hellos of a robot that drives."""
        return round(self.moving * (1.0 + HELLO_SPREAD))

    @property
    def parked_max(self) -> Duration:
        """The longest time between two hellos of a robot that is parked."""
        return round(self.parked * (1.0 + HELLO_SPREAD))

    def moving_beside(self, driving: int) -> Duration:
        """Return the time between two hellos of a robot that drives, beside so many others that are known to."""
        return min(self.moving, max(self.moving_least, MOVING_PER_ROBOT * (driving + 1)))


@lru_cache(maxsize=64)
def profile_of(robots: int, pace: float = 1.0) -> Profile:
    """Return the profile of a roster of so many robots, that drive `pace` times as fast as the reference robot."""
    crowd = robots >= CROWD_FROM
    moving_least = max(round(MOVING / pace), EAGER)
    moving = min(max(moving_least, MOVING_PER_ROBOT * robots), MOVING_MAX)
    parked = min(max(PARKED, PARKED_PER_ROBOT * robots), PARKED_MAX)
    return Profile(
        moving_least=moving_least,
        moving=moving,
        parked=parked,
        waiting=min(max(MOVING, PARKED_PER_ROBOT * robots), parked),
        eager=min(max(EAGER, MOVING_PER_ROBOT * robots), moving),
        first_spread=max(min(FIRST_PER_ROBOT * robots, FIRST_MAX), ANSWER_PER_ROBOT * robots),
        change_spread=max(CHANGE, ANSWER_PER_ROBOT * robots),
        promises_to_stay=crowd,
        listens_first=crowd,
        late_goes_next=crowd,
        finishes_in_order=not crowd,
        overhears_passing=crowd,
    )

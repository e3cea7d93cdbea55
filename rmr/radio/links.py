"""Effects on a link besides distance: shadowing, losses, bursts, and timed disturbances.

The state of a link at an instant is a function of (seed, the two ends, the instant), and of nothing else. So every
process and the simulator compute the same state.

*Shadowing* takes from or adds to a link a fixed normal number of decibels, the same both ways, within three
deviations (which bounds how far anybody hears). *Bursts* are the two-state model of Gilbert (1960) and Elliott
(1963): a link is good for an exponential time, then bad for another, in which frames are lost with a greater
probability; both ways alike, since an obstacle in a link also blocks its acknowledgements.
A *disturbance* is a stretch of time in which frames between groups of robots lose power, are lost by chance, or are
cut off: the lab file's lossy links, partitions and losses, and what `rmr fault` does to a running lab.
Losses are independent of each other. What applies to a frame is decided at its first symbol.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from math import inf
from typing import Any, Final, NamedTuple

from rmr.base.streams import stream
from rmr.base.time import NEVER, NS_PER_S, Duration, Instant
from rmr.radio.phy import RadioConfig

SHADOWING_SIGMAS: Final = 3.0
"""Standard deviations at which a link's shadowing is cut off."""

DISTURBANCES_MAX: Final = 256
"""Disturbances of one lab at a time, at most: each is checked for every frame that it may affect."""

GROUPS_MAX: Final = 64
"""Groups of one disturbance at most."""

CYCLES: Final = 64
"""A link's bursts are drawn anew after so many mean lengths of good and bad time together: a robot that is
started late need not follow them from the beginning, and no link keeps more than about 128 changes."""


class Disturbance(NamedTuple):
    """An interval of lab time in which some links are degraded."""

    since: Instant = 0
    until: Instant = NEVER
    """End of the half-open interval."""
    groups: tuple[tuple[int, ...], ...] = ()
    """Affected are frames from a robot of one group to a robot of another; without groups all frames. Robots of no
    group are not affected."""
    one_way: bool = False
    """Affected are only frames from an earlier group to a later one."""
    loss: float = 0.0
    """Probability that a frame is lost, for each receiver by itself."""
    attenuation_db: float = 0.0
    """Attenuation of the received power, dB; `inf` cuts the link: a frame is neither received nor sensed."""

    def check(self) -> "Disturbance":
        """Return itself. Raises `ValueError` that says what is wrong."""
        if not 0 <= self.since < self.until <= NEVER:
            raise ValueError("a disturbance ends after it begins, and begins at 0 or later")
        if not 0.0 <= self.loss <= 1.0:
            raise ValueError(f"loss {self.loss}: write a probability, 0 to 1")
        if not self.attenuation_db >= 0.0:
            raise ValueError(f"attenuation {self.attenuation_db}: write decibels, 0 or more")
        named = [robot for group in self.groups for robot in group]
        if len(self.groups) == 1 or len(self.groups) > GROUPS_MAX:
            raise ValueError(f"{len(self.groups)} groups: write 2 to {GROUPS_MAX}, or none for all robots")
        if not all(self.groups):
            raise ValueError("a group has no robots")
        if len(set(named)) != len(named):
            raise ValueError("a robot is in two groups")
        if not all(0 <= robot <= 0xFFFF for robot in named):
            raise ValueError("a robot's number must fit 16 bits")
        return self

    def to_wire(self) -> list[Any]:
        """Return the fields as values that msgpack carries."""
        return [self.since, self.until, [list(group) for group in self.groups], *self[3:]]

    @classmethod
    def from_wire(cls, fields: Any) -> "Disturbance":
        """Return the disturbance in `fields`. Raises `ValueError` if they cannot be one."""
        if not isinstance(fields, list | tuple) or len(fields) != len(cls._fields):
            raise ValueError("a disturbance has six fields")
        since, until, groups, one_way, loss, attenuation_db = fields
        if not (type(since) is int and type(until) is int and isinstance(one_way, bool)):
            raise ValueError("a disturbance's times are integers, and it is one way or not")
        if not (isinstance(loss, int | float) and isinstance(attenuation_db, int | float)):
            raise ValueError("a disturbance's loss and attenuation are numbers")
        if not isinstance(groups, list | tuple) or not all(isinstance(group, list | tuple) for group in groups):
            raise ValueError("a disturbance's groups are lists")
        if not all(type(robot) is int for group in groups for robot in group):
            raise ValueError("a disturbance's groups hold robots' numbers")
        made = cls(since, until, tuple(map(tuple, groups)), one_way, float(loss), float(attenuation_db))
        return made.check()


class _Active:
    """A disturbance with its robots by group."""

    __slots__ = ("attenuation_db", "group_of", "loss", "one_way", "since", "until")

    def __init__(self, disturbance: Disturbance) -> None:
        self.since = disturbance.since
        self.until = disturbance.until
        self.loss = disturbance.loss
        self.attenuation_db = disturbance.attenuation_db
        self.one_way = disturbance.one_way
        self.group_of = {robot: index for index, group in enumerate(disturbance.groups) for robot in group}

    def touches(self, source: int, receiver: int, at: Instant) -> bool:
        if not self.since <= at < self.until:
            return False
        if not self.group_of:
            return True
        one = self.group_of.get(source)
        other = self.group_of.get(receiver)
        if one is None or other is None:
            return False
        return one < other if self.one_way else one != other


class _Weather(NamedTuple):
    """One link's changes between good and bad within one stretch of `CYCLES` cycles."""

    begin: Instant
    finish: Instant
    bad_first: bool
    changes: list[Instant]


class Links:
    """The state of every link of one lab."""

    def __init__(self, config: RadioConfig, seed: int, disturbances: Iterable[Disturbance] = ()) -> None:
        """`seed` is the radio's. Raises `ValueError` for a disturbance that cannot be one."""
        self._config = config
        self._seed = seed
        self._active: list[_Active] = []
        self._shadowing: dict[tuple[int, int], float] = {}
        self._weather: dict[tuple[int, int], _Weather] = {}
        self.replace(disturbances)

    def replace(self, disturbances: Iterable[Disturbance]) -> None:
        """Replace all disturbances by these. Raises `ValueError`."""
        checked = [disturbance.check() for disturbance in disturbances]
        if len(checked) > DISTURBANCES_MAX:
            raise ValueError(f"{len(checked)} disturbances: at most {DISTURBANCES_MAX} at a time")
        self._active = [_Active(disturbance) for disturbance in checked]
        config = self._config
        self.fades = bool(config.shadowing_db) or any(active.attenuation_db for active in self._active)
        """Whether any link has a gain besides its path loss; else `gain_db` is always 0."""
        self.loses = bool(config.loss or config.bursts) or any(active.loss for active in self._active)
        """Whether any frame may be lost by chance: else `loss` is always 0."""

    @property
    def even(self) -> bool:
        """Whether `loss` is that of the configuration on all links at all times."""
        return self._config.bursts is None and not any(active.loss for active in self._active)

    def gain_db(self, source: int, receiver: int, at: Instant) -> float:
        """Return the gain, dB, of a frame that begins `at`; minus infinity where the link is cut."""
        gain = self._shadow(source, receiver) if self._config.shadowing_db else 0.0
        for active in self._active:
            if active.attenuation_db and active.touches(source, receiver, at):
                gain -= active.attenuation_db
        return gain

    def loss(self, source: int, receiver: int, at: Instant) -> float:
        """Return the probability that a frame that begins `at` is lost independently of its power."""
        kept = 1.0 - self._config.loss
        for active in self._active:
            if active.loss and active.touches(source, receiver, at):
                kept *= 1.0 - active.loss
        bursts = self._config.bursts
        if bursts is not None and self.is_bad(source, receiver, at):
            kept *= 1.0 - bursts.loss
        return 1.0 - kept

    def is_bad(self, source: int, receiver: int, at: Instant) -> bool:
        """Whether the link is in the bad state of the burst model at `at`."""
        pair = (source, receiver) if source < receiver else (receiver, source)
        weather = self._weather.get(pair)
        if weather is None or not weather.begin <= at < weather.finish:
            weather = self._weather[pair] = self._forecast(pair, at)
        return weather.bad_first ^ (bisect_right(weather.changes, at) % 2 == 1)

    def _shadow(self, source: int, receiver: int) -> float:
        pair = (source, receiver) if source < receiver else (receiver, source)
        known = self._shadowing.get(pair)
        if known is None:
            sigma = self._config.shadowing_db
            drawn = stream(f"{self._seed}/link{pair[0]}-{pair[1]}/shadowing").gauss(0.0, sigma)
            limit = SHADOWING_SIGMAS * sigma
            known = self._shadowing[pair] = max(-limit, min(limit, drawn))
        return known

    def _forecast(self, pair: tuple[int, int], at: Instant) -> _Weather:
        bursts = self._config.bursts
        assert bursts is not None
        means = bursts.good, bursts.bad
        length: Duration = CYCLES * (bursts.good + bursts.bad)
        index = at // length
        chance = stream(f"{self._seed}/link{pair[0]}-{pair[1]}/bursts/{index}")
        bad_first = bad = chance.random() * (bursts.good + bursts.bad) < bursts.bad
        begin = now = index * length
        changes: list[Instant] = []
        while True:
            now += round(chance.expovariate(NS_PER_S / means[bad]) * NS_PER_S)
            if now >= begin + length:
                return _Weather(begin, begin + length, bad_first, changes)
            changes.append(now)
            bad = not bad


def partition(groups: Sequence[Sequence[int]], since: Instant = 0, until: Instant = NEVER) -> Disturbance:
    """Return the disturbance that cuts `groups` off from each other."""
    return Disturbance(since, until, tuple(map(tuple, groups)), attenuation_db=inf)


def muted(robot: int, roster: Iterable[int], since: Instant = 0, until: Instant = NEVER) -> Disturbance:
    """Return the disturbance that cuts off all frames from `robot` to the rest of `roster`."""
    others = tuple(other for other in roster if other != robot)
    return Disturbance(since, until, ((robot,), others), one_way=True, attenuation_db=inf)


def deafened(robot: int, roster: Iterable[int], since: Instant = 0, until: Instant = NEVER) -> Disturbance:
    """Return the disturbance that cuts off all frames from the rest of `roster` to `robot`."""
    others = tuple(other for other in roster if other != robot)
    return Disturbance(since, until, (others, (robot,)), one_way=True, attenuation_db=inf)

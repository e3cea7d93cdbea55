"""Random faults: what `rmr sim --chaos` adds to a lab.

All are drawn from the stream ``SEED/chaos``, so that a seed always has the same faults. Each seed uses only some kinds
of faults, each with an intensity of its own (swarm testing: Groce et al., ISSTA 2012), for with all kinds at once many
failures mask one another. A run has two phases, as in TigerBeetle's simulator. In the safety phase faults come and go,
and nothing unsafe may happen. In the liveness phase there are no faults, every robot lives, and all must finish within
the lab's own duration.

Hard chaos adds faults of other kinds, which last longer, to those of the same seed. They are drawn from the stream
``SEED/chaos/hard``, so that the faults of ordinary chaos stay what they are.

Times are whole milliseconds and shares have two decimals, so that the faults can be written into a lab file.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import exp, inf, log
from random import Random

from rmr.base.streams import stream
from rmr.base.time import NS_PER_MS, Duration, Instant
from rmr.radio.links import DISTURBANCES_MAX, Disturbance, deafened, muted, partition
from rmr_world.lab import Fault, Kill, Lab, Outage, Restart, Slow, Stall

HEAL_MS = 20_000, 30_000
"""Range of the end of the safety phase, ms: long enough to hit each phase of the labs' programs."""
USED = 0.5
"""Probability that a kind of fault is used."""
AGAIN = 0.25
"""Probability that a restarted robot is killed once more."""
HARD_MAX = 3
"""Bound of the faults of each kind of hard chaos: each takes a robot or a link away for most of a run."""
FAULTS_MAX = 12
"""Bound of the faults of each kind, beside the number of robots. More make a run no harder, only longer to read."""
HARD_FROM_MS_MAX = 30_000
"""Latest beginning of a fault of hard chaos: later the robots of most labs have finished."""
HARD_LENGTH_MS = 4_000, 60_000
"""Range of the length of a stall of hard chaos, from the longest one of ordinary chaos on."""
HARD_RADIO_MS = 4_000, 30_000
"""Range of the length of the faults of the radio of hard chaos."""
BURSTS_MAX = 30
"""Bound of the bursts of a run."""

_Drawn = Iterator[Fault | Disturbance]


class _Draws:
    """The random draws of one run: robots, times and intensities of faults."""

    def __init__(self, chance: Random, roster: tuple[int, ...]) -> None:
        self.chance = chance
        self.roster = roster
        self.heal_ms = chance.randint(*HEAL_MS)
        self.mortal: tuple[int, ...] = roster
        """Robots that may be killed."""

    def times(self, most: int) -> range:
        """Return a random number of faults, from 1 to `most`, as a range."""
        return range(self.chance.randint(1, max(1, most)))

    @property
    def most(self) -> int:
        """Bound of the number of faults of single robots."""
        return min(len(self.roster), FAULTS_MAX)

    def length_ms(self, shortest_ms: int, longest_ms: int) -> int:
        """Return the length of a fault, log-uniformly distributed."""
        return round(exp(self.chance.uniform(log(shortest_ms), log(longest_ms))))

    def span(self, shortest_ms: int, longest_ms: int) -> tuple[Instant, Instant]:
        """Return the beginning and the end of a fault within the safety phase."""
        length_ms = self.length_ms(shortest_ms, longest_ms)
        since_ms = self.chance.randint(0, self.heal_ms - length_ms)
        return since_ms * NS_PER_MS, (since_ms + length_ms) * NS_PER_MS

    def hard_span(self, shortest_ms: int, longest_ms: int) -> tuple[Instant, Instant]:
        """Return the beginning and the end of a fault of hard chaos."""
        length_ms = self.length_ms(shortest_ms, longest_ms)
        since_ms = self.chance.randint(0, HARD_FROM_MS_MAX)
        return since_ms * NS_PER_MS, (since_ms + length_ms) * NS_PER_MS

    def robot(self) -> int:
        """Return one of the robots."""
        return self.chance.choice(self.roster)

    def share(self, least: float, most: float) -> float:
        """Return a share of frames."""
        return round(self.chance.uniform(least, most), 2)

    def two(self) -> tuple[tuple[int, ...], ...]:
        """Return two different robots as groups."""
        a, b = self.chance.sample(self.roster, 2)
        return (a,), (b,)


def _losses(draws: _Draws) -> _Drawn:
    for _ in draws.times(3):
        since, until = draws.span(1000, 15_000)
        yield Disturbance(since, until, loss=draws.share(0.05, 0.6))


def _bursts(draws: _Draws) -> _Drawn:
    """All frames are lost for a moment, as under interference by another radio."""
    for _ in draws.times(BURSTS_MAX):
        since, until = draws.span(20, 400)
        yield Disturbance(since, until, loss=1.0)


def _bad_links(draws: _Draws) -> _Drawn:
    for _ in draws.times(2 * draws.most):
        since, until = draws.span(500, 10_000)
        yield Disturbance(since, until, draws.two(), loss=draws.share(0.2, 1.0))


def _one_way_links(draws: _Draws) -> _Drawn:
    for _ in draws.times(draws.most):
        since, until = draws.span(500, 10_000)
        yield Disturbance(since, until, draws.two(), one_way=True, attenuation_db=inf)


def _partitions(draws: _Draws) -> _Drawn:
    for _ in draws.times(3):
        yield _parted(draws, *draws.span(500, 8000))


def _parted(draws: _Draws, since: Instant, until: Instant) -> Disturbance:
    """Return a partition into two parts at random."""
    robots = draws.chance.sample(draws.roster, len(draws.roster))
    cut = draws.chance.randint(1, len(robots) - 1)
    return partition([sorted(robots[:cut]), sorted(robots[cut:])], since, until)


def _stalls(draws: _Draws) -> _Drawn:
    for _ in draws.times(draws.most):
        yield Stall(*draws.span(50, 4000), draws.robot())


def _slow_ticks(draws: _Draws) -> _Drawn:
    for _ in draws.times(draws.most):
        yield Slow(*draws.span(1000, 10_000), draws.robot(), draws.length_ms(30, 400) * NS_PER_MS)


def _outages(draws: _Draws) -> _Drawn:
    for _ in draws.times(3):
        since, until = draws.span(500, 8000)
        deaf = draws.chance.sample(draws.roster, draws.chance.randint(1, len(draws.roster)))
        yield from (Outage(since, until, robot) for robot in sorted(deaf))


def _crashes(draws: _Draws) -> _Drawn:
    chance = draws.chance
    for robot in chance.sample(draws.mortal, min(len(draws.mortal), chance.randint(1, draws.most))):
        at_ms = 0
        while True:
            dead_ms = draws.length_ms(200, 6000)
            at_ms += chance.randint(0, max(0, draws.heal_ms - dead_ms - at_ms))
            if at_ms + dead_ms > draws.heal_ms:
                break
            yield Kill(at_ms * NS_PER_MS, robot)
            at_ms += dead_ms
            yield Restart(at_ms * NS_PER_MS, robot)
            if chance.random() >= AGAIN:
                break
            at_ms += 1


def _long_stalls(draws: _Draws) -> _Drawn:
    for _ in draws.times(HARD_MAX):
        yield Stall(*draws.hard_span(*HARD_LENGTH_MS), draws.robot())


def _mute(draws: _Draws) -> _Drawn:
    for _ in draws.times(HARD_MAX):
        since, until = draws.hard_span(*HARD_RADIO_MS)
        yield muted(draws.robot(), draws.roster, since, until)


def _deaf(draws: _Draws) -> _Drawn:
    for _ in draws.times(HARD_MAX):
        since, until = draws.hard_span(*HARD_RADIO_MS)
        yield deafened(draws.robot(), draws.roster, since, until)


def _long_partitions(draws: _Draws) -> _Drawn:
    for _ in draws.times(HARD_MAX):
        yield _parted(draws, *draws.hard_span(*HARD_RADIO_MS))


ALONE: tuple[Callable[[_Draws], _Drawn], ...] = (_losses, _bursts, _stalls, _slow_ticks, _outages, _crashes)
TOGETHER: tuple[Callable[[_Draws], _Drawn], ...] = (_bad_links, _one_way_links, _partitions)
"""Kinds of faults that need two robots."""
HARD_ALONE: tuple[Callable[[_Draws], _Drawn], ...] = (_long_stalls,)
HARD_TOGETHER: tuple[Callable[[_Draws], _Drawn], ...] = (_mute, _deaf, _long_partitions)
"""Further kinds of hard chaos."""


def with_chaos(lab: Lab, seed: int, *, hard: bool = False) -> Lab:
    """Return `lab` with the faults of `seed` added to its own, and its duration counted from the end of these.

    With `hard` those of hard chaos are added, too.
    """
    chance = stream(f"{seed}/chaos")
    draws = _Draws(chance, lab.roster)
    fated = {fault.robot for fault in lab.faults if isinstance(fault, Kill | Restart)}
    draws.mortal = tuple(robot for robot in lab.roster if robot not in fated)
    drawn = _drawn(draws, ALONE, TOGETHER)
    heal: Duration = draws.heal_ms * NS_PER_MS
    if hard:
        added = _drawn(_Draws(stream(f"{seed}/chaos/hard"), lab.roster), HARD_ALONE, HARD_TOGETHER)
        heal = max(heal, *(one.until if isinstance(one, Disturbance) else _end(one) for one in added))
        drawn = added + drawn  # where there is no room for all, ordinary disturbances are left out
    room = DISTURBANCES_MAX - len(lab.disturbances)
    disturbances = [fault for fault in drawn if isinstance(fault, Disturbance)][:room]
    faults = [fault for fault in drawn if not isinstance(fault, Disturbance)]
    return replace(
        lab,
        faults=(*lab.faults, *faults),
        disturbances=(*lab.disturbances, *disturbances),
        duration=heal + lab.duration,
    )


def _drawn(
    draws: _Draws, alone: tuple[Callable[[_Draws], _Drawn], ...], together: tuple[Callable[[_Draws], _Drawn], ...]
) -> list[Fault | Disturbance]:
    """Return the faults of some of the kinds, of one at least."""
    chance = draws.chance
    kinds = alone + together if len(draws.roster) > 1 else alone
    used = [kind for kind in kinds if chance.random() < USED] or [chance.choice(kinds)]
    return [fault for kind in used for fault in kind(draws)]


def _end(fault: Fault) -> Instant:
    return fault.at if isinstance(fault, Kill | Restart) else fault.end

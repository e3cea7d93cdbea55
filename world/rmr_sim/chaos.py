"""Faults at random: what `rmr sim --chaos` adds to a lab.

All is drawn from the stream ``SEED/chaos``, so a seed always meets the same faults. Each seed uses some of the kinds
alone, each of them as hard as is drawn (swarm testing: Groce et al., ISSTA 2012): where everything always goes wrong,
much hides behind the rest. A run has two phases, as in TigerBeetle's simulator: until it heals, faults come and go, and
nothing unsafe may happen whatever they do; from then on nothing goes wrong any more, every robot lives, and all must
finish within the lab's own duration.

Times are whole milliseconds and shares have two decimals, so that what is drawn can be written into a lab file.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import exp, inf, log
from random import Random

from rmr.base.streams import stream
from rmr.base.time import NS_PER_MS, Duration, Instant
from rmr.radio.links import DISTURBANCES_MAX, Disturbance, partition
from rmr_world.lab import Fault, Kill, Lab, Outage, Restart, Slow, Stall

HEAL_MS = 20_000, 30_000
"""When the last fault is over: time enough to hit each phase of the labs' programs."""
USED = 0.5
"""Probability of each kind of fault to be used."""
AGAIN = 0.25
"""Probability of a robot that has been started again to die once more."""
FAULTS_MAX = 12
"""Of each kind; as often as there are robots at most. More do not make it harder, only longer to read."""
BURSTS_MAX = 30

_Drawn = Iterator[Fault | Disturbance]


class _Scene:
    """What faults are drawn for: the robots, the time, and how hard a kind of fault hits."""

    def __init__(self, chance: Random, roster: tuple[int, ...]) -> None:
        self.chance = chance
        self.roster = roster
        self.heal_ms = chance.randint(*HEAL_MS)
        self.mortal: tuple[int, ...] = roster
        """Who may be killed."""

    def times(self, most: int) -> range:
        """Return how often a kind of fault occurs, `most` at most."""
        return range(self.chance.randint(1, max(1, most)))

    @property
    def most(self) -> int:
        """How often a fault of single robots occurs at most."""
        return min(len(self.roster), FAULTS_MAX)

    def length_ms(self, shortest_ms: int, longest_ms: int) -> int:
        """Return the length of a fault; short ones are as likely as long ones, in proportion."""
        return round(exp(self.chance.uniform(log(shortest_ms), log(longest_ms))))

    def span(self, shortest_ms: int, longest_ms: int) -> tuple[Instant, Instant]:
        """Return the beginning and the end of a fault, which is over when the run heals."""
        length_ms = self.length_ms(shortest_ms, longest_ms)
        since_ms = self.chance.randint(0, self.heal_ms - length_ms)
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


def _losses(scene: _Scene) -> _Drawn:
    for _ in scene.times(3):
        since, until = scene.span(1000, 15_000)
        yield Disturbance(since, until, loss=scene.share(0.05, 0.6))


def _bursts(scene: _Scene) -> _Drawn:
    """Nobody understands anybody for a moment, as when somebody else's radio drowns all."""
    for _ in scene.times(BURSTS_MAX):
        since, until = scene.span(20, 400)
        yield Disturbance(since, until, loss=1.0)


def _bad_links(scene: _Scene) -> _Drawn:
    for _ in scene.times(2 * scene.most):
        since, until = scene.span(500, 10_000)
        yield Disturbance(since, until, scene.two(), loss=scene.share(0.2, 1.0))


def _one_way_links(scene: _Scene) -> _Drawn:
    for _ in scene.times(scene.most):
        since, until = scene.span(500, 10_000)
        yield Disturbance(since, until, scene.two(), one_way=True, attenuation_db=inf)


def _partitions(scene: _Scene) -> _Drawn:
    for _ in scene.times(3):
        since, until = scene.span(500, 8000)
        robots = scene.chance.sample(scene.roster, len(scene.roster))
        cut = scene.chance.randint(1, len(robots) - 1)
        yield partition([sorted(robots[:cut]), sorted(robots[cut:])], since, until)


def _stalls(scene: _Scene) -> _Drawn:
    for _ in scene.times(scene.most):
        yield Stall(*scene.span(50, 4000), scene.robot())


def _slow_ticks(scene: _Scene) -> _Drawn:
    for _ in scene.times(scene.most):
        yield Slow(*scene.span(1000, 10_000), scene.robot(), scene.length_ms(30, 400) * NS_PER_MS)


def _outages(scene: _Scene) -> _Drawn:
    for _ in scene.times(3):
        since, until = scene.span(500, 8000)
        deaf = scene.chance.sample(scene.roster, scene.chance.randint(1, len(scene.roster)))
        yield from (Outage(since, until, robot) for robot in sorted(deaf))


def _crashes(scene: _Scene) -> _Drawn:
    chance = scene.chance
    for robot in chance.sample(scene.mortal, min(len(scene.mortal), chance.randint(1, scene.most))):
        at_ms = 0
        while True:
            dead_ms = scene.length_ms(200, 6000)
            at_ms += chance.randint(0, max(0, scene.heal_ms - dead_ms - at_ms))
            if at_ms + dead_ms > scene.heal_ms:
                break
            yield Kill(at_ms * NS_PER_MS, robot)
            at_ms += dead_ms
            yield Restart(at_ms * NS_PER_MS, robot)
            if chance.random() >= AGAIN:
                break
            at_ms += 1


ALONE: tuple[Callable[[_Scene], _Drawn], ...] = (_losses, _bursts, _stalls, _slow_ticks, _outages, _crashes)
TOGETHER: tuple[Callable[[_Scene], _Drawn], ...] = (_bad_links, _one_way_links, _partitions)
"""Kinds of faults that take two robots."""


def with_chaos(lab: Lab, seed: int) -> Lab:
    """Return `lab` with the faults of `seed` beside its own, and its duration counted from when they are over."""
    chance = stream(f"{seed}/chaos")
    scene = _Scene(chance, lab.roster)
    fated = {fault.robot for fault in lab.faults if isinstance(fault, Kill | Restart)}
    scene.mortal = tuple(robot for robot in lab.roster if robot not in fated)
    kinds = ALONE + TOGETHER if len(lab.roster) > 1 else ALONE
    used = [kind for kind in kinds if chance.random() < USED] or [chance.choice(kinds)]
    drawn = [fault for kind in used for fault in kind(scene)]
    room = DISTURBANCES_MAX - len(lab.disturbances)
    disturbances = [fault for fault in drawn if isinstance(fault, Disturbance)][:room]
    faults = [fault for fault in drawn if not isinstance(fault, Disturbance)]
    heal: Duration = scene.heal_ms * NS_PER_MS
    return replace(
        lab,
        faults=(*lab.faults, *faults),
        disturbances=(*lab.disturbances, *disturbances),
        duration=heal + lab.duration,
    )

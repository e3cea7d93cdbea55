"""Faults at random: what `rmr sim --chaos` adds to a lab.

All is drawn from the stream ``SEED/chaos``, so a seed always meets the same faults. A run has two phases (as in
TigerBeetle's simulator): until `Chaos.heal` faults come and go, and whatever they do, nothing unsafe may happen;
from then on nothing goes wrong any more, and the robots must finish. The run may last `HEALED` longer than healing.
"""

from dataclasses import replace
from random import Random

from rmr.base.streams import stream
from rmr.base.time import Instant, seconds
from rmr.radio.links import Disturbance
from rmr_world.lab import Lab

HEAL_S = 20.0, 30.0
"""When the last fault is over: time enough for each phase of the labs' programs to be hit."""


def with_chaos(lab: Lab, seed: int) -> Lab:
    """Return `lab` with the faults of `seed`, and time enough to finish after they are over."""
    chance = stream(f"{seed}/chaos")
    heal = seconds(chance.uniform(*HEAL_S))
    disturbances = (*lab.disturbances, *_losses(chance, heal))
    return replace(lab, disturbances=disturbances, duration=heal + lab.duration)


def _losses(chance: Random, heal: Instant) -> list[Disturbance]:
    """Return a stretch of time in which all frames are lost by chance."""
    since, until = sorted(chance.sample(range(heal), 2))
    return [Disturbance(since, until, loss=chance.uniform(0.05, 0.6))]

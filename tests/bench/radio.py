"""What the radio costs in virtual time: a table, and JSON in build/bench-radio.json.

    python tests/bench/radio.py [--quick] [--output FILE] [--write FOLDER] [--page FILE]

*Receptions.* 50 stations on a circle of 10 m, all in range of each other, broadcast 10 frames of 50 octets a second
each for 60 s of virtual time, with the radio of the reference. ns-3 3.44 (C++) transmits 6,100 frames and receives
178,000 a second of processor time there; here it is to be a third of its receptions at least. A reception is one that
came through; each is handed to its station, as in the simulator, or only counted.

*Reach.* Robots with a weak radio in groups of ten, a frame a second each, all of a group in range of each other and of
nobody else: what a frame costs with 1, 10 and 100 groups once all have sent before. It must not grow with the robots
out of reach.

Each figure is the best of some rounds, of processor time; the exit code is 0 only if every target is met.
"""

import argparse
import gc
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from math import ceil, sqrt

import numpy as np
from page import add_options, figure_rows, keep, table
from run import Figure, show

from rmr.base.kernel import ROBOT, Kernel
from rmr.base.streams import stream
from rmr.base.time import NS_PER_S, Instant
from rmr.radio.air import Announcement, Confirmed, Received
from rmr.radio.ether import Ether
from rmr.radio.ether_station import EtherStation
from rmr.radio.phy import RadioConfig
from rmr.radio.trials import REFERENCE
from rmr.radio.trials.places import Place, circle
from rmr.radio.trials.traffic import PAN

NS3_RECEPTIONS = 178_000
"""A second of processor time; its frames: 6,100."""
STATIONS = 50
RATE_FPS = 10.0
PAYLOAD = bytes(50)
SECONDS = 60
ROUNDS = 3

WEAK = RadioConfig(tx_power_dbm=-30.0)
"""Received over 2 m, disturbing over 9 m."""
GROUP = 10
"""Robots on a circle of half a metre."""
APART_M = 50.0
"""From one group to the next."""
ROBOTS = (10, 100, 1_000)
REACH_FPS = 1.0
FRAMES = 6_000
"""Of each number of robots."""
WARM_UP_S = 3.0
"""Nineteen of twenty have then sent, and what they reach is known."""
GROWTH_MAX = 1.5
"""Cost of a frame among 1,000 robots over that among 10: their places in the arrays, and a longer queue of events. If
it grew with the robots out of reach it would be nearly 100."""


class Field:
    """Stations that broadcast at random, and what it costs."""

    def __init__(self, config: RadioConfig, places: list[Place], rate_fps: float, *, handed: bool) -> None:
        self.frames = self.handed_on = 0
        self._rate_fps = rate_fps
        self._kernel = Kernel()
        self._ether = Ether(self._kernel, config, 0, PAN)
        self._ether.on_air = self._count
        take = self._take if handed else None
        for address, (x, y) in enumerate(places):
            station = self._ether.add(address, stream(f"bench/{address}/csma"), take, x, y)
            self._offer(station, stream(f"bench/{address}/arrivals").expovariate)

    def run(self, seconds: float) -> float:
        """Run on for so long in virtual time; return the seconds of processor time."""
        gc.collect()
        began = time.process_time()
        self._kernel.run_until(self._kernel.now + round(seconds * NS_PER_S))
        return time.process_time() - began

    @property
    def received(self) -> int:
        """Receptions of all stations."""
        return sum(station.counters.received for station in self._ether.stations)

    def _offer(self, station: EtherStation, gap_s: Callable[[float], float]) -> None:
        def offer(now: Instant) -> None:
            station.request(PAYLOAD, None, 0)
            self._kernel.at(now + round(gap_s(self._rate_fps) * NS_PER_S), ROBOT, offer)

        self._kernel.at(round(gap_s(self._rate_fps) * NS_PER_S), ROBOT, offer)

    def _count(self, _announcement: Announcement) -> None:
        self.frames += 1

    def _take(self, what: Received | Confirmed) -> None:
        self.handed_on += isinstance(what, Received)


def receptions(rounds: int, seconds: int) -> Iterable[Figure]:
    """Frames and receptions a second of processor time with all in range."""
    for handed, words in ((True, "each handed on"), (False, "counted only")):
        best: tuple[float, float] = 0.0, 0.0
        for _ in range(rounds):
            field = Field(REFERENCE, circle(STATIONS, 10.0), RATE_FPS, handed=handed)
            taken_s = field.run(seconds)
            assert field.handed_on == (field.received if handed else 0)
            best = max(best, (field.received / taken_s, field.frames / taken_s))
        target = round(NS3_RECEPTIONS / 3e3, 1) if handed else None
        name, unit = f"50 stations in range, {words}", "thousand/s"
        yield Figure(f"{name}: receptions", best[0] / 1e3, unit, target, at_least=True)
        yield Figure(f"{name}: frames", best[1] / 1e3, unit)


def in_groups(robots: int) -> list[Place]:
    """Return the places of robots in groups on a square grid."""
    groups = robots // GROUP
    columns = ceil(sqrt(groups))
    corners = [(APART_M * (group % columns), APART_M * (group // columns)) for group in range(groups)]
    return [(x + dx, y + dy) for x, y in corners for dx, dy in circle(GROUP, 0.5)]


def reach(rounds: int, frames: int) -> Iterable[Figure]:
    """Cost of a frame among more and more robots, most of them out of reach."""
    costs: list[float] = []
    for robots in ROBOTS:
        taken = []
        for _ in range(rounds):
            field = Field(WEAK, in_groups(robots), REACH_FPS, handed=True)
            field.run(WARM_UP_S)
            before = field.frames
            taken.append(field.run(frames / robots / REACH_FPS) / (field.frames - before))
        costs.append(min(taken) * 1e6)
        yield Figure(f"{robots:,} robots in groups of 10: cost of a frame", costs[-1], "us")
    yield Figure("cost of a frame, 1,000 robots over 10", costs[-1] / costs[0], "", GROWTH_MAX)


def main() -> int:
    """Take all figures; return the exit code."""
    parser = argparse.ArgumentParser(description="Take what the radio costs in virtual time.")
    parser.add_argument("--quick", action="store_true", help="less time and fewer rounds")
    add_options(parser, "radio")
    options = parser.parse_args()
    rounds, seconds, frames = (1, SECONDS // 10, FRAMES // 4) if options.quick else (ROUNDS, SECONDS, FRAMES)
    taken = [*receptions(rounds, seconds), *reach(rounds, frames)]
    show(taken, [])
    record = {"cores": os.cpu_count(), "numpy": np.__version__, "quick": options.quick}
    told = [{**asdict(figure), "met": figure.met} for figure in taken]
    rows = table(("radio in virtual time", "taken", "target"), figure_rows(told))
    keep(options, "speed.json", {**record, "figures": told}, "radio", rows)
    return 0 if all(figure.met for figure in taken) else 1


if __name__ == "__main__":
    sys.exit(main())

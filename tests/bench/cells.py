"""What the cells of the air save on the bus: a table, and JSON in build/bench-cells.json.

    python tests/bench/cells.py [--quick] [--output FILE] [--write FOLDER] [--page FILE]

Robots drive about in a square arena, and each announces some frames a second: over a session of its own, ten sessions
to a process, through a router in another process, on this machine. Everything between the station and the bus is the
robots' own: the keys that they listen to as they drive, messages read strictly, stations that keep what matters. Each
arena is taken twice, with the cells of the lab's radio and with one cell as wide as can be, in which everybody is told
of everything. Deliveries and processor time (of Python and zenoh) are counted from the first announcement until all
have arrived, and told for each second in which robots announce.

The share of deliveries that is saved is told beside the one that follows from the width of the arena in cells if robots
may be anywhere. Deliveries to robots within the interference range are the least that any scheme could do with.
"""

import argparse
import asyncio
import itertools
import math
import resource
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from random import Random
from typing import Any, NamedTuple

from hosts import hosts, machine, said
from page import add_options, keep, table

from rmr.base.time import NS_PER_S
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.bus.session import Bus, open_bus
from rmr.radio.air import Announcement
from rmr.radio.cells import RANGE_MAX_M, Grid, grid_of, interference_range_m
from rmr.radio.frame import BROADCAST, DataFrame, encode_data
from rmr.radio.phy import TURNAROUND, RadioConfig, airtime
from rmr.radio.station import Station
from rmr_agent.bus_ports import RADIO_GRACE, RadioLink
from rmr_agent.local_air import LocalAir

CONFIG = RadioConfig(tx_power_dbm=-30.0)
"""A weak radio, for a short range: what counts is how wide the arena is in ranges."""
RANGE_M = interference_range_m(CONFIG)
SPEED_MPS = 0.2
GRID = grid_of(CONFIG, SPEED_MPS)
ONE_CELL = Grid(RANGE_MAX_M)

ROBOTS = (50, 100)
ARENAS = (1, 4, 9)  # ranges wide
FRAMES_PER_S = 1
"""Announced by each robot: 9,900 deliveries a second to 100 robots in one cell keep about one core busy."""
PAYLOAD = bytes(50)
TALKING_S = 5.0
SESSIONS = 10
"""Robots in one process: a hundred interpreters would not fit this machine's cores and measure their own start."""
SETTLE_S = 0.5
"""When nothing has arrived for so long after the last announcement, all has."""
ARRIVED_MIN = 0.98
"""Of all that one cell should deliver; a machine that is too busy for that measures nothing but its own load."""


class Case(NamedTuple):
    """One run."""

    robots: int
    arena: int
    cells: bool
    seconds: float

    @property
    def grid(self) -> Grid:
        return GRID if self.cells else ONE_CELL

    @property
    def side_m(self) -> float:
        return self.arena * RANGE_M


class Tally(NamedTuple):
    """What processes count."""

    announced: int = 0
    delivered: int = 0
    near: int = 0
    """Of those delivered: within the interference range."""
    changes: int = 0
    """Robots' changes of cell."""
    lost: int = 0
    cpu_s: float = 0.0


def cpu_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


class Robot:
    """A body that drives about and a radio that announces frames."""

    def __init__(self, robot: int, case: Case, bus: Bus) -> None:
        self._rng = Random(f"{robot}/{case.arena}")
        self._side = case.side_m
        self._grid, self.robot, self.bus = case.grid, robot, bus
        self.x, self.y = (self._rng.uniform(0.0, self._side) for _ in "xy")
        self._angle = self._rng.uniform(0.0, math.tau)
        self._air = LocalAir(bus, Keys("bench"), case.grid, self._hear, robot)
        station = Station(robot, 7, 1, Random(robot), CONFIG, RADIO_GRACE)
        self._link = RadioLink(station, time.monotonic_ns, self._air.publish)
        self._psdu = encode_data(DataFrame(7, BROADCAST, robot, 0, False, PAYLOAD))
        self.announced = self.delivered = self.near = self.changes = 0
        self._place(self.x, self.y)

    def _place(self, x: float, y: float) -> None:
        self.changes += self._grid.cell_of(x, y) != self._grid.cell_of(self.x, self.y)
        self.x, self.y = x, y
        self._link.station.move(x, y)
        self._air.move(x, y)

    def _hear(self, _key: str, message: wire.Envelope) -> None:
        assert isinstance(message.body, wire.Air)
        announcement = message.body.announcement
        self.delivered += 1
        self.near += math.dist((announcement.x, announcement.y), (self.x, self.y)) <= RANGE_M
        self._link.hear(announcement)

    def step(self) -> None:
        """Drive on until the next frame, straight but for the walls; announce one."""
        way = SPEED_MPS / FRAMES_PER_S
        x, y = self.x + way * math.cos(self._angle), self.y + way * math.sin(self._angle)
        if not (0.0 <= x <= self._side and 0.0 <= y <= self._side):
            self._angle = self._rng.uniform(0.0, math.tau)
            x, y = self.x, self.y
        self._place(x, y)
        now = time.monotonic_ns()
        self._link.advance(now, x, y)
        self._link.receive()
        start = now + TURNAROUND
        self._air.publish(
            Announcement(
                self.robot, self.announced, 0, start, start + airtime(len(self._psdu)), CONFIG.tx_power_dbm, x, y,
                self._psdu,
            )
        )  # fmt: skip
        self.announced += 1

    async def live(self, begin_ns: int, end_ns: int) -> None:
        """Announce frames at an even pace, at an instant of its own within each."""
        pace = NS_PER_S // FRAMES_PER_S
        at = begin_ns + self._rng.randrange(pace)
        while at < end_ns:
            await until(at)
            self.step()
            at += pace


async def until(instant_ns: int) -> None:
    await asyncio.sleep(max(0, instant_ns - time.monotonic_ns()) / NS_PER_S)


async def robots_live(case: Case, ids: Sequence[int], endpoint: str, pipe: Connection) -> None:
    """Open sessions, wait for the word, live; tell the tally when all has arrived."""
    robots = [Robot(robot, case, open_bus(robot, connect=endpoint)) for robot in ids]

    def tally() -> Tally:
        fields = ("announced", "delivered", "near", "changes")
        counts = [sum(getattr(robot, field) for robot in robots) for field in fields]
        return Tally(*counts, lost=sum(robot.bus.losses.lost for robot in robots))

    pipe.send("ready")
    begin_ns = await asyncio.to_thread(pipe.recv)
    before = cpu_s()
    await asyncio.gather(*[robot.live(begin_ns, begin_ns + int(case.seconds * NS_PER_S)) for robot in robots])
    delivered = None
    while delivered != (delivered := tally().delivered):
        await asyncio.sleep(SETTLE_S)
    pipe.send(tally()._replace(cpu_s=cpu_s() - before))
    await asyncio.to_thread(pipe.recv)
    for robot in robots:
        robot.bus.close()


async def router_lives(endpoint: str, pipe: Connection) -> None:
    """Open a router; tell what it used from the first word until the second."""
    bus = open_bus(wire.WORLD_ID, listen=endpoint)
    pipe.send("ready")
    await asyncio.to_thread(pipe.recv)
    before = cpu_s()
    await asyncio.to_thread(pipe.recv)
    pipe.send(Tally(cpu_s=cpu_s() - before))
    await asyncio.to_thread(pipe.recv)
    bus.close()


def process(case: Case, ids: Sequence[int], endpoint: str, pipe: Connection) -> None:
    """Be the router (no ids) or some robots."""
    asyncio.run(robots_live(case, ids, endpoint, pipe) if ids else router_lives(endpoint, pipe))


def run(case: Case) -> tuple[Tally, float]:
    """Let the robots of one run live; return what they have counted, and the processor time of their router."""
    groups = [(), *(range(at, min(at + SESSIONS, case.robots)) for at in range(0, case.robots, SESSIONS))]
    with hosts(process, case, groups) as pipes:
        begin_ns = time.monotonic_ns() + NS_PER_S // 2
        for pipe in pipes:
            pipe.send(begin_ns)
        tallies: list[Tally] = [said(pipe) for pipe in pipes[1:]]
        pipes[0].send("that was all")
        router: Tally = said(pipes[0])
    return Tally(*map(sum, zip(*tallies, strict=True))), router.cpu_s


@dataclass(frozen=True)
class Row:
    """An arena with one cell and with those of the radio."""

    robots: int
    arena_ranges: int
    arena_m: float
    robots_per_range_squared: float
    announced_per_s: float
    delivered_per_s: float
    """With one cell."""
    delivered_per_s_cells: float
    saved_percent: float
    expected_percent: float
    needed_percent: float
    """Of the deliveries with one cell: those to robots within the interference range."""
    robots_cpu: float
    """Cores that all robots keep busy."""
    robots_cpu_cells: float
    router_cpu: float
    router_cpu_cells: float
    changes: int
    """Of all robots' cells in the run with cells."""
    lost: int
    """Messages that the bus lost, in both runs."""


def expected_percent(case: Case) -> float:
    """Return the share of deliveries that cells save if robots may be anywhere: between cells that do not touch."""
    whole, part = divmod(case.side_m, GRID.width_m)
    shares = [GRID.width_m / case.side_m] * int(whole) + [part / case.side_m]
    beside = sum(share * sum(shares[max(0, at - 1) : at + 2]) for at, share in enumerate(shares))
    return 100.0 * (1.0 - beside * beside)


def compared(robots: int, arena: int, seconds: float) -> Row:
    case = Case(robots, arena, cells=True, seconds=seconds)
    (one, router_one), (cells, router_cells) = run(case._replace(cells=False)), run(case)
    due = one.announced * (robots - 1)
    if one.delivered < ARRIVED_MIN * due:
        raise RuntimeError(f"{one.delivered} of {due} deliveries: this machine is too busy")
    # Both runs announce from the same places; only who listens drives on while an announcement is under way.
    assert cells.announced == one.announced
    assert cells.near > ARRIVED_MIN * one.near - 10, "cells keep from robots what they should hear"
    return Row(
        robots=robots,
        arena_ranges=arena,
        arena_m=case.side_m,
        robots_per_range_squared=robots / arena**2,
        announced_per_s=one.announced / seconds,
        delivered_per_s=one.delivered / seconds,
        delivered_per_s_cells=cells.delivered / seconds,
        saved_percent=100.0 * (1.0 - cells.delivered / due),
        expected_percent=expected_percent(case),
        needed_percent=100.0 * one.near / one.delivered,
        robots_cpu=one.cpu_s / seconds,
        robots_cpu_cells=cells.cpu_s / seconds,
        router_cpu=router_one / seconds,
        router_cpu_cells=router_cells / seconds,
        changes=cells.changes,
        lost=one.lost + cells.lost,
    )


HEADER = (
    "robots", "arena, ranges", "deliveries/s, one cell", "with cells", "saved", "expected", "within range",
    "cores of the robots", "with cells", "of the router", "with cells", "lost",
)  # fmt: skip


def cells_of(row: Row) -> tuple[str, ...]:
    """Return a row of the table."""
    return (
        f"{row.robots}",
        f"{row.arena_ranges} x {row.arena_ranges}",
        f"{row.delivered_per_s:,.0f}",
        f"{row.delivered_per_s_cells:,.0f}",
        f"{row.saved_percent:.1f} %",
        f"{row.expected_percent:.1f} %",
        f"{row.needed_percent:.1f} %",
        f"{row.robots_cpu:.2f}",
        f"{row.robots_cpu_cells:.2f}",
        f"{row.router_cpu:.2f}",
        f"{row.router_cpu_cells:.2f}",
        f"{row.lost}",
    )


def main() -> int:
    """Take all rows; return the exit code."""
    parser = argparse.ArgumentParser(description="Take what the cells of the air save on the bus.")
    parser.add_argument("--quick", action="store_true", help="50 robots only, a second each")
    add_options(parser, "cells")
    options = parser.parse_args()
    taken = []
    sizes = ROBOTS[:1] if options.quick else ROBOTS
    for robots, arena in itertools.product(sizes, ARENAS):
        taken.append(row := compared(robots, arena, 1.0 if options.quick else TALKING_S))
        print("  ".join(f"{name} {value}" for name, value in zip(HEADER, cells_of(row), strict=True)), flush=True)
    record: dict[str, Any] = {
        **machine(),
        "quick": options.quick,
        "range_m": RANGE_M,
        "cell_m": GRID.width_m,
        "frames_per_s": FRAMES_PER_S,
        "payload_octets": len(PAYLOAD),
        "sessions_per_process": SESSIONS,
    }
    record["rows"] = [asdict(row) for row in taken]
    keep(options, "cells.json", record, "cells", table(HEADER, [cells_of(row) for row in taken]))
    return 0


if __name__ == "__main__":
    sys.exit(main())

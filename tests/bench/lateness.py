"""What the bus costs the radio: robots' radios as processes beside the same radios in virtual time.

    python tests/bench/lateness.py [--quick] [--output FILE] [--write FOLDER] [--page FILE]

Some stations within range of each other offer broadcasts at independent times: once each in a process of its own over
zenoh through a router in another process, once in the ether. In virtual time an announcement is there 192 us before
its first symbol. Between processes one may come later; its reception is decided by the stamps all the same, but who
assesses the channel meanwhile does not know of it and may transmit at the same time (`frames.late`, `frames.blind`).
What that does to deliveries is the difference between the two.

A robot leaves what it need not acknowledge until it wakes anyway. Here each announcement wakes its hearers, as only
those of frames to be acknowledged do there: it is the bus that is measured, not their patience.
"""

import argparse
import asyncio
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from random import Random
from typing import Any, NamedTuple

from hosts import hosts, machine, said
from page import add_options, keep, table

from rmr.base.kernel import ROBOT, Kernel
from rmr.base.time import NS_PER_S, Instant, seconds
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.bus.process import run_precisely
from rmr.bus.session import open_bus
from rmr.radio.ether import Ether
from rmr.radio.phy import RadioConfig
from rmr.radio.station import Station
from rmr_agent.bus_ports import RADIO_GRACE, RadioLink

PAN = 7
SEED = 11
PAYLOAD = bytes(50)
KEY = Keys("lateness").radio(0, 0)
LEAD_S = 0.5
"""From the word to begin until the first frame may be offered."""
SETTLE_S = 0.5
SLEEP_S = 0.005
"""Of the machine's own test."""
MEASURED_S = 20.0
CASES = ((2, 10.0), (5, 25.0), (10, 50.0), (10, 100.0), (10, 200.0))
"""Stations, and frames that all of them together offer in a second."""


class Case(NamedTuple):
    """One load."""

    stations: int
    offered_fps: float
    seconds: float

    def offers(self, station: int) -> Iterator[Instant]:
        """Yield when a station offers frames: alike in processes and in virtual time."""
        chance, at = Random(f"{SEED}/{station}"), 0.0
        while (at := at + chance.expovariate(self.offered_fps / self.stations)) < self.seconds:
            yield seconds(at)

    def place(self, station: int) -> tuple[float, float]:
        return float(station), 0.0


class Radio:
    """One station's host in a process: the timers and the bus."""

    def __init__(self, case: Case, robot: int, endpoint: str) -> None:
        self._place = case.place(robot)
        self._offers = list(case.offers(robot))[::-1]
        self._begin_ns = 0
        self._timer: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()
        self.bus = open_bus(robot, connect=endpoint)
        self.bus.subscribe(KEY, self._hear)
        self.station = Station(robot, PAN, SEED, Random(robot), RadioConfig(), RADIO_GRACE)
        self.station.move(*self._place)
        self._link = RadioLink(self.station, self._now, lambda one: self.bus.publish(KEY, wire.Handshake(one)))
        self.heard = 0

    def begin(self, begin_ns: int) -> None:
        """Offer frames from the monotonic instant `begin_ns` on, which is 0 of their time."""
        self._begin_ns = begin_ns
        self._turn()

    def _now(self) -> Instant:
        return time.monotonic_ns() - self._begin_ns

    def _hear(self, _key: str, message: wire.Envelope) -> None:
        assert isinstance(message.body, wire.Handshake)
        self.heard += 1
        self._link.hear(message.body.announcement)
        self._turn()

    def _turn(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        now = self._now()
        while self._offers and self._offers[-1] <= now:
            self._offers.pop()
            self._link.transmit(PAYLOAD, None, 0)
        self._link.advance(max(now, 0), *self._place)
        self._link.receive()
        self._link.confirmations()
        wake = min(self.station.next_wake, self._offers[-1] if self._offers else now + NS_PER_S)
        self._timer = self._loop.call_later(max(0, wake - self._now()) / NS_PER_S, self._turn)


async def station_lives(case: Case, robot: int, endpoint: str, pipe: Connection) -> None:
    radio = Radio(case, robot, endpoint)
    pipe.send("ready")
    radio.begin(await asyncio.to_thread(pipe.recv))
    await asyncio.sleep(LEAD_S + case.seconds + SETTLE_S)
    losses = radio.bus.losses
    pipe.send(radio.station.counters.as_dict() | {"heard": radio.heard, "bus_lost": losses.lost})
    await asyncio.to_thread(pipe.recv)
    radio.bus.close()


async def router_lives(endpoint: str, pipe: Connection) -> None:
    bus = open_bus(wire.WORLD_ID, listen=endpoint)
    pipe.send("ready")
    await asyncio.to_thread(pipe.recv)
    bus.close()


def process(case: Case, robot: int | None, endpoint: str, pipe: Connection) -> None:
    """Be the router (None) or a station."""
    run_precisely(router_lives(endpoint, pipe) if robot is None else station_lives(case, robot, endpoint, pipe))


def overslept_ms(duration_s: float) -> float:
    """Sleep again and again for so long; return by how much the machine oversleeps, 95 times of 100 at most."""
    until, over = time.monotonic() + duration_s, []
    while (begun := time.monotonic()) < until:
        time.sleep(SLEEP_S)
        over.append(time.monotonic() - begun - SLEEP_S)
    return 1e3 * sorted(over)[len(over) * 95 // 100]


def as_processes(case: Case) -> tuple[list[dict[str, int]], float]:
    """Return the stations' counters after a run as processes, and how much the machine overslept meanwhile, ms."""
    with hosts(process, case, (None, *range(1, case.stations + 1))) as pipes:
        begin_ns = time.monotonic_ns() + seconds(LEAD_S)
        for pipe in pipes[1:]:
            pipe.send(begin_ns)
        overslept = overslept_ms(LEAD_S + case.seconds)
        counters = [said(pipe) for pipe in pipes[1:]]
    return counters, overslept


def in_virtual_time(case: Case) -> list[dict[str, int]]:
    """Return the stations' counters after a run in the ether."""
    kernel = Kernel()
    ether = Ether(kernel, RadioConfig(), SEED, PAN)
    for robot in range(1, case.stations + 1):
        station = ether.add(robot, Random(robot), None, *case.place(robot))
        for at in case.offers(robot):
            kernel.at(at, ROBOT, lambda _, station=station: station.request(PAYLOAD, None, 0))
    kernel.run_until(seconds(case.seconds + SETTLE_S))
    return [station.counters.as_dict() for station in ether.stations]


def shares(case: Case, counters: list[dict[str, int]]) -> tuple[float, float]:
    """Return the shares of deliveries that came through, and of requests that got no access."""
    total = {name: sum(each[name] for each in counters) for name in ("sent", "received", "access_failed")}
    requests = total["sent"] + total["access_failed"]
    return total["received"] / (total["sent"] * (case.stations - 1)), total["access_failed"] / requests


@dataclass(frozen=True)
class Row:
    """One load in both hosts; shares, 0 to 1."""

    stations: int
    offered_fps: float
    delivery: float
    delivery_virtual: float
    access_failure: float
    access_failure_virtual: float
    late: float
    """Of the announcements heard."""
    blind: float
    """Of the frames sent."""
    overdue: float
    """Of the announcements heard."""
    bus_lost: int
    overslept_ms: float
    """By how much a sleep took longer than asked for, 95 times of 100 at most: what the machine itself costs."""


def compared(stations: int, offered_fps: float, measured_s: float) -> Row:
    """Run one load in both hosts."""
    case = Case(stations, offered_fps, measured_s)
    real, overslept = as_processes(case)
    total = {name: sum(each[name] for each in real) for name in real[0]}
    delivery, failure = shares(case, real)
    delivery_virtual, failure_virtual = shares(case, in_virtual_time(case))
    return Row(
        stations=stations,
        offered_fps=offered_fps,
        delivery=delivery,
        delivery_virtual=delivery_virtual,
        access_failure=failure,
        access_failure_virtual=failure_virtual,
        late=total["late"] / total["heard"],
        blind=total["blind"] / total["sent"],
        overdue=total["overdue"] / total["heard"],
        bus_lost=total["bus_lost"],
        overslept_ms=overslept,
    )


HEADER = (
    "stations", "offered frames/s", "delivered, processes", "virtual time", "no access, processes", "virtual time",
    "late", "blind", "overdue", "lost by the bus", "overslept",
)  # fmt: skip


def cells_of(row: Row) -> tuple[str, ...]:
    """Return a row of the table."""
    parts = (row.delivery, row.delivery_virtual, row.access_failure, row.access_failure_virtual)
    parts += (row.late, row.blind, row.overdue)
    shown = [f"{100 * part:.1f} %" for part in parts]
    return (f"{row.stations}", f"{row.offered_fps:g}", *shown, f"{row.bus_lost}", f"{row.overslept_ms:.1f} ms")


def main() -> int:
    """Take all rows; return the exit code."""
    parser = argparse.ArgumentParser(description="Take what the bus costs the radio.")
    parser.add_argument("--quick", action="store_true", help="two loads, 3 s each")
    add_options(parser, "lateness")
    options = parser.parse_args()
    taken = []
    for stations, offered_fps in CASES[:2] if options.quick else CASES:
        row = compared(stations, offered_fps, 3.0 if options.quick else MEASURED_S)
        taken.append(row)
        print("  ".join(f"{name} {value}" for name, value in zip(HEADER, cells_of(row), strict=True)), flush=True)
    record: dict[str, Any] = {
        **machine(),
        "quick": options.quick,
        "seed": SEED,
        "payload_octets": len(PAYLOAD),
        "measured_s": MEASURED_S,
    }
    record["rows"] = [asdict(row) for row in taken]
    keep(options, "lateness.json", record, "lateness", table(HEADER, [cells_of(row) for row in taken]))
    return 0


if __name__ == "__main__":
    sys.exit(main())

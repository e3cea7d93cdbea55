"""The ether of virtual time and the stations of processes are one radio: the same runs, frame by frame."""

from random import Random
from typing import Any

import pytest

from rmr.base.kernel import ROBOT, Kernel
from rmr.base.streams import stream
from rmr.base.time import NEVER, NS_PER_MS, NS_PER_US, seconds
from rmr.radio import ether
from rmr.radio.air import Announcement, Confirmed, Received
from rmr.radio.ether import Ether
from rmr.radio.links import Disturbance, Links, partition
from rmr.radio.phy import Bursts, RadioConfig
from rmr.radio.station import Station

PAN = 7
RUNS = 40
Places = dict[int, tuple[float, float]]
Request = tuple[int, int, int | None, bytes, tuple[float, float]]
"""When, who, to whom, what, and where it is from then on."""
Log = dict[int, list[Any]]


def rounded(out: Announcement | Received | Confirmed) -> Any:
    """Return `out` with its power as far as a logarithm of one library and of another agree."""
    if not isinstance(out, Received):
        return out
    return Received(out.payload, out.source, out.unicast, round(out.rssi_dbm, 9), out.lqi, out.stamp)


def in_the_ether(
    places: Places, requests: list[Request], config: RadioConfig, seed: int, disturbances: list[Disturbance], until: int
) -> tuple[Log, dict[int, dict[str, int]]]:
    kernel = Kernel()
    medium = Ether(kernel, config, seed, PAN, disturbances)
    log: Log = {address: [] for address in places}
    medium.on_air = lambda one: log[one.source].append((kernel.now, one))
    for address, (x, y) in places.items():

        def take(out: Received | Confirmed, address: int = address) -> None:
            log[address].append((kernel.now, rounded(out)))

        medium.add(address, stream(f"{seed}/{address}"), take, x, y)
    stations = {station.receive_filter.address: station for station in medium.stations}

    def ask(index: int) -> None:
        _, source, to, payload, place = requests[index]
        stations[source].move(*place)
        stations[source].request(payload, to, index)

    for index, (when, *_) in enumerate(requests):
        kernel.at(when, ROBOT, lambda _, index=index: ask(index))
    kernel.run_until(until)
    return log, {address: station.counters.as_dict() for address, station in stations.items()}


def of_stations(
    places: Places, requests: list[Request], config: RadioConfig, seed: int, disturbances: list[Disturbance], until: int
) -> tuple[Log, dict[int, dict[str, int]]]:
    places = dict(places)
    stations = {
        address: Station(
            address, PAN, seed, stream(f"{seed}/{address}"), config, links=Links(config, seed, disturbances)
        )
        for address in places
    }
    for address, place in places.items():
        stations[address].move(*place)
    log: Log = {address: [] for address in places}
    waiting = sorted(enumerate(requests), key=lambda item: item[1][0])
    while True:
        now = min(waiting[0][1][0] if waiting else NEVER, *(one.next_wake for one in stations.values()))
        if now > until:
            return log, {address: station.counters.as_dict() for address, station in stations.items()}
        for address, one in stations.items():
            for out in one.advance(now, *places[address]):
                log[address].append((now, rounded(out)))
                if isinstance(out, Announcement):
                    for other in stations.values():
                        other.hear(out)
        while waiting and waiting[0][1][0] <= now:
            index, (_, source, to, payload, places[source]) = waiting.pop(0)
            stations[source].move(*places[source])
            stations[source].request(now, payload, to, index)


def drawn(seed: int) -> tuple[Places, list[Request], RadioConfig, list[Disturbance]]:
    """Return a crowd with things to say: near and far, over and below what the channel takes."""
    chance = Random(seed)
    count = chance.randrange(2, 9)
    side = chance.choice([1.0, 15.0, 40.0, 150.0])
    places = {3 * i + 1: (chance.uniform(0, side), chance.uniform(0, side)) for i in range(count)}
    if chance.random() < 0.2:  # equal powers
        places = {address: (10.0 * (i % 2), 10.0 * (i // 2 % 2)) for i, address in enumerate(places)}
    addresses = list(places)
    rate = chance.choice([5, 20, 60])
    drives = chance.choice([0.0, 0.0, 0.5])  # metres, before each frame: over borders of cells too
    requests: list[Request] = []
    for source in addresses:
        for _ in range(rate // 2):
            others = [None, *(a for a in addresses if a != source), 999]
            to = chance.choice(others) if chance.random() < 0.6 else None
            step = chance.choice([1, 320 * NS_PER_US, NS_PER_MS])
            when = chance.randrange(500 * NS_PER_MS) // step * step
            x, y = (along + chance.uniform(-1.0, 1.0) * drives for along in places[source])
            requests.append((when, source, to, bytes(chance.randrange(1, 117)), (x, y)))
    disturbances = []
    if chance.random() < 0.3:
        disturbances.append(partition([addresses[:1], addresses[1:2]], 100 * NS_PER_MS, 300 * NS_PER_MS))
        disturbances.append(Disturbance(0, seconds(1), (), loss=0.2))
        disturbances.append(Disturbance(0, NEVER, ((addresses[0],), (addresses[-1],)), True, 0.1, 9.0))
    config = RadioConfig(
        interference=chance.choice(["awgn", "capture_3db"]),
        loss=chance.choice([0.0, 0.0, 0.1]),
        shadowing_db=chance.choice([0.0, 0.0, 4.0]),
        bursts=chance.choice([None, None, Bursts(seconds(0.1), seconds(0.02))]),
        tx_power_dbm=chance.choice([0.0, -20.0, -30.0]),  # in a crowd of 40 m: a single cell, nine, or twenty-five
    )
    return places, requests, config, disturbances


@pytest.mark.parametrize("seed", range(RUNS))
def test_the_ether_and_the_stations_of_processes_do_the_same(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ether, "FEW", seed % 2 * ether.FEW)  # a crowd's arrays are held to few stations too
    places, requests, config, disturbances = drawn(seed)
    one, counted = in_the_ether(places, requests, config, seed, disturbances, seconds(2))
    other, counts = of_stations(places, requests, config, seed, disturbances, seconds(2))
    for address in places:
        assert one[address] == other[address]
    assert counted == counts
    assert sum(len(log) for log in one.values()) > len(requests)


def test_disturbances_that_begin_when_a_sender_has_been_heard_before_touch_it_too() -> None:
    kernel = Kernel()
    medium = Ether(kernel, RadioConfig(), 1, PAN)
    heard: list[Any] = []
    speaker = medium.add(1, stream("1"), None)
    medium.add(2, stream("2"), heard.append, 5.0)
    for disturbances, count in (([], 1), ([partition([[1], [2]])], 1), ([], 2)):
        medium.links.replace(disturbances)
        speaker.request(b"hello", None, 0)
        kernel.run_until(kernel.now + seconds(0.1))
        assert len(heard) == count

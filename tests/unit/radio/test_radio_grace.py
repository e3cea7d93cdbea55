"""Stations in processes: announcements come late, out of order, and twice."""

from random import Random

import pytest
from radio_ether import MS, US, Ether, station, transmission

from rmr.radio.air import Announcement, Confirmed, Received

GRACE = 5 * MS
SECOND = 1000 * MS


def crowded_air(seed: int) -> list[Announcement]:
    """Return 60 transmissions of 8 sources at random, many of which overlap."""
    rng = Random(seed)
    free = dict.fromkeys(range(2, 10), 0)
    made = []
    for sequence in range(60):
        source = rng.randrange(2, 10)
        start = max(free[source], rng.randrange(150) * MS + rng.randrange(1000) * US)
        one = transmission(source, start, x=1.0 + source, payload=bytes(rng.randrange(100)), sequence=sequence)
        free[source] = one.end + 200 * US
        made.append(one)
    return made


def heard(listener_grace: int, arrivals: list[tuple[int, Announcement]], step: int) -> list[Received]:
    listener = station(grace=listener_grace, loss=0.1)
    arrivals = sorted(arrivals, key=lambda pair: pair[0])
    got: list[Received] = []
    for now in range(0, 400 * MS, step):
        while arrivals and arrivals[0][0] <= now:
            listener.hear(arrivals.pop(0)[1])
        got += [o for o in listener.advance(now, 0, 0) if isinstance(o, Received)]
    return got


@pytest.mark.parametrize("seed", range(12))
def test_late_and_reordered_announcements_lead_to_the_same_receptions_as_early_ones(seed: int) -> None:
    rng = Random(seed)
    air = crowded_air(seed)
    early = heard(0, [(one.start - 192 * US, one) for one in air], 100 * US)
    late = heard(GRACE, [(one.start + rng.randrange(GRACE), one) for one in air], 100 * US)
    twice = heard(GRACE, [(one.start + rng.randrange(GRACE), one) for one in air + air], 700 * US)
    assert late == early
    assert twice == early
    assert 5 < len(early) < 60


def test_a_unicast_between_processes_is_acknowledged_by_time_stamp_and_confirmed_late() -> None:
    rng = Random(4)
    ether = Ether([(0, 0), (2, 0)], grace=GRACE, delay=lambda: rng.randrange(100 * US, 4 * MS))
    for k in range(50):
        ether.send(k * 50 * MS, 0, b"x" * 30, 1, k)
    ether.run(4 * SECOND)
    assert ether.confirmed(0) == [Confirmed(k, "ok") for k in range(50)]
    assert len(ether.received(1)) == 50
    for sent, ack in zip(ether.announced(0), ether.announced(1, acks=True), strict=True):
        assert ack.start == sent.end + 192 * US


def test_an_absent_destination_is_still_a_no_ack_between_processes() -> None:
    ether = Ether([(0, 0), (500, 0)], grace=GRACE, delay=lambda: MS)
    ether.send(0, 0, b"x", 1, 3)
    ether.run(SECOND)
    assert ether.confirmed(0) == [Confirmed(3, "no_ack")]
    assert len(ether.announced(0)) == 4


def test_a_station_does_not_transmit_over_an_acknowledgement_that_it_may_owe() -> None:
    for seed in range(20):
        ether = Ether([(0, 0)], seed=seed, grace=GRACE)
        incoming = transmission(9, 0, x=2.0, to=0)
        ether.stations[0].hear(incoming)
        ether.send(incoming.end - 300 * US, 0, b"mine" * 9)
        ether.run(SECOND)
        (ack,), (mine,) = ether.announced(0, acks=True), ether.announced(0)
        assert mine.start >= ack.end or mine.end <= ack.start


def test_an_acknowledgement_that_would_run_into_an_own_transmission_is_withheld_and_counted() -> None:
    ether = Ether([(0, 0)], grace=GRACE)
    ether.send(0, 0, b"mine" * 9)
    ether.run(3 * MS)
    (mine,) = ether.announced(0)
    psdu_us = 32 * (6 + 11 + 40)
    incoming = transmission(9, mine.start - (psdu_us + 250) * US, x=2.0, to=0)  # ends 250 us before `mine` starts
    ether.stations[0].hear(incoming)
    ether.run(SECOND)
    assert len(ether.received(0)) == 1
    assert ether.announced(0, acks=True) == []
    assert ether.stations[0].counters.withheld == 1


def test_an_announcement_that_comes_after_its_reception_was_due_is_counted() -> None:
    listener = station(grace=GRACE)
    one = transmission(9, MS, x=2.0)
    listener.advance(one.end + GRACE + MS, 0, 0)
    listener.hear(one)
    assert (listener.counters.late, listener.counters.overdue) == (1, 1)
    assert len(listener.advance(one.end + GRACE + MS, 0, 0)) == 1


def test_an_announcement_within_the_turnaround_costs_nothing_and_is_not_late() -> None:
    listener = station(grace=GRACE)
    one = transmission(9, MS, x=2.0)
    listener.hear(one, one.start)
    assert listener.counters.late == 0


def test_transmission_on_a_busy_channel_is_reported_when_the_late_announcement_arrives() -> None:
    for started, blind in ((0, 1), (MS, 0)):
        ether = Ether([(0, 0)], grace=GRACE)
        ether.send(0, 0, b"mine")
        ether.run(20 * MS)
        assessed = ether.announced(0)[0].start - 192 * US
        late = transmission(9, assessed - 50 * US + started, x=2.0)
        ether.stations[0].hear(late, late.start + 2 * MS)
        assert (ether.stations[0].counters.late, ether.stations[0].counters.blind) == (1, blind)

"""Stations on a common air: contention, acknowledgement, collision, loss, repeats."""

import os
import subprocess
import sys
from hashlib import blake2b
from pathlib import Path
from random import Random

import msgpack
import pytest
from radio_ether import MS, PAN, US, Ether, station, transmission

from rmr.base.time import NEVER
from rmr.radio.air import ACK_ATTEMPT, Announcement, Confirmed, Received
from rmr.radio.frame import encode_ack
from rmr.radio.mac import QUEUE_MAX
from rmr.radio.phy import airtime
from rmr.radio.station import AIR_MAX, Station

ACCESS_US = [320 * k for k in range(1, 9)]
SECOND = 1000 * MS


def first_ms(ether: Ether, announcements: list[Announcement]) -> None:
    for announcement in announcements:
        for one in ether.stations:
            one.hear(announcement)


def test_a_broadcast_reaches_all_in_range_with_power_quality_and_time() -> None:
    ether = Ether([(0, 0), (2, 0), (0, 5)])
    ether.send(0, 0, b"hello")
    ether.run(SECOND)
    sent = ether.announced(0)[0]
    assert ether.received(1) == [Received(b"hello", 0, False, pytest.approx(-55.7086, abs=1e-3), 187, sent.end)]
    assert [r.stamp for r in ether.received(2)] == [sent.end]
    assert ether.confirmed(0) == [Confirmed(0, "ok")]


def test_signal_strength_falls_with_distance_until_nothing_arrives() -> None:
    # -85 dBm at exponent 3 is reached where 46.68 + 30 log10(d) = 85: at 18.9 m.
    ether = Ether([(0, 0), (2, 0), (4, 0), (8, 0), (16, 0), (40, 0)])
    ether.send(0, 0, b"hello")
    ether.run(SECOND)
    strengths = [r.rssi_dbm for who in range(1, 6) for r in ether.received(who)]
    assert len(strengths) == 4
    assert strengths == sorted(strengths, reverse=True)
    assert strengths[0] - strengths[1] == pytest.approx(9.03, abs=0.01)


@pytest.mark.parametrize(("payload", "to", "first_us"), [(100, None, 4064), (20, None, 1504), (50, None, 2464)])
def test_on_an_idle_channel_a_broadcast_takes_one_of_eight_times(payload: int, to: None, first_us: int) -> None:
    # Access of 320 k us (k = 1..8), then the airtime of payload + 11 octets.
    assert idle_latencies(payload, to) == [first_us + 320 * k for k in range(8)]


@pytest.mark.parametrize(("payload", "first_us"), [(100, 4608), (20, 2048), (50, 3008)])
def test_on_an_idle_channel_a_unicast_is_confirmed_after_one_of_eight_times(payload: int, first_us: int) -> None:
    # As above, and 192 us of turnaround and 352 us of acknowledgement.
    assert idle_latencies(payload, 1) == [first_us + 320 * k for k in range(8)]


def idle_latencies(payload: int, to: int | None) -> list[int]:
    ether = Ether([(0, 0), (10, 0)])
    for k in range(100):
        ether.send(k * 50 * MS, 0, bytes(payload), to, k)
    ether.run(6 * SECOND)
    assert [c.status for c in ether.confirmed(0)] == ["ok"] * 100
    return sorted({at % (50 * MS) // US for at in ether.confirmed_at(0)})


def test_a_sender_waits_until_the_channel_is_free() -> None:
    ether = Ether([(0, 0)])
    ether.stations[0].hear(transmission(9, 0, x=3.0, payload=bytes(116)))
    ether.send(100 * US, 0, b"mine")
    ether.run(SECOND)
    assert ether.announced(0)[0].start >= 4256 * US


def test_a_channel_that_stays_busy_is_an_access_failure() -> None:
    ether = Ether([(0, 0)])
    for k in range(12):
        ether.stations[0].hear(transmission(9, k * 4256 * US, x=3.0, payload=bytes(116), sequence=k))
    ether.send(100 * US, 0, b"mine", handle=4)
    ether.run(SECOND)
    assert ether.announced(0) == []
    assert ether.confirmed(0) == [Confirmed(4, "access_failure")]
    assert ether.stations[0].counters.access_failed == 1


def test_a_unicast_is_acknowledged_192_us_after_its_end_and_handed_to_its_destination_alone() -> None:
    ether = Ether([(0, 0), (2, 0), (3, 0)])
    ether.send(0, 0, b"for you", 1, 8)
    ether.run(SECOND)
    sent, ack = ether.announced(0)[0], ether.announced(1, acks=True)[0]
    assert (ack.start, ack.end) == (sent.end + 192 * US, sent.end + 544 * US)
    assert [r.unicast for r in ether.received(1)] == [True]
    assert ether.received(2) == []
    assert ether.confirmed(0) == [Confirmed(8, "ok")]
    assert ether.confirmed_at(0) == [ack.end]


def test_an_absent_destination_costs_four_transmissions_and_is_a_no_ack() -> None:
    ether = Ether([(0, 0), (500, 0)])
    ether.send(0, 0, b"anybody?", 1, 8)
    ether.run(SECOND)
    assert [a.attempt for a in ether.announced(0)] == [0, 1, 2, 3]
    assert ether.confirmed(0) == [Confirmed(8, "no_ack")]
    assert ether.stations[0].counters.no_ack == 1


def test_a_frame_whose_acknowledgement_is_lost_is_delivered_once() -> None:
    ether = Ether([(0, 0), (2, 0)])
    deafened = ether.stations[0].hear
    ether.stations[0].hear = lambda a: None if a.attempt == ACK_ATTEMPT else deafened(a)  # type: ignore[method-assign]
    ether.send(0, 0, b"once", 1)
    ether.run(SECOND)
    assert len(ether.announced(0)) == 2
    assert len(ether.announced(1, acks=True)) == 2
    assert len(ether.received(1)) == 1
    assert ether.stations[1].counters.duplicates == 1
    assert [c.status for c in ether.confirmed(0)] == ["ok"]


def test_two_stations_that_start_together_destroy_each_other_at_equal_power() -> None:
    listener = station()
    for source in (2, 3):
        listener.hear(transmission(source, MS, x=3.0))
    assert listener.advance(SECOND, 0, 0) == []
    assert listener.counters.collided == 2


def test_capture_effect_of_simultaneous_frames_needs_three_decibels() -> None:
    listener = station()
    listener.hear(transmission(2, MS, x=3.0))
    listener.hear(transmission(3, MS, x=2.0))
    assert [o.source for o in listener.advance(SECOND, 0, 0) if isinstance(o, Received)] == [3]


def test_stations_that_draw_the_same_backoff_collide_and_others_do_not() -> None:
    outcomes = {"both": 0, "none": 0}
    for seed in range(60):
        ether = Ether([(0, 5), (0, -5), (0, 0)], seed=seed)
        ether.send(0, 0, b"a" * 30)
        ether.send(0, 1, b"b" * 30)
        ether.run(SECOND)
        together = ether.announced(0)[0].start == ether.announced(1)[0].start
        assert len(ether.received(2)) == (0 if together else 2)
        outcomes["none" if together else "both"] += 1
    assert outcomes["none"] > 0
    assert outcomes["both"] > outcomes["none"]


def test_hidden_terminals_collide_where_neighbours_do_not() -> None:
    def lost(places: list[tuple[float, float]]) -> int:
        ether = Ether(places)
        for k in range(100):
            ether.send(k * 50 * MS, 0, bytes(100))
            ether.send(k * 50 * MS + 2 * MS, 1, bytes(100))
        ether.run(6 * SECOND)
        return 200 - len(ether.received(2))

    assert lost([(-17, 0), (17, 0), (0, 0)]) > 120  # 34 m apart they do not hear each other
    assert lost([(-17, 0), (-17, 1), (0, 0)]) < 20


def test_a_station_does_not_hear_while_it_transmits() -> None:
    ether = Ether([(0, 0)])
    ether.send(0, 0, bytes(116))
    ether.run(3 * MS)
    own = ether.announced(0)[0]
    ether.stations[0].hear(transmission(9, own.end - 100 * US, x=2.0, sequence=1))
    ether.stations[0].hear(transmission(9, own.end + 10 * MS, x=2.0, sequence=2))
    ether.run(SECOND)
    assert len(ether.received(0)) == 1
    assert ether.stations[0].counters.deaf == 1


def test_packet_error_rate_is_that_of_the_formula() -> None:
    # At -86 dBm the signal is 0.593 dB under the noise floor of -85.407 dBm; 61 octets are 8 * 67 bits on the air.
    from rmr.radio.phy import bit_error_rate, milliwatts

    expected = (1 - bit_error_rate(milliwatts(-0.593))) ** 536
    listener = station()
    x = 10 ** ((86 - 46.6777) / 30)
    count = 3000
    for k in range(count):
        listener.hear(transmission(2, k * 10 * MS, x=x, sequence=k, payload=bytes(50)))
        listener.advance((k + 1) * 10 * MS, 0, 0)
    measured = listener.counters.received / count
    assert 0.2 < expected < 0.9
    assert measured == pytest.approx(expected, abs=4 * (expected * (1 - expected) / count) ** 0.5)
    assert listener.counters.dropped == count - listener.counters.received


def test_a_configured_loss_of_a_fifth_loses_a_fifth_for_each_receiver_by_itself() -> None:
    listeners = [station(address, loss=0.2) for address in (1, 2)]
    got: list[set[int]] = []
    for listener in listeners:
        stamps = set()
        for k in range(2000):
            listener.hear(transmission(9, k * 10 * MS, x=2.0, sequence=k))
            stamps |= {o.stamp for o in listener.advance((k + 1) * 10 * MS, 0, 0) if isinstance(o, Received)}
        got.append(stamps)
    assert [len(stamps) / 2000 for stamps in got] == pytest.approx([0.8, 0.8], abs=0.036)
    assert len(got[0] & got[1]) / 2000 == pytest.approx(0.64, abs=0.045)


def test_loss_strikes_acknowledgements_too() -> None:
    # A single attempt is acknowledged with 0.8 * 0.8 = 0.64: 1.56 transmissions a frame, where 1.25 would do without.
    ether = Ether([(0, 0), (2, 0)], loss=0.2)
    for k in range(500):
        ether.send(k * 100 * MS, 0, b"x" * 20, 1, k)
    ether.run(60 * SECOND)
    confirmed = [c.status for c in ether.confirmed(0)]
    assert confirmed.count("ok") / 500 == pytest.approx(1 - 0.36**4, abs=0.02)
    assert len(ether.announced(0)) / 500 == pytest.approx(1 + 0.36 + 0.36**2 + 0.36**3, abs=0.12)
    assert ether.stations[1].counters.duplicates > 50
    assert len(ether.received(1)) == len({r.stamp for r in ether.received(1)}) >= 490


def test_a_frame_lost_at_one_sequence_number_is_not_lost_again_256_frames_later() -> None:
    listener = station(loss=0.5)
    got = []
    for k in range(512):
        listener.hear(transmission(9, k * 10 * MS, x=2.0, sequence=k))
        got.append(bool(listener.advance((k + 1) * 10 * MS, 0, 0)))
    assert got[:256] != got[256:]


def test_a_sequence_number_that_returns_after_a_while_is_a_new_frame() -> None:
    listener = station()
    for when in (MS, 40 * MS, 700 * MS):
        listener.hear(transmission(9, when, x=2.0, sequence=4, attempt=when // MS % 4, payload=b"same"))
    assert len([o for o in listener.advance(SECOND, 0, 0) if isinstance(o, Received)]) == 2
    assert listener.counters.duplicates == 1


def test_frames_of_another_pan_and_for_others_are_not_received() -> None:
    foreign = Station(1, PAN + 1, 5, Random(1))
    foreign.hear(transmission(9, MS, x=2.0))
    assert foreign.next_wake == NEVER
    listener = station()
    listener.hear(transmission(9, 10 * MS, x=2.0, to=55))
    assert listener.next_wake == NEVER


def test_octets_that_are_no_frame_are_counted_and_still_occupy_the_channel() -> None:
    ether = Ether([(0, 0)])
    ether.stations[0].hear(Announcement(9, 0, 0, 0, airtime(100), 0.0, 2.0, 0.0, bytes(100)))
    ether.send(0, 0, b"mine")
    ether.run(SECOND)
    assert ether.stations[0].counters.malformed == 1
    assert ether.announced(0)[0].start > airtime(100)


def test_a_frame_far_below_the_sensitivity_is_forgotten_at_once() -> None:
    listener = station()
    listener.hear(transmission(9, MS, x=1000.0))
    assert listener.next_wake == NEVER
    assert listener.advance(SECOND, 0, 0) == []
    assert sum(listener.counters.as_dict().values()) == 0


def test_a_station_ignores_its_own_announcements_and_repeated_ones() -> None:
    listener = station(1)
    listener.hear(transmission(1, MS, x=0.0))
    for _ in range(2):
        listener.hear(transmission(9, MS, x=2.0))
    assert len(listener.advance(SECOND, 0, 0)) == 1


def test_a_full_queue_is_an_access_failure_known_at_once() -> None:
    one = station()
    for k in range(QUEUE_MAX + 2):
        one.request(0, b"x", None, k)
    assert one.next_wake == 0
    assert one.advance(0, 0, 0) == [Confirmed(QUEUE_MAX + 1, "access_failure")]


def test_late_host_loses_no_frame_and_is_notified() -> None:
    prompt, tardy = station(), station()
    for one in (prompt, tardy):
        one.request(0, b"x" * 20, None, 1)
    outputs = []
    while prompt.next_wake < NEVER:
        outputs += prompt.advance(prompt.next_wake, 0, 0)
    assert tardy.advance(SECOND, 0, 0) == outputs
    assert (prompt.counters.overdue, tardy.counters.overdue) == (0, 1)


def test_announcements_of_times_to_come_displace_no_frame_of_now() -> None:
    one = station(1, grace=4 * MS)
    one.advance(0, 0.0, 0.0)
    for index in range(2 * AIR_MAX):
        one.hear(transmission(2 + index, 1000 * MS + index * 5 * MS, x=2.0), 0)
    one.hear(transmission(9, MS, x=2.0), 0)
    assert [out.source for out in one.advance(900 * MS, 0.0, 0.0) if isinstance(out, Received)] == [9]


def test_an_announcement_survives_the_wire() -> None:
    announcement = transmission(9, MS, x=2.0, to=3, attempt=2)
    assert Announcement.from_wire(msgpack.unpackb(msgpack.packb(announcement))) == announcement


@pytest.mark.parametrize(
    "change",
    [
        {"source": -1},
        {"sequence": "1"},
        {"attempt": 256},
        {"start": True},
        {"end": 0},
        {"end": 2 * MS},
        {"x": float("nan")},
        {"power_dbm": None},
        {"power_dbm": 3080.0},  # more milliwatts than a number holds
        {"psdu": "text"},
        {"psdu": bytes(128)},
    ],
)
def test_invalid_announcement_is_refused(change: dict[str, object]) -> None:
    fields = tuple(transmission(9, MS, x=2.0)._replace(**change))
    with pytest.raises(ValueError, match="announcement"):
        Announcement.from_wire(fields)
    with pytest.raises(ValueError, match="nine"):
        Announcement.from_wire(fields[:-1])


def test_an_acknowledgement_with_another_number_is_not_taken_for_ours() -> None:
    ether = Ether([(0, 0), (500, 0)])
    ether.send(0, 0, b"x", 1)

    def answer(at: int, who: int, what: object) -> None:
        if isinstance(what, Announcement) and not what.attempt & ACK_ATTEMPT:
            start = what.end + 192 * US
            psdu = encode_ack(what.sequence + 1 & 0xFF)
            ether.stations[0].hear(Announcement(9, 0, ACK_ATTEMPT, start, start + airtime(5), 0.0, 2.0, 0.0, psdu))

    ether.on_output = answer
    ether.run(SECOND)
    assert [c.status for c in ether.confirmed(0)] == ["no_ack"]


def scenario_digest() -> str:
    """Return a digest of everything that happens among six busy, lossy stations."""
    ether = Ether([(k * 3.0, k % 2) for k in range(6)], loss=0.1)
    for k in range(120):
        ether.send(k * 3 * MS, k % 6, b"x" * (k % 90), (k + 1) % 6 if k % 3 else None, k)
    ether.run(SECOND)
    return blake2b(repr(ether.log).encode(), digest_size=8).hexdigest()


@pytest.mark.medium
def test_a_run_is_the_same_under_every_hash_seed() -> None:
    program = "from test_radio_station import scenario_digest; print(scenario_digest())"
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parents[2])])
    digests = {scenario_digest()}
    for hash_seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "PYTHONPATH": path}
        run = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
        )
        digests.add(run.stdout.strip())
    assert len(digests) == 1

"""Whatever comes over the air or the bus: counted, dropped, never an exception, and the next good frame arrives."""

from random import Random

import pytest

from rmr.base.kernel import Kernel
from rmr.base.streams import stream
from rmr.base.time import NS_PER_MS, NS_PER_US
from rmr.radio.air import Announcement, Received
from rmr.radio.ether import Ether
from rmr.radio.frame import PSDU_MAX, AckFrame, DataFrame, FrameError, check_sequence, decode, encode_data
from rmr.radio.phy import RadioConfig, airtime
from rmr.radio.station import Station

PAN = 7
STRINGS = 100_000
GOOD = encode_data(DataFrame(PAN, 1, 2, 9, True, b"good"))
SECURED = encode_data(DataFrame(PAN, 1, 2, 10, True, bytes(20), secured=True))
STEP = 6 * NS_PER_MS


def resealed(octets: bytes) -> bytes:
    """Return `octets` with a frame check sequence that is right."""
    return octets[:-2] + check_sequence(octets[:-2]).to_bytes(2, "little") if len(octets) > 2 else octets


def strings(seed: int, count: int) -> list[bytes]:
    """Return octet strings: random ones, damaged good ones, and either with the check sequence repaired."""
    chance = Random(seed)
    out = []
    for _ in range(count):
        kind = chance.randrange(4)
        if kind < 2:
            made = chance.randbytes(chance.randrange(140))
        else:
            damaged = bytearray(chance.choice([GOOD, GOOD + chance.randbytes(chance.randrange(110)), SECURED]))
            for _ in range(chance.randrange(1, 4)):
                damaged[chance.randrange(len(damaged))] = chance.randrange(256)
            made = bytes(damaged[: chance.randrange(len(damaged) + 1)] if chance.random() < 0.2 else damaged)
        out.append(resealed(made) if kind % 2 else made)
    return out


def is_frame(psdu: bytes) -> bool:
    try:
        return isinstance(decode(psdu), DataFrame | AckFrame)
    except FrameError:
        return False


def announced(psdu: bytes, start: int) -> Announcement:
    return Announcement(2, start // STEP, 0, start, start + airtime(len(psdu)), 0.0, 3.0, 0.0, psdu)


@pytest.mark.medium
def test_a_hundred_thousand_octet_strings_are_counted_and_dropped() -> None:
    listener = Station(1, PAN, 5, Random(1))
    given = strings(5, STRINGS)
    wrong = kept = 0
    for index, psdu in enumerate(given):
        if len(psdu) > PSDU_MAX:
            with pytest.raises(FrameError):
                decode(psdu)
            continue
        wrong += not is_frame(psdu)
        one = announced(psdu, index * STEP)
        listener.hear(one)
        kept += sum(isinstance(out, Received) for out in listener.advance(one.end + NS_PER_MS, 0.0, 0.0))
    assert listener.counters.malformed == wrong
    assert STRINGS // 2 < wrong < STRINGS
    assert kept == listener.counters.received > 0
    assert listener.counters.unsecured > 0
    good = announced(encode_data(DataFrame(PAN, 1, 2, 200, True, b"good")), (STRINGS + 100) * STEP)
    listener.hear(good)
    received = [out for out in listener.advance(good.end, 0.0, 0.0) if isinstance(out, Received)]
    assert [out.payload for out in received] == [b"good"]


def test_octets_that_are_no_frame_are_counted_where_they_are_heard_in_virtual_time() -> None:
    kernel = Kernel()
    ether = Ether(kernel, RadioConfig(), 5, PAN)
    heard: list[object] = []
    near, _, far = (ether.add(n, stream(f"{n}"), heard.append, x) for n, x in ((1, 0.0), (2, 3.0), (3, 5000.0)))
    given = [psdu for psdu in strings(6, 3000) if len(psdu) <= PSDU_MAX and not is_frame(psdu)]
    for psdu in given:
        ether.transmit(2, psdu, kernel.now + 200 * NS_PER_US)
        kernel.run_until(kernel.now + STEP)
    assert near.counters.malformed == len(given)
    assert far.counters.malformed == 0
    assert heard == []
    ether.transmit(2, GOOD, kernel.now + 200 * NS_PER_US)
    kernel.run_until(kernel.now + STEP)
    assert [out.payload for out in heard if isinstance(out, Received)] == [b"good"]


BODY = b"\x09\x07\x00\x01\x00\x02\x00"
WRONG = {
    "too short for any frame": b"\x02\x00",
    "too short for a data frame": resealed(b"\x41\x88\x09\x07\x00\x01\x00\x02" + b"\0\0"),
    "an acknowledgement with more behind it": resealed(b"\x02\x00\x09\x00\x00\x00"),
    "too long": resealed(b"\x41\x88" + BODY + bytes(120)),
    "frame check sequence": GOOD[:-1] + bytes([GOOD[-1] ^ 1]),
    "a beacon": resealed(b"\x40\x88" + BODY + b"\0\0"),
    "a command": resealed(b"\x43\x88" + BODY + b"\0\0"),
    "a reserved type": resealed(b"\x47\x88" + BODY + b"\0\0"),
    "version 2": resealed(b"\x41\xa8" + BODY + b"\0\0"),
    "version 3": resealed(b"\x41\xb8" + BODY + b"\0\0"),
    "version 1 without security": resealed(b"\x41\x98" + BODY + b"\0\0"),
    "no addresses": resealed(b"\x41\x00" + BODY + b"\0\0"),
    "a long destination": resealed(b"\x41\x8c" + BODY + bytes(8)),
    "a long source": resealed(b"\x41\xc8" + BODY + bytes(8)),
    "a reserved addressing mode": resealed(b"\x41\x84" + BODY + b"\0\0"),
    "two PANs": resealed(b"\x01\x88" + BODY + bytes(4)),
    "a broadcast that wants an acknowledgement": resealed(b"\x61\x88\x09\x07\x00\xff\xff\x02\x00" + b"\0\0"),
    "from everybody": resealed(b"\x41\x88\x09\x07\x00\x01\x00\xff\xff" + b"\0\0"),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_frame_is_refused_and_says_nothing_to_the_node(what: str) -> None:
    with pytest.raises(FrameError):
        decode(WRONG[what])
    listener = Station(1, PAN, 5, Random(1))
    if len(WRONG[what]) <= PSDU_MAX:
        listener.hear(announced(WRONG[what], STEP))
        assert listener.advance(3 * STEP, 0.0, 0.0) == []
        assert listener.counters.malformed == 1


def test_what_differs_from_a_wrong_frame_in_the_wrong_thing_alone_is_a_frame() -> None:
    assert is_frame(resealed(b"\x41\x88" + BODY + b"\0\0"))
    assert is_frame(resealed(b"\x02\x00\x09\x00\x00"))


def test_no_announcement_from_the_bus_raises_but_what_the_host_counts() -> None:
    chance = Random(3)
    values = (0, -1, 7, 1 << 70, 1.5, 9e4, -9e5, float("nan"), float("inf"), None, True, b"", GOOD, "x", [1], {})
    good = announced(GOOD, STEP)
    assert Announcement.from_wire(good) == good
    refused = 0
    for _ in range(20_000):
        fields = list(good)
        for _ in range(chance.randrange(1, 3)):
            fields[chance.randrange(len(fields))] = chance.choice(values)
        if chance.random() < 0.1:
            fields = fields[: chance.randrange(len(fields) + 1)]
        try:
            made = Announcement.from_wire(fields)
        except ValueError:
            refused += 1
            continue
        listener = Station(1, PAN, 5, Random(1))
        listener.hear(made)
        listener.advance(NS_PER_MS * 100, 0.0, 0.0)
    assert 10_000 < refused < 20_000

"""CSMA/CA, acknowledgements and retries, step by step."""

from random import Random

import pytest
from radio_ether import US

from rmr.base.time import NEVER
from rmr.radio.air import Confirmed
from rmr.radio.frame import DataFrame, decode
from rmr.radio.mac import QUEUE_MAX, Mac, State, Transmission
from rmr.radio.security import Level, Security


class Fixed(Random):
    """Always draws the longest backoff and remembers how many bits were asked for."""

    def __init__(self) -> None:
        super().__init__(0)
        self.bits: list[int] = []

    def getrandbits(self, k: int, /) -> int:
        self.bits.append(k)
        return (1 << k) - 1


def mac(rng: Random | None = None) -> Mac:
    return Mac(1, 7, rng or Random(3))


def send(machine: Mac, *, to: int | None = None, payload: bytes = b"x" * 50, now: int = 0, handle: int = 1) -> None:
    assert machine.request(now, payload, to, handle)


def transmit(machine: Mac) -> Transmission:
    out = machine.fire(busy=False)
    assert isinstance(out, Transmission)
    return out


def test_idle_mac_has_no_timer() -> None:
    assert mac().next_wake == NEVER


def test_on_an_idle_channel_the_first_symbol_leaves_after_one_of_eight_times() -> None:
    # Backoff of 0..7 periods of 320 us, assessment 128 us, turnaround 192 us: 320, 640, ..., 2560 us.
    seen = set()
    for seed in range(200):
        machine = mac(Random(seed))
        send(machine)
        seen.add(transmit(machine).start // US)
    assert sorted(seen) == [320, 640, 960, 1280, 1600, 1920, 2240, 2560]


def sent_order(machine: Mac, count: int) -> list[int]:
    """The handles of the next requests, in the order in which they are over."""
    over = []
    while len(over) < count:
        out = machine.fire(busy=False)
        if isinstance(out, Confirmed):
            over.append(out.handle)
    return over


def test_requests_with_a_deadline_are_sent_earliest_deadline_first_and_others_keep_their_places() -> None:
    machine = mac()
    for handle, due in enumerate([9, 5, NEVER, 7, 5, NEVER, 1, 9]):
        assert machine.request(0, b"x", None, handle, due)
    # The first is under way already. Deadlines 5, -, 7, 5, -, 1, 9 become 1, -, 5, 5, -, 7, 9.
    assert sent_order(machine, 8) == [0, 6, 2, 1, 4, 5, 3, 7]


def test_reordered_requests_are_secured_in_the_order_in_which_they_are_sent() -> None:
    ours = Security(Level.ENC_MIC_32, bytes(16), 7)
    theirs = Security(Level.ENC_MIC_32, bytes(16), 8)
    machine = Mac(7, 1, Random(3), security=ours)
    for handle, due in enumerate([9, 5, 1]):
        assert machine.request(0, bytes([handle]), None, handle, due)
    payloads = []
    while len(payloads) < 3:
        out = machine.fire(busy=False)
        if isinstance(out, Transmission):
            frame = decode(out.psdu)
            assert isinstance(frame, DataFrame)
            payloads.append(theirs.open(frame).payload)
    assert payloads == [b"\0", b"\2", b"\1"], "none is refused as replayed"


def test_five_busy_channels_in_a_row_are_an_access_failure_at_37_44_ms_at_the_latest() -> None:
    # (7 + 15 + 31 + 31 + 31) backoff periods of 320 us and five assessments of 128 us.
    rng = Fixed()
    machine = mac(rng)
    send(machine)
    rng.bits.clear()
    machine_log = [machine.fire(busy=True) for _ in range(4)]
    assert machine_log == [None] * 4
    assert machine.next_wake == 37_440 * US - 0
    assert machine.fire(busy=True) == Confirmed(1, "access_failure")
    assert rng.bits == [4, 5, 5, 5]
    assert machine.next_wake == NEVER


def test_a_broadcast_is_sent_once_and_confirmed_at_its_end() -> None:
    machine = mac()
    send(machine, to=None)
    sent = transmit(machine)
    assert machine.next_wake == sent.end
    assert machine.fire(busy=False) == Confirmed(1, "ok")
    assert machine.state is State.IDLE


def test_an_unanswered_unicast_is_sent_four_times_864_us_after_each_and_then_given_up() -> None:
    machine = mac()
    send(machine, to=2)
    attempts = []
    for _ in range(4):
        sent = transmit(machine)
        attempts.append(sent.attempt)
        assert machine.fire(busy=False) is None
        assert machine.next_wake == sent.end + 864 * US
        outcome = machine.fire(busy=False)
    assert attempts == [0, 1, 2, 3]
    assert outcome == Confirmed(1, "no_ack")


def test_an_acknowledgement_of_the_right_number_and_time_ends_the_request() -> None:
    machine = mac()
    send(machine, to=2)
    sent = transmit(machine)
    machine.fire(busy=False)
    start = sent.end + 192 * US
    assert machine.awaits_ack(sent.sequence & 0xFF, start)
    assert not machine.awaits_ack(sent.sequence + 1 & 0xFF, start)
    assert not machine.awaits_ack(sent.sequence & 0xFF, sent.end - 1)
    assert not machine.awaits_ack(sent.sequence & 0xFF, sent.end + 864 * US)
    assert machine.acknowledged(start + 352 * US, start + 352 * US) == Confirmed(1, "ok")


def test_a_retry_that_finds_no_free_channel_ends_the_request_as_access_failure() -> None:
    machine = mac()
    send(machine, to=2)
    transmit(machine)
    machine.fire(busy=False)
    machine.fire(busy=False)
    outcomes = [machine.fire(busy=True) for _ in range(5)]
    assert outcomes[-1] == Confirmed(1, "access_failure")


@pytest.mark.parametrize(("payload", "space_us"), [(b"x" * 7, 192), (b"x" * 8, 640)])
def test_the_next_request_keeps_a_short_space_after_18_octets_and_a_long_one_after_more(
    payload: bytes, space_us: int
) -> None:
    rng = Fixed()
    machine = mac(rng)
    send(machine, payload=payload)
    send(machine, payload=payload, handle=2)
    sent = transmit(machine)
    machine.fire(busy=False)
    assert machine.next_wake == sent.end + (space_us + 7 * 320 + 128) * US


def test_a_request_after_the_space_has_passed_begins_at_once() -> None:
    machine = mac(Fixed())
    send(machine)
    sent = transmit(machine)
    machine.fire(busy=False)
    later = sent.end + 10_000 * US
    send(machine, now=later)
    assert machine.next_wake == later + (7 * 320 + 128) * US


def test_requests_are_served_in_order_with_rising_sequence_numbers() -> None:
    machine = mac()
    for handle in range(3):
        send(machine, handle=handle)
    sequences, handles = [], []
    for _ in range(3):
        sequences.append(transmit(machine).sequence)
        outcome = machine.fire(busy=False)
        assert isinstance(outcome, Confirmed)
        handles.append(outcome.handle)
    assert handles == [0, 1, 2]
    assert [s - sequences[0] for s in sequences] == [0, 1, 2]


def test_the_queue_is_bounded() -> None:
    machine = mac()
    taken = [machine.request(0, b"", None, k) for k in range(QUEUE_MAX + 5)]
    assert taken.count(True) == QUEUE_MAX + 1  # one is being served
    assert not any(taken[QUEUE_MAX + 1 :])


def test_a_payload_that_does_not_fit_is_the_callers_mistake_and_leaves_no_trace() -> None:
    machine = mac()
    with pytest.raises(ValueError, match="116"):
        machine.request(0, bytes(117), None, 1)
    assert machine.next_wake == NEVER

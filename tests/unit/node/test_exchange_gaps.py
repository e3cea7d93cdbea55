"""Selective acknowledgements: what is missing is repeated at once, and what holds back others without back-off."""

from random import Random

import pytest

from rmr.base.time import milliseconds, seconds
from rmr.node import payloads
from rmr.node.logic.exchange import HEARD_WITHIN, RETRY_MAX, Exchange, Outcome
from rmr.node.logic.inbound import SEQUENCE_MASK, UNORDERED
from rmr.node.logic.outbound import IN_FLIGHT_MAX, RETRY_FIRST
from rmr.node.payloads import ACK_BEFORE_BITS, Delivery, DeliveryRole

FACT = Delivery(DeliveryRole.FACT, 3, (1,))
RECEIVER, SENDER = 1, 2
JITTER = 1.5


def robot() -> Exchange:
    return Exchange(9, 0, Random(1))


def leaving(exchange: Exchange) -> list[bytes]:
    frames = [payload for payload, *_ in exchange.outbox]
    exchange.outbox.clear()
    return frames


def numbers(exchange: Exchange) -> list[int]:
    """The numbers of the deliveries that leave."""
    return [payloads.decode_fact_frame(payload).sequence for payload in leaving(exchange)]


def sender_of(count: int, ordered: bool = True) -> Exchange:
    """A robot with so many deliveries under way, and one before them that has been acknowledged."""
    sender = robot()
    for number in range(count + 1):
        sender.send(0, RECEIVER, FACT, bytes([number]), ordered=ordered)
        if number == 0:
            sender.acknowledged(0, payloads.encode_ack(0, 0 if ordered else UNORDERED), RECEIVER)
    leaving(sender)
    return sender


def acknowledged(sender: Exchange, now: int, sequence: int, before: int = 0) -> None:
    sender.acknowledged(now, payloads.encode_ack(0, sequence, before), RECEIVER)


def times_sent(sender: Exchange, begin: int, end: int) -> list[int]:
    """The instants at which anything leaves, while nothing is acknowledged."""
    times = []
    while begin <= sender.next_wake < end:
        now = sender.next_wake
        sender.wake(now)
        times += [now] * len(leaving(sender))
    return times


@pytest.mark.parametrize("kind", [0, UNORDERED])
def test_what_has_not_arrived_although_something_later_has_is_repeated_at_once(kind):
    sender = sender_of(3, ordered=not kind)
    acknowledged(sender, milliseconds(10), kind | 3)
    assert numbers(sender) == [kind | 1, kind | 2]
    assert sender.repeated == 2


def test_each_copy_is_repeated_at_once_but_once():
    sender = sender_of(4)
    acknowledged(sender, milliseconds(10), 2)
    assert numbers(sender) == [1]
    acknowledged(sender, milliseconds(11), 2)
    acknowledged(sender, milliseconds(12), 3)
    acknowledged(sender, milliseconds(13), 4)
    assert numbers(sender) == [], "those left before the repeat"
    sender.send(milliseconds(20), RECEIVER, FACT, b"x")
    acknowledged(sender, milliseconds(30), 5)
    assert numbers(sender) == [5, 1], "this one left after it"


def test_a_repeated_delivery_that_is_acknowledged_tells_nothing_of_those_that_left_between_its_copies():
    sender = sender_of(2)
    sender.wake(milliseconds(230))
    assert numbers(sender) == [1, 2]
    acknowledged(sender, milliseconds(231), 2)
    assert numbers(sender) == []


def test_a_delivery_that_the_radio_may_have_preferred_tells_nothing_of_those_before_it():
    sender = sender_of(1)
    sender.send(0, RECEIVER, FACT, b"x", due=seconds(1))
    leaving(sender)
    acknowledged(sender, milliseconds(10), 2)
    assert numbers(sender) == []


@pytest.mark.parametrize("kind", [0, UNORDERED])
def test_an_acknowledgement_tells_which_before_it_have_arrived_too(kind):
    sender, receiver = sender_of(0, ordered=not kind), robot()
    for frame in payloads.encode_fact_frames(9, 0, kind, b"\0"):
        receiver.received(0, frame, SENDER)
    for _ in range(5):
        sender.send(0, RECEIVER, FACT, b"x", ordered=not kind)
    for place, frame in enumerate(leaving(sender)):
        if place != 2:  # number 3 is lost
            receiver.received(0, frame, SENDER)
    *lost, last = leaving(receiver)
    assert payloads.decode_ack(last) == (0, kind | 5, 0b11101)
    sender.acknowledged(0, last, RECEIVER)
    assert [news.outcome for news in sender.news] == [*[Outcome.DELIVERED] * 5, Outcome.REPEATED]
    assert numbers(sender) == [kind | 3]
    for frame in lost:  # they come late
        sender.acknowledged(0, frame, RECEIVER)
    assert numbers(sender) == []


@pytest.mark.parametrize("kind", [0, UNORDERED])
def test_what_an_acknowledgement_tells_of_goes_round_with_the_numbers(kind):
    receiver = robot()
    last = ACK_BEFORE_BITS // 2
    for number in (*range(-2 * ACK_BEFORE_BITS, last - 1), last):
        for frame in payloads.encode_fact_frames(9, 0, kind | number & SEQUENCE_MASK, b"x"):
            receiver.received(0, frame, SENDER)
    assert payloads.decode_ack(leaving(receiver)[-1]) == (0, kind | last, (1 << ACK_BEFORE_BITS) - 2)


def test_the_oldest_is_repeated_without_back_off_while_its_receiver_acknowledges_anything():
    sender = sender_of(1)
    times = times_sent(sender, 0, HEARD_WITHIN)
    assert max(b - a for a, b in zip([0, *times], times, strict=False)) <= JITTER * RETRY_FIRST
    assert len(times) <= HEARD_WITHIN / RETRY_FIRST


def test_a_robot_that_acknowledges_nothing_is_sent_ever_fewer_repeats():
    sender = sender_of(1)
    times_sent(sender, 0, HEARD_WITHIN + seconds(3))
    begin = sender.next_wake
    assert len(times_sent(sender, begin, begin + seconds(10))) <= seconds(10) / RETRY_MAX + 1


def test_others_than_the_oldest_back_off():
    sender = sender_of(IN_FLIGHT_MAX)
    oldest, all_sent = len(times_sent(sender_of(1), 0, HEARD_WITHIN)), len(times_sent(sender, 0, HEARD_WITHIN))
    assert all_sent <= oldest + (IN_FLIGHT_MAX - 1) * 4


def test_the_next_oldest_need_not_wait_for_its_back_off():
    sender = sender_of(2)
    times_sent(sender, 0, seconds(1))
    now = seconds(1)
    acknowledged(sender, now, 1)
    (again, *_) = times_sent(sender, now, seconds(2))
    assert again <= now + JITTER * RETRY_FIRST


def test_what_is_under_way_to_a_silent_robot_is_repeated_when_it_is_heard_again():
    sender = sender_of(3)
    times_sent(sender, 0, seconds(20))
    assert list(sender.silent) == [RECEIVER]
    now = seconds(20)
    sender.heard_again(now, RECEIVER)
    assert not sender.silent
    sender.wake(now)
    assert numbers(sender) == [1, 2, 3]


def test_a_robot_that_is_heard_and_acknowledges_nothing_is_not_sent_all_again_each_time():
    sender = sender_of(IN_FLIGHT_MAX)
    now, sent = 0, 0
    for now in range(seconds(3), seconds(23), milliseconds(20)):  # it is heard each 20 ms
        sender.wake(now)
        if RECEIVER in sender.silent:
            sender.heard_again(now, RECEIVER)
            sender.wake(now)
        sent += len(leaving(sender))
    assert sent <= 20 * IN_FLIGHT_MAX * seconds(2) / RETRY_MAX


def test_a_robot_to_which_nothing_is_under_way_is_not_silent():
    sender = sender_of(2)
    times_sent(sender, 0, seconds(5))
    acknowledged(sender, seconds(5), 2, 1)
    sender.wake(seconds(60))
    assert sender.idle
    assert not sender.silent

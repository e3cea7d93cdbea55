"""Facts between robots arrive exactly once while both live, whatever the radio loses or repeats."""

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmr.base.time import NEVER, seconds
from rmr.node import wire
from rmr.node.exchange import IN_FLIGHT_MAX, REMEMBERED_MAX, TIME_TO_LIVE, WAITING_MAX, Exchange, Outcome
from rmr.node.wire import Delivery, Kind, Role

FACT = Delivery(Role.FACT, 3, (1,))


class Pair:
    """Two exchanges over a link that loses and repeats frames as `rng` says."""

    def __init__(self, rng: Random, loss: float = 0.0, repeat: float = 0.0, digests: tuple[int, int] = (9, 9)) -> None:
        self.a = Exchange(digests[0], 0, Random(1))
        self.b = Exchange(digests[1], 0, Random(2))
        self.rng, self.loss, self.repeat = rng, loss, repeat
        self.now = 0
        self.arrived: list[bytes] = []

    def _carry(self, source: Exchange, target: Exchange) -> None:
        frames, source.outbox[:] = list(source.outbox), []
        for payload, _ in frames:
            for _ in range(1 + (self.rng.random() < self.repeat)):
                if self.rng.random() < self.loss:
                    continue
                if payload[0] == Kind.FACT_ACK:
                    target.acknowledged(self.now, payload, 1)
                else:
                    body = target.received(payload, 1)
                    if body is not None:
                        self.arrived.append(body)

    def run(self, until: int) -> None:
        while self.now < until:
            self._carry(self.a, self.b)
            self._carry(self.b, self.a)
            self._carry(self.a, self.b)
            if self.a.next_wake == NEVER or self.a.next_wake > until:
                break
            self.now = max(self.now + 1, self.a.next_wake)
            self.a.wake(self.now)


def given_up(exchange: Exchange) -> list[tuple[int, Delivery]]:
    return [(news.destination, news.delivery) for news in exchange.news if news.outcome is Outcome.UNDELIVERED]


@given(st.integers(0, 10**6), st.floats(0, 0.7), st.floats(0, 0.5), st.integers(1, 20))
def test_every_fact_arrives_exactly_once(seed, loss, repeat, count):
    pair = Pair(Random(seed), loss, repeat)
    bodies = [bytes([i]) * (1 + 17 * i) for i in range(count)]
    for body in bodies:
        pair.a.send(0, 1, FACT, body)
    pair.run(seconds(29))
    lost = given_up(pair.a)
    assert len(set(pair.arrived)) == len(pair.arrived), "nothing arrives twice"
    if loss <= 0.3:
        assert sorted(pair.arrived) == sorted(bodies)
    assert not lost, "nothing is given up before its time"


def test_what_nobody_acknowledges_comes_back_to_the_sender():
    pair = Pair(Random(0), loss=1.0)
    pair.a.send(0, 1, FACT, b"x")
    pair.run(TIME_TO_LIVE + seconds(5))
    assert given_up(pair.a) == [(1, FACT)]
    assert pair.arrived == []


def test_at_most_a_bounded_number_is_in_flight_and_the_rest_waits_in_order():
    exchange = Exchange(1, 0, Random(0))
    for i in range(IN_FLIGHT_MAX + 5):
        exchange.send(0, 1, FACT, bytes([i]))
    assert len(exchange.outbox) == IN_FLIGHT_MAX
    exchange.acknowledged(0, wire.encode_ack(0, 0), 1)
    assert wire.decode_fact_frame(exchange.outbox[-1][0]).piece == bytes([IN_FLIGHT_MAX])


def test_a_restarted_sender_is_not_taken_for_its_earlier_life():
    receiver = Exchange(1, 0, Random(0))
    for epoch in (0, 1):
        (frame,) = wire.encode_fact_frames(1, epoch, 0, b"x")
        assert receiver.received(frame, 5) == b"x"
        assert receiver.received(frame, 5) is None
    assert receiver.duplicates == 2


def test_facts_of_another_program_are_counted_and_dropped():
    pair = Pair(Random(0), digests=(1, 2))
    pair.a.send(0, 1, FACT, b"x")
    pair.run(seconds(1))
    assert pair.arrived == []
    assert pair.b.foreign > 0


def test_a_robot_that_never_answers_is_sent_a_bounded_number_of_facts():
    exchange = Exchange(1, 0, Random(0))
    for _ in range(IN_FLIGHT_MAX + WAITING_MAX):
        exchange.send(0, 1, FACT, b"x")
    with pytest.raises(wire.WireError, match="wait for robot 1"):
        exchange.send(0, 1, FACT, b"x")
    exchange.send(0, 2, FACT, b"x")


def test_what_has_waited_for_longer_than_its_time_is_given_up_unsent():
    exchange = Exchange(1, 0, Random(0))
    for _ in range(3 * IN_FLIGHT_MAX):
        exchange.send(0, 1, FACT, b"x")
    exchange.outbox.clear()
    exchange.wake(TIME_TO_LIVE)
    assert len(given_up(exchange)) == 3 * IN_FLIGHT_MAX
    assert exchange.outbox == []
    assert exchange.idle


def test_what_waits_for_a_robot_that_answers_is_not_given_up():
    exchange = Exchange(1, 0, Random(0))
    for _ in range(2 * IN_FLIGHT_MAX):
        exchange.send(0, 1, FACT, b"x")
    exchange.acknowledged(seconds(20), wire.encode_ack(0, 0), 1)
    exchange.wake(TIME_TO_LIVE)
    assert len(given_up(exchange)) == IN_FLIGHT_MAX - 1, "those that were in flight all the time"
    exchange.news.clear()
    exchange.wake(seconds(49))
    assert given_up(exchange) == [], "the others are repeated for their whole time"


def test_a_sender_does_not_run_so_far_ahead_that_the_receiver_forgets_what_it_may_repeat():
    exchange = Exchange(1, 0, Random(0))
    receiver = Exchange(1, 0, Random(0))
    oldest: list[bytes] = []
    for number in range(3 * REMEMBERED_MAX):
        if number < 2 * REMEMBERED_MAX:
            exchange.send(0, 1, FACT, b"x")
        sent, exchange.outbox[:] = list(exchange.outbox), []
        for payload, _ in sent:
            receiver.received(payload, 1)
            sequence = wire.decode_fact_frame(payload).sequence
            if sequence == 0:
                oldest.append(payload)  # its acknowledgement is lost again and again
            else:
                exchange.acknowledged(0, wire.encode_ack(0, sequence), 1)
    assert receiver.received(oldest[0], 1) is None, "it is known as a repeat"


def test_fragments_that_disagree_on_their_number_are_no_delivery_and_no_reason_to_stop():
    receiver = Exchange(1, 0, Random(0))
    body = bytes(3 * 108)
    one, two, three = wire.encode_fact_frames(1, 0, 7, body)
    other = wire.encode_fact_frames(1, 0, 7, bytes(2 * 108))
    assert [receiver.received(frame, 5) for frame in (three, other[0], one)] == [None, None, None]
    assert receiver.received(two, 5) == body

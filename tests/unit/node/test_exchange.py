"""Facts between robots arrive exactly once while both live, whatever the radio loses or repeats."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.base.time import NEVER, seconds
from rmr.node import payloads
from rmr.node.logic.exchange import TIME_TO_LIVE, WAITING_MAX, Exchange, Outcome
from rmr.node.logic.inbound import ORDERED_WINDOW, SEQUENCE_MASK, UNORDERED
from rmr.node.logic.outbound import IN_FLIGHT_MAX
from rmr.node.payloads import Delivery, DeliveryRole, PayloadKind

FACT = Delivery(DeliveryRole.FACT, 3, (1,))


def taken(exchange: Exchange, payload: bytes, source: int, now: int = 0) -> list[bytes]:
    """What takes effect when `exchange` receives a frame."""
    match payload[0]:
        case PayloadKind.FACT_ACK:
            exchange.acknowledged(now, payload, source)
        case PayloadKind.FACT_BASE:
            exchange.base_told(now, payload, source)
        case PayloadKind.FACT_BASE_WANTED:
            exchange.asked(payload, source)
        case _:
            exchange.received(now, payload, source)
    return handed_on(exchange)


def handed_on(exchange: Exchange) -> list[bytes]:
    arrivals, exchange.arrivals = exchange.arrivals, []
    return [arrival.body for arrival in arrivals]


def numbered(first: int, n: int) -> int:
    return first & UNORDERED | (first + n) & SEQUENCE_MASK


def received(exchange: Exchange, payload: bytes, source: int) -> bytes | None:
    return next(iter(taken(exchange, payload, source)), None)


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
        for payload, *_ in frames:
            for _ in range(1 + (self.rng.random() < self.repeat)):
                if self.rng.random() < self.loss:
                    continue
                self.arrived += taken(target, payload, 1, self.now)

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
    exchange.acknowledged(0, payloads.encode_ack(0, 0), 1)
    assert payloads.decode_fact_frame(exchange.outbox[-1][0]).piece == bytes([IN_FLIGHT_MAX])


def test_a_restarted_sender_is_not_taken_for_its_earlier_life():
    receiver = Exchange(1, 0, Random(0))
    for epoch in (0, 1):
        (frame,) = payloads.encode_fact_frames(1, epoch, 0, b"x")
        assert received(receiver, frame, 5) == b"x"
        assert received(receiver, frame, 5) is None
    assert receiver.duplicates == 2


def test_a_late_frame_of_an_earlier_life_is_dropped_and_the_newer_one_remembered():
    receiver = Exchange(1, 0, Random(0))
    (old,), (new,) = (payloads.encode_fact_frames(1, epoch, 0, b"x") for epoch in (0, 1))
    assert received(receiver, old, 5) == b"x"
    assert received(receiver, new, 5) == b"x"
    assert [received(receiver, frame, 5) for frame in (old, new, old, new)] == [None] * 4
    assert (receiver.late, receiver.duplicates) == (2, 2)
    acknowledged = [payloads.decode_ack(payload)[0] for payload, *_ in receiver.outbox]
    assert acknowledged == [0, 1, 1, 1], "a life that has ended waits for nothing"


@pytest.mark.parametrize(("old", "new"), [(255, 0), (250, 3), (0, 127)])
def test_the_count_of_lives_goes_round(old, new):
    receiver = Exchange(1, 0, Random(0))
    (late,), (first,) = (payloads.encode_fact_frames(1, epoch, 0, b"x") for epoch in (old, new))
    assert received(receiver, late, 5) == b"x"
    assert received(receiver, first, 5) == b"x"
    assert received(receiver, late, 5) is None
    assert received(receiver, first, 5) is None


@pytest.mark.parametrize("first", [0, UNORDERED, UNORDERED + 32_600])
def test_a_copy_that_comes_after_hundreds_of_newer_ones_is_a_repeat(first):
    receiver = Exchange(1, 0, Random(0))
    frames = [payloads.encode_fact_frames(1, 0, numbered(first, n), b"x")[0] for n in range(4 * ORDERED_WINDOW)]
    assert [received(receiver, frame, 5) for frame in frames] == [b"x"] * len(frames)
    assert {received(receiver, frame, 5) for frame in frames} == {None}
    assert receiver.duplicates == len(frames)


class Restarting:
    """A sender that is restarted again and again, and a receiver that lives throughout.

    The network keeps every frame it has carried: it delivers them in any order, again and again, or never.
    """

    def __init__(self, seed: int, epoch: int) -> None:
        self.rng, self.epoch, self.now = Random(seed), epoch, 0
        self.receiver = Exchange(9, 0, Random(1))
        self.sender = Exchange(9, epoch, Random(2))
        self.network: list[bytes] = []
        self.answers: list[bytes] = []
        self.arrived: list[bytes] = []
        self.sent = 0

    def act(self) -> None:
        rng = self.rng
        match rng.choices(("send", "carry", "late", "answer", "wait", "restart"), (30, 60, 20, 30, 10, 1))[0]:
            case "send":
                self.sent += 1
                body = self.sent.to_bytes(4, "big") * rng.choice((1, 1, 1, 60))
                self.sender.send(self.now, 1, FACT, body)
            case "carry" if self.network:
                self._deliver(self.network[-rng.randint(1, min(12, len(self.network)))])
            case "late" if self.network:
                self._deliver(rng.choice(self.network))
            case "answer" if self.answers:
                taken(self.sender, rng.choice(self.answers[-20:]), 1, self.now)
            case "wait":
                self.now += seconds(rng.random())
                self.sender.wake(self.now)
                self._ask()
            case "restart":
                self.epoch = (self.epoch + 1) & 0xFF
                self.sender = Exchange(9, self.epoch, Random(2))
        self.network += [payload for payload, *_ in self.sender.outbox]
        self.sender.outbox.clear()

    def _deliver(self, frame: bytes) -> None:
        self.arrived += taken(self.receiver, frame, 1, self.now)
        self.answers += [payload for payload, *_ in self.receiver.outbox]
        self.receiver.outbox.clear()

    def heal(self) -> None:
        """Let everything of the present life through, until neither waits for anything."""
        while not (self.sender.idle and self.receiver.idle):
            self.now = max(self.now, min(self.sender.next_wake, self.receiver.next_wake))
            self.sender.wake(self.now)
            self._ask()
            while self.sender.outbox or self.answers:
                frames, self.sender.outbox[:] = [payload for payload, *_ in self.sender.outbox], []
                for frame in frames:
                    self._deliver(frame)
                answers, self.answers = self.answers, []
                for answer in answers:
                    taken(self.sender, answer, 1, self.now)

    def _ask(self) -> None:
        self.receiver.wake(self.now)
        self.arrived += handed_on(self.receiver)
        self.answers += [payload for payload, *_ in self.receiver.outbox]
        self.receiver.outbox.clear()


@pytest.mark.medium
@settings(deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0, 1, 250]), st.integers(1, 3000))
def test_no_order_repetition_delay_or_restart_makes_a_fact_arrive_twice(seed, epoch, steps):
    run = Restarting(seed, epoch)
    for _ in range(steps):
        run.act()
    assert len(set(run.arrived)) == len(run.arrived)
    before = run.sent
    for _ in range(2 * IN_FLIGHT_MAX):
        run.sent += 1
        run.sender.send(run.now, 1, FACT, run.sent.to_bytes(4, "big"))
    run.heal()
    assert len(set(run.arrived)) == len(run.arrived)
    assert {n.to_bytes(4, "big") for n in range(before + 1, run.sent + 1)} <= set(run.arrived)


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
    with pytest.raises(payloads.WireError, match="wait for robot 1"):
        exchange.send(0, 1, FACT, b"x")
    exchange.send(0, 2, FACT, b"x")


def test_what_has_waited_for_longer_than_its_time_is_given_up_unsent():
    exchange = Exchange(1, 0, Random(0))
    for _ in range(3 * IN_FLIGHT_MAX):
        exchange.send(0, 1, FACT, b"x")
    exchange.outbox.clear()
    exchange.wake(TIME_TO_LIVE)
    assert len(given_up(exchange)) == 3 * IN_FLIGHT_MAX
    assert [payload[0] for payload, *_ in exchange.outbox] == [PayloadKind.FACT_BASE], "nothing is waited for"
    assert exchange.idle


def test_what_waits_for_a_robot_that_answers_is_not_given_up():
    exchange = Exchange(1, 0, Random(0))
    for _ in range(2 * IN_FLIGHT_MAX):
        exchange.send(0, 1, FACT, b"x")
    exchange.acknowledged(seconds(20), payloads.encode_ack(0, 0), 1)
    exchange.wake(TIME_TO_LIVE)
    assert len(given_up(exchange)) == IN_FLIGHT_MAX - 1, "those that were in flight all the time"
    exchange.news.clear()
    exchange.wake(seconds(49))
    assert given_up(exchange) == [], "the others are repeated for their whole time"


def test_a_sender_does_not_run_so_far_ahead_that_the_receiver_forgets_what_it_may_repeat():
    exchange = Exchange(1, 0, Random(0))
    receiver = Exchange(1, 0, Random(0))
    oldest: list[bytes] = []
    for number in range(3 * ORDERED_WINDOW):
        if number < 2 * ORDERED_WINDOW:
            exchange.send(0, 1, FACT, b"x")
        sent, exchange.outbox[:] = list(exchange.outbox), []
        for payload, *_ in sent:
            received(receiver, payload, 1)
            sequence = payloads.decode_fact_frame(payload).sequence
            if sequence == 0:
                oldest.append(payload)  # its acknowledgement is lost again and again
            else:
                exchange.acknowledged(0, payloads.encode_ack(0, sequence), 1)
    assert received(receiver, oldest[0], 1) is None, "it is known as a repeat"


def test_fragments_that_disagree_on_their_number_are_no_delivery_and_no_reason_to_stop():
    receiver = Exchange(1, 0, Random(0))
    body = bytes(3 * 108)
    one, two, three = payloads.encode_fact_frames(1, 0, 0, body)
    other = payloads.encode_fact_frames(1, 0, 0, bytes(2 * 108))
    assert [received(receiver, frame, 5) for frame in (three, other[0], one)] == [None, None, None]
    assert received(receiver, two, 5) == body

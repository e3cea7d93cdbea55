"""The air of an evaluation: who gets what and when, what is lost, and how it is counted."""

import pytest

from rmr.base.kernel import Kernel
from rmr.base.streams import stream
from rmr.base.time import milliseconds, seconds
from rmr.eval.eval_ether import HOPS_AT_ONCE_MAX, LATENCY, EvalEther
from rmr.eval.topology import named
from rmr.node import payloads
from rmr.node.logic.inbound import SEQUENCE_MASK, UNORDERED

ROBOTS = dict.fromkeys((1, 2, 3, 4))
SCHEDULE = b"\x02a schedule"
"""Coordination, by its first octet."""


class Air:
    """An ether with its kernel, and what each robot has heard so far."""

    def __init__(self, shape="line", **conditions):
        self.kernel = Kernel()
        self.lost = []
        self.ether = EvalEther(
            self.kernel,
            named(shape, ROBOTS),
            stream("0/ether"),
            **({"loss": 0.0, "latency": milliseconds(5)} | conditions),
            lost=lambda *loss: self.lost.append(loss),
        )
        self.links = {robot: self.ether.link(robot, lambda now: None) for robot in ROBOTS}

    def send(self, source, payload, destination=None, handle=1):
        self.links[source].transmit(payload, destination, handle)

    def heard(self, robot):
        return [(frame.source, frame.payload) for frame in self.links[robot].receive()]

    @property
    def counts(self):
        messages = self.ether.messages
        return messages.sent, messages.delivered, messages.lost, messages.repeated, messages.octets


def fact(sequence, body=b"p(@1)"):
    return payloads.encode_fact_frames(7, 0, sequence, body)[0]


def test_a_frame_arrives_after_the_latency_and_not_before():
    air = Air()
    air.send(1, fact(0), 2)
    air.kernel.run_until(milliseconds(5) - 1)
    assert air.heard(2) == []
    assert air.ether.pending == 1
    air.kernel.run_until(milliseconds(5))
    assert air.ether.pending == 1, "the robot has yet to take it in"
    assert air.heard(2) == [(1, fact(0))]
    assert air.heard(2) == []
    assert air.ether.pending == 0


def test_a_broadcast_reaches_all_in_range_and_counts_for_each_of_them():
    air = Air()
    air.send(2, SCHEDULE)
    air.kernel.run_until(seconds(1))
    assert [air.heard(robot) for robot in (1, 3, 4)] == [[(2, SCHEDULE)], [(2, SCHEDULE)], []]
    assert air.counts == (2, 2, 0, 0, 2 * len(SCHEDULE))


def test_a_robot_out_of_range_is_not_reached_and_the_frame_is_lost():
    air = Air()
    air.send(1, fact(0), 4)
    air.kernel.run_until(seconds(1))
    assert air.heard(4) == []
    assert air.counts == (1, 0, 1, 0, len(fact(0)))
    assert air.lost == [(0, 1, 4, fact(0))]


def test_acknowledgements_travel_like_any_frame_and_are_not_counted():
    air = Air(loss=1.0)
    air.send(1, payloads.encode_ack(0, 0), 2)
    air.kernel.run_until(seconds(1))
    assert air.heard(2) == []
    assert air.counts == (0, 0, 0, 0, 0)
    assert len(air.lost) == 1


def test_sent_is_delivered_lost_and_under_way():
    air = Air("complete", loss=0.4)
    for number in range(200):
        air.send(1 + number % 4, SCHEDULE + bytes([number]))
        air.kernel.run_until(air.kernel.now + milliseconds(1))
        sent, delivered, lost, _, _ = air.counts
        assert 0 <= sent - delivered - lost <= 15
    air.kernel.run_until(seconds(2))
    sent, delivered, lost, _, _ = air.counts
    assert sent == delivered + lost == 600
    assert 180 < lost < 300


def test_each_receiver_of_a_broadcast_loses_by_itself():
    air = Air("complete", loss=0.5)
    for number in range(50):
        air.send(1, SCHEDULE + bytes([number]))
    air.kernel.run_until(seconds(1))
    heard = {robot: {payload for _, payload in air.heard(robot)} for robot in (2, 3, 4)}
    assert heard[2] != heard[3] != heard[4]


def test_outcome_of_a_unicast_coordination_frame_is_reported():
    air = Air()
    air.send(1, SCHEDULE, 2, handle=5)
    air.send(1, SCHEDULE, 3, handle=6)
    air.send(1, fact(0), 2, handle=7)
    air.kernel.run_until(milliseconds(10) - 1)
    assert air.links[1].confirmations() == []
    air.kernel.run_until(milliseconds(10))
    assert air.links[1].confirmations() == [(5, "ok"), (6, "no_ack")]


def test_repeats_are_known_by_number_even_when_thousands_of_frames_lie_between():
    link = Air().links[1]
    assert not any(link.repeats(fact(sequence & SEQUENCE_MASK), 2) for sequence in range(0, UNORDERED + 0x10, 0x10))
    assert all(link.repeats(fact(sequence), 2) for sequence in (0x0, 0x7FF0, 0x4010))
    assert not link.repeats(fact(0x10), 2)


def test_the_same_number_to_another_robot_is_no_repeat():
    air = Air()
    air.send(2, fact(0), 1)
    air.send(2, fact(0), 3)
    assert air.ether.messages.repeated == 0


def test_the_parts_of_one_fact_are_no_repeats_of_each_other():
    air = Air()
    frames = payloads.encode_fact_frames(7, 0, 0, b"x" * 300)
    assert len(frames) == 3
    for frame in frames * 2:
        air.send(1, frame, 2)
    assert air.ether.messages.repeated == 3


def test_equal_frames_without_a_number_are_repeats_for_each_receiver():
    air = Air()
    for _ in range(3):
        air.send(2, payloads.encode_failure(7, 0))
    assert air.counts[:4] == (6, 0, 0, 4)


@pytest.mark.parametrize("awaited", [fact(0), payloads.encode_failure(7, 0)])
def test_frames_that_matter_are_pending_until_they_arrive(awaited):
    air = Air()
    air.send(1, SCHEDULE)
    air.send(1, payloads.encode_ack(0, 0), 2)
    assert air.ether.pending == 0
    air.send(1, awaited, 2)
    assert air.ether.pending == air.ether.carried == 1


def conversation(air):
    """Let robots 1 and 2 answer each other without end; return how often they have."""
    answered = [0]

    def answer(robot, other):
        def wake(now):
            answered[0] += len(air.links[robot].receive())
            air.send(robot, fact(answered[0] & 0xFFFF), other)

        return wake

    air.links[1].wake, air.links[2].wake = answer(1, 2), answer(2, 1)
    air.send(1, fact(0), 2)
    return answered


def test_endless_replies_at_one_instant_do_not_stop_time():
    air = Air(latency=0)
    answered = conversation(air)
    air.kernel.run_until(0)
    assert answered[0] == HOPS_AT_ONCE_MAX
    assert air.ether.slowed_at == 0
    air.kernel.run_until(LATENCY * 10)
    assert answered[0] == HOPS_AT_ONCE_MAX + 10


def test_a_long_conversation_that_takes_time_is_no_endless_one():
    air = Air(latency=1)
    answered = conversation(air)
    air.kernel.run_until(3 * HOPS_AT_ONCE_MAX)
    assert answered[0] == 3 * HOPS_AT_ONCE_MAX
    assert air.ether.slowed_at is None


def test_many_frames_of_one_instant_that_answer_nothing_are_no_endless_chain():
    air = Air("star", latency=0)
    for number in range(5 * HOPS_AT_ONCE_MAX):
        air.send(2 + number % 3, fact(number), 1)
    air.kernel.run_until(0)
    assert len(air.heard(1)) == 5 * HOPS_AT_ONCE_MAX
    assert air.ether.slowed_at is None

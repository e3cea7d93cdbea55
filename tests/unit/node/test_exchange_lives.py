"""A delivery takes effect in one life of its receiver at most; what no earlier life can have got goes to the new."""

from random import Random

import pytest
from flock import Flock

from rmr.base.time import milliseconds, seconds
from rmr.node import payloads
from rmr.node.logic.exchange import CLOCKS_APART, Exchange, News, Outcome
from rmr.node.logic.outbound import IN_FLIGHT_MAX
from rmr.node.payloads import Delivery, DeliveryRole, PayloadKind, WireError

FACT = Delivery(DeliveryRole.FACT, 3, (1,))
RECEIVER, SENDER = 1, 2
KILLED_AT = seconds(1)
BACK_AT = seconds(2)


def exchange(epoch: int = 0, ended: int = 0) -> Exchange:
    made = Exchange(9, epoch, Random(1))
    made.predecessor_ended = ended
    return made


def leaving(robot: Exchange) -> list[bytes]:
    frames = [payload for payload, *_ in robot.outbox]
    robot.outbox.clear()
    return frames


def handed_on(robot: Exchange) -> list[bytes]:
    arrivals, robot.arrivals = robot.arrivals, []
    return [arrival.body for arrival in arrivals]


def give(robot: Exchange, now: int, frames: list[bytes], source: int) -> list[bytes]:
    """Give a robot frames; return what takes effect."""
    for frame in frames:
        match frame[0]:
            case PayloadKind.FACT_ACK:
                robot.acknowledged(now, frame, source)
            case PayloadKind.FACT_BASE:
                robot.base_told(now, frame, source)
            case PayloadKind.FACT_BASE_WANTED:
                robot.asked(frame, source)
            case PayloadKind.FACT_LIFE:
                robot.life_told(now, frame, source)
            case _:
                robot.received(now, frame, source)
    return handed_on(robot)


def talk(sender: Exchange, receiver: Exchange, now: int) -> list[bytes]:
    """Let the two talk over a perfect link until they have no more to say; return what takes effect."""
    taken = []
    while sender.outbox or receiver.outbox:
        taken += give(receiver, now, leaving(sender), SENDER)
        give(sender, now, leaving(receiver), RECEIVER)
        receiver.wake(now)
        taken += handed_on(receiver)
    return taken


def test_a_relay_that_dies_before_its_acknowledgement_arrives_does_not_take_the_parcel_again():
    sender, relay = exchange(), exchange()
    parcel = sender.send(0, RECEIVER, FACT, b"parcel")
    assert give(relay, 0, leaving(sender), SENDER) == [b"parcel"]
    leaving(relay)  # the acknowledgement is lost, the parcel has gone on
    relay = exchange(1, KILLED_AT)
    sender.wake(BACK_AT)
    assert talk(sender, relay, BACK_AT) == []
    assert sender.news[-1] == News(Outcome.OUTLIVED, RECEIVER, 0, parcel.sequence, FACT)
    sender.wake(BACK_AT)
    assert sender.idle


def test_what_was_first_sent_after_the_death_goes_to_the_new_life():
    sender = exchange()
    sender.send(KILLED_AT, RECEIVER, FACT, b"while it is dead")
    leaving(sender)
    relay = exchange(1, KILLED_AT)
    sender.wake(BACK_AT)
    assert talk(sender, relay, BACK_AT) == [b"while it is dead"]
    assert [news.outcome for news in sender.news] == [Outcome.REPEATED, Outcome.DELIVERED]


@pytest.mark.parametrize("ordered", [True, False])
def test_what_waits_goes_to_the_new_life_in_order(ordered):
    sender = exchange()
    for n in range(IN_FLIGHT_MAX + 20):
        sender.send(0, RECEIVER, FACT, bytes([n]) * (1 if n % 2 else 300), ordered=ordered)
    leaving(sender)
    relay = exchange(1, KILLED_AT)
    sender.wake(BACK_AT)
    taken = [body[0] for body in talk(sender, relay, BACK_AT)]
    assert taken == list(range(IN_FLIGHT_MAX, IN_FLIGHT_MAX + 20))
    assert [news.outcome for news in sender.news].count(Outcome.OUTLIVED) == IN_FLIGHT_MAX


def test_a_lasting_delivery_is_repeated_to_each_life():
    sender, receiver = exchange(), exchange()
    sender.send(0, RECEIVER, FACT, b"offer", ordered=False, lasting=True)
    assert give(receiver, 0, leaving(sender), SENDER) == [b"offer"]
    leaving(receiver)
    sender.wake(BACK_AT)
    assert talk(sender, exchange(1, KILLED_AT), BACK_AT) == [b"offer"]


def test_late_copies_of_what_an_earlier_life_has_acknowledged_are_dropped():
    sender, receiver = exchange(), exchange()
    for ordered in (True, False):
        sender.send(0, RECEIVER, FACT, b"x", ordered=ordered)
    copies = leaving(sender)
    assert give(receiver, 0, copies, SENDER) == [b"x", b"x"]
    later = exchange(1, KILLED_AT)
    assert give(later, BACK_AT, copies, SENDER) == []
    assert later.late == 2
    assert [frame[0] for frame in leaving(later)] == [PayloadKind.FACT_LIFE], "a burst gets one answer"


def test_a_restarted_sender_reaches_a_receiver_that_has_been_restarted_often():
    receiver = exchange(200, KILLED_AT)
    sender = exchange(3)
    sender.send(BACK_AT, RECEIVER, FACT, b"x")
    assert talk(sender, receiver, BACK_AT) == [b"x"]
    sender.send(BACK_AT, RECEIVER, FACT, b"y")
    assert len(sender.outbox) == 1
    assert talk(sender, receiver, BACK_AT) == [b"y"]


def test_a_word_of_an_earlier_life_that_comes_late_costs_a_round_trip_only():
    sender = exchange()
    sender.send(BACK_AT, RECEIVER, FACT, b"x")
    early, newer = payloads.encode_life(1, KILLED_AT), payloads.encode_life(2, KILLED_AT + milliseconds(1))
    for word in (newer, early):
        give(sender, BACK_AT, [word], RECEIVER)
    assert talk(sender, exchange(2, KILLED_AT + milliseconds(1)), BACK_AT) == [b"x"]


def test_a_forged_life_is_contradicted_by_the_receiver():
    sender, receiver = exchange(), exchange()
    sender.send(0, RECEIVER, FACT, b"lost to the forger")
    leaving(sender)
    give(sender, BACK_AT, [payloads.encode_life(77, BACK_AT)], RECEIVER)
    for body in (b"x", b"y"):
        sender.send(BACK_AT, RECEIVER, FACT, body)
        assert talk(sender, receiver, BACK_AT) == [body]
    outcomes = [news.outcome for news in sender.news]
    assert outcomes == [Outcome.OUTLIVED, Outcome.DELIVERED, Outcome.DELIVERED]


def test_a_life_that_will_have_ended_is_malformed():
    sender = exchange()
    sender.send(0, RECEIVER, FACT, b"x")
    with pytest.raises(WireError, match="not ended yet"):
        sender.life_told(0, payloads.encode_life(1, CLOCKS_APART + 1), RECEIVER)
    with pytest.raises(WireError, match="life"):
        sender.life_told(0, payloads.encode_life(1, 0)[:-1], RECEIVER)
    assert not sender.idle, "nothing was given up"


def test_deliveries_to_a_first_life_have_the_octets_of_the_program_alone():
    assert payloads.address(0xBEEF, 0) == 0xBEEF
    (frame,) = payloads.encode_fact_frames(0xBEEF, 0, 7, b"x")
    again = payloads.addressed(frame, payloads.address(0xBEEF, 3))
    assert len(again) == len(frame)
    assert payloads.decode_fact_frame(again)._replace(address=0xBEEF) == payloads.decode_fact_frame(frame)


@pytest.mark.parametrize(("ended", "told"), [(None, 0), (milliseconds(700), milliseconds(700) + 1)])
def test_what_was_first_sent_in_the_instant_of_the_death_may_have_been_taken(ended, told):
    """Where frames take no time, as with `rmr eval --latency 0`, it was."""
    flock = Flock("start(@1).", epoch=1, predecessor_ended=ended)
    assert flock.node(1).messenger.exchange.predecessor_ended == told

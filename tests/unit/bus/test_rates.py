"""Rates per sender: what is in order passes, a flood is cut, others are not concerned, and it is told."""

import asyncio

import pytest
from bus_star import FRAME, on_a_star, until

from rmr.base.time import NS_PER_S
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr.bus.rates import NOBODY, RATES, SENDERS_MAX, Rates, claimed_sender, kind_of

LAB = Keys("x")


@pytest.mark.parametrize("sender", [-2, -1, 0, 1, 127, 128, 255, 256, 65533])
def test_the_sender_is_read_without_decoding_as_it_is_with(sender):
    data = wire.encode(sender, 1 << 40, 7, FRAME)
    assert claimed_sender(data) == wire.decode(data).sender == sender


@pytest.mark.parametrize(
    "data", [b"", b"\x93", b"\x93\x01", b"\xc0\x01\x01", b"\x93\x01\xcd\x01", b"\x93\x01\xcd\x00\x05"]
)
def test_what_no_robot_of_ours_writes_has_no_sender(data):
    assert claimed_sender(data) == NOBODY


@pytest.mark.parametrize(
    ("key", "kind"),
    [
        (LAB.radio(1, 2), "radio"),
        (LAB.radio(1, 2, "4"), "radio"),
        (LAB.call(4), "call"),
        (LAB.acts, "act"),
        (LAB.sense(4), "sense"),
        (LAB.statuses, "status"),
        (LAB.stop("world"), "stop"),
        (LAB.load(4), "load"),
        (LAB.answers("*"), "load"),
        (LAB.clock, "clock"),
        (LAB.map("*"), "map"),
        (LAB.disturbances, "disturbances"),
        (LAB.silence, "silence"),
        (LAB.truth, "truth"),
        ("rmr/x/new", "other"),
        ("rmr", "other"),
    ],
)
def test_each_key_has_its_kind(key, kind):
    assert kind_of(key) == kind


def test_a_sender_has_its_rate_whatever_others_do():
    rates = Rates()
    bound = rates.bounded(LAB.acts)
    rate = RATES["act"]
    for second in range(5):
        for step in range(1000):
            now = second * NS_PER_S + step * NS_PER_S // 1000
            bound.takes(1, now)
            if step % 16 == 0:
                assert bound.takes(2, now)
    taken = 5000 - rates.dropped[1]
    assert rate.at_once + 4 * rate.per_s <= taken <= rate.at_once + 5 * rate.per_s
    assert set(rates.dropped) == {1}


def test_what_a_stopped_receiver_finds_at_once_passes():
    bound = Rates().bounded(LAB.radio(0, 0, "*"))
    assert all(bound.takes(1, 0) for _ in range(RATES["radio"].at_once))
    assert not bound.takes(1, 0)


def test_senders_without_number_are_bounded_together():
    bound = Rates().bounded(LAB.map("*"))
    taken = sum(bound.takes(sender, 0) for sender in range(SENDERS_MAX) for _ in range(2))
    assert taken == 2 * SENDERS_MAX
    beyond = sum(bound.takes(sender, 0) for sender in range(SENDERS_MAX, SENDERS_MAX + 1000))
    assert beyond == RATES["map"].at_once
    assert len(bound._buckets) == SENDERS_MAX + 1


def test_the_samples_of_all_bodies_pass_that_the_world_sends_to_one_process():
    rates = Rates()
    samples = wire.encode(wire.WORLD_ID, 0, 1, FRAME)
    bounds = {LAB.sense(robot): rates.bounded(LAB.sense(robot)) for robot in range(50)}
    for _ in range(RATES["sense"].at_once):
        assert all(bound.admits(key, samples) for key, bound in bounds.items())
    assert not rates.dropped


def test_with_keys_the_sender_is_whom_the_key_names_and_not_whom_the_message_claims():
    rates = Rates()
    bound = rates.bounded(LAB.radio(0, 0, "*"))
    for claimed in range(RATES["radio"].at_once + 50):
        bound.admits(LAB.radio(0, 0, "3"), wire.encode(claimed % 9, 0, 1, FRAME))
    assert set(rates.dropped) == {3}


@pytest.mark.parametrize("key", ["rmr/x/body/٣/act", "rmr/x/body/999999/act", "rmr/x/body/y/act"])
def test_a_key_that_names_no_robot_is_nobodys(key):
    rates = Rates()
    bound = rates.bounded(LAB.acts)
    for _ in range(RATES["act"].at_once + 1):
        bound.admits(key, b"")
    assert set(rates.dropped) == {NOBODY}


@pytest.mark.real
def test_a_flood_is_dropped_before_the_inbox_and_counted_and_others_get_through(caplog):
    async def scene(_router, one, two):
        heard = []
        two.subscribe("rmr/x/body/*/act", lambda _, message: heard.append(message.sender))
        await until(lambda: one.publish("rmr/x/body/1/act", wire.Act(0.0, 0.0, 0)) or heard)
        for _ in range(20):
            for _ in range(200):
                one.publish("rmr/x/body/1/act", wire.Act(0.0, 0.0, 0))
            await asyncio.sleep(0.01)  # what the connection could not take is no flood any more
        await until(lambda: two.excess)
        before = len(heard)
        assert before < 4000
        _router.publish("rmr/x/body/world/act", wire.Act(0.0, 0.0, 0))
        await until(lambda: wire.WORLD_ID in heard)
        [[sender, dropped]] = two.excess
        assert sender == 1
        assert dropped > 500
        assert two.seat(7).excess == []

    on_a_star(scene)
    assert "robot 1 sends more than 240 act messages a second: what is beyond is dropped" in caplog.text


@pytest.mark.real
def test_questions_beyond_the_rate_are_not_answered():
    async def scene(router, one):
        asked = []
        router.serve("rmr/x/map/*", lambda message, _: asked.append(message.sender))
        await until(lambda: asyncio.ensure_future(one.ask("rmr/x/map/1", wire.AskMap(1, 1), 0.1)) and asked)
        await asyncio.gather(*(one.ask("rmr/x/map/1", wire.AskMap(1, 1), 0.2) for _ in range(100)))
        assert RATES["map"].at_once <= len(asked) < 60
        assert router.excess[0][0] == 1

    on_a_star(scene, clients=1)

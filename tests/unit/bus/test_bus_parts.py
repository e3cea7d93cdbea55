"""Messages larger than one message may be: cut into parts, put together, and given up where a part is missing."""

import asyncio

import pytest
from bus_star import on_a_star, until

from rmr.bus import wire
from rmr.bus.message_parts import HELD_OCTETS_MAX, TooLargeError, Unfinished, cut

SIZE = wire.PART_OCTETS_MAX


def status(octets):
    facts = tuple("x" * 1000 for _ in range(octets // 1000))
    return wire.Status("running", "", False, False, 0, {"facts": facts})


def envelopes(body, sender=4, run=1, serial=1):
    data = wire.encode(sender, run, 9, body)
    return [wire.Envelope(sender, run, n, part) for n, part in enumerate(cut(data, serial))]


def test_a_message_in_parts_is_put_together_with_its_last_one():
    body, unfinished = status(3 * SIZE), Unfinished()
    *first, last = envelopes(body)
    assert [unfinished.add("k", part) for part in first] == [None] * len(first)
    whole = unfinished.add("k", last)
    assert whole == wire.Envelope(4, 1, 9, body)


@pytest.mark.parametrize("missing", [0, 1, 3])
def test_a_message_with_a_missing_part_is_given_up_and_the_next_one_is_whole(missing):
    unfinished, parts = Unfinished(), envelopes(status(4 * SIZE))
    assert [unfinished.add("k", part) for n, part in enumerate(parts) if n != missing] == [None] * (len(parts) - 1)
    assert unfinished.add("k", envelopes(status(2 * SIZE), serial=2)[-1]) is None
    assert [unfinished.add("k", part) for part in envelopes(status(2 * SIZE), serial=3)][-1] is not None


def test_streams_and_sessions_do_not_mix():
    unfinished = Unfinished()
    one, other = envelopes(status(2 * SIZE), sender=4), envelopes(status(2 * SIZE), sender=5)
    restarted = envelopes(status(2 * SIZE), sender=4, run=2)
    assert unfinished.add("k", one[0]) is unfinished.add("k", other[0]) is unfinished.add("l", one[1]) is None
    assert unfinished.add("k", restarted[1]) is None
    assert unfinished.add("k", other[1]) is None
    assert unfinished.add("k", other[2]).sender == 5


def test_what_unfinished_messages_hold_is_bounded_and_the_oldest_goes_first():
    unfinished = Unfinished()
    streams = HELD_OCTETS_MAX // SIZE + 10
    for sender in range(streams):
        unfinished.add("k", wire.Envelope(sender, 1, 0, wire.Part(1, 0, 2, bytes(SIZE))))
    assert len(unfinished._held) == HELD_OCTETS_MAX // SIZE
    assert ("k", 0) not in unfinished._held


def test_parts_that_hold_another_senders_message_or_parts_are_malformed():
    [inner] = envelopes(status(1000), sender=5)
    with pytest.raises(wire.MalformedError):
        Unfinished().add("k", inner._replace(sender=4))
    nested = wire.encode(4, 1, 1, wire.Part(1, 0, 1, b"x"))
    with pytest.raises(wire.MalformedError):
        Unfinished().add("k", wire.Envelope(4, 1, 1, wire.Part(1, 0, 1, nested)))


def test_what_does_not_fit_even_in_parts_is_refused_with_its_size():
    with pytest.raises(TooLargeError, match=f"{wire.WHOLE_OCTETS_MAX + 1} octets"):
        list(cut(bytes(wire.WHOLE_OCTETS_MAX + 1), 1))


def test_a_large_status_arrives_whole_where_it_is_wanted_and_not_elsewhere():
    async def scene(router, robot, operator):
        whole, small = [], []
        operator.subscribe("rmr/x/ops/*/status", lambda _key, message: whole.append(message.body), whole=True)
        router.subscribe("rmr/x/ops/*/status", lambda _key, message: small.append(message.body))
        ready = wire.Status("ready", "", False, False, 0, {})
        while not (whole and small):  # a subscription takes a moment to reach another client
            await robot.publish_whole("rmr/x/ops/1/status", ready)
            await asyncio.sleep(0.01)
        body = status(20 * SIZE)
        while not any(each.report for each in whole):  # a busy bus may drop a part; robots tell it again, too
            await robot.publish_whole("rmr/x/ops/1/status", body)
            await asyncio.sleep(0.1)
        await robot.publish_whole("rmr/x/ops/1/status", ready._replace(state="stopped"))
        await until(lambda: whole[-1].state == small[-1].state == "stopped")
        assert all(each == body for each in whole if each.report)
        assert [each for each in small if each.report] == []

    on_a_star(scene)

"""Messages: what is sent arrives as it was; anything else is dropped, whatever the octets."""

import contextlib
import math
from dataclasses import asdict

import msgpack
import pytest
from bus_star import FRAME
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.base import arena
from rmr.base.arena import Area, Arena, Disc, FloorPassage, Polygon
from rmr.base.geometry import Point
from rmr.base.time import NEVER, NS_PER_S
from rmr.base.values import ROBOT_ID_MAX, Robot, Symbol
from rmr.bus import checks, wire
from rmr.bus.checks import PLAIN_DEPTH_MAX, QUANTITY_MAX
from rmr.bus.losses import SENT_AT_ONCE, SENT_PER_S, STREAMS_MAX, Losses
from rmr.bus.wire import Envelope, MalformedError, decode, encode
from rmr.radio.air import Announcement
from rmr.radio.links import DISTURBANCES_MAX, Disturbance
from rmr.radio.phy import Bursts, RadioConfig, airtime

pytestmark = pytest.mark.medium

numbers = st.floats(allow_nan=False, allow_infinity=False)
quantities = st.floats(-QUANTITY_MAX, QUANTITY_MAX)
lengths = st.floats(0.0, QUANTITY_MAX)
instants = st.integers(-NEVER, NEVER)
counts = st.integers(0, 1 << 40)
lists = {"max_size": 3}
robots = st.integers(0, ROBOT_ID_MAX)
texts = st.text(max_size=20)
lines = st.text("abc äß(1).", max_size=20)
names = st.from_regex(r"[a-z][A-Za-z0-9_]{0,9}", fullmatch=True)
labs = st.from_regex(r"[a-z][a-z0-9_-]{0,9}", fullmatch=True)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(1 << 63), (1 << 63) - 1) | numbers | texts,
    lambda inner: st.lists(inner, max_size=3).map(tuple) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=10,
)
values = st.recursive(
    st.booleans()
    | st.integers(-(1 << 63), (1 << 63) - 1)
    | numbers
    | texts
    | st.from_regex(r"[a-z][a-z0-9_]{0,5}", fullmatch=True).map(Symbol)
    | robots.map(Robot),
    lambda inner: st.lists(inner, max_size=3).map(tuple),
    max_leaves=6,
)
disturbances = st.builds(
    lambda since, length, groups, one_way, loss, attenuation_db: Disturbance(
        since, since + length, groups, one_way, loss, attenuation_db
    ),
    counts,
    st.integers(1, 1 << 40),
    st.sampled_from([(), ((1,), (2,)), ((1, 2), (3, 7), (9,))]),
    st.booleans(),
    st.floats(0.0, 1.0),
    st.floats(0.0, allow_nan=False),
)

places = st.floats(-9e5, 9e5)
poses = st.tuples(places, places, quantities)
points = st.tuples(st.floats(0.0, 9.0), st.floats(0.0, 9.0)).map(lambda xy: Point(*xy))
areas = st.builds(
    lambda name, places, slotted, queue: Area(name, tuple(places), None, slotted, tuple(queue)),
    names,
    st.lists(points, min_size=1, max_size=3),
    st.booleans(),
    st.lists(points, **lists),
)
discs = st.builds(Disc, points, st.floats(0.0, 1.0))
polygons = st.lists(points, min_size=3, max_size=4).map(lambda corners: Polygon(tuple(corners)))


def arrived(value):
    """Return plain data as they arrive: lists as tuples."""
    if isinstance(value, dict):
        return {key: arrived(item) for key, item in value.items()}
    return tuple(map(arrived, value)) if isinstance(value, list | tuple) else value


def passages_between(entrances):
    """Return a passage with these entrances, or none."""
    return (FloorPassage("door", tuple(entrances)),) if entrances else ()


floors = st.builds(
    lambda obstacles, areas, beacons: arrived(
        arena.to_data(
            Arena(9.0, 9.0, 0.05, tuple(obstacles), tuple(areas), tuple(beacons), passages_between(areas[:2]))
        )
    ),
    st.lists(discs | polygons, **lists),
    st.lists(areas, **lists),
    st.lists(points, **lists),
)
radios = st.builds(
    lambda loss, pan, bursts: asdict(RadioConfig(loss=loss, bursts=bursts)) | {"pan": pan, "seed": 1},
    st.floats(0.0, 1.0),
    st.integers(0, 0x7FFF),
    st.none() | st.just(Bursts(NS_PER_S, NS_PER_S)),
)
jobs = st.builds(
    lambda job, start, finish, met: {
        "name": "crossing",
        "job": job,
        "start_s": start,
        "finish_s": finish,
        "deadline_s": 9.0,
        "met": met,
        "cause": None,
    },
    texts,
    numbers,
    st.none() | numbers,
    st.none() | st.booleans(),
)
reports = st.fixed_dictionaries(
    {},
    optional={
        "finish_s": st.none() | numbers,
        "assertions": st.lists(jobs, **lists).map(tuple),
        "facts": st.lists(texts, **lists).map(tuple),
        "goals": st.just({"achieved": (("x", 1.0),), "open": ()}),
        "frames": st.dictionaries(texts, counts, max_size=3),
        "schedules": st.just(({"event": "e", "leader": 1, "term": 1, "order": (1, 2), "formed_s": 0.5},)),
        "anything": plain,
    },
)
announcements = st.builds(
    lambda source, sequence, attempt, start, power_dbm, x, y, psdu: Announcement(
        source, sequence, attempt, start, start + airtime(len(psdu)), power_dbm, x, y, psdu
    ),
    robots,
    st.integers(0, 0xFFFF_FFFF),
    st.integers(0, 0xFF),
    counts,
    st.floats(-99.0, 99.0),
    places,
    places,
    st.binary(min_size=5, max_size=127),
)

MESSAGES = {
    wire.Air: st.builds(wire.Air, announcements),
    wire.Handshake: st.builds(wire.Handshake, announcements),
    wire.Sense: st.builds(
        wire.Sense,
        instants,
        quantities,
        quantities,
        quantities,
        st.none() | quantities,
        st.lists(st.tuples(counts, lengths), **lists).map(tuple),
        st.lists(st.tuples(quantities, quantities, quantities, quantities), **lists).map(tuple),
        st.booleans(),
        poses,
        st.none() | st.tuples(places, places, quantities, lengths, lengths),
        st.none() | st.lists(st.tuples(names, st.lists(values, **lists).map(tuple)), **lists).map(tuple),
    ),
    wire.Act: st.builds(wire.Act, quantities, quantities, instants),
    wire.Perform: st.builds(wire.Perform, counts, st.none() | names, st.lists(values, **lists).map(tuple), instants),
    wire.Performed: st.builds(wire.Performed, counts, lines),
    wire.AskClock: st.just(wire.AskClock()),
    wire.Clock: st.builds(wire.Clock, st.sampled_from(wire.CLOCK_STATES), instants, instants),
    wire.AskMap: st.builds(wire.AskMap, robots, counts),
    wire.Map: st.builds(
        wire.Map,
        labs,
        st.booleans(),
        st.booleans(),
        st.integers(0, checks.LIVES_MAX),
        instants,
        st.lists(robots, min_size=1, max_size=3, unique=True).map(tuple),
        floors,
        radios,
        st.lists(st.tuples(names, st.none() | robots, st.lists(values, **lists).map(tuple)), **lists).map(tuple),
        st.none() | st.tuples(names, st.lists(st.none() | values, **lists).map(tuple)),
        st.sampled_from(wire.CLOCK_STATES),
        st.lists(disturbances, **lists).map(tuple),
        st.none() | instants,
        st.lists(names, **lists).map(tuple),
        st.booleans(),
    ),
    wire.Truth: st.builds(
        wire.Truth,
        instants,
        st.lists(st.tuples(robots, places, places, quantities, lengths), **lists).map(tuple),
        counts,
        st.none() | lengths,
        counts,
        st.booleans(),
    ),
    wire.Status: st.builds(
        wire.Status, st.sampled_from(wire.STATES), lines, st.booleans(), st.booleans(), instants, reports
    ),
    wire.Stop: st.builds(wire.Stop, lines),
    wire.Silence: st.builds(wire.Silence, robots, instants),
    wire.HostOrder: st.builds(wire.HostOrder, st.binary(max_size=9)),
    wire.HostAnswer: st.builds(wire.HostAnswer, labs, st.binary(max_size=9)),
    wire.Launcher: st.builds(
        wire.Launcher,
        labs,
        st.sampled_from(wire.LAUNCHER_STATES),
        st.lists(st.tuples(labs, st.lists(robots, max_size=3).map(tuple)), max_size=3).map(tuple),
        st.lists(st.tuples(lines, lines), max_size=3).map(tuple),
        st.lists(st.tuples(robots, st.sampled_from(wire.ENDS)), max_size=3).map(tuple),
        lines,
        st.booleans(),
        lines,
        st.binary(max_size=9),
    ),
    wire.AskDisturbances: st.builds(wire.AskDisturbances, st.sampled_from(wire.WISHES), st.none() | disturbances),
    wire.Disturbances: st.builds(
        wire.Disturbances, labs, instants, st.lists(disturbances, **lists).map(tuple), counts, lines
    ),
    wire.Load: st.builds(wire.Load, st.binary(max_size=50)),
    wire.LoadOrder: st.builds(
        wire.LoadOrder, st.binary(max_size=50), st.lists(robots, max_size=3).map(tuple), st.booleans(), st.booleans()
    ),
    wire.LoadOutcome: st.builds(wire.LoadOutcome, st.binary(max_size=50), st.sampled_from(["", "it is busy"])),
    wire.Part: st.builds(wire.Part, counts, counts, counts, st.binary(max_size=50)),
}


def typed(value):
    """Return `value` with its types spelled out: 1, 1.0, true, @1 and a symbol are different things."""
    if isinstance(value, tuple):
        return (type(value), [typed(item) for item in value])
    if isinstance(value, dict):
        return {key: typed(item) for key, item in value.items()}
    return type(value), value


@pytest.mark.parametrize("row", wire.TABLE, ids=lambda row: row.kind.__name__)
def test_every_message_arrives_as_it_was_sent(row):
    @settings(max_examples=60, deadline=None)
    @given(MESSAGES[row.kind], st.integers(-2, ROBOT_ID_MAX), counts, counts)
    def holds(body, sender, run, number):
        arrived = decode(encode(sender, run, number, body))
        assert arrived == Envelope(sender, run, number, body)
        assert typed(arrived.body) == typed(body)

    holds()


def test_the_table_lists_every_message_once_with_a_check_for_each_field():
    assert set(MESSAGES) == {row.kind for row in wire.TABLE}
    assert len({row.code for row in wire.TABLE}) == len(wire.TABLE)
    assert all(len(row.checks) == len(row.kind._fields) for row in wire.TABLE)


@pytest.mark.parametrize(
    "fields",
    [
        [0, 5, [], False, 0.5],
        [5, 5, [], False, 0.5, 0.0],
        [0, 5, [], False, 1.5, 0.0],
        [0, 5, [], False, math.nan, 0.0],
        [0, 5, [], False, 0.5, math.nan],
        [0, 5, [], False, 0.5, -1.0],
        [0, 5, [], 0, 0.5, 0.0],
        [0, 5.0, [], False, 0.5, 0.0],
        [0, 5, [[1]], False, 0.5, 0.0],
        [0, 5, [[1], [1]], False, 0.5, 0.0],
        [0, 5, [[1], [-1]], False, 0.5, 0.0],
        [0, 5, [[1], [True]], False, 0.5, 0.0],
        [0, 5, [1, 2], False, 0.5, 0.0],
        [0, 5, None, False, 0.5, 0.0],
        "loss",
    ],
    ids=str,
)
def test_invalid_disturbance_is_malformed(fields):
    with pytest.raises(MalformedError):
        decode(msgpack.packb([11, -2, 1, 1, "add", fields]))


def test_more_disturbances_than_a_lab_may_have_are_malformed():
    held = (Disturbance(loss=0.1),) * DISTURBANCES_MAX
    assert decode(encode(-1, 1, 1, wire.Disturbances("x", 0, held, 0, ""))).body.held == held
    with pytest.raises(MalformedError):
        decode(encode(-1, 1, 1, wire.Disturbances("x", 0, (*held, held[0]), 0, "")))


def decodes_or_is_malformed(data):
    try:
        message = decode(data)
    except MalformedError:
        return
    assert decode(encode(*message[:3], message.body)) == message


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=80))
def test_decoding_arbitrary_octets_raises_only_malformed(data):
    decodes_or_is_malformed(data)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(list(MESSAGES)).flatmap(MESSAGES.get), st.data())
def test_a_damaged_message_is_malformed_or_another_valid_one(body, data):
    octets = bytearray(encode(4, 1, 1, body))
    at = data.draw(st.integers(0, len(octets) - 1))
    octets[at] ^= data.draw(st.integers(1, 255))
    decodes_or_is_malformed(bytes(octets))


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(list(MESSAGES)).flatmap(MESSAGES.get), st.data())
def test_a_truncated_message_is_malformed(body, data):
    octets = encode(4, 1, 1, body)
    with pytest.raises(MalformedError):
        decode(octets[: data.draw(st.integers(0, len(octets) - 1))])


@settings(max_examples=200, deadline=None)
@given(st.sampled_from([row.code for row in wire.TABLE]), st.lists(plain, max_size=9))
def test_fields_of_wrong_types_are_malformed_or_fit(code, fields):
    decodes_or_is_malformed(msgpack.packb([code, 4, 1, 1, *fields]))


@pytest.mark.parametrize(
    ("items", "reason"),
    [
        ([99, 4, 1, 1], "unknown type"),
        ([True, 4, 1, 1, ""], "unknown type"),
        ([10, 4, 1, 1], "1 fields"),
        ([10, 4, 1, 1, "", ""], "1 fields"),
        ([10, "4", 1, 1, ""], "a sender"),
        ([10, 4, 1, -1, ""], "a count"),
        ([10, 4, 1, 1, b"x"], "text"),
        ([3, 4, 1, 1, math.nan, 0.0, 0], "finite"),
        ([3, 4, 1, 1, math.inf, 0.0, 0], "finite"),
        ([3, 4, 1, 1, True, 0.0, 0], "finite"),
        ([3, 4, 1, 1, 0.0, 0.0, 1.0], "an instant"),
        ([6, 4, 1, 1, ROBOT_ID_MAX + 1, 0], "robot's id"),
        ([5, 4, 1, 1, "later", 0, 0], "one of waiting, running, stopped"),
        ([9, 4, 1, 1, "ready", "", False, False, 0, {1: 2}], "not msgpack"),
        ({}, "an array"),
        ([10, 4], "an array"),
    ],
)
def test_a_malformed_message_says_what_is_wrong(items, reason):
    with pytest.raises(MalformedError, match=reason):
        decode(msgpack.packb(items))


def test_a_message_beyond_the_bound_is_not_even_read():
    with pytest.raises(MalformedError, match="too long"):
        decode(bytes(wire.MESSAGE_OCTETS_MAX + 1))


def test_whole_numbers_are_accepted_where_fractions_may_stand():
    body = decode(msgpack.packb([3, 4, 1, 1, 0, -1, 5])).body
    assert body == wire.Act(0.0, -1.0, 5)
    assert isinstance(body.v, float)


@pytest.mark.parametrize("depth", [PLAIN_DEPTH_MAX + 2, 400, 900])
@pytest.mark.parametrize("open_", [b"\x91", b"\x81\xa1a"], ids=["lists", "records"])
def test_deeply_nested_plain_data_are_malformed(depth, open_):
    # A `Status` whose report has one entry, of which the rest is the value.
    start = b"\x9a\x09\x01\x01\x01" + b"\xa5ready\xa0\xc2\xc2\x00" + b"\x81\xa1a"
    assert decode(start + open_ * PLAIN_DEPTH_MAX + b"\xc0").body.report
    with pytest.raises(MalformedError):
        decode(start + open_ * depth + b"\xc0")


def test_messages_marked_patient_are_those_that_need_no_prompt_reply():
    bodies = {wire.Air: FRAME, wire.Handshake: wire.Handshake(FRAME.announcement), wire.Act: wire.Act(0.0, 0.0, 0)}
    bodies |= {wire.Sense: wire.Sense(0, *[0.0] * 4, (), (), False, (0.0,) * 3), wire.AskClock: wire.AskClock()}
    waits = {kind for kind, body in bodies.items() if wire.is_patient(encode(1, 1, 1, body))}
    assert waits == {wire.Air, wire.Act, wire.Sense} == {row.kind for row in wire.TABLE if row.patient}
    assert not wire.is_patient(b"")


def test_deeply_nested_values_are_malformed():
    value = "x"
    for _ in range(100):
        value = ["l", value]
    with pytest.raises(MalformedError):
        checks.value(value)


# --- what the middleware lost -------------------------------------------------------------------------------


def after(*numbers_of_one_sender, run=1):
    losses = Losses()
    for number in numbers_of_one_sender:
        losses.note("k", Envelope(4, run, number, wire.AskClock()), 0)
    return losses


def test_a_gap_in_the_numbers_is_counted_as_lost():
    assert after(1, 2, 3).lost == 0
    assert after(1, 2, 5, 6, 9).lost == 4


def test_messages_before_the_first_received_one_are_not_counted_lost():
    assert after(17, 18).lost == 0


def test_repeated_and_overtaken_messages_are_counted_apart():
    losses = after(1, 2, 2, 1, 3)
    assert (losses.lost, losses.repeated) == (0, 2)


def test_a_sender_that_restarts_begins_a_new_count():
    losses = after(1, 2, 3)
    losses.note("k", Envelope(4, 2, 1, wire.AskClock()), 0)
    losses.note("k", Envelope(4, 2, 3, wire.AskClock()), 0)
    assert (losses.lost, losses.repeated) == (1, 0)


def numbered(number, run=1):
    return Envelope(4, run, number, wire.AskClock())


@pytest.mark.parametrize("forged", [4 + SENT_AT_ONCE + SENT_PER_S, 1 << 40, checks.COUNT_MAX])
def test_a_number_that_cannot_have_been_reached_is_refused_and_the_true_ones_go_on(forged):
    losses = after(1)
    losses.note("k", numbered(2), NS_PER_S)
    with pytest.raises(MalformedError, match="cannot have reached"):
        losses.note("k", numbered(forged), NS_PER_S)
    losses.note("k", numbered(5), NS_PER_S)
    assert (losses.lost, losses.repeated) == (2, 0)


def test_what_can_have_been_sent_meanwhile_is_counted_lost():
    losses = after(1)
    losses.note("k", numbered(2 + SENT_PER_S), NS_PER_S)
    assert losses.lost == SENT_PER_S


def test_forged_numbers_of_changing_runs_count_no_more_than_can_have_been_sent():
    losses = Losses()
    for run in range(1000):
        with contextlib.suppress(MalformedError):
            losses.note("k", numbered(0, run), NS_PER_S)
            losses.note("k", numbered(SENT_AT_ONCE, run), NS_PER_S)
    assert losses.lost <= SENT_AT_ONCE


def test_a_sender_that_goes_on_from_a_number_beyond_belief_is_followed_and_nothing_counted():
    losses = after(1, 2)
    with pytest.raises(MalformedError):
        losses.note("k", numbered(1 << 20), 0)
    losses.note("k", numbered((1 << 20) + 1), 0)
    losses.note("k", numbered((1 << 20) + 3), 0)
    assert losses.lost == 1


def test_senders_and_keys_are_counted_apart():
    losses = Losses()
    for key, sender in (("a", 1), ("a", 2), ("b", 1)):
        for number in (5, 7):
            losses.note(key, Envelope(sender, 1, number, wire.AskClock()), 0)
    assert losses.lost == 3


def test_messages_sent_while_unsubscribed_are_not_counted_lost_on_that_key_only():
    losses = Losses()
    for number in (1, 5):
        for key in ("radio/0/0", "radio/0/1"):
            losses.note(key, Envelope(4, 1, number, wire.AskClock()), 0)
        losses.forget(lambda key: key == "radio/0/0")
    assert losses.lost == 3


def test_the_streams_that_are_kept_apart_are_bounded():
    losses = Losses()
    for sender in range(STREAMS_MAX + 10):
        losses.note("k", Envelope(sender, 1, 1, wire.AskClock()), 0)
    losses.note("k", Envelope(STREAMS_MAX + 5, 1, 9, wire.AskClock()), 0)
    losses.note("k", Envelope(0, 1, 3, wire.AskClock()), 0)
    assert losses.lost == 1

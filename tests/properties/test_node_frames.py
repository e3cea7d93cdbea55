"""Deliveries: every one reads back as it was written, damage is an error or another delivery, sizes are bounded."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol, Value
from rmr.node import payloads
from rmr.node.payloads import NUMBERED, Delivery, DeliveryRole, WireError

NAMES = ("entry", "exit")
NUMBERS = {name: number for number, name in enumerate(NAMES)}

scalars = st.one_of(
    st.booleans(),
    st.integers(INT_MIN, INT_MAX),
    st.floats(allow_nan=False),
    st.text(max_size=20),
    st.sampled_from([Symbol("exit"), Symbol("elsewhere")]),
    st.integers(0, 65533).map(Robot),
)
values: st.SearchStrategy[Value] = st.recursive(scalars, lambda v: st.lists(v, max_size=4).map(tuple), max_leaves=8)


@st.composite
def deliveries(draw: st.DrawFn) -> Delivery:
    role = draw(st.sampled_from(DeliveryRole))
    number = draw(st.integers(0, 2**64 - 1)) if role in NUMBERED else 0
    return Delivery(role, draw(st.integers(0, 0xFFFF)), tuple(draw(st.lists(values, max_size=6))), number)


def written(delivery: Delivery) -> bytes:
    return payloads.encode_delivery(delivery, NUMBERS)


def read(octets: bytes) -> Delivery | None:
    """Return the delivery in `octets`, None if they hold none; any other exception is a failure."""
    try:
        return payloads.decode_delivery(octets, NAMES)
    except WireError:
        return None


@given(deliveries())
def test_a_delivery_reads_back_as_it_was_written_with_its_types(delivery):
    back = read(written(delivery))
    assert back == delivery
    assert [type(arg) for arg in back.args] == [type(arg) for arg in delivery.args]


@given(deliveries(), st.integers(1, 40))
def test_a_delivery_cut_short_or_with_something_behind_it_is_refused(delivery, octets):
    whole = written(delivery)
    assert read(whole[: max(0, len(whole) - octets)]) is None
    assert read(whole + bytes(octets)) is None


@pytest.mark.medium
@given(deliveries(), st.data())
def test_a_damaged_delivery_is_refused_or_is_another_one_that_can_be_written(delivery, data):
    octets = bytearray(written(delivery))
    octets[data.draw(st.integers(0, len(octets) - 1))] ^= data.draw(st.integers(1, 255))
    back = read(bytes(octets))
    assert back is None or len(written(back)) <= len(octets) * 9, "no value grows beyond what its octets can say"


@given(st.binary(max_size=130))
def test_random_octets_are_refused_and_never_raise_anything_else(octets):
    read(octets)


@given(st.sampled_from(DeliveryRole), st.integers(1, 15))
def test_reserved_bits_are_no_delivery(role, low):
    octets = bytearray(written(Delivery(role, 1, ())))
    octets[0] |= low
    assert read(bytes(octets)) is None


@given(st.integers(len(DeliveryRole), 15))
def test_unknown_role_is_no_delivery(role):
    assert read(struct.pack(">BHBQ", role << 4, 0, 0, 0)) is None


@given(
    st.integers(0, 0xFFFF),
    st.integers(0, 0xFF),
    st.integers(0, 0xFFFF),
    st.binary(max_size=700),
    st.sampled_from((116, 107, 103, 95)),
)
def test_the_frames_of_a_delivery_fit_the_radio_and_hold_its_whole_body(to, epoch, sequence, body, room):
    frames_out = payloads.encode_fact_frames(to, epoch, sequence, body, room)
    assert all(len(payload) <= room for payload in frames_out)
    assert len(frames_out) == 1 or len(frames_out[0]) == room
    frames = [payloads.decode_fact_frame(payload) for payload in frames_out]
    assert {(f.address, f.epoch, f.sequence, f.parts) for f in frames} == {(to, epoch, sequence, len(frames))}
    assert b"".join(f.piece for f in frames) == body


def test_text_that_is_no_unicode_cannot_be_encoded():
    with pytest.raises(WireError, match="no Unicode"):
        written(Delivery(DeliveryRole.FACT, 0, ("\ud800",)))

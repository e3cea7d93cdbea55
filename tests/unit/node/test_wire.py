"""Frames between robots round-trip, and octets that nobody sent are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmr.base.values import Value
from rmr.node import payloads
from rmr.node.payloads import Delivery, DeliveryRole, Hello, WireError
from rmr.radio.frame import FCS_OCTETS, HEADER_OCTETS
from rmr.radio.phy import airtime

SYMBOLS = ("entry", "exit")
INDEX = {name: i for i, name in enumerate(SYMBOLS)}


@given(st.binary(max_size=130))
def test_random_octets_are_refused_and_never_raise_anything_else(octets):
    for decode in (payloads.decode_hello, payloads.decode_ack, payloads.decode_failure, payloads.decode_life):
        try:
            decode(octets)
        except WireError:
            continue
    if octets:
        try:
            frame = payloads.decode_fact_frame(octets)
        except WireError:
            return
        assert 0 <= frame.part < frame.parts


def test_lists_nested_too_deep_are_refused():
    value: Value = ()
    for _ in range(payloads.LIST_DEPTH_MAX + 2):
        value = (value,)
    with pytest.raises(WireError, match="deep"):
        payloads.encode_delivery(Delivery(DeliveryRole.FACT, 0, (value,)), INDEX)
    body = b"\0\0\0\1" + b"\x09\0\1" * (payloads.LIST_DEPTH_MAX + 2) + b"\0"
    with pytest.raises(WireError, match="deep"):
        payloads.decode_delivery(body, SYMBOLS)


def test_a_text_longer_than_its_length_can_tell_is_refused_by_the_sender():
    payloads.encode_delivery(Delivery(DeliveryRole.FACT, 0, ("x" * payloads.LENGTH_MAX,)), INDEX)
    with pytest.raises(WireError, match="too long"):
        payloads.encode_delivery(Delivery(DeliveryRole.FACT, 0, ("x" * (payloads.LENGTH_MAX + 1),)), INDEX)


@pytest.mark.parametrize(("assertion", "told"), [(None, None), (0, 0), (254, 254), (255, None), (1000, None)])
def test_a_failure_names_its_assertion_or_none(assertion, told):
    assert payloads.decode_failure(payloads.encode_failure(7, assertion)) == (7, told)


@given(
    st.floats(-300, 300),
    st.floats(-300, 300),
    st.floats(0, 6.28),
    st.booleans(),
    st.integers(0, 255),
    st.booleans(),
    st.binary(max_size=payloads.HELLO_LIST_OCTETS_MAX),
)
def test_a_hello_keeps_position_to_the_centimetre(x, y, theta, parked, rank, going, listed):
    stays = parked and not going
    hello = Hello(x, y, theta, -0.2, parked, rank, (y, x) if going else None, rank * 257, stays, listed)
    back = payloads.decode_hello(payloads.encode_hello(hello))
    assert back.x == pytest.approx(x, abs=0.0051)
    assert back.y == pytest.approx(y, abs=0.0051)
    assert back.v == -0.2
    assert (back.parked, back.rank, back.digest, back.stays, back.listed) == (parked, rank, rank * 257, stays, listed)
    assert (back.goal is None) is not going


def test_a_hello_whose_list_is_too_long_is_no_hello():
    hello = payloads.encode_hello(Hello(0.0, 0.0, 0.0, 0.0, True, 0, None))
    with pytest.raises(WireError, match="a list of 7 octets"):
        payloads.decode_hello(hello + bytes(7))


def test_the_list_adds_no_more_than_a_fifth_to_the_airtime_of_a_hello():
    hello = Hello(0.0, 0.0, 0.0, 0.0, True, 0, None)
    mac = HEADER_OCTETS + FCS_OCTETS
    bare = airtime(mac + len(payloads.encode_hello(hello)))
    longest = hello._replace(listed=bytes(payloads.HELLO_LIST_OCTETS_MAX))
    assert airtime(mac + len(payloads.encode_hello(longest))) <= 1.2 * bare


def test_every_payload_fits_one_frame():
    frames = payloads.encode_fact_frames(0xABCD, 1, 7, bytes(1000))
    assert len(frames) > 1
    assert all(len(frame) <= payloads.PAYLOAD_OCTETS_MAX for frame in frames)
    assert len(payloads.encode_fact_frames(0xABCD, 1, 7, bytes(payloads.FACT_BODY_OCTETS_MAX))) == 1


def test_a_fact_too_large_to_travel_says_how_large_it_may_be():
    with pytest.raises(WireError, match=r"at most \d+ octets"):
        payloads.encode_fact_frames(0, 0, 0, bytes(payloads.PARTS_MAX * 108 + 1))

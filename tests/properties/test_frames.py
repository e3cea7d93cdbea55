"""Frames of IEEE 802.15.4: what is encoded comes back, and what is damaged is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rmr.radio.frame import (
    PAYLOAD_MAX,
    PSDU_MAX,
    AckFrame,
    DataFrame,
    FrameError,
    check_sequence,
    decode,
    encode_ack,
    encode_data,
)
from rmr.radio.security import Level, Security, SecurityError

addresses = st.integers(0, 0xFFFE)
data_frames = st.builds(
    DataFrame,
    pan=st.integers(0, 0xFFFF),
    destination=addresses,
    source=addresses,
    sequence=st.integers(0, 255),
    wants_ack=st.booleans(),
    payload=st.binary(max_size=PAYLOAD_MAX),
    secured=st.booleans(),
)


@given(data_frames)
def test_a_data_frame_comes_back_as_it_was_encoded(frame: DataFrame) -> None:
    psdu = encode_data(frame)
    assert len(psdu) == 11 + len(frame.payload) <= PSDU_MAX
    assert decode(psdu) == frame


@given(st.integers(0, 255))
def test_an_acknowledgement_comes_back_as_it_was_encoded(sequence: int) -> None:
    assert decode(encode_ack(sequence)) == AckFrame(sequence)


@given(data_frames, st.data())
def test_a_frame_with_one_or_two_bits_flipped_is_refused(frame: DataFrame, data: st.DataObject) -> None:
    psdu = encode_data(frame)
    flips = data.draw(st.sets(st.integers(0, 8 * len(psdu) - 1), min_size=1, max_size=2))
    word = int.from_bytes(psdu, "little")
    for bit in sorted(flips):
        word ^= 1 << bit
    with pytest.raises(FrameError):
        decode(word.to_bytes(len(psdu), "little"))


@given(data_frames, st.data())
def test_a_truncated_frame_is_refused_or_is_a_frame_of_its_own(frame: DataFrame, data: st.DataObject) -> None:
    psdu = encode_data(frame)
    assert_refused_or_canonical(psdu[: data.draw(st.integers(0, len(psdu) - 1))])


@given(st.binary(max_size=140))
def test_random_octets_are_refused_or_are_exactly_what_the_encoder_would_write(octets: bytes) -> None:
    assert_refused_or_canonical(octets)


@given(st.binary(max_size=125))
def test_octets_with_a_right_check_sequence_are_still_held_to_the_header(body: bytes) -> None:
    assert_refused_or_canonical(body + check_sequence(body).to_bytes(2, "little"))


def assert_refused_or_canonical(octets: bytes) -> None:
    try:
        frame = decode(octets)
    except FrameError:
        return
    again = encode_ack(frame.sequence) if isinstance(frame, AckFrame) else encode_data(frame)
    assert again == octets


KEY = bytes(range(16))


@given(st.sampled_from(Level), data_frames, st.integers(0, 255), st.binary(max_size=95), st.data())
def test_secured_frame_decrypts_to_its_payload_and_spliced_parts_are_rejected(
    level: Level, frame: DataFrame, life: int, payload: bytes, data: st.DataObject
) -> None:
    frame = frame._replace(payload=payload, secured=False)
    receiver = Security(level, KEY, frame.source + 1)
    secured = decode(Security(level, KEY, frame.source, life).protect(frame))
    assert isinstance(secured, DataFrame)
    at = data.draw(st.integers(0, len(secured.payload)))
    part = data.draw(st.binary(min_size=1, max_size=5))
    other = secured.payload[:at] + part + secured.payload[at + len(part) :]
    if other != secured.payload:
        with pytest.raises(SecurityError):
            receiver.open(secured._replace(payload=other))
    assert receiver.open(secured) == frame


@given(data_frames, st.sampled_from(Level))
def test_malformed_security_header_is_refused_by_name(frame: DataFrame, level: Level) -> None:
    with pytest.raises(SecurityError) as refused:
        Security(level, KEY, 1).open(frame)
    assert refused.value.reason in ("forged", "unsecured")
    assert frame.secured or refused.value.reason == "unsecured"

"""The frame codec against the numbers of the standard."""

import pytest

from rmr.radio.frame import (
    BROADCAST,
    PAYLOAD_MAX,
    DataFrame,
    FrameError,
    check_sequence,
    decode,
    encode_ack,
    encode_data,
)


def test_the_check_sequence_is_that_of_the_standards_example() -> None:
    # 802.15.4-2006, 7.2.1.9: the acknowledgement 02 00 6a has the FCS 0010 0111 1001 1110, first bit first.
    assert encode_ack(0x6A) == bytes((0x02, 0x00, 0x6A, 0xE4, 0x79))
    assert check_sequence(b"123456789") == 0x2189  # the published check value of this CRC


def test_a_data_frame_lays_its_header_out_as_the_standard_does() -> None:
    psdu = encode_data(DataFrame(0x1234, 0x0005, 0x00A6, 0x42, wants_ack=True, payload=b"hi"))
    assert psdu[:-2] == bytes.fromhex("6188 42 3412 0500 a600") + b"hi"


def test_header_and_check_sequence_leave_116_octets_of_payload() -> None:
    assert PAYLOAD_MAX == 116
    with pytest.raises(ValueError, match="at most 116"):
        encode_data(DataFrame(1, 2, 3, 4, wants_ack=False, payload=bytes(117)))


def test_a_broadcast_never_asks_for_an_acknowledgement() -> None:
    with pytest.raises(ValueError, match="broadcast"):
        encode_data(DataFrame(1, BROADCAST, 3, 4, wants_ack=True, payload=b""))
    body = bytes.fromhex("6188 42 3412 ffff a600")
    with pytest.raises(FrameError, match="broadcast"):
        decode(body + check_sequence(body).to_bytes(2, "little"))


@pytest.mark.parametrize("field", ["pan", "destination", "source", "sequence"])
def test_a_field_out_of_range_is_the_callers_mistake(field: str) -> None:
    frame = DataFrame(1, 2, 3, 4, wants_ack=False, payload=b"")._replace(**{field: 0x10000})
    with pytest.raises(ValueError, match="16"):
        encode_data(frame)


def test_every_flipped_bit_of_a_full_frame_is_noticed() -> None:
    psdu = encode_data(DataFrame(7, 1, 2, 3, wants_ack=True, payload=bytes(range(116))))
    for bit in range(8 * len(psdu)):
        damaged = bytearray(psdu)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(FrameError):
            decode(bytes(damaged))

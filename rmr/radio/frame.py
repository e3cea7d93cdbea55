"""Frames of IEEE 802.15.4-2006: data and acknowledgement, octet by octet (section 7.2).

A PSDU is what the physical layer carries, at most 127 octets:

    data   frame control 2 | sequence 1 | PAN 2 | destination 2 | source 2 | payload 0..116 | FCS 2
    ack    frame control 2 | sequence 1 | FCS 2

Of a secured data frame the payload here is what stands between header and FCS: auxiliary security header,
encrypted payload, integrity code (`rmr.radio.security`). Acknowledgements are never secured in this edition.

Addresses are short ones within a single PAN (PAN id compression), all fields little-endian. The frame check
sequence is the ITU-T CRC-16 (x^16 + x^12 + x^5 + 1, least significant bit first, start value 0), which finds
every single and double bit error in frames of this length. Other frame types of the standard (beacons,
commands, long addresses) are not supported: they are refused as a peer's mistake.
"""

import binascii
from typing import Final, NamedTuple

BROADCAST: Final = 0xFFFF
"""The broadcast address: every station receives it."""

PSDU_MAX: Final = 127
"""aMaxPHYPacketSize."""
HEADER_OCTETS: Final = 9
FCS_OCTETS: Final = 2
PAYLOAD_MAX: Final = PSDU_MAX - HEADER_OCTETS - FCS_OCTETS
ACK_OCTETS: Final = 5

ACK_REQUEST: Final = 0x0020
_DATA: Final = 0x8841  # type data, PAN id compression, both addresses short, frame version 0
_ACK: Final = 0x0002
_SECURED: Final = 0x1008  # security enabled, which demands frame version 1 (7.2.3)
_DATA_CONTROLS: Final = (_DATA, _DATA | ACK_REQUEST, _DATA | _SECURED, _DATA | _SECURED | ACK_REQUEST)

_REVERSED: Final = bytes(int(f"{octet:08b}"[::-1], 2) for octet in range(256))


class FrameError(ValueError):
    """The octets are no frame of this PAN's kind; the message says why."""


class DataFrame(NamedTuple):
    """A data frame."""

    pan: int
    destination: int
    """Short address, or `BROADCAST`."""
    source: int
    sequence: int
    """Data sequence number, 0..255."""
    wants_ack: bool
    payload: bytes
    secured: bool = False
    """Whether the payload is secured, and begins with the auxiliary security header."""


class AckFrame(NamedTuple):
    """An acknowledgement. It bears no address, only the sequence number of the frame that it answers."""

    sequence: int


def check_sequence(octets: bytes) -> int:
    """Return the FCS of `octets` (802.15.4-2006, 7.2.1.9)."""
    # The library's CRC has the same polynomial with the most significant bit first: mirror in, mirror out.
    mirrored = binascii.crc_hqx(octets.translate(_REVERSED), 0)
    return _REVERSED[mirrored >> 8] | _REVERSED[mirrored & 0xFF] << 8


def encode_data(frame: DataFrame) -> bytes:
    """Return the PSDU of `frame`.

    Raises `ValueError` for a payload over 116 octets, a field out of range, or a broadcast that wants an
    acknowledgement (7.2.1.1.4 forbids it).
    """
    if len(frame.payload) > PAYLOAD_MAX:
        raise ValueError(f"payload of {len(frame.payload)} octets: split it into pieces of at most {PAYLOAD_MAX}")
    body = encode_header(frame) + frame.payload
    return body + check_sequence(body).to_bytes(2, "little")


def encode_header(frame: DataFrame) -> bytes:
    """Return the first 9 octets of `frame`. Raises `ValueError` as `encode_data` does."""
    if frame.wants_ack and frame.destination == BROADCAST:
        raise ValueError("a broadcast cannot be acknowledged: leave wants_ack off")
    if not (
        0 <= frame.sequence <= 0xFF and all(0 <= a <= 0xFFFF for a in (frame.pan, frame.destination, frame.source))
    ):
        raise ValueError("sequence must fit 8 bits, PAN and addresses 16")
    control = _DATA | (ACK_REQUEST if frame.wants_ack else 0) | (_SECURED if frame.secured else 0)
    return (
        control.to_bytes(2, "little")
        + bytes((frame.sequence,))
        + frame.pan.to_bytes(2, "little")
        + frame.destination.to_bytes(2, "little")
        + frame.source.to_bytes(2, "little")
    )


def encode_ack(sequence: int) -> bytes:
    """Return the PSDU that acknowledges the data frame `sequence` (0..255)."""
    body = bytes((_ACK, 0, sequence))
    return body + check_sequence(body).to_bytes(2, "little")


def decode(psdu: bytes) -> DataFrame | AckFrame:
    """Return the frame in `psdu`. Raises `FrameError` if it is damaged or of an unsupported kind."""
    if not ACK_OCTETS <= len(psdu) <= PSDU_MAX:
        raise FrameError(f"{len(psdu)} octets")
    if check_sequence(psdu[:-2]) != psdu[-2] | psdu[-1] << 8:
        raise FrameError("frame check sequence")
    control = psdu[0] | psdu[1] << 8
    if control == _ACK and len(psdu) == ACK_OCTETS:
        return AckFrame(psdu[2])
    if control not in _DATA_CONTROLS or len(psdu) < HEADER_OCTETS + FCS_OCTETS:
        raise FrameError(f"frame control {control:#06x}")
    pan, destination, source = (psdu[at] | psdu[at + 1] << 8 for at in (3, 5, 7))
    wants_ack = bool(control & ACK_REQUEST)
    if wants_ack and destination == BROADCAST:
        raise FrameError("a broadcast that wants an acknowledgement")
    if source == BROADCAST:
        raise FrameError("a frame from everybody")
    return DataFrame(pan, destination, source, psdu[2], wants_ack, psdu[9:-2], bool(control & _SECURED))

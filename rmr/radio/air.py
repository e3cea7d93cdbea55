"""The interface of a station: announcements of transmissions, receptions, confirmations.

A sender announces each transmission with its start, end, power and position, 192 us before the first symbol. In
virtual time `rmr.radio.ether` has all announcements at once. Between processes there is no central medium:
announcements cross the bus and come late, out of order, twice or not at all. Each receiver computes its own reception
from their time stamps.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, final

from rmr.base.time import NEVER, Instant
from rmr.radio.frame import ACK_REQUEST, PSDU_MAX
from rmr.radio.phy import airtime

ACK_ATTEMPT: Final = 0x80
"""Set in `Announcement.attempt` of an acknowledgement, whose low bits repeat the data frame's attempt."""

SEQUENCE_MASK: Final = 0xFFFF_FFFF

POWER_MAX_DBM: Final = 100.0
"""Greatest radiated power, ten megawatts: a forged power of thousands of dBm overflows as milliwatts."""
PLACE_MAX_M: Final = 1e6
"""Greatest coordinate of a transmitter, metres, either way."""


_NUMBERS: Final = (int, float)


class Announcement(NamedTuple):
    """One transmission, with all that decides its reception."""

    source: int
    """Short address of the transmitter."""
    sequence: int
    """Number of the request at its source, 32 bits; the frame's own sequence number is its low octet. An
    acknowledgement repeats the number of the frame that it answers."""
    attempt: int
    """0 for the first transmission, then 1, 2, 3; `ACK_ATTEMPT` is added for an acknowledgement."""
    start: Instant
    """First symbol of the preamble."""
    end: Instant
    """End of the last symbol."""
    power_dbm: float
    """Radiated power."""
    x: float
    """True position of the transmitter, metres."""
    y: float
    psdu: bytes

    @property
    def pressing(self) -> bool:
        """Whether the frame wants an acknowledgement, or is one: its reception must be decided within milliseconds."""
        return bool(self.attempt & ACK_ATTEMPT) or bool(self.psdu and self.psdu[0] & ACK_REQUEST)

    @classmethod
    def from_wire(cls, fields: Sequence[Any]) -> "Announcement":
        """Return the announcement in `fields`. Raises `ValueError` if they cannot be one."""
        if not isinstance(fields, list | tuple) or len(fields) != len(cls._fields):
            raise ValueError("an announcement has nine fields")
        source, sequence, attempt, start, end, power_dbm, x, y, psdu = fields
        # Written out: a robot reads a hundred of them a second.
        if not (type(source) is type(sequence) is type(attempt) is type(start) is type(end) is int) or not (
            0 <= source <= 0xFFFF
            and 0 <= sequence <= SEQUENCE_MASK
            and 0 <= attempt <= 0xFF
            and 0 <= start <= NEVER
            and 0 <= end <= NEVER
        ):
            raise ValueError("an announcement's integers are out of range")
        if not (type(power_dbm) in _NUMBERS and type(x) in _NUMBERS and type(y) in _NUMBERS) or not (
            -POWER_MAX_DBM < power_dbm < POWER_MAX_DBM
            and -PLACE_MAX_M < x < PLACE_MAX_M
            and -PLACE_MAX_M < y < PLACE_MAX_M
        ):
            raise ValueError("an announcement's power or position is out of range")
        # Over a network a frame is there at one instant (`rmr.radio.network`).
        if not isinstance(psdu, bytes) or len(psdu) > PSDU_MAX or end - start not in (0, airtime(len(psdu))):
            raise ValueError("an announcement's frame and its airtime do not agree")
        return cls(source, sequence, attempt, start, end, float(power_dbm), float(x), float(y), psdu)


@final
class Received:
    """A data frame that this station received."""

    __slots__ = ("lqi", "payload", "rssi_dbm", "source", "stamp", "unicast")

    def __init__(self, payload: bytes, source: int, unicast: bool, rssi_dbm: float, lqi: int, stamp: Instant) -> None:
        self.payload = payload
        self.source = source
        self.unicast = unicast
        self.rssi_dbm = rssi_dbm
        self.lqi = lqi
        """Link quality, 0..255."""
        self.stamp = stamp
        """Lab time at which its last symbol arrived."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Received) and self._fields() == other._fields()

    def __hash__(self) -> int:
        return self.stamp

    def __repr__(self) -> str:
        return f"Received{self._fields()}"

    def _fields(self) -> tuple[bytes, int, bool, float, int, Instant]:
        return self.payload, self.source, self.unicast, self.rssi_dbm, self.lqi, self.stamp


class Confirmed(NamedTuple):
    """The outcome of a request."""

    handle: int
    status: str
    """``ok``, ``no_ack`` or ``access_failure`` (802.15.4-2006, 7.1.1.2: different outcomes)."""


Output = Announcement | Received | Confirmed

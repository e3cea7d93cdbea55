"""Link security of IEEE 802.15.4-2006 (7.5.8, 7.6, Annex B): AES-CCM* and a frame counter against replay.

A secured data frame bears the security bit and frame version 1; between its header and its FCS stand

    security control 1 | frame counter 4 | encrypted payload | integrity code 4, 8 or 16

Security control is the level (5, 6, 7) with key identifier mode 0: there is one key, known to all by other ways.
Header, security control and counter are authenticated; the payload is encrypted as well. The nonce is

    extended address of the source 8 | frame counter 4 | level 1        (7.6.3.2, big-endian)

and must never occur twice under one key, else a listener learns what two payloads have in common and can forge
frames. Three things see to that. Each run has a key of its own, derived from the lab's. Each robot has an extended
address of its own, derived from PAN and short address: 02 52 4D 52, PAN, address (locally administered, so it cannot
be a device's). And the counter of a robot that is started again begins above all that it can have used: at its number
of earlier lives times 2^24. A robot that has used up its part of the counter sends no more.

A receiver accepts of each source only counters above the highest so far (7.5.8.2.3). A retransmission repeats its
counter; that it is a duplicate and no replay is decided by `rmr.radio.receive_filter`. A receiver forgets the counters
when it is started again: frames of the same run that were recorded before can then be replayed to it once, up to the
next frame of their source.
"""

from enum import IntEnum
from typing import Final, Literal

from rmr.radio.frame import PAYLOAD_MAX, DataFrame, encode_data, encode_header

KEY_OCTETS: Final = 16
LIVES_MAX: Final = 256
"""Lives of a robot in one run: the counter's upper octet."""
FRAMES_MAX: Final = 1 << 24
"""Frames of one life: days at the rate of a busy robot, 16 hours on a channel of its own."""
AUXILIARY_OCTETS: Final = 5
"""Security control and frame counter (7.6.2)."""

_COUNTER_MAX: Final = 0xFFFF_FFFF
"""Bears no frame: the standard keeps it for "used up" (7.5.8.2.1)."""
_EXTENDED_PREFIX: Final = bytes.fromhex("02524d52")

Reason = Literal["forged", "replayed", "unsecured"]


class Level(IntEnum):
    """Security level (Table 95). Levels without encryption or without integrity are not supported."""

    ENC_MIC_32 = 5
    ENC_MIC_64 = 6
    ENC_MIC_128 = 7

    @property
    def code_octets(self) -> int:
        """Length of the integrity code."""
        return 4 << (self - Level.ENC_MIC_32)

    @property
    def payload_max(self) -> int:
        """Octets of payload that a secured frame leaves: 107, 103 or 95."""
        return PAYLOAD_MAX - AUXILIARY_OCTETS - self.code_octets


UNSECURED: Final = "none"
LEVELS: Final[dict[str, Level | None]] = {
    UNSECURED: None,
    "enc-mic-32": Level.ENC_MIC_32,
    "enc-mic-64": Level.ENC_MIC_64,
    "enc-mic-128": Level.ENC_MIC_128,
}
"""Names of the levels in lab files and on the bus."""


class SecurityError(Exception):
    """A frame that is refused: a peer's mistake or an attack, to be counted by its `reason`."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason: Reason = reason


def run_key(key: bytes, host: Literal["robots", "simulator"], lab: str, run: int) -> bytes:
    """Return the key of one run, derived from the lab's (HKDF-SHA256, RFC 5869).

    `run` is the number of the world's session among robots, the seed in the simulator; both are below 2^64. A
    simulated run is repeatable, nonces included, so that its key must not be that of any real one.
    """
    # Loaded where there is a key alone: it takes 30 ms and 6 MB, and a host may start fifty robots.
    from cryptography.hazmat.primitives.hashes import SHA256  # noqa: PLC0415
    from cryptography.hazmat.primitives.kdf.hkdf import HKDF  # noqa: PLC0415

    context = b"rmr radio\0" + f"{host}\0{lab}\0".encode() + (run & 0xFFFF_FFFF_FFFF_FFFF).to_bytes(8, "big")
    return HKDF(SHA256(), KEY_OCTETS, salt=None, info=context).derive(key)


def extended_address(pan: int, address: int) -> bytes:
    """Return the 8 octets that stand for a station in nonces."""
    return _EXTENDED_PREFIX + pan.to_bytes(2, "big") + address.to_bytes(2, "big")


class Security:
    """The security of one station: its counter, and those of whom it has heard."""

    __slots__ = ("_address", "_cipher", "_counter", "_end", "_heard", "_invalid", "level")

    def __init__(self, level: Level, key: bytes, address: int, life: int = 0) -> None:
        """`key` is the run's; `life` is how often the robot was started before in this run.

        Raises `ValueError` for a life beyond what the counter holds.
        """
        from cryptography.exceptions import InvalidTag  # noqa: PLC0415
        from cryptography.hazmat.primitives.ciphers.aead import AESCCM  # noqa: PLC0415

        if not 0 <= life < LIVES_MAX:
            raise ValueError(f"the frame counter lasts for {LIVES_MAX} starts in one run: begin a new run")
        self.level = level
        self._address = address
        self._cipher = AESCCM(key, level.code_octets)
        self._invalid = InvalidTag
        self._counter = life * FRAMES_MAX
        self._end = min(self._counter + FRAMES_MAX, _COUNTER_MAX)
        # The address space bounds it, and only who has the key gets in. Nobody else sends in this station's name.
        self._heard: dict[int, int] = {address: _COUNTER_MAX}

    @property
    def used_up(self) -> bool:
        """Whether this life has no counter left: nothing can be sent any more."""
        return self._counter >= self._end

    @property
    def left(self) -> int:
        """How many more frames this life can send."""
        return self._end - self._counter

    def check(self, frame: DataFrame) -> None:
        """Raise `ValueError` if `protect` would refuse the length of `frame`."""
        if len(frame.payload) > self.level.payload_max:
            limit = self.level.payload_max
            raise ValueError(f"payload of {len(frame.payload)} octets: split it into pieces of at most {limit}")

    def protect(self, frame: DataFrame) -> bytes:
        """Return the PSDU of `frame`, secured. Raises `ValueError` if it cannot be a frame, and if `used_up`.

        A retransmission repeats these octets: to protect it again would take another counter for the same frame.
        """
        if self.used_up:
            raise ValueError("the frame counter is used up: start the robot again")
        self.check(frame)
        auxiliary = bytes((self.level,)) + self._counter.to_bytes(4, "little")
        open_frame = frame._replace(secured=True, payload=auxiliary)
        sealed = self._cipher.encrypt(self._nonce(frame, self._counter), frame.payload, _authenticated(open_frame))
        self._counter += 1
        return encode_data(open_frame._replace(payload=auxiliary + sealed))

    def open(self, frame: DataFrame) -> DataFrame:
        """Return `frame` as it was before `protect`, and take note of its counter. Raises `SecurityError`."""
        auxiliary = frame.payload[:AUXILIARY_OCTETS]
        sealed = frame.payload[AUXILIARY_OCTETS:]
        if not frame.secured or auxiliary[:1] != bytes((self.level,)):
            raise SecurityError("unsecured")
        counter = int.from_bytes(auxiliary[1:], "little")
        header = _authenticated(frame._replace(payload=auxiliary))
        try:
            payload = self._cipher.decrypt(self._nonce(frame, counter), sealed, header)
        except self._invalid:
            raise SecurityError("forged") from None
        if counter <= self._heard.get(frame.source, -1):
            raise SecurityError("replayed")
        self._heard[frame.source] = counter
        return frame._replace(secured=False, payload=payload)

    def _nonce(self, frame: DataFrame, counter: int) -> bytes:
        return extended_address(frame.pan, frame.source) + counter.to_bytes(4, "big") + bytes((self.level,))


def payload_max(security: Security | None) -> int:
    """Return how many octets of payload a frame of a station holds."""
    return PAYLOAD_MAX if security is None else security.level.payload_max


def _authenticated(frame: DataFrame) -> bytes:
    """Return what a frame whose payload is the auxiliary header alone has authenticated and not encrypted."""
    return encode_header(frame) + frame.payload

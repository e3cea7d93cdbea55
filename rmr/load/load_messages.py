"""The messages by which robots get a new program: one vocabulary for the radio and the bus.

On the radio a message is a payload whose first octet is `LOAD`; on the bus it is the same octets in a field. All
numbers are big-endian. A program is named by its 32-bit digest and sent in fragments. A *version* is the instant of lab
time at which robots switched to it: 0 for the program that a robot was started with. Of two versions the later one is
the newer.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from rmr.base.time import Instant
from rmr.bytecode.layout import SIZE_MAX
from rmr.node.payloads import PayloadKind

LOAD: Final = int(PayloadKind.LOAD)
"""First octet of a payload."""


class LoadKind(IntEnum):
    """Second octet."""

    ASK = 1
    """A robot that has started asks the others for their program. version 8, digest 4."""
    TELL = 2
    """A robot's program, if it was loaded. version 8, digest 4, octets 4, octets of a fragment 2, targets."""
    OFFER = 3
    """A program that the robot is to get. digest 4, octets 4, octets of a fragment 2, dry run 1."""
    WANT = 4
    """Which fragments are missing. digest 4, the first one 2, then a bit for each fragment from that one on."""
    FRAGMENT = 5
    """digest 4, number 2, octets of the program."""
    READY = 6
    """It is whole, verified, and fits. digest 4, facts that it keeps 2, that it drops 2, text."""
    REFUSED = 7
    """It cannot be run. digest 4, reason."""
    COMMIT = 8
    """All are ready: switch at an instant. digest 4, instant 8, targets."""
    COMMITTED = 9
    """The instant is known. digest 4, instant 8."""
    ABORT = 10
    """Not all are ready, or not all know the instant: the old program goes on. digest 4."""
    ABORTED = 11
    """That is known. digest 4."""


class LoadError(ValueError):
    """A message that no robot of ours sends, or a program that cannot be sent."""


_PROGRAM: Final = struct.Struct(">QIIH")
_OFFER: Final = struct.Struct(">IIHB")
_PIECE: Final = struct.Struct(">IH")
_READY: Final = struct.Struct(">IHH")
_COMMIT: Final = struct.Struct(">IQ")
_DIGEST: Final = struct.Struct(">I")
HEAD: Final = 2
"""Octets before the fields."""
FRAGMENT_HEAD: Final = HEAD + _PIECE.size
"""Octets of a fragment's message before the piece of the program."""
COUNT_MAX: Final = (1 << 16) - 1
"""Fragments of a program; facts in an answer."""
TARGETS_MAX: Final = 40
"""Robots that a message names, so that it fits a frame; all of the lab are named by none."""


@dataclass(frozen=True, slots=True)
class LoadMessage:
    """A message; a field that its kind has not is 0 or empty."""

    kind: LoadKind
    digest: int
    version: Instant = 0
    """Of COMMIT and COMMITTED the instant of the switch."""
    octets: int = 0
    """Of the whole program."""
    piece_octets: int = 0
    number: int = 0
    """Of a fragment; of WANT the first fragment that `data` has a bit for."""
    data: bytes = b""
    """Octets of the program; of WANT the bits, 1: it is missing."""
    text: str = ""
    carried: int = 0
    ended: int = 0
    dry: bool = False
    targets: tuple[int, ...] = ()
    """The robots that are to run it; empty: all of the lab."""

    def encode(self, octets_max: int) -> bytes:
        """Return the payload, with texts cut to fit `octets_max`. Raises LoadError if the rest does not fit."""
        head = bytes((LOAD, self.kind))
        payload = head + self._fields(octets_max)
        if len(payload) > octets_max:
            raise LoadError(f"a message of {len(payload)} octets does not fit {octets_max}")
        return payload

    def _fields(self, octets_max: int) -> bytes:
        match self.kind:
            case LoadKind.ASK:
                return _COMMIT.pack(self.digest, self.version)
            case LoadKind.TELL:
                program = _PROGRAM.pack(self.version, self.digest, self.octets, self.piece_octets)
                return program + _ids(self.targets)
            case LoadKind.OFFER:
                return _OFFER.pack(self.digest, self.octets, self.piece_octets, self.dry)
            case LoadKind.WANT | LoadKind.FRAGMENT:
                return _PIECE.pack(self.digest, self.number) + self.data
            case LoadKind.READY:
                counts = (min(self.carried, COUNT_MAX), min(self.ended, COUNT_MAX))
                return _READY.pack(self.digest, *counts) + cut(self.text, octets_max - HEAD - _READY.size)
            case LoadKind.REFUSED:
                return _DIGEST.pack(self.digest) + cut(self.text, octets_max - HEAD - _DIGEST.size)
            case LoadKind.COMMIT:
                return _COMMIT.pack(self.digest, self.version) + _ids(self.targets)
            case LoadKind.COMMITTED:
                return _COMMIT.pack(self.digest, self.version)
            case LoadKind.ABORT | LoadKind.ABORTED:
                return _DIGEST.pack(self.digest)


def decode(payload: bytes) -> LoadMessage:
    """Return the message in `payload`. Raises LoadError."""
    try:
        if payload[0] != LOAD:
            raise LoadError("no message about a program")
        return _decoded(LoadKind(payload[1]), payload[HEAD:])
    except (struct.error, IndexError, ValueError) as error:
        raise LoadError(f"message about a program: {error}") from error


def _decoded(kind: LoadKind, rest: bytes) -> LoadMessage:
    match kind:
        case LoadKind.ASK | LoadKind.COMMITTED:
            digest, version = _COMMIT.unpack(rest)
            return LoadMessage(kind, digest, version)
        case LoadKind.TELL:
            version, digest, octets, piece = _PROGRAM.unpack_from(rest)
            targets = _targets(rest[_PROGRAM.size :])
            return LoadMessage(kind, digest, version, octets, _piece(piece), targets=targets)
        case LoadKind.OFFER:
            digest, octets, piece, dry = _OFFER.unpack(rest)
            return LoadMessage(kind, digest, octets=octets, piece_octets=_piece(piece), dry=bool(dry))
        case LoadKind.WANT | LoadKind.FRAGMENT:
            digest, number = _PIECE.unpack_from(rest)
            return LoadMessage(kind, digest, number=number, data=rest[_PIECE.size :])
        case LoadKind.READY:
            digest, carried, ended = _READY.unpack_from(rest)
            return LoadMessage(kind, digest, text=_text(rest[_READY.size :]), carried=carried, ended=ended)
        case LoadKind.REFUSED:
            [digest] = _DIGEST.unpack_from(rest)
            return LoadMessage(kind, digest, text=_text(rest[_DIGEST.size :]))
        case LoadKind.COMMIT:
            digest, version = _COMMIT.unpack_from(rest)
            return LoadMessage(kind, digest, version, targets=_targets(rest[_COMMIT.size :]))
        case LoadKind.ABORT | LoadKind.ABORTED:
            [digest] = _DIGEST.unpack(rest)
            return LoadMessage(kind, digest)


def _piece(octets: int) -> int:
    if octets == 0:
        raise LoadError("fragments of no octets")
    return octets


def _ids(robots: Iterable[int]) -> bytes:
    listed = tuple(robots)
    if len(listed) > TARGETS_MAX:
        raise LoadError(f"{len(listed)} robots are too many to be named: {TARGETS_MAX} at most, or all of the lab")
    return struct.pack(f">B{len(listed)}H", len(listed), *listed)


def _targets(octets: bytes) -> tuple[int, ...]:
    return struct.unpack(f">{octets[0]}H", octets[1:])


def cut(text: str, octets: int) -> bytes:
    """Return `text` in at most so many octets of UTF-8."""
    return text.encode("utf-8", "replace")[: max(0, octets)]


def _text(octets: bytes) -> str:
    return octets.decode("utf-8", "ignore")


def missing_bits(missing: Iterable[int], octets_max: int) -> tuple[int, bytes]:
    """Return the first missing fragment and a bit for each from that one on, as many as fit."""
    numbers = sorted(missing)
    first = numbers[0] if numbers else 0
    bits = bytearray()
    for number in numbers:
        place = number - first
        if place >> 3 >= octets_max:
            break
        bits.extend(bytes((place >> 3) + 1 - len(bits)))
        bits[place >> 3] |= 1 << (place & 7)
    return first, bytes(bits)


def numbers_of(first: int, bits: bytes) -> list[int]:
    """Return the numbers of the bits that are set."""
    return [first + place for place in range(8 * len(bits)) if bits[place >> 3] >> (place & 7) & 1]


class Fragments:
    """The fragments of one program, all of `piece_octets` but the last one."""

    def __init__(self, digest: int, octets: int, piece_octets: int) -> None:
        """Raise LoadError if no program has so many octets, or it has too many fragments."""
        self.digest: Final = digest
        self.octets: Final = octets
        self.piece_octets: Final = piece_octets
        self.count: Final = -(-octets // piece_octets)
        if not 0 < octets <= SIZE_MAX or self.count > COUNT_MAX:
            raise LoadError(f"a program of {octets} octets in {self.count} fragments is too large")
        self._pieces: dict[int, bytes] = {}

    @classmethod
    def of(cls, digest: int, program: bytes, piece_octets: int) -> "Fragments":
        """Return the fragments of a whole program. Raises LoadError."""
        fragments = cls(digest, len(program), piece_octets)
        for number in range(fragments.count):
            fragments._pieces[number] = program[number * piece_octets : (number + 1) * piece_octets]
        return fragments

    def is_same(self, digest: int, octets: int, piece_octets: int) -> bool:
        """Return whether these are the fragments of such a program."""
        return (self.digest, self.octets, self.piece_octets) == (digest, octets, piece_octets)

    def add(self, number: int, piece: bytes) -> bool:
        """Take a fragment; return whether it was missing. One of the wrong size is none."""
        size = self.piece_octets if number < self.count - 1 else self.octets - number * self.piece_octets
        if number >= self.count or len(piece) != size or number in self._pieces:
            return False
        self._pieces[number] = piece
        return True

    def piece(self, number: int) -> bytes | None:
        """Return a fragment; None if it is missing."""
        return self._pieces.get(number)

    @property
    def missing(self) -> list[int]:
        """The numbers of the missing fragments."""
        return [number for number in range(self.count) if number not in self._pieces]

    @property
    def whole(self) -> bytes | None:
        """The program; None while fragments are missing."""
        if len(self._pieces) < self.count:
            return None
        return b"".join([self._pieces[number] for number in range(self.count)])

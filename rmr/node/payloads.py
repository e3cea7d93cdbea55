"""What robots say to each other besides coordination: facts, their acknowledgements, hellos and failures.

One table of kinds; the first octet of a frame's payload is the kind (0x01-0x0F belong to `rmr.coord`). The body of
a fact frame is a delivery, whose role says what it is, so that everything that must arrive once travels the same way.
All numbers are big-endian; a value is one tag octet and its body, and a symbol that the program knows travels as
its number. A frame that does not parse is the sender's mistake: `WireError`, counted and dropped by the node.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

from rmr.base.time import NEVER, NS_PER_MS, Duration, Instant
from rmr.base.values import INT_MAX, INT_MIN, Robot, Symbol, Value

PAYLOAD_OCTETS_MAX: Final = 116
"""127 octets of PSDU less 9 of header and 2 of FCS (IEEE 802.15.4-2006, 7.2). A secured radio leaves fewer."""
LIST_DEPTH_MAX: Final = 8
"""Deeper lists are refused, so that a malformed frame cannot exhaust the stack."""
LENGTH_MAX: Final = 0xFFFF
"""Octets of a text, items of a list: their number travels in two octets."""


class WireError(ValueError):
    """A payload that no robot of this program could have sent, or a value that no payload can hold."""


class UnsendableError(WireError):
    """A delivery that no frames can carry, whatever the radio: it is too large, or nested too deep."""


class PayloadKind(IntEnum):
    """First octet of a payload."""

    FACT = 0x10
    """address 2 (`address`), epoch 1, sequence 2 (bit 15: unordered; both kinds are numbered apart), body."""
    FACT_ACK = 0x11
    """epoch 1, sequence 2, before 2 (bit k: number sequence - 1 - k of its kind, ordered or not, has arrived, too)."""
    FRAGMENT = 0x12
    """address 2, epoch 1, sequence 2, part 1, parts 1, piece of a body."""
    FACT_BASE = 0x13
    """address 2, epoch 1, sequence 2: the first ordered delivery to the receiver that the sender is not done with."""
    FACT_BASE_WANTED = 0x14
    """epoch 1: a receiver that holds back deliveries of this life of the other robot asks for its `FACT_BASE`."""
    FACT_LIFE = 0x15
    """life 1, instant 8: a receiver answers what is addressed to an earlier life of it. The instant is one at which the
    life before had ended, in nanoseconds of lab time."""
    SHARED = 0x16
    """digest 2, epoch 1, number 2, for how long it holds 1 (0.5 s), then for each predicate: index 2, facts 1, values.
    The facts of these predicates that the sender holds, all of them (`rmr.node.logic.shared_facts`)."""
    FACT_UNKNOWN = 0x17
    """address 2, digest 2, life 4: a robot that was loaded with a program answers what is addressed to robots of
    another one, which it has not run in this life: to whom, its own program, its life."""
    HELLO = 0x20
    """digest 2, x 2, y 2 (signed, cm), heading 1 (256ths of a turn), speed 1 (cm/s), flags 1, rank 1, goal x 2, y 2,
    up to 6 octets: whom the sender hears (`rmr.node.peers.link_sensing`)."""
    LOAD = 0x22
    """A message about a new program (`rmr.load`): the host's, never handed to the node."""
    FAILURE = 0x21
    """digest 2, assertion 1: the robot missed that assertion's deadline (paper III.E); 255: none in particular."""


LOAD_OCTET: Final = bytes((PayloadKind.LOAD,))
"""First octet of the payloads by which programs are distributed."""


class DeliveryRole(IntEnum):
    """What a delivery is: role 1 (upper half), index 2, arguments 1, of some roles a number 8, then the arguments.

    Bit 0 of the role's octet: behind the number a deadline 4, milliseconds of lab time.
    """

    FACT = 0
    GOAL = 1
    ACTION = 2
    """To be executed. Number: the sender's number of the action; 0 if it does not wait for the end."""
    COMPLETED = 3
    """The end of an action, to the robot that derived it. Number: the action's."""
    FAILED = 4
    """The same; it failed, or has no handler."""
    FINISH_AWAITED = 5
    """A job waits for a fact of the receiver. Index: the assertion; arguments: S's. Number: the job's start."""
    FINISH_SEEN = 6
    """Such a fact was inserted. Index: the assertion; arguments: F's. Number: when."""


NUMBERED: Final = frozenset(DeliveryRole) - {DeliveryRole.FACT, DeliveryRole.GOAL}
"""Roles that carry a number."""


@dataclass(frozen=True, slots=True)
class Delivery:
    """What one robot tells another reliably."""

    role: DeliveryRole
    index: int
    """Of the predicate; of the assertion where the role says so."""
    args: tuple[Value, ...]
    """Without the owner."""
    number: int = 0
    """An instant, or what names an action; 64 bits unsigned, 0 where the role has none."""
    due: Instant = NEVER
    """Deadline of the job that it serves, up to a millisecond later; NEVER: none."""


class Hello(NamedTuple):
    """Where a robot says it is and what place it has taken."""

    x: float
    """Metres."""
    y: float
    theta: float
    """Radians."""
    v: float
    """Speed along the heading, m/s."""
    parked: bool
    """It stands and does not intend to move yet."""
    rank: int
    """Its place in the schedule, 0 without one."""
    goal: tuple[float, float] | None
    """The place it is going to or stands on, metres."""
    digest: int = 0
    """Identity of its program, 16 bits."""
    stays: bool = False
    """It will stand for `rmr.node.peers.hello.STAYS` from now on, whatever happens."""
    listed: bytes = b""
    """Which robots it hears (`rmr.node.peers.link_sensing`), up to HELLO_LIST_OCTETS_MAX octets."""


HELLO_LIST_OCTETS_MAX: Final = 6  # 19 % of the airtime without a list: 15 octets, and 17 of preamble, header and FCS
_HELLO: Final = struct.Struct(">BHhhBbBBhh")
_FACT: Final = struct.Struct(">BHBH")
_ACK: Final = struct.Struct(">BBHH")
ACK_BEFORE_BITS: Final = 16
"""Numbers before the acknowledged one of which an acknowledgement tells: more than are under way to one robot."""
_LIFE: Final = struct.Struct(">BBQ")
_UNKNOWN: Final = struct.Struct(">BHHI")
_FRAGMENT: Final = struct.Struct(">BHBHBB")
_FAILURE: Final = struct.Struct(">BHB")
FACT_BODY_OCTETS_MAX: Final = PAYLOAD_OCTETS_MAX - _FACT.size
PARTS_MAX: Final = 64
"""A fact larger than 64 fragments (about 6.9 kB, secured 5.6 kB at least) is refused by the sender."""

_PARKED: Final = 1
_GOAL: Final = 2
_STAYS: Final = 4
_NO_ASSERTION: Final = 255
_TURN: Final = 6.283185307179586


def encode_hello(hello: Hello) -> bytes:
    """Return the payload of a hello; positions beyond +-327 m are clamped."""
    x, y = _cm(hello.x), _cm(hello.y)
    gx, gy = map(_cm, hello.goal or (0.0, 0.0))
    flags = (_PARKED if hello.parked else 0) | (_GOAL if hello.goal else 0) | (_STAYS if hello.stays else 0)
    heading = round(hello.theta / _TURN * 256) & 0xFF
    speed = max(-127, min(127, round(hello.v * 100)))
    rank = min(hello.rank, 255)
    head = _HELLO.pack(PayloadKind.HELLO, hello.digest, x, y, heading, speed, flags, rank, gx, gy)
    return head + hello.listed[:HELLO_LIST_OCTETS_MAX]


def decode_hello(payload: bytes) -> Hello:
    """Return the hello in `payload`. Raises WireError."""
    try:
        _, digest, x, y, heading, speed, flags, rank, gx, gy = _HELLO.unpack_from(payload)
    except struct.error as error:
        raise WireError(f"hello: {error}") from error
    listed = payload[_HELLO.size :]
    if len(listed) > HELLO_LIST_OCTETS_MAX:
        raise WireError(f"hello: a list of {len(listed)} octets")
    goal = (gx / 100, gy / 100) if flags & _GOAL else None
    theta = heading / 256 * _TURN
    parked = bool(flags & _PARKED)
    return Hello(x / 100, y / 100, theta, speed / 100, parked, rank, goal, digest, bool(flags & _STAYS), listed)


def _cm(metres: float) -> int:
    return max(-32768, min(32767, round(metres * 100)))


class FactFrame(NamedTuple):
    """One frame of a delivery; a delivery that fits has one part."""

    address: int
    epoch: int
    """The sender's start count: after a restart sequence numbers begin anew."""
    sequence: int
    part: int
    parts: int
    piece: bytes


def address(digest: int, life: int) -> int:
    """Return whom deliveries are for, 16 bits: robots of a program, in the life with this number (of 8 bits).

    For first lives it is the program's digest, so that a life costs no octet.
    """
    return (digest ^ (life & 0xFF) << 8) & 0xFFFF


def addressed(frame: bytes, to: int) -> bytes:
    """Return a frame of a delivery with another address."""
    return frame[:1] + to.to_bytes(2, "big") + frame[3:]


def encode_fact_frames(
    to: int, epoch: int, sequence: int, body: bytes, payload_max: int = PAYLOAD_OCTETS_MAX
) -> list[bytes]:
    """Return the payloads that carry `body` to an `address`: one, or fragments. Raises WireError if it is too large."""
    if _FACT.size + len(body) <= payload_max:
        return [_FACT.pack(PayloadKind.FACT, to, epoch & 0xFF, sequence) + body]
    piece = payload_max - _FRAGMENT.size
    pieces = [body[i : i + piece] for i in range(0, len(body), piece)]
    if len(pieces) > PARTS_MAX:
        raise UnsendableError(f"a fact of {len(body)} octets is too large: at most {PARTS_MAX * piece} octets")
    return [
        _FRAGMENT.pack(PayloadKind.FRAGMENT, to, epoch & 0xFF, sequence, part, len(pieces)) + piece
        for part, piece in enumerate(pieces)
    ]


def decode_fact_frame(payload: bytes) -> FactFrame:
    """Return the fact or fragment in `payload`. Raises WireError."""
    try:
        if payload[0] == PayloadKind.FACT:
            _, to, epoch, sequence = _FACT.unpack_from(payload)
            return FactFrame(to, epoch, sequence, 0, 1, payload[_FACT.size :])
        _, to, epoch, sequence, part, parts = _FRAGMENT.unpack_from(payload)
    except struct.error as error:
        raise WireError(f"fact: {error}") from error
    if not 0 <= part < parts <= PARTS_MAX:
        raise WireError(f"fact: part {part} of {parts}")
    return FactFrame(to, epoch, sequence, part, parts, payload[_FRAGMENT.size :])


def encode_ack(epoch: int, sequence: int, before: int = 0) -> bytes:
    """Return the payload that acknowledges a whole delivery, and those of the `before` numbers whose bits are set."""
    return _ACK.pack(PayloadKind.FACT_ACK, epoch & 0xFF, sequence, before)


def decode_ack(payload: bytes) -> tuple[int, int, int]:
    """Return (epoch, sequence, before). Raises WireError."""
    try:
        _, epoch, sequence, before = _ACK.unpack(payload)
    except struct.error as error:
        raise WireError(f"acknowledgement: {error}") from error
    return epoch, sequence, before


def encode_base(to: int, epoch: int, sequence: int) -> bytes:
    """Return the payload that says from which ordered delivery on the `address` has to wait for missing ones."""
    return _FACT.pack(PayloadKind.FACT_BASE, to, epoch & 0xFF, sequence)


def decode_base(payload: bytes) -> tuple[int, int, int]:
    """Return (address, epoch, sequence). Raises WireError."""
    try:
        _, to, epoch, sequence = _FACT.unpack(payload)
    except struct.error as error:
        raise WireError(f"first delivery: {error}") from error
    if sequence >> 15:
        raise WireError("first delivery: an unordered number")
    return to, epoch, sequence


def encode_base_wanted(epoch: int) -> bytes:
    """Return the payload that asks a sender for its `FACT_BASE`; `epoch` is the life of it that is meant."""
    return bytes((PayloadKind.FACT_BASE_WANTED, epoch & 0xFF))


def decode_base_wanted(payload: bytes) -> int:
    """Return the epoch. Raises WireError."""
    if len(payload) != 2:
        raise WireError(f"question for the first delivery: {len(payload)} octets instead of 2")
    return payload[1]


def encode_life(life: int, ended: Instant) -> bytes:
    """Return the payload by which a robot tells its life, and an instant at which the one before had ended."""
    return _LIFE.pack(PayloadKind.FACT_LIFE, life & 0xFF, ended)


def decode_life(payload: bytes) -> tuple[int, Instant]:
    """Return (life, instant). Raises WireError."""
    try:
        _, life, ended = _LIFE.unpack(payload)
    except struct.error as error:
        raise WireError(f"life: {error}") from error
    return life, ended


def encode_unknown(to: int, digest: int, life: int) -> bytes:
    """Return the payload by which a robot of another program answers what is for the `address`."""
    return _UNKNOWN.pack(PayloadKind.FACT_UNKNOWN, to, digest & 0xFFFF, life)


def decode_unknown(payload: bytes) -> tuple[int, int, int]:
    """Return (address, digest, life). Raises WireError."""
    try:
        _, to, digest, life = _UNKNOWN.unpack(payload)
    except struct.error as error:
        raise WireError(f"unknown program: {error}") from error
    return to, digest, life


def encode_failure(digest: int, assertion: int | None) -> bytes:
    """Return the payload of a failure broadcast; `assertion` None, or beyond an octet: no deadline in particular."""
    known = assertion is not None and assertion < _NO_ASSERTION
    return _FAILURE.pack(PayloadKind.FAILURE, digest & 0xFFFF, assertion if known else _NO_ASSERTION)


def decode_failure(payload: bytes) -> tuple[int, int | None]:
    """Return (digest, assertion index or None). Raises WireError."""
    try:
        _, digest, assertion = _FAILURE.unpack(payload)
    except struct.error as error:
        raise WireError(f"failure: {error}") from error
    return digest, None if assertion == _NO_ASSERTION else assertion


class SharedFrame(NamedTuple):
    """What a robot tells its neighbours of its shared facts."""

    digest: int
    epoch: int
    number: int
    lasts: Duration
    """For how long it holds, in whole half seconds on the air, rounded up."""
    parts: Sequence[bytes] = ()
    """What is sent: of each predicate (`encode_shared_part`)."""
    facts: Sequence[tuple[int, list[tuple[Value, ...]]]] = ()
    """What has arrived: predicate and all its facts."""


_SHARED: Final = struct.Struct(">BHBHB")
SHARED_OCTETS: Final = _SHARED.size
SHARED_PART_OCTETS: Final = 3
SHARED_FACTS_MAX: Final = 255
"""Facts of one predicate in a frame: their number takes an octet."""
_HALF_SECOND: Final[Duration] = 500 * NS_PER_MS


def encode_values(values: Sequence[Value], symbols: Mapping[str, int]) -> bytes:
    """Return values as octets. Raises WireError when one is too long, or nested too deep."""
    out = bytearray()
    for value in values:
        _encode_value(out, value, symbols, 0)
    return bytes(out)


def encode_shared_part(index: int, facts: Sequence[bytes]) -> bytes:
    """Return what a frame says of one predicate; the values of a fact are told by `encode_values`."""
    return struct.pack(">HB", index, len(facts)) + b"".join(facts)


def encode_shared(frame: SharedFrame) -> bytes:
    """Return the payload that tells shared facts."""
    lasts = min(255, -(-frame.lasts // _HALF_SECOND))
    head = _SHARED.pack(PayloadKind.SHARED, frame.digest, frame.epoch, frame.number, lasts)
    return head + b"".join(frame.parts)


def decode_shared(payload: bytes, widths: Mapping[int, int], symbols: Sequence[str], digest: int) -> SharedFrame | None:
    """Return what `payload` tells, None if that is of a program with another digest. Raises WireError.

    `widths` gives the shared predicates of the program their numbers of arguments, without the owner.
    """
    try:
        _, whose, epoch, number, lasts = _SHARED.unpack_from(payload)
        if whose != digest:
            return None
        reader = _Reader(payload, _SHARED.size, symbols)
        facts = []
        while reader.offset < len(payload):
            index, count = reader.part()
            if index not in widths:
                raise WireError(f"shared facts of predicate {index}, which is none")
            facts.append((index, [tuple([reader.value(0) for _ in range(widths[index])]) for _ in range(count)]))
    except (struct.error, IndexError, ValueError, UnicodeDecodeError) as error:
        raise WireError(f"shared facts: {error}") from error
    return SharedFrame(whose, epoch, number, lasts * _HALF_SECOND, facts=facts)


class _Tag(IntEnum):
    FALSE = 0
    TRUE = 1
    INT8 = 2
    INT64 = 3
    FLOAT = 4
    STRING = 5
    SYMBOL_INDEX = 6
    SYMBOL = 7
    ROBOT = 8
    LIST = 9


def encode_delivery(delivery: Delivery, symbols: Mapping[str, int]) -> bytes:
    """Return the body of a delivery; `symbols` gives the program's symbols their numbers, 16 bits each.

    Raises WireError when a value is too long, or nested too deep, to be told.
    """
    due_ms = -(-delivery.due // NS_PER_MS)
    timed = 0 <= due_ms < 1 << 32
    out = bytearray((delivery.role << 4 | timed, *_length(delivery.index), len(delivery.args)))
    if delivery.role in NUMBERED:
        out += struct.pack(">Q", delivery.number)
    if timed:
        out += struct.pack(">I", due_ms)
    for arg in delivery.args:
        _encode_value(out, arg, symbols, 0)
    return bytes(out)


def role_of(body: bytes) -> int:
    """Return the role of the delivery in `body`, a `DeliveryRole` if a robot of this program has sent it."""
    return body[0] >> 4 if body else 0


def fact_of(body: bytes) -> int:
    """Return the predicate if the delivery in `body` is a fact, else -1."""
    return int.from_bytes(body[1:3], "big") if len(body) >= 4 and body[0] >> 4 == DeliveryRole.FACT else -1


def _length(value: int) -> bytes:
    if value > LENGTH_MAX:
        raise UnsendableError(f"a value of {value} octets or items is too long: at most {LENGTH_MAX}")
    return struct.pack(">H", value)


def _encode_value(out: bytearray, value: Value, symbols: Mapping[str, int], depth: int) -> None:
    if isinstance(value, bool):
        out.append(_Tag.TRUE if value else _Tag.FALSE)
    elif isinstance(value, Robot):
        out += struct.pack(">BH", _Tag.ROBOT, value)
    elif isinstance(value, int):
        out += struct.pack(">Bb", _Tag.INT8, value) if -128 <= value < 128 else struct.pack(">Bq", _Tag.INT64, value)
    elif isinstance(value, float):
        out += struct.pack(">Bd", _Tag.FLOAT, value)
    elif isinstance(value, str):
        _encode_text(out, value, symbols)
    elif depth >= LIST_DEPTH_MAX:
        raise UnsendableError("lists nested too deep")
    else:
        out += bytes((_Tag.LIST,)) + _length(len(value))
        for item in value:
            _encode_value(out, item, symbols, depth + 1)


def _encode_text(out: bytearray, value: str, symbols: Mapping[str, int]) -> None:
    if isinstance(value, Symbol) and value in symbols:
        out += bytes((_Tag.SYMBOL_INDEX,)) + _length(symbols[value])
        return
    try:
        octets = value.encode()
    except UnicodeEncodeError as error:
        raise WireError(f"a text that is no Unicode: {error.reason}") from error
    out += bytes((_Tag.SYMBOL if isinstance(value, Symbol) else _Tag.STRING,)) + _length(len(octets)) + octets


def decode_delivery(body: bytes, symbols: Sequence[str]) -> Delivery:
    """Return the delivery in `body`. Raises WireError."""
    try:
        head, index, count = struct.unpack_from(">BHB", body)
        role = DeliveryRole(head >> 4)
        reader = _Reader(body, 4, symbols)
        number = reader.number() if role in NUMBERED else 0
        due = reader.due() if head & 1 else NEVER
        args = tuple(reader.value(0) for _ in range(count))
    except (struct.error, IndexError, ValueError, UnicodeDecodeError) as error:
        raise WireError(f"fact: {error}") from error
    if head & 0x0E or reader.offset != len(body):
        raise WireError("fact: bits that mean nothing")
    return Delivery(role, index, args, number, due)


class _Reader:
    """Reads values off a body, left to right."""

    def __init__(self, data: bytes, offset: int, symbols: Sequence[str]) -> None:
        self.data = data
        self.offset = offset
        self.symbols = symbols

    def _take(self, form: str) -> int | float:
        value: int | float = struct.unpack_from(form, self.data, self.offset)[0]
        self.offset += struct.calcsize(form)
        return value

    def number(self) -> int:
        """Read a delivery's number."""
        return int(self._take(">Q"))

    def due(self) -> Instant:
        """Read a delivery's deadline."""
        return int(self._take(">I")) * NS_PER_MS

    def part(self) -> tuple[int, int]:
        """Read the predicate of shared facts, and how many follow."""
        return int(self._take(">H")), int(self._take(">B"))

    def value(self, depth: int) -> Value:
        """Read one value, so many lists deep."""
        tag = _Tag(int(self._take(">B")))
        match tag:
            case _Tag.FALSE | _Tag.TRUE:
                return tag is _Tag.TRUE
            case _Tag.INT8:
                return int(self._take(">b"))
            case _Tag.INT64:
                return max(INT_MIN, min(INT_MAX, int(self._take(">q"))))
            case _Tag.FLOAT:
                return float(self._take(">d"))
            case _Tag.ROBOT:
                return Robot(self._take(">H"))
            case _Tag.SYMBOL_INDEX:
                return Symbol(self.symbols[int(self._take(">H"))])
            case _Tag.LIST:
                if depth >= LIST_DEPTH_MAX:
                    raise WireError("lists nested too deep")
                return tuple(self.value(depth + 1) for _ in range(int(self._take(">H"))))
            case _Tag.STRING | _Tag.SYMBOL:
                return self._text(tag)

    def _text(self, tag: _Tag) -> str:
        length = int(self._take(">H"))
        octets = self.data[self.offset : self.offset + length]
        if len(octets) != length:
            raise WireError("text cut short")
        self.offset += length
        return Symbol(octets.decode()) if tag is _Tag.SYMBOL else octets.decode()

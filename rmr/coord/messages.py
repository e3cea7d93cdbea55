"""The frames of coordination, each exactly as long as its table says and never longer than a payload.

Every frame begins with 15 octets: kind, event (6, a hash of program, assertion and finish arguments), time
(ms of lab time) and term (counter, leader). All times are absolute or counted from `time`, so that a late or
relayed frame carries its own expiry. Numbers are big-endian.

Inside the core instants are nanoseconds; encoding rounds down to the unit of the field and saturates at its
ends, so that a far release or deadline stays far. Triggers and slots lie on the 10 ms grid.

A decoder believes nothing: a wrong length, an unknown kind or phase, or a part that cannot be raises
`MessageError`, which the receiver counts and drops.
"""

import struct
from collections.abc import Callable
from enum import IntEnum
from typing import Any, Final, NamedTuple

from rmr.base.direction import DIRECTION_MAX
from rmr.base.time import Duration, Instant
from rmr.coord.term import NOBODY, Term
from rmr.coord.timing import GRID, HEADWAY_UNIT, MS, PAYLOAD_MAX

ENTRIES_MAX: Final = 10
"""Entries of one SCHED frame: 24 + 9 x 10 = 114 octets. Where frames are shorter, `entries_max`."""
PARTS_MAX: Final = 15
"""Parts of one schedule: four bits."""
STEPS_MAX: Final = 242
"""Steps of one PATH frame: three bits each in 91 octets. Where frames are shorter, `steps_max`."""
GROUP_ID_OCTETS: Final = 6

_U16: Final = 0xFFFF
_U32: Final = 0xFFFFFFFF
_NO_START: Final = 0x7FFF
_UNDERWAY: Final = 0x10
"""Above the direction in its octet."""
_ABSENT_SHIFT: Final = 5
"""The three bits above that."""
_START_MAX: Final = 0x7FFE
_TRIGGER_SLACK: Final = 16
"""Grid units by which a trigger may lie after the schedule that lists it (clock errors, consecutive triggers)."""


class MessageError(ValueError):
    """The octets are no frame of coordination."""


class FrameKind(IntEnum):
    """First octet of a coordination frame; 0x01..0x0F belong to coordination."""

    JOB = 0x01
    SCHED = 0x02
    BEACON = 0x03
    PATH = 0x04


class Phase(IntEnum):
    """How far a job is, in beacons and in the entries of a schedule."""

    WAITING = 0
    """Entries only: noted, or with a slot ahead."""
    CLAIM = 1
    """About to enter."""
    IN = 2
    YIELD = 3
    """Will not enter in this slot after all."""
    OUT = 4
    GONE = 5
    """Beacons: over without entering. Entries: presumed over, for its owner has been silent for too long; not final."""
    PROVISIONAL = 6
    """Entries only: taken over from the predecessor's list; its owner should tell its job again."""


OVER: Final = frozenset((Phase.OUT, Phase.GONE))
"""Phases of entries that no longer delay others."""


class Job(NamedTuple):
    """JOB, 35 octets: "who leads this event?" (broadcast) or "list me" (unicast). The sender is its owner."""

    group_id: bytes
    time: Instant
    term: Term
    asked: Instant
    """When the owner asked first: the earlier asker goes on, the later waits."""
    trigger: Instant
    release: Instant
    duration: Duration
    deadline: Instant
    headway: Duration
    direction: int
    missed: Instant | None
    """Start of the slot that the owner let pass."""
    underway: bool = False
    """The owner has set out and was put off: others would have to pass it."""
    absent: int = 0
    """Slots in a row that the owner let pass because it was not ready to enter, and it is not ready yet."""


class Entry(NamedTuple):
    """One entry of a schedule, 9 octets. `robot` NOBODY: a rank without a robot."""

    robot: int
    trigger: Instant
    start: Instant | None
    duration: Duration
    direction: int
    phase: Phase


class Sched(NamedTuple):
    """SCHED, 24 + 9k octets: entries in order of rank; rank = passed + `entries_max` x part + position, from 1."""

    group_id: bytes
    issued: Instant
    term: Term
    resign: bool
    """The sender leads no more; `heir` shall."""
    heir: int
    opens: Duration
    """How long after `issued` slots are given (the paper's n); 0 when they are."""
    passed: int
    """Jobs of this event that were done before the first entry of part 0."""
    part: int
    parts: int
    entries: tuple[Entry, ...]


class Beacon(NamedTuple):
    """BEACON, 28 octets: what `who` is about to do, does or has done; repeated unchanged by witnesses."""

    group_id: bytes
    time: Instant
    term: Term
    who: int
    trigger: Instant
    phase: Phase
    direction: int
    start: Instant
    """CLAIM and YIELD: of the slot; else the instant of entry."""
    end: Instant


class PathPart(NamedTuple):
    """PATH, 25 octets and three bits a step: up to `steps_max` of the leader's path. Parts of one path share `time`."""

    group_id: bytes
    time: Instant
    term: Term
    direction: int
    part: int
    first: tuple[int, int]
    total: int
    """Steps of the whole path."""
    offset: int
    steps: tuple[int, ...]


Message = Job | Sched | Beacon | PathPart

_HEADER: Final = struct.Struct(">B6sIHH")
_JOB: Final = struct.Struct(">IIHHIBBh")
_SCHED: Final = struct.Struct(">BHHHBB")
_ENTRY: Final = struct.Struct(">HHhHB")
_BEACON: Final = struct.Struct(">HIBIH")
_PATH: Final = struct.Struct(">BBHHHH")

JOB_OCTETS: Final = _HEADER.size + _JOB.size
SCHED_OCTETS: Final = _HEADER.size + _SCHED.size
ENTRY_OCTETS: Final = _ENTRY.size
BEACON_OCTETS: Final = _HEADER.size + _BEACON.size
PATH_OCTETS: Final = _HEADER.size + _PATH.size


def entries_max(payload_max: int) -> int:
    """Return how many entries a SCHED frame has at most: 10, 9, 8 or 7 in 116, 107, 103 or 95 octets."""
    return min(ENTRIES_MAX, (payload_max - SCHED_OCTETS) // ENTRY_OCTETS)


def steps_max(payload_max: int) -> int:
    """Return how many steps a PATH frame has at most: 242, 218, 208 or 186 in 116, 107, 103 or 95 octets."""
    return min(STEPS_MAX, (payload_max - PATH_OCTETS) * 8 // 3)


def on_grid(instant: Instant) -> Instant:
    """Return `instant` rounded down to the grid of triggers and slots."""
    return instant - instant % GRID


def encode(message: Message) -> bytes:
    """Return the frame of `message`. Raises ValueError when it breaks a bound that no caller may break."""
    return _ENCODERS[type(message)](message)


def decode(payload: bytes, payload_max: int = PAYLOAD_MAX) -> Message:
    """Return the message in `payload`, `payload_max` octets at most. Raises MessageError for anything malformed."""
    if len(payload) < _HEADER.size or len(payload) > payload_max:
        raise MessageError(f"{len(payload)} octets are no frame")
    if payload[0] == FrameKind.PATH:
        return _decode_path(payload, steps_max(payload_max))
    decoder = _DECODERS.get(payload[0])
    if decoder is None:
        raise MessageError(f"kind {payload[0]} is unknown")
    return decoder(payload)


def _clamp(value: int, low: int, high: int) -> int:
    return low if value < low else min(value, high)


def _header(kind: FrameKind, group_id: bytes, time: Instant, term: Term) -> bytes:
    return _HEADER.pack(kind, group_id, _ms(time), term.counter, term.leader)


def _ms(instant: Instant) -> int:
    return _clamp(instant // MS, 0, _U32)


def _direction_phase(direction: int, phase: Phase) -> int:
    if not 0 <= direction <= DIRECTION_MAX:
        raise ValueError(f"direction {direction} does not fit four bits: use 0..{DIRECTION_MAX}")
    return direction << 4 | phase


def _split(octet: int, allowed: frozenset[int]) -> tuple[int, Phase]:
    if octet & 15 not in allowed:
        raise MessageError(f"phase {octet & 15} is unknown here")
    return octet >> 4, Phase(octet & 15)


_BEACON_PHASES: Final = frozenset((Phase.CLAIM, Phase.IN, Phase.YIELD, Phase.OUT, Phase.GONE))
_ENTRY_PHASES: Final = frozenset((Phase.WAITING, Phase.IN, Phase.OUT, Phase.GONE, Phase.PROVISIONAL))


def _encode_job(job: Job) -> bytes:
    base = job.time // GRID
    missed = _NO_START if job.missed is None else _clamp(job.missed // GRID - base, -0x8000, _START_MAX)
    return _header(FrameKind.JOB, job.group_id, job.time, job.term) + _JOB.pack(
        _ms(job.asked),
        _ms(job.trigger),
        _clamp(-(-job.release // GRID) - base, 0, _U16),
        _clamp(-(-job.duration // GRID), 0, _U16),
        _ms(job.deadline),
        _clamp(-(-job.headway // HEADWAY_UNIT), 0, 0xFF),
        _direction_phase(job.direction, Phase.WAITING) >> 4 | _UNDERWAY * job.underway | job.absent << _ABSENT_SHIFT,
        missed,
    )


def _decode_job(payload: bytes) -> Job:
    if len(payload) != JOB_OCTETS:
        raise MessageError(f"a JOB has {JOB_OCTETS} octets, not {len(payload)}")
    _, group_id, time, counter, leader = _HEADER.unpack_from(payload)
    asked, trigger, release, duration, deadline, headway, direction, missed = _JOB.unpack_from(payload, _HEADER.size)
    base = time * MS // GRID
    return Job(
        group_id,
        time * MS,
        Term(counter, leader),
        asked * MS,
        trigger * MS,
        (base + release) * GRID,
        duration * GRID,
        deadline * MS,
        headway * HEADWAY_UNIT,
        direction & DIRECTION_MAX,
        None if missed == _NO_START else (base + missed) * GRID,
        bool(direction & _UNDERWAY),
        direction >> _ABSENT_SHIFT,
    )


def _encode_sched(sched: Sched) -> bytes:
    if len(sched.entries) > ENTRIES_MAX or not 0 <= sched.part < sched.parts <= PARTS_MAX:
        raise ValueError("a SCHED has at most 10 entries and 15 parts")
    base = sched.issued // GRID
    pieces = [
        _header(FrameKind.SCHED, sched.group_id, sched.issued, sched.term),
        _SCHED.pack(
            sched.resign,
            sched.heir,
            _clamp(sched.opens // GRID, 0, _U16),
            sched.passed & _U16,
            sched.part << 4 | sched.parts,
            len(sched.entries),
        ),
    ]
    for robot, trigger, start, duration, direction, phase in sched.entries:
        offset = _NO_START if start is None else _clamp(start // GRID - base, -0x8000, _START_MAX)
        duration_units = _clamp(-(-duration // GRID), 0, _U16)
        pieces.append(
            _ENTRY.pack(robot, trigger // GRID & _U16, offset, duration_units, _direction_phase(direction, phase))
        )
    return b"".join(pieces)


def _decode_sched(payload: bytes) -> Sched:
    if len(payload) < SCHED_OCTETS:
        raise MessageError("a SCHED is cut short")
    _, group_id, issued, counter, leader = _HEADER.unpack_from(payload)
    flags, heir, opens, passed, part, count = _SCHED.unpack_from(payload, _HEADER.size)
    if flags > 1 or not part >> 4 < (part & 15) or count > ENTRIES_MAX or leader == NOBODY or counter == 0:
        raise MessageError("a SCHED with impossible fields")
    if len(payload) != SCHED_OCTETS + count * ENTRY_OCTETS:
        raise MessageError(f"a SCHED of {count} entries does not have {len(payload)} octets")
    base = issued * MS // GRID
    latest = base + _TRIGGER_SLACK
    entries = []
    for robot, trigger, offset, duration, octet in _ENTRY.iter_unpack(payload[SCHED_OCTETS:]):
        direction, phase = _split(octet, _ENTRY_PHASES)
        start = None if offset == _NO_START else (base + offset) * GRID
        trigger_at = (latest - ((latest - trigger) & _U16)) * GRID
        entries.append(Entry(robot, trigger_at, start, duration * GRID, direction, phase))
    return Sched(
        group_id,
        issued * MS,
        Term(counter, leader),
        bool(flags),
        heir,
        opens * GRID,
        passed,
        part >> 4,
        part & 15,
        tuple(entries),
    )


def _encode_beacon(beacon: Beacon) -> bytes:
    return _header(FrameKind.BEACON, beacon.group_id, beacon.time, beacon.term) + _BEACON.pack(
        beacon.who,
        _ms(beacon.trigger),
        _direction_phase(beacon.direction, beacon.phase),
        _ms(beacon.start),
        _clamp(-(-(beacon.end - beacon.start) // GRID), 0, _U16),
    )


def _decode_beacon(payload: bytes) -> Beacon:
    if len(payload) != BEACON_OCTETS:
        raise MessageError(f"a BEACON has {BEACON_OCTETS} octets, not {len(payload)}")
    _, group_id, time, counter, leader = _HEADER.unpack_from(payload)
    who, trigger, octet, start, length = _BEACON.unpack_from(payload, _HEADER.size)
    direction, phase = _split(octet, _BEACON_PHASES)
    if who == NOBODY:
        raise MessageError("a BEACON without a robot")
    start_at = start * MS
    return Beacon(
        group_id,
        time * MS,
        Term(counter, leader),
        who,
        trigger * MS,
        phase,
        direction,
        start_at,
        start_at + length * GRID,
    )


def _encode_path(path: PathPart) -> bytes:
    if len(path.steps) > STEPS_MAX:
        raise ValueError(f"a PATH frame has at most {STEPS_MAX} steps: split the path")
    bits = 0
    for step in path.steps:
        bits = bits << 3 | step
    octets = (3 * len(path.steps) + 7) // 8
    bits <<= 8 * octets - 3 * len(path.steps)
    return (
        _header(FrameKind.PATH, path.group_id, path.time, path.term)
        + _PATH.pack(path.direction, path.part, *path.first, path.total, path.offset)
        + bits.to_bytes(octets, "big")
    )


def _decode_path(payload: bytes, full: int) -> PathPart:
    if len(payload) < PATH_OCTETS:
        raise MessageError("a PATH is cut short")
    _, group_id, time, counter, leader = _HEADER.unpack_from(payload)
    direction, part, column, row, total, offset = _PATH.unpack_from(payload, _HEADER.size)
    count = min(full, total - offset)
    octets = (3 * max(count, 0) + 7) // 8
    if direction > DIRECTION_MAX or offset != part * full or count < 0 or len(payload) != PATH_OCTETS + octets:
        raise MessageError("a PATH with impossible fields")
    bits = int.from_bytes(payload[PATH_OCTETS:], "big") >> (8 * octets - 3 * count)
    steps = tuple(bits >> 3 * (count - 1 - i) & 7 for i in range(count))
    return PathPart(group_id, time * MS, Term(counter, leader), direction, part, (column, row), total, offset, steps)


_ENCODERS: Final[dict[type, Callable[[Any], bytes]]] = {
    Job: _encode_job,
    Sched: _encode_sched,
    Beacon: _encode_beacon,
    PathPart: _encode_path,
}
_DECODERS: Final[dict[int, Callable[[bytes], Message]]] = {
    int(FrameKind.JOB): _decode_job,
    int(FrameKind.SCHED): _decode_sched,
    int(FrameKind.BEACON): _decode_beacon,
}
"""The one table of kinds; only how a PATH is read depends on how long a frame may be."""

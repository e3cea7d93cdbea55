"""Reads the log of one mind: batches into calls, each with its inputs and outputs as values."""

from dataclasses import dataclass, field
from struct import Struct
from typing import Any, Final, NamedTuple
from zlib import crc32

from rmr.base.time import Instant
from rmr.mind import mind_format as form
from rmr.mind.fact_values import unpack
from rmr.node.ports import Confirmed, PoseFix, Received, SeenBody, Sensed

TRUTH: Final = (0.0, 0.0, 0.0)
"""What a sample of a replay says of the truth, which no mind sees and no log holds."""


class MindLogError(ValueError):
    """A batch cannot be used; the message says what is wrong with it."""


class LoggedOperation(NamedTuple):
    """One operation of a call."""

    kind: int
    value: Any
    octets: bytes
    """As it stands in the log."""


@dataclass(slots=True)
class MindCall:
    """One call of the node."""

    kind: int
    at: Instant
    octets: bytes = b""
    """All operations, the call itself included; without what the host says of itself."""
    operations: list[LoggedOperation] = field(default_factory=list)

    def inputs(self) -> list[LoggedOperation]:
        """Return the inputs that the node fetched."""
        return [each for each in self.operations if each.kind < form.TRANSMIT]


class Batch(NamedTuple):
    """One batch of the log."""

    number: int
    base: Instant
    header: bytes
    """Empty but in the first batch."""
    calls: list[MindCall]
    not_delivered: tuple[int, int, int] | None
    """Totals of samples and frames dropped and of frames refused, if they have changed."""
    end: tuple[int, int, int] | None
    """The last digest, if the log ends here in good order."""


def read_batch(data: bytes) -> Batch:
    """Return the batch in `data`. Raises MindLogError."""
    if len(data) < form.HEAD.size + form.CRC.size:
        raise MindLogError("a batch of the log is cut short")
    magic, version, _flags, number, base, header_size = form.HEAD.unpack_from(data)
    if magic != form.MAGIC:
        raise MindLogError("a batch of the log does not begin as one does")
    if version != form.VERSION:
        raise MindLogError(f"the log has format {version}; this rmr reads format {form.VERSION}")
    [crc] = form.CRC.unpack_from(data, len(data) - form.CRC.size)
    if crc32(data[: -form.CRC.size]) != crc:
        raise MindLogError(f"batch {number} of the log is damaged: its check sum differs")
    header = data[form.HEAD.size : form.HEAD.size + header_size]
    cursor = _Cursor(data, form.HEAD.size + header_size, len(data) - form.CRC.size)
    try:
        return Batch(number, base, header, *cursor.calls(base))
    except (ValueError, IndexError) as error:
        raise MindLogError(f"batch {number} of the log is malformed: {error}") from None


def operations_of(octets: bytes, base: Instant) -> MindCall:
    """Return the one call in `octets`; `base` is the instant of the previous call. Raises MindLogError."""
    try:
        [call], _, _ = _Cursor(octets, 0, len(octets)).calls(base)
    except (ValueError, IndexError) as error:
        raise MindLogError(f"a call of the log is malformed: {error}") from None
    return call


def calls_of(octets: bytes, base: Instant) -> list[MindCall]:
    """Return the calls in `octets`; `base` is the instant of the call before. Raises MindLogError."""
    try:
        calls, _, _ = _Cursor(octets, 0, len(octets)).calls(base)
    except (ValueError, IndexError) as error:
        raise MindLogError(f"a call of the log is malformed: {error}") from None
    return calls


class _Cursor:
    """A place in the octets of a batch."""

    def __init__(self, data: bytes, place: int, end: int) -> None:
        self._data = data
        self._place = place
        self._end = end
        self._now: Instant = 0

    def calls(self, base: Instant) -> tuple[list[MindCall], tuple[int, int, int] | None, tuple[int, int, int] | None]:
        """Return the calls up to the end, what was not delivered, and the last digest, if there are any."""
        calls: list[MindCall] = []
        not_delivered = None
        end = None
        self._now = base
        begun = self._place
        while self._place < self._end:
            start = self._place
            kind = self._data[start]
            if kind in form.CALLS:
                _, distance = self._unpack(form.CALL)
                self._now += distance
                calls.append(MindCall(kind, self._now))
                begun = start
            elif kind == form.NOT_DELIVERED:
                _, samples, frames, refused = self._unpack(form.NOT_DELIVERED_WHOLE)
                not_delivered = (samples, frames, refused)
                continue
            elif kind == form.END:
                _, outputs, everything, state = self._unpack(form.DIGEST_WHOLE)
                end = (outputs, everything, state)
                continue
            else:
                value = self._operation(kind)
                calls[-1].operations.append(LoggedOperation(kind, value, self._data[start : self._place]))
            calls[-1].octets = self._data[begun : self._place]
        return calls, not_delivered, end

    def _unpack(self, what: Struct) -> tuple[Any, ...]:
        if self._place + what.size > self._end:
            raise ValueError("an operation is cut short")
        found = what.unpack_from(self._data, self._place)
        self._place += what.size
        return found

    def _take(self, octets: int) -> bytes:
        if self._place + octets > self._end:
            raise ValueError("an operation is cut short")
        found = self._data[self._place : self._place + octets]
        self._place += octets
        return found

    def _operation(self, kind: int) -> Any:
        """Return the value of the operation at the cursor."""
        match kind:
            case form.OFFERED:
                self._place += 1
                return self._frame()
            case form.RECEIVED:
                _, count, again = self._unpack(form.RECEIVED_HEAD)
                return bool(again), [self._frame() for _ in range(count - again)]
            case form.CONFIRMED:
                _, count = self._unpack(form.COUNTED)
                return [self._outcome() for _ in range(count)]
            case form.SENSED:
                _, count = self._unpack(form.COUNTED)
                return [self._sample() for _ in range(count)]
            case form.OVERRUN:
                return self._unpack(form.COUNTED)[1]
            case form.FACT | form.NEIGHBORS | form.ACTED | form.NESTED | form.PROGRAM:
                return unpack(self._blob())
            case _:
                return self._output(kind)

    def _output(self, kind: int) -> Any:
        match kind:
            case form.TRANSMIT:
                _, to, handle, octets = self._unpack(form.TRANSMIT_HEAD)
                return None if to < 0 else to, handle, self._take(octets)
            case form.ACT:
                return self._unpack(form.ACT_WHOLE)[1:]
            case form.NOTE:
                return self._unpack(form.NOTE_WHOLE)[1:]
            case form.TAKEN:
                self._place += 1
                return None
            case form.RAISED:
                return self._blob().decode("utf-8", "replace")
            case form.DIGEST:
                return self._unpack(form.DIGEST_WHOLE)[1:]
            case _:
                raise ValueError(f"the unknown operation {kind}")

    def _blob(self) -> bytes:
        _, octets = self._unpack(form.BLOB)
        return self._take(octets)

    def _frame(self) -> Received:
        source, rssi_dbm, lqi, unicast, stamp, octets = self._unpack(form.FRAME)
        return Received(self._take(octets), source, bool(unicast), rssi_dbm, lqi, self._now + stamp)

    def _outcome(self) -> Confirmed:
        handle, status = self._unpack(form.OUTCOME)
        return Confirmed(handle, form.STATUSES[status])

    def _sample(self) -> Sensed:
        stamp, left_m, right_m, gyro, reading, flags, ranges, bodies = self._unpack(form.SAMPLE)
        compass = None if flags & form.NO_COMPASS else reading
        fix = PoseFix(*self._unpack(form.FIX)) if flags & form.FIXED else None
        told = unpack(self._blob()) if flags & form.TOLD else None
        heard = tuple([self._unpack(form.RANGE) for _ in range(ranges)])
        seen = tuple([SeenBody(*self._unpack(form.BODY)) for _ in range(bodies)])
        bumped = bool(flags & form.BUMPED)
        return Sensed(self._now + stamp, left_m, right_m, gyro, compass, heard, seen, bumped, TRUTH, fix, told)

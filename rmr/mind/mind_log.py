"""Writes the log of one mind (`mind_format`), operation by operation, in batches of a second of lab time.

An operation is kept as the values that it consists of, which never change, and all operations of a batch are encoded
together. Encoding each at once costs a robot process several times as much: its calls are milliseconds apart, and by
the next one other code has displaced the encoder from the caches of the processor.

This module is compiled where a build is, as each frame and each sample passes it.
"""

from collections.abc import Callable
from typing import Final, cast
from zlib import crc32

from rmr.base.geometry import Twist
from rmr.base.time import NS_PER_S, Instant
from rmr.mind.fact_values import pack
from rmr.mind.mind_format import (
    ACT,
    ACTED,
    BUMPED,
    CALLS,
    CONFIRMED,
    CRC,
    DIGEST,
    END,
    FACT,
    FIXED,
    HAS_HEADER,
    HEAD,
    MAGIC,
    NEIGHBORS,
    NESTED,
    NO_COMPASS,
    NOT_DELIVERED,
    NOTE,
    OFFERED,
    OVERRUN,
    PROGRAM,
    RAISED,
    RECEIVED,
    SENSED,
    STATUSES,
    TAKEN,
    TOLD,
    TRANSMIT,
    VERSION,
    pack_act,
    pack_blob,
    pack_body,
    pack_call,
    pack_counted,
    pack_digest,
    pack_fix,
    pack_frame,
    pack_not_delivered,
    pack_note,
    pack_outcome,
    pack_range,
    pack_received,
    pack_sample,
    pack_transmit,
)
from rmr.node.ports import Confirmed, Received, Sensed

MindSink = Callable[[Instant, int, int, bytes], None]
"""Takes a batch: instant, robot, epoch, octets."""

_OFFERED: Final = bytes([OFFERED])
_TAKEN: Final = bytes([TAKEN])
_OUTPUT: Final = 0
"""Before the octets of an output that is encoded already; no operation has this number."""
_STATUS: Final = {status: number for number, status in enumerate(STATUSES)}


class MindLog:
    """The log of one incarnation."""

    def __init__(self, robot: int, epoch: int, header: bytes, sink: MindSink | None) -> None:
        """Without a `sink` the operations stay here until they are taken (`take`)."""
        self._robot = robot
        self._epoch = epoch
        self._header = header
        self._sink = sink
        self._operations: list[object] = []
        """Operations that are not encoded yet: the number of each, then its values; or its octets."""
        self._packed_base: Instant = 0
        """The instant of the call before the first operation that is not encoded yet."""
        self._number = 0
        self.base: Instant = 0
        """The instant of the previous call, or the base of the batch."""
        self._batch_base: Instant = 0
        self._crc = 0
        """Of the outputs since the last digest that are encoded."""
        self._crc_all = 0
        """Of all operations since the last digest that are encoded."""
        self.asks = 0
        """Questions after the time of the frame, within this call."""
        self.refused: Received | None = None
        """The frame that `overhear` refused last."""
        self.closed = False
        self._lost = (0, 0, 0)
        self._lost_logged = (0, 0, 0)

    def begin(self, now: Instant) -> None:
        """Let the log begin at `now`."""
        self.rebase(now)
        self._batch_base = now

    def rebase(self, base: Instant) -> None:
        """Let `base` be the instant of the previous call."""
        self.base = base
        self._packed_base = base

    # -- calls --------------------------------------------------------------------------------------------------

    def call(self, operation: int, now: Instant) -> None:
        """Begin a call."""
        self.asks = 0
        self._operations.append(operation)
        self._operations.append(now)
        self.base = now

    def overheard(self, frame: Received) -> None:
        """Log the frame of a call that has just begun."""
        self._operations.append(OFFERED)
        self._operations.append(frame)

    def inserted(self, fact: bytes) -> None:
        """Log the fact of a call that has just begun."""
        self._blob(FACT, fact)

    def program(self, program: bytes) -> None:
        """Log the new program of a call that has just begun."""
        self._blob(PROGRAM, program)

    def _blob(self, operation: int, data: bytes) -> None:
        self._operations.append(pack_blob(operation, len(data)) + data)

    # -- inputs -------------------------------------------------------------------------------------------------

    def received(self, frames: list[Received]) -> None:
        """Log what the link has delivered; the first frame may be the one that was refused before."""
        again = frames[0] is self.refused
        self.refused = None
        operations = self._operations
        operations.append(RECEIVED)
        operations.append(frames)
        operations.append(again)

    def confirmed(self, outcomes: list[Confirmed]) -> None:
        """Log outcomes of requests."""
        self._operations.append(CONFIRMED)
        self._operations.append(outcomes)

    def sensed(self, samples: list[Sensed]) -> None:
        """Log samples of the body, without the truth, which is not for the mind."""
        self._operations.append(SENSED)
        self._operations.append(samples)

    def overrun(self) -> None:
        """Log that the time of the frame is used up at the present question."""
        self._operations.append(pack_counted(OVERRUN, self.asks))

    def neighbors(self, offered: bytes) -> None:
        """Log who is in range, as the host has it."""
        self._blob(NEIGHBORS, offered)

    def nested(self, fact: bytes) -> None:
        """Log a fact that is inserted within a call."""
        self._blob(NESTED, fact)

    def acted(self, step: bytes) -> None:
        """Log a step of a user's handler."""
        self._blob(ACTED, step)

    def again(self, operation: bytes) -> None:
        """Log an operation as it stands in another log."""
        self._operations.append(operation)

    # -- outputs ------------------------------------------------------------------------------------------------

    def _output(self, octets: bytes) -> None:
        self._operations.append(_OUTPUT)
        self._operations.append(octets)

    def transmit(self, payload: bytes, destination: int | None, handle: int) -> None:
        """Log a frame that the node hands to its radio."""
        to = -1 if destination is None else destination
        self._output(pack_transmit(TRANSMIT, to, handle, len(payload)) + payload)

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Log a wheel command."""
        operations = self._operations
        operations.append(ACT)
        operations.append(twist)
        operations.append(stamp)

    def note(self, word: int, fields: bytes) -> None:
        """Log an entry of the trace."""
        self._output(pack_note(NOTE, word, crc32(fields)))

    def taken(self) -> None:
        """Log that the frame was taken in."""
        self._output(_TAKEN)

    def raised(self, text: str) -> None:
        """Log the exception that ended the call."""
        data = text.encode("utf-8", "backslashreplace")
        self._output(pack_blob(RAISED, len(data)) + data)

    def digest(self, state: bytes) -> None:
        """Log the digests of all that was logged up to the last `flush` or `take`, and of the node's `state`."""
        self._operations.append(pack_digest(DIGEST, *self.digests(state)))
        self._crc = 0
        self._crc_all = 0

    # -- batches ------------------------------------------------------------------------------------------------

    def not_delivered(self, samples: int, frames: int, refused: int) -> None:
        """Take totals of samples and frames that the host has dropped, and of frames that it has refused."""
        self._lost = (samples, frames, refused)

    def digests(self, state: bytes) -> tuple[int, int, int]:
        """Return the digests of what was logged up to the last `flush` or `take`, and of the node's `state`."""
        return self._crc, self._crc_all, crc32(state)

    def end(self, state: bytes) -> None:
        """End the log in good order; nothing is logged any more."""
        if not self.closed:
            self._flush(state)
            self.closed = True

    def flush(self) -> None:
        """Hand over what has been logged, up to a call that is over."""
        self._flush(None)

    def _flush(self, state: bytes | None) -> None:
        """Hand over what has been logged, with the end of the log if there is a last `state`."""
        sink = self._sink
        if sink is None:
            return
        body = self.take()
        ends: list[bytes] = []
        if self._lost != self._lost_logged:
            self._lost_logged = self._lost
            samples, frames, refused = self._lost
            ends.append(pack_not_delivered(NOT_DELIVERED, samples, frames, refused))
        if state is not None:
            ends.append(pack_digest(END, *self.digests(state)))
        if not self.closed and (body or ends or self._header):
            flags = HAS_HEADER if self._header else 0
            head = HEAD.pack(MAGIC, VERSION, flags, self._number, self._batch_base, len(self._header))
            data = b"".join([head, self._header, body, *ends])
            sink(self.base, self._robot, self._epoch, data + CRC.pack(crc32(data)))
            self._number += 1
            self._header = b""
        self._batch_base = self.base

    def take(self) -> bytes:
        """Return and forget what has been logged since the last call; for a log without a sink."""
        operations = self._operations
        self._operations = []
        taken = self._encoded(operations)
        self._crc_all = crc32(taken, self._crc_all)
        return taken

    def _encoded(self, operations: list[object]) -> bytes:
        """Return the octets of `operations`, and add the outputs among them to their check sum."""
        parts: list[bytes] = []
        outputs: list[bytes] = []
        base = self._packed_base
        count = len(operations)
        place = 0
        while place < count:
            first = operations[place]
            if isinstance(first, bytes):
                parts.append(first)
                place += 1
                continue
            operation = cast(int, first)
            value = operations[place + 1]
            place += 2
            if operation in CALLS:
                now = cast(int, value)
                parts.append(pack_call(operation, now - base))
                base = now
            elif operation == OFFERED:
                parts.append(_OFFERED)
                _encode_frame(parts, cast(Received, value), base)
            elif operation == RECEIVED:
                _encode_frames(parts, cast(list[Received], value), cast(bool, operations[place]), base)
                place += 1
            elif operation == CONFIRMED:
                _encode_outcomes(parts, cast(list[Confirmed], value))
            elif operation == SENSED:
                _encode_samples(parts, cast(list[Sensed], value), base)
            else:
                if operation == ACT:
                    twist = cast(Twist, value)
                    output = pack_act(ACT, twist.v, twist.w, cast(int, operations[place]) - base)
                    place += 1
                else:
                    output = cast(bytes, value)
                parts.append(output)
                outputs.append(output)
        self._packed_base = base
        self._crc = crc32(b"".join(outputs), self._crc)
        return b"".join(parts)


def _encode_frame(parts: list[bytes], frame: Received, base: Instant) -> None:
    payload = frame.payload
    head = pack_frame(frame.source, frame.rssi_dbm, frame.lqi, frame.unicast, frame.stamp - base, len(payload))
    parts.append(head)
    parts.append(payload)


def _encode_frames(parts: list[bytes], frames: list[Received], again: bool, base: Instant) -> None:
    parts.append(pack_received(RECEIVED, len(frames), again))
    for frame in frames[1:] if again else frames:
        _encode_frame(parts, frame, base)


def _encode_outcomes(parts: list[bytes], outcomes: list[Confirmed]) -> None:
    parts.append(pack_counted(CONFIRMED, len(outcomes)))
    parts.extend([pack_outcome(outcome.handle, _STATUS[outcome.status]) for outcome in outcomes])


def _encode_samples(parts: list[bytes], samples: list[Sensed], base: Instant) -> None:
    parts.append(pack_counted(SENSED, len(samples)))
    for sample in samples:
        ranges = sample.ranges
        bodies = sample.bodies
        compass = sample.compass
        fix = sample.fix
        flags = BUMPED if sample.bumped else 0
        flags |= (NO_COMPASS if compass is None else 0) | (0 if fix is None else FIXED)
        flags |= 0 if sample.facts is None else TOLD
        parts.append(
            pack_sample(
                sample.stamp - base,
                sample.left_m,
                sample.right_m,
                sample.gyro,
                0.0 if compass is None else compass,
                flags,
                len(ranges),
                len(bodies),
            )
        )
        if fix is not None:
            parts.append(pack_fix(fix.x, fix.y, fix.theta, fix.sigma_m, fix.sigma_rad))
        if sample.facts is not None:
            told = pack(sample.facts)
            parts.append(pack_blob(TOLD, len(told)) + told)
        for beacon, metres in ranges:
            parts.append(pack_range(beacon, metres))
        parts.extend([pack_body(body.x, body.y, body.vx, body.vy) for body in bodies])


def next_second(now: Instant) -> Instant:
    """Return the first whole second after `now`."""
    return (now // NS_PER_S + 1) * NS_PER_S

"""Writes the log of one mind (`mind_format`), operation by operation, in batches of a second of lab time.

This module is compiled where a build is, as each frame and each sample passes it.
"""

from collections.abc import Callable
from typing import Final
from zlib import crc32

from rmr.base.geometry import Twist
from rmr.base.time import NS_PER_S, Instant
from rmr.mind.mind_format import (
    ACT,
    ACTED,
    CONFIRMED,
    CRC,
    DIGEST,
    END,
    FACT,
    HAS_HEADER,
    HEAD,
    MAGIC,
    NEIGHBORS,
    NESTED,
    NOT_DELIVERED,
    NOTE,
    OFFERED,
    OVERRUN,
    RAISED,
    RECEIVED,
    SENSED,
    STATUSES,
    TAKEN,
    TRANSMIT,
    VERSION,
    pack_act,
    pack_blob,
    pack_body,
    pack_call,
    pack_counted,
    pack_digest,
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
_STATUS: Final = {status: number for number, status in enumerate(STATUSES)}


class MindLog:
    """The log of one incarnation."""

    def __init__(self, robot: int, epoch: int, header: bytes, sink: MindSink | None) -> None:
        """Without a `sink` the operations stay here until they are taken (`take`)."""
        self._robot = robot
        self._epoch = epoch
        self._header = header
        self._sink = sink
        self._parts: list[bytes] = []
        self._number = 0
        self.base: Instant = 0
        """The instant of the previous call, or the base of the batch."""
        self._batch_base: Instant = 0
        self._crc = 0
        """Of the outputs since the last digest."""
        self._crc_all = 0
        """Of all operations since the last digest, as far as they are no more here."""
        self.asks = 0
        """Questions after the time of the frame, within this call."""
        self.refused: Received | None = None
        """The frame that `overhear` refused last."""
        self.closed = False
        self._lost = (0, 0, 0)
        self._lost_logged = (0, 0, 0)

    def begin(self, now: Instant) -> None:
        """Let the log begin at `now`."""
        self.base = now
        self._batch_base = now

    # -- calls --------------------------------------------------------------------------------------------------

    def call(self, operation: int, now: Instant) -> None:
        """Begin a call."""
        self.asks = 0
        self._parts.append(pack_call(operation, now - self.base))
        self.base = now

    def overheard(self, frame: Received) -> None:
        """Log the frame of a call that has just begun."""
        self._parts.append(_OFFERED)
        self._frame(frame)

    def inserted(self, fact: bytes) -> None:
        """Log the fact of a call that has just begun."""
        self._blob(FACT, fact)

    def _frame(self, frame: Received) -> None:
        payload = frame.payload
        head = pack_frame(frame.source, frame.rssi_dbm, frame.lqi, frame.unicast, frame.stamp - self.base, len(payload))
        self._parts.append(head)
        self._parts.append(payload)

    def _blob(self, operation: int, data: bytes) -> None:
        self._parts.append(pack_blob(operation, len(data)))
        self._parts.append(data)

    # -- inputs -------------------------------------------------------------------------------------------------

    def received(self, frames: list[Received]) -> None:
        """Log what the link has delivered; the first frame may be the one that was refused before."""
        again = frames[0] is self.refused
        self.refused = None
        self._parts.append(pack_received(RECEIVED, len(frames), again))
        for frame in frames[1:] if again else frames:
            self._frame(frame)

    def confirmed(self, outcomes: list[Confirmed]) -> None:
        """Log outcomes of requests."""
        self._parts.append(pack_counted(CONFIRMED, len(outcomes)))
        for outcome in outcomes:
            self._parts.append(pack_outcome(outcome.handle, _STATUS[outcome.status]))

    def sensed(self, samples: list[Sensed]) -> None:
        """Log samples of the body, without the truth, which is not for the mind."""
        parts = self._parts
        base = self.base
        parts.append(pack_counted(SENSED, len(samples)))
        for sample in samples:
            ranges = sample.ranges
            bodies = sample.bodies
            parts.append(
                pack_sample(
                    sample.stamp - base,
                    sample.left_m,
                    sample.right_m,
                    sample.gyro,
                    sample.compass,
                    sample.bumped,
                    len(ranges),
                    len(bodies),
                )
            )
            for beacon, metres in ranges:
                parts.append(pack_range(beacon, metres))
            for body in bodies:
                parts.append(pack_body(body.x, body.y, body.vx, body.vy))

    def overrun(self) -> None:
        """Log that the time of the frame is used up at the present question."""
        self._parts.append(pack_counted(OVERRUN, self.asks))

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
        self._parts.append(operation)

    # -- outputs ------------------------------------------------------------------------------------------------

    def _output(self, part: bytes) -> None:
        self._parts.append(part)
        self._crc = crc32(part, self._crc)

    def transmit(self, payload: bytes, destination: int | None, handle: int) -> None:
        """Log a frame that the node hands to its radio."""
        to = -1 if destination is None else destination
        self._output(pack_transmit(TRANSMIT, to, handle, len(payload)))
        self._output(payload)

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Log a wheel command."""
        self._output(pack_act(ACT, twist.v, twist.w, stamp - self.base))

    def note(self, word: int, fields: bytes) -> None:
        """Log an entry of the trace."""
        self._output(pack_note(NOTE, word, crc32(fields)))

    def taken(self) -> None:
        """Log that the frame was taken in."""
        self._output(_TAKEN)

    def raised(self, text: str) -> None:
        """Log the exception that ended the call."""
        data = text.encode("utf-8", "backslashreplace")
        self._output(pack_blob(RAISED, len(data)))
        self._output(data)

    def digest(self, state: bytes) -> None:
        """Log the digests of all that was logged up to the last `flush` or `take`, and of the node's `state`."""
        self._parts.append(pack_digest(DIGEST, *self.digests(state)))
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
        body = b"".join(self._parts)
        self._crc_all = crc32(body, self._crc_all)
        self._parts.clear()
        if body:
            self._parts.append(body)
        if self._lost != self._lost_logged:
            self._lost_logged = self._lost
            samples, frames, refused = self._lost
            self._parts.append(pack_not_delivered(NOT_DELIVERED, samples, frames, refused))
        if state is not None:
            self._parts.append(pack_digest(END, *self.digests(state)))
        if not self.closed and (self._parts or self._header):
            flags = HAS_HEADER if self._header else 0
            head = HEAD.pack(MAGIC, VERSION, flags, self._number, self._batch_base, len(self._header))
            data = b"".join([head, self._header, *self._parts])
            sink(self.base, self._robot, self._epoch, data + CRC.pack(crc32(data)))
            self._number += 1
            self._header = b""
        self._parts.clear()
        self._batch_base = self.base

    def take(self) -> bytes:
        """Return and forget what has been logged since the last call; for a log without a sink."""
        taken = b"".join(self._parts)
        self._crc_all = crc32(taken, self._crc_all)
        self._parts.clear()
        return taken


def next_second(now: Instant) -> Instant:
    """Return the first whole second after `now`."""
    return (now // NS_PER_S + 1) * NS_PER_S

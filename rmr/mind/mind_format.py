"""The octets of the log of one mind: batches of operations.

A batch has a head, for the first batch of an incarnation its header (`mind_header`), operations, and a check sum:

    head     magic "RM", version, flags, number (from 0), base instant, length of the header
    header   msgpack; in the first batch only
    body     operations; the first is a call
    crc32    of all that precedes it

A *call* is what the host calls the node with: start, tick, overhear, insert, change of program. All operations up to
the next call belong to it: inputs that the node fetched from its ports in this call, and outputs. A batch contains
whole calls. The instant of a call is stored as the distance from the previous call, in the first call of a batch from
the base.

All numbers are little endian. Instants are nanoseconds of lab time, in 8 octets.
"""

from collections.abc import Callable
from struct import Struct
from typing import Final

MAGIC: Final = b"RM"
VERSION: Final = 1
HAS_HEADER: Final = 1
"""Flag of a batch: a header follows its head."""
HEAD: Final = Struct("<2sBBIqI")
"""Magic, version, flags, number, base instant, octets of the header."""
CRC: Final = Struct("<I")

# Calls.
START: Final = 1
TICK: Final = 2
OVERHEAR: Final = 3
INSERT: Final = 4
CHANGE: Final = 5
"""The node goes on with another program."""
CALLS: Final = (START, TICK, OVERHEAR, INSERT, CHANGE)

# Inputs within a call.
OFFERED: Final = 8
"""The frame of an `overhear`."""
FACT: Final = 9
"""Length and msgpack of [predicate, [arguments]], of an `insert`."""
RECEIVED: Final = 10
"""Number of frames; whether the first is the one that `overhear` last refused, which is not repeated; the others."""
CONFIRMED: Final = 11
"""Number of outcomes, then the outcomes."""
SENSED: Final = 12
"""Number of samples, then the samples."""
OVERRUN: Final = 13
"""The time of the frame was used up at this question after it, counted from 0 within the call."""
NEIGHBORS: Final = 14
"""Length and msgpack of [[robot, metres], ...]: what the host offers from now on."""
ACTED: Final = 15
"""Length and msgpack of a step of a user's handler (`recorded_actions`)."""
NESTED: Final = 16
"""Length and msgpack of [number of an event, predicate, [arguments]]: a fact that the witness inserted when it was told
of this event of the call, counted from 1."""

PROGRAM: Final = 17
"""Length and msgpack of [digest, byte-code] of the new program, of a `change`."""

# Outputs.
TRANSMIT: Final = 20
"""Destination (-1: everybody), handle, length, payload."""
ACT: Final = 21
"""Speed, turn rate, and the stamp as its distance from the call."""
NOTE: Final = 22
"""An entry of the trace: the place of its word in `EVENTS`, and the CRC of its fields."""
TAKEN: Final = 23
"""The frame of an `overhear` was taken in."""
RAISED: Final = 24
"""Length and text of the exception that ended the call."""
DIGEST: Final = 25
"""Once a second: CRCs of the outputs since the previous digest, of all operations since then, and of a part of the
node's state before this call."""

# Of the host: neither input nor output of the mind.
NOT_DELIVERED: Final = 30
"""Samples and frames that the host dropped because a queue was full, and frames that it refused; totals."""
END: Final = 31
"""The incarnation ended, or the recording did, in good order; with a last digest."""

CALL: Final = Struct("<Bq")
FRAME: Final = Struct("<HdBBqB")
"""Source, RSSI, LQI, whether it is a unicast, stamp as its distance from the call, octets of the payload."""
RECEIVED_HEAD: Final = Struct("<BHB")
COUNTED: Final = Struct("<BH")
OUTCOME: Final = Struct("<IB")
SAMPLE: Final = Struct("<qddddBHH")
"""Stamp as its distance from the call, left, right, gyro, compass, flags, number of ranges, of bodies."""
BUMPED: Final = 1
NO_COMPASS: Final = 2
"""The robot has none; the place of its reading holds 0."""
FIXED: Final = 4
"""A fix follows the sample."""
FIX: Final = Struct("<ddddd")
TOLD: Final = 8
"""Facts from outside follow, packed."""
RANGE: Final = Struct("<Hd")
BODY: Final = Struct("<dddd")
BLOB: Final = Struct("<BI")
TRANSMIT_HEAD: Final = Struct("<BiIB")
ACT_WHOLE: Final = Struct("<Bddq")
NOTE_WHOLE: Final = Struct("<BBI")
DIGEST_WHOLE: Final = Struct("<BIII")
NOT_DELIVERED_WHOLE: Final = Struct("<BQQQ")

STATUSES: Final = ("ok", "no_ack", "access_failure")
"""The outcomes of a request, by their number in the log."""

# The bound methods: compiled code would look them up at each call.
Pack = Callable[..., bytes]
pack_call: Final[Pack] = CALL.pack
pack_frame: Final[Pack] = FRAME.pack
pack_received: Final[Pack] = RECEIVED_HEAD.pack
pack_counted: Final[Pack] = COUNTED.pack
pack_outcome: Final[Pack] = OUTCOME.pack
pack_sample: Final[Pack] = SAMPLE.pack
pack_fix: Final[Pack] = FIX.pack
pack_range: Final[Pack] = RANGE.pack
pack_body: Final[Pack] = BODY.pack
pack_blob: Final[Pack] = BLOB.pack
pack_transmit: Final[Pack] = TRANSMIT_HEAD.pack
pack_act: Final[Pack] = ACT_WHOLE.pack
pack_note: Final[Pack] = NOTE_WHOLE.pack
pack_digest: Final[Pack] = DIGEST_WHOLE.pack
pack_not_delivered: Final[Pack] = NOT_DELIVERED_WHOLE.pack

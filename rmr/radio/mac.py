"""Medium access: unslotted CSMA/CA, acknowledgements and retries of IEEE 802.15.4-2006 (7.5.1.4, 7.5.6).

One request at a time, in order. A request waits 0..2^BE - 1 backoff periods, assesses the channel for 128 us
and, if that is clear, transmits 192 us later. A busy channel raises BE and is tried again, at most five times
in all; then the request has failed to get access. A unicast waits for its acknowledgement and is transmitted at
most four times; access lost on a retry ends the request as well (7.5.6.5).

    state      event                               next state            output
    idle       request                             backoff
    backoff    channel clear                       sending               Transmission
    backoff    channel busy, fewer than 5 times    backoff, BE + 1
    backoff    channel busy, the 5th time          idle                  Confirmed access_failure
    sending    end, no acknowledgement wanted      idle                  Confirmed ok
    sending    end, acknowledgement wanted         waiting
    waiting    acknowledged                        idle                  Confirmed ok
    waiting    deadline, fewer than 4 attempts     backoff, BE = 3
    waiting    deadline, after the 4th             idle                  Confirmed no_ack

Requests wait in line. Those with a deadline exchange places among each other, earliest deadline first, and equal ones
stay in order; a request without one keeps its place, so that none of the others overtakes it.

Idle goes on to the next request at once, but keeps the interframe space after the last frame. The machine
performs no I/O: `next_wake` says when it wants `fire`, which is told whether the channel is busy.
"""

from collections import deque
from enum import Enum
from random import Random
from typing import Final, NamedTuple

from rmr.base.time import NEVER, NS_PER_US, Duration, Instant
from rmr.radio.air import SEQUENCE_MASK, Confirmed
from rmr.radio.frame import BROADCAST, DataFrame, encode_data
from rmr.radio.phy import CCA, TURNAROUND, airtime
from rmr.radio.security import Security

BACKOFF_PERIOD: Final[Duration] = 320 * NS_PER_US
"""aUnitBackoffPeriod."""
BE_MIN: Final = 3
"""macMinBE."""
BE_MAX: Final = 5
"""macMaxBE."""
BACKOFFS_MAX: Final = 4
"""macMaxCSMABackoffs: the fifth busy channel is the last."""
RETRIES_MAX: Final = 3
"""macMaxFrameRetries."""
ACK_WAIT: Final[Duration] = 864 * NS_PER_US
"""macAckWaitDuration."""
SHORT_FRAME_OCTETS: Final = 18
"""aMaxSIFSFrameSize."""
SHORT_SPACE: Final[Duration] = 192 * NS_PER_US
LONG_SPACE: Final[Duration] = 640 * NS_PER_US
"""Interframe spaces after short and long frames (macMinSIFSPeriod, macMinLIFSPeriod: 12 and 40 symbols)."""

QUEUE_MAX: Final = 64
"""Capacity of the queue of requests: nearly half a second of full-sized frames. A request beyond it fails at once, so
that a sender that offers more than the channel carries is notified."""


class State(Enum):
    """The states of the table at the head of this module."""

    IDLE = "idle"
    BACKOFF = "backoff"
    SENDING = "sending"
    WAITING = "waiting"


class Transmission(NamedTuple):
    """A frame to put on the air."""

    psdu: bytes
    sequence: int
    """32 bits; the frame bears its low octet."""
    attempt: int
    start: Instant
    end: Instant


class _Request(NamedTuple):
    psdu: bytes
    sequence: int
    wants_ack: bool
    handle: int
    due: Instant = NEVER
    """The deadline; NEVER: the request keeps its place."""
    frame: DataFrame | None = None
    """The frame, to be secured when its turn comes."""


class Mac:
    """The medium access of one station."""

    __slots__ = (
        "_address",
        "_attempt",
        "_backoffs",
        "_current",
        "_exponent",
        "_pan",
        "_patience",
        "_queue",
        "_rng",
        "_security",
        "_sent_end",
        "_sequence",
        "_space_until",
        "next_wake",
        "state",
    )

    def __init__(
        self, address: int, pan: int, rng: Random, patience: Duration = 0, security: Security | None = None
    ) -> None:
        """`patience` is added to macAckWaitDuration, where acknowledgements are announced late."""
        self._address = address
        self._pan = pan
        self._rng = rng
        self._patience = patience
        self._security = security
        self._queue: deque[_Request] = deque()
        self._current: _Request | None = None
        self._sequence = rng.getrandbits(8)
        self._attempt = self._backoffs = 0
        self._exponent = BE_MIN
        self._sent_end = self._space_until = 0
        self.state = State.IDLE
        self.next_wake: Instant = NEVER

    def request(self, now: Instant, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> bool:
        """Queue `payload`, due at `due`; False if the queue is full, or the frame counter used up.

        Raises `ValueError` if it cannot be a frame.
        """
        security = self._security
        if len(self._queue) >= QUEUE_MAX or (security is not None and security.left <= len(self._queue)):
            return False
        unicast = destination is not None and destination != BROADCAST
        frame = DataFrame(
            self._pan,
            destination if unicast and destination is not None else BROADCAST,
            self._address,
            self._sequence & 0xFF,
            unicast,
            payload,
        )
        psdu = encode_data(frame)
        if security is not None:
            security.check(frame)
        self._enqueue(_Request(psdu, self._sequence, unicast, handle, due, frame))
        self._sequence = (self._sequence + 1) & SEQUENCE_MASK
        if self.state is State.IDLE:
            self._begin_next(now)
        return True

    def _enqueue(self, request: _Request) -> None:
        """Append `request`; then let it change places, from the back, with those that are due later."""
        queue = self._queue
        queue.append(request)
        if request.due == NEVER:
            return
        place = len(queue) - 1
        for other in range(place - 1, -1, -1):
            due = queue[other].due
            if due == NEVER:
                continue
            if due <= request.due:
                return
            queue[place] = queue[other]
            queue[other] = request
            place = other

    @property
    def queued(self) -> int:
        """Number of requests that wait for the present one to be over."""
        return len(self._queue)

    def fire(self, busy: bool) -> Transmission | Confirmed | None:
        """Handle what is due at `next_wake`; `busy` is the channel there, if the state is ``BACKOFF``."""
        if self.state is State.BACKOFF:
            return self._assessed(self.next_wake, busy)
        if self.state is State.SENDING:
            return self._sent(self.next_wake)
        assert self.state is State.WAITING, "an idle MAC has no timer"
        return self._unanswered(self.next_wake)

    def awaits_ack(self, sequence: int, start: Instant) -> bool:
        """Whether an acknowledgement of `sequence` (0..255) that starts at `start` is the one waited for."""
        return (
            self._current is not None
            and self._current.wants_ack
            and self.state in (State.SENDING, State.WAITING)
            and self._current.sequence & 0xFF == sequence
            and self._sent_end <= start < self._sent_end + ACK_WAIT
        )

    def acknowledged(self, now: Instant, ack_end: Instant) -> Confirmed:
        """Finish the request whose acknowledgement `awaits_ack`; its last symbol arrived at `ack_end`."""
        return self._finish(now, "ok", ack_end)

    def back_off_again(self, now: Instant) -> None:
        """Begin the present backoff anew `now`: its host was held up, and the air of that time is past."""
        assert self.state is State.BACKOFF, "only a backoff can be begun anew"
        self._backoff(now)

    def _backoff(self, now: Instant) -> None:
        self.state = State.BACKOFF
        self.next_wake = now + self._rng.getrandbits(self._exponent) * BACKOFF_PERIOD + CCA

    def _begin_attempt(self, now: Instant) -> None:
        self._backoffs = 0
        self._exponent = BE_MIN
        self._backoff(now)

    def _begin_next(self, now: Instant) -> None:
        if not self._queue:
            self.state = State.IDLE
            self.next_wake = NEVER
            self._current = None
            return
        request = self._queue.popleft()
        if self._security is not None and request.frame is not None:
            # In the order of sending: receivers refuse a counter below one that they have heard. Secured once:
            # a retransmission repeats the octets, and so the frame counter (7.5.6.5).
            request = request._replace(psdu=self._security.protect(request.frame))
        self._current = request
        self._attempt = 0
        self._begin_attempt(max(now, self._space_until))

    def _assessed(self, now: Instant, busy: bool) -> Transmission | Confirmed | None:
        assert self._current is not None
        if not busy:
            start = now + TURNAROUND
            self._sent_end = start + airtime(len(self._current.psdu))
            self.state = State.SENDING
            self.next_wake = self._sent_end
            return Transmission(self._current.psdu, self._current.sequence, self._attempt, start, self._sent_end)
        self._backoffs += 1
        if self._backoffs > BACKOFFS_MAX:
            return self._finish(now, "access_failure", self._sent_end)
        self._exponent = min(self._exponent + 1, BE_MAX)
        self._backoff(now)
        return None

    def _sent(self, now: Instant) -> Confirmed | None:
        assert self._current is not None
        if not self._current.wants_ack:
            return self._finish(now, "ok", now)
        self.state = State.WAITING
        self.next_wake = now + ACK_WAIT + self._patience
        return None

    def _unanswered(self, now: Instant) -> Confirmed | None:
        if self._attempt >= RETRIES_MAX:
            return self._finish(now, "no_ack", self._sent_end)
        self._attempt += 1
        self._begin_attempt(now)
        return None

    def _finish(self, now: Instant, status: str, last_symbol: Instant) -> Confirmed:
        assert self._current is not None
        done = self._current
        space = LONG_SPACE if len(done.psdu) > SHORT_FRAME_OCTETS else SHORT_SPACE
        self._space_until = max(self._space_until, last_symbol + space)
        self._begin_next(now)
        return Confirmed(done.handle, status)

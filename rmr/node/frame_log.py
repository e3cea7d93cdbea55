"""The transmissions of one robot's radio, put together from what its host sees: requests, announcements, outcomes.

A station serves its requests one at a time and in order (`rmr.radio.mac`), so an announced data frame belongs to the
oldest request without an outcome. A transmission is written when the next thing is known: another attempt, or the
request's outcome, which stands with the last attempt alone. A request that never got access to the channel is written
once, without instants of a transmission.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from rmr.base.time import Instant
from rmr.coord.messages import FrameKind
from rmr.node.payloads import PayloadKind
from rmr.radio.air import ACK_ATTEMPT, Announcement, Confirmed
from rmr.radio.frame import BROADCAST, FCS_OCTETS, HEADER_OCTETS

KINDS: Final[dict[int, str]] = {int(kind): kind.name.lower() for kind in (*FrameKind, *PayloadKind)}
"""Names of the kinds of payload, by first octet."""
OTHER: Final = "other"
ACK: Final = "ack"
"""The kind of an acknowledgement of a frame."""
NULL: Final = "null"
_QUOTED: Final = '"%s"'

Write = Callable[[Instant, Callable[[], bytes]], None]
"""Takes a transmission at its end, as a function that returns it as JSON."""


class FrameRequest:
    """A request that has no outcome yet."""

    __slots__ = ("asked", "handle", "kind", "octets")

    def __init__(self, handle: int, asked: Instant, payload: bytes) -> None:
        self.handle = handle
        self.asked = asked
        self.kind = KINDS.get(payload[0], OTHER) if payload else OTHER
        self.octets = HEADER_OCTETS + len(payload) + FCS_OCTETS


class FrameLog:
    """The log of one robot; see `rmr.record.channels` on the fields of an entry."""

    def __init__(self, robot: int, write: Write) -> None:
        self._robot = robot
        self._write = write
        self._requests: deque[FrameRequest] = deque()
        self._announced: Announcement | None = None
        """The last transmission of the oldest request, which is not written yet."""

    def requested(self, now: Instant, payload: bytes, handle: int) -> None:
        """Note that the robot has handed `payload` to its radio."""
        self._requests.append(FrameRequest(handle, now, payload))

    def announced(self, announcement: Announcement) -> None:
        """Note a transmission of this robot."""
        if announcement.attempt & ACK_ATTEMPT:
            self._put(None, announcement, announcement.end, None)
            return
        self._flush(None)
        self._announced = announcement

    def confirmed(self, now: Instant, outcome: Confirmed) -> None:
        """Note the outcome of a request."""
        requests = self._requests
        if requests and requests[0].handle == outcome.handle:
            if self._announced is not None:
                self._flush(outcome.status)
            else:
                self._put(requests[0], None, now, outcome.status)
            requests.popleft()
            return
        for request in requests:  # the queue of the radio was full: it is refused before those that wait
            if request.handle == outcome.handle:
                requests.remove(request)
                self._put(request, None, now, outcome.status)
                return

    def end(self) -> None:
        """Write what is not written yet: the radio has been switched off."""
        self._flush(None)
        self._requests.clear()

    def _flush(self, outcome: str | None) -> None:
        announced = self._announced
        if announced is not None:
            self._announced = None
            self._put(self._requests[0] if self._requests else None, announced, announced.end, outcome)

    def _put(self, request: FrameRequest | None, sent: Announcement | None, at: Instant, outcome: str | None) -> None:
        self._write(at, LoggedFrame(self._robot, request, sent, outcome).to_json)


class LoggedFrame:
    """A transmission, or a request that led to none."""

    __slots__ = ("_outcome", "_request", "_robot", "_sent")

    def __init__(
        self, robot: int, request: FrameRequest | None, sent: Announcement | None, outcome: str | None
    ) -> None:
        self._robot = robot
        self._request = request
        self._sent = sent
        self._outcome = outcome

    def to_json(self) -> bytes:
        """Return it as a message of the channel `/frames`.

        Written out, as a run has thousands: all texts in it are names without quotes.
        """
        request = self._request
        sent = self._sent
        outcome = self._outcome
        destination: int | None = None
        kind = OTHER if request is None else request.kind
        if sent is not None and sent.attempt & ACK_ATTEMPT:
            kind = ACK
        elif sent is not None:
            destination = sent.psdu[5] | sent.psdu[6] << 8
            if destination == BROADCAST:
                destination = None
                outcome = "broadcast" if outcome == "ok" else outcome
        octets = 0 if request is None else request.octets
        handle = asked = start = end = NULL
        attempt = 0
        if request is not None:
            handle = str(request.handle)
            asked = _s(request.asked)
        if sent is not None:
            octets = len(sent.psdu)
            start = _s(sent.start)
            end = _s(sent.end)
            attempt = sent.attempt & ~ACK_ATTEMPT
        return (
            f'{{"source":{self._robot},"destination":{NULL if destination is None else str(destination)},'
            f'"kind":"{kind}","octets":{octets},"handle":{handle},"asked_s":{asked},"start_s":{start},"end_s":{end},'
            f'"attempt":{attempt},"outcome":{NULL if outcome is None else _QUOTED % outcome}}}'
        ).encode()


def _s(instant: Instant) -> str:
    """Return an instant in seconds, as a whole number of microseconds with the exponent: quick to write."""
    return f"{(instant + 500) // 1000}e-6"

"""The air of an evaluation: ideal or lossy, with a latency, among robots that are in range of each other.

It replaces a robot's radio, without medium access, collisions or repeats of its own. A frame reaches each of its
receivers after the latency, or is lost, independently for each receiver. Acknowledgements are frames like any other.
Robots out of range receive nothing; there is no routing.

If the latency is 0, frames of one instant may answer each other endlessly. So the length of a chain of answers within
one instant is bounded. Beyond it no frame is faster than the usual latency, and time moves on.
"""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from random import Random

from rmr.base.kernel import RADIO, Kernel
from rmr.base.time import NEVER, Duration, Instant, milliseconds
from rmr.eval.topology import Topology
from rmr.node import payloads
from rmr.node.logic.inbound import SEQUENCE_BITS, SEQUENCE_MASK, UNORDERED
from rmr.node.payloads import PayloadKind
from rmr.node.ports import Confirmed, Received

HOPS_AT_ONCE_MAX = 1000
"""Longest chain of answers within one instant: a flood through a thousand robots in a line needs as many."""
LATENCY: Duration = milliseconds(5)
"""The usual latency, also the least one once the robots have answered each other without end."""
LQI = 255
"""Link quality of every reception: the best value of IEEE 802.15.4."""

NUMBERS_ALONE = frozenset(
    {PayloadKind.FACT_ACK, PayloadKind.FACT_BASE, PayloadKind.FACT_BASE_WANTED, PayloadKind.FACT_LIFE}
)
"""Kinds of frames that carry only sequence numbers of deliveries; they are not counted as messages."""
COORDINATION_LAST = 0x0F
"""First octets up to this belong to coordination (`rmr.node.payloads`)."""

Lost = Callable[[Instant, int, int, bytes], None]
"""Callback for a lost frame: (instant of sending, source, destination that it did not reach, payload)."""


@dataclass(slots=True)
class Messages:
    """Frames that are no acknowledgements, counted for each robot that they were for."""

    sent: int = 0
    delivered: int = 0
    lost: int = 0
    repeated: int = 0
    """Of those sent: how many repeat an earlier one."""
    octets: int = 0
    """Payload of those sent."""


class EtherLink:
    """One robot's end of it: the `rmr.node.ports.RadioPort` of its node."""

    payload_max = payloads.PAYLOAD_OCTETS_MAX

    def __init__(self, ether: "EvalEther", robot: int, wake: Callable[[Instant], None]) -> None:
        self.robot = robot
        self.wake = wake
        self._ether = ether
        self._received: list[Received] = []
        self._confirmed: list[Confirmed] = []
        self._newest: dict[int, tuple[int, int]] = {}
        """Per destination: sequence and part of the newest frame of the exchange."""
        # Frames without a number that are remembered per robot: such repeats follow each other within half a second.
        self._said: deque[tuple[int | None, bytes]] = deque(maxlen=16)
        self._instant: Instant = -1
        self._hops = 0
        self.on = True
        """Whether the robot lives."""

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Send a frame; outcomes are reported for unicasts of coordination alone, for nothing else uses them."""
        del due  # no frame waits here
        self._ether.send(self, payload, destination, handle)

    def receive(self) -> list[Received]:
        """Return what has arrived since the last call."""
        received = self._received
        self._received = []
        self._ether.taken(received)
        return received

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known."""
        confirmed = self._confirmed
        self._confirmed = []
        return confirmed

    def hops(self, now: Instant) -> int:
        """Return how many frames of this instant led to what the robot sends now."""
        return self._hops if now == self._instant else 0

    def take(self, now: Instant, frame: Received, hops: int) -> None:
        """Receive a frame, the last of a chain of `hops` within one instant."""
        self._hops = max(hops, self.hops(now))
        self._instant = now
        self._received.append(frame)
        self.wake(now)

    def confirm(self, now: Instant, handle: int, status: str) -> None:
        """Learn what became of a unicast."""
        if not self.on:
            return
        self._confirmed.append(Confirmed(handle, status))
        self.wake(now)

    def repeats(self, payload: bytes, destination: int | None) -> bool:
        """Return whether a frame that leaves repeats an earlier one, and remember it."""
        if destination is not None and payload[0] in (PayloadKind.FACT, PayloadKind.FRAGMENT):
            frame = payloads.decode_fact_frame(payload)
            if not frame.sequence & UNORDERED:
                return self._repeats_numbered(frame, destination)
        known = (destination, payload) in self._said
        if not known:
            self._said.append((destination, payload))
        return known

    def _repeats_numbered(self, frame: payloads.FactFrame, destination: int) -> bool:
        """Ordered numbers of first copies only rise (modulo 2**15), and the parts of one number follow each other."""
        newest = self._newest.get(destination)
        if newest is not None:
            ahead = (frame.sequence - newest[0]) & SEQUENCE_MASK
            if ahead >= 1 << (SEQUENCE_BITS - 1) or (ahead == 0 and frame.part <= newest[1]):
                return True
        self._newest[destination] = (frame.sequence, frame.part)
        return False


class EvalEther:
    """Carries frames between the links of all robots."""

    def __init__(
        self,
        kernel: Kernel,
        topology: Topology,
        rng: Random,
        *,
        loss: float,
        latency: Duration,
        lost: Lost | None = None,
    ) -> None:
        self.messages = Messages()
        self.pending = 0
        """Frames that are neither acknowledgements nor coordination and that their receivers have yet to take in."""
        self.carried = 0
        """Such frames so far."""
        self.slowed_at: Instant | None = None
        """When the robots were found to answer each other without end."""
        self._kernel = kernel
        self._topology = topology
        self._rng = rng
        self._loss = loss
        self._latency = latency
        self._lost = lost
        self._links: dict[int, EtherLink] = {}

    def link(self, robot: int, wake: Callable[[Instant], None]) -> EtherLink:
        """Return the link of `robot`; `wake` is called when there is something new for it."""
        link = self._links[robot] = EtherLink(self, robot, wake)
        return link

    def switch_off(self, link: EtherLink) -> None:
        """Let nothing more arrive at a robot, nor what it has yet to take in."""
        link.on = False
        link.receive()

    def send(self, link: EtherLink, payload: bytes, destination: int | None, handle: int) -> None:
        """Send a frame, to all in range or (whether it is in range or not) to one."""
        if destination is None:
            wanted = reached = self._topology.neighbors(link.robot)
        else:
            wanted = (destination,)
            reached = wanted if self._topology.adjacent(link.robot, destination) else ()
        arriving = [robot for robot in reached if not self._drops() and self._links[robot].on]
        self._count(link, payload, destination, wanted, arriving)
        if arriving:
            self._carry(link.robot, payload, destination is not None, arriving)
        if destination is not None and payload[0] <= COORDINATION_LAST:
            status = "ok" if arriving and not self._drops() else "no_ack"
            later = self._kernel.now + 2 * self._latency
            self._kernel.at(later, RADIO, lambda now: link.confirm(now, handle, status))

    def _drops(self) -> bool:
        return self._loss > 0.0 and self._rng.random() < self._loss

    def _count(
        self, link: EtherLink, payload: bytes, destination: int | None, wanted: Iterable[int], arriving: list[int]
    ) -> None:
        count = len(list(wanted))
        if self._lost is not None and len(arriving) < count:
            there = dict.fromkeys(arriving)
            for robot in wanted:
                if robot not in there:
                    self._lost(self._kernel.now, link.robot, robot, payload)
        if payload[0] in NUMBERS_ALONE:
            return
        messages = self.messages
        messages.sent += count
        messages.lost += count - len(arriving)
        messages.octets += count * len(payload)
        if link.repeats(payload, destination):
            messages.repeated += count

    def _carry(self, source: int, payload: bytes, unicast: bool, arriving: list[int]) -> None:
        now = self._kernel.now
        hops = 0 if self._latency else 1 + self._links[source].hops(now)
        if hops > HOPS_AT_ONCE_MAX:
            self.slowed_at = now
            self._latency = LATENCY
        if _awaited(payload):
            self.pending += len(arriving)
            self.carried += len(arriving)
        at = now + self._latency
        # Every reception is of the same strength, in dBm: the emulated links have no path loss.
        arrive = partial(self._arrive, Received(payload, source, unicast, -40.0, LQI, at), hops, arriving)
        self._kernel.at(at, RADIO, arrive)

    def _arrive(self, frame: Received, hops: int, receivers: list[int], now: Instant) -> None:
        taken = [robot for robot in receivers if self._links[robot].on]
        for robot in taken:
            self._links[robot].take(now, frame, hops)
        if len(taken) < len(receivers):
            self._miss(frame, [robot for robot in receivers if robot not in taken])
        if frame.payload[0] not in NUMBERS_ALONE:
            self.messages.delivered += len(taken)

    def _miss(self, frame: Received, dead: list[int]) -> None:
        """Count a frame as lost for robots that have died while it was under way."""
        self.taken([frame] * len(dead))
        if frame.payload[0] not in NUMBERS_ALONE:
            self.messages.lost += len(dead)
        if self._lost is not None:
            for robot in dead:
                self._lost(self._kernel.now, frame.source, robot, frame.payload)

    def taken(self, frames: Iterable[Received]) -> None:
        """Count frames that a robot takes in."""
        self.pending -= sum(_awaited(frame.payload) for frame in frames)


def _awaited(payload: bytes) -> bool:
    return payload[0] > COORDINATION_LAST and payload[0] not in NUMBERS_ALONE


def frame_text(payload: bytes) -> str:
    """Return what kind of frame a payload is: ``fact``, ``acknowledgement``, ``coordination``, ..."""
    if payload[0] <= COORDINATION_LAST:
        return "coordination"
    return {PayloadKind.FACT_ACK: "acknowledgement"}.get(PayloadKind(payload[0]), PayloadKind(payload[0]).name.lower())

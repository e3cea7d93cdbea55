"""The ports of a durable robot's node (`durable_node`): inputs from journal or host, outputs held until recorded.

This module is compiled where a build is, as `DurableNode` is.
"""

from collections.abc import Sequence

from rmr.base.geometry import Twist
from rmr.base.time import NEVER, Duration, Instant
from rmr.mind.replay_feed import ReplayFeed
from rmr.node.crossing.coordination_link import UNCONFIRMED_MAX
from rmr.node.ports import Confirmed, Ports, Received, Sensed


class HeldFrame:
    """A frame that leaves when the call is recorded."""

    def __init__(self, payload: bytes, destination: int | None, handle: int, due: Instant) -> None:
        self.payload = payload
        self.destination = destination
        self.handle = handle
        self.due = due


class PortGate:
    """The node's ports: from the journal while the node is brought back, then the host's, with outputs held."""

    def __init__(self, ports: Ports, feed: ReplayFeed) -> None:
        self.host = ports
        """The host's ports."""
        self._feed = feed
        self.live = False
        self.frames: list[HeldFrame] = []
        """What the present call sends."""
        self.twist: Twist | None = None
        """The wheel command of the present call, the last one."""
        self._stamp: Instant = 0
        self.handles: list[int] = []
        """The newest frames of the node that is brought back, whose outcomes may be awaited."""
        self.unanswered: list[Confirmed] = []
        """Outcomes that the radio did not live to tell."""

    @property
    def holds(self) -> bool:
        """Whether something waits to leave."""
        return bool(self.frames) or self.twist is not None

    def release(self) -> None:
        """Let go what is held."""
        frames = self.frames
        if frames:
            self.frames = []
            for frame in frames:
                self.host.link.transmit(frame.payload, frame.destination, frame.handle, frame.due)
        twist = self.twist
        body = self.host.body
        if twist is not None and body is not None:
            self.twist = None
            body.act(twist, self._stamp)

    # -- ports --------------------------------------------------------------------------------------------------

    @property
    def payload_max(self) -> int:
        """Octets of payload that a frame holds."""
        return self.host.link.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Hold a frame."""
        if self.live:
            self.frames.append(HeldFrame(payload, destination, handle, due))
            return
        self.handles.append(handle)
        if len(self.handles) > 2 * UNCONFIRMED_MAX:
            del self.handles[:UNCONFIRMED_MAX]

    def receive(self) -> list[Received]:
        """Return what has arrived."""
        return self.host.link.receive() if self.live else self._feed.receive()

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known."""
        if not self.live:
            return self._feed.confirmations()
        if self.unanswered:
            outcomes = self.unanswered
            self.unanswered = []
            return outcomes + self.host.link.confirmations()
        return self.host.link.confirmations()

    def sense(self) -> list[Sensed]:
        """Return the new samples."""
        if not self.live:
            return self._feed.sense()
        body = self.host.body
        assert body is not None
        return body.sense()

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Hold a wheel command; a later one of the same call takes its place."""
        if self.live:
            self.twist = twist
            self._stamp = stamp

    def spent(self) -> Duration:
        """Return the processor time of the present call."""
        if not self.live:
            return self._feed.spent()
        spent = self.host.spent
        assert spent is not None
        return spent()

    def neighbors(self) -> Sequence[tuple[int, float]]:
        """Return who is in range."""
        if not self.live:
            return self._feed.neighbors()
        neighbors = self.host.neighbors
        assert neighbors is not None
        return neighbors()

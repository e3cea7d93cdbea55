"""The two ends of the radio port: `Transmitter` numbers what leaves, `Receiver` shares out what arrives.

The first octet of a payload says whose it is: below `PayloadKind.FACT` the coordination core's, else the messenger's.
"""

from rmr.base.time import Instant
from rmr.node.crossing.coordination_link import CoordLink
from rmr.node.messenger import Messenger
from rmr.node.payloads import PayloadKind
from rmr.node.peers.presence import Presence
from rmr.node.peers.proximity import Proximity
from rmr.node.ports import Confirmed, RadioPort, Received, Spoken
from rmr.node.robot_state import RobotState


class Transmitter:
    """Hands payloads to the radio."""

    def __init__(self, state: RobotState, port: RadioPort) -> None:
        self._state = state
        self._port = port
        self._sent = 0

    def transmit(self, payload: bytes, destination: int | None) -> int:
        """Hand a payload to the radio; return the handle by which it will tell the outcome."""
        self._sent += 1
        if self._state.config.witness is not None:
            self._state.tell(Spoken(payload))
        self._port.transmit(payload, destination, self._sent)
        return self._sent


class Receiver:
    """Takes in frames and outcomes."""

    def __init__(
        self,
        state: RobotState,
        port: RadioPort,
        proximity: Proximity,
        coordination: CoordLink,
        presence: Presence,
        messenger: Messenger,
    ) -> None:
        self._state = state
        self._port = port
        self._peers = state.peers
        self._coordination = coordination
        self._presence = presence
        self._messenger = messenger
        self._crowded = state.config.crowded
        self._needs_call = proximity.used
        """Whether every frame needs a call of the node: it may change the facts about who is near."""

    def run(self, now: Instant) -> None:
        """Handle all that has arrived since the last call."""
        for frame in self._port.receive():
            self._receive(now, frame)
        for outcome in self._port.confirmations():
            self._state.reschedule = True
            self._coordination.confirm(now, outcome)
        self._messenger.wake(now)

    def _receive(self, now: Instant, frame: Received) -> None:
        self._peers.heard(now, frame.source, frame.rssi_dbm)
        kind = frame.payload[0] if frame.payload else PayloadKind.HELLO
        if kind != PayloadKind.HELLO:
            self._state.reschedule = True
        if kind < PayloadKind.FACT:
            self._coordination.receive(now, frame.payload, frame.source)
        else:
            self._messenger.receive(now, frame)

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` as it arrives, if no task has to look at it; else return False: it is to wait for a call.

        In a crowd nearly all that is heard are hellos that change nothing but where a robot is known to be.
        """
        # After a suspension of the host the age of `frame` is not known: a call of the node dates it (`heard_at`).
        if self._needs_call or self._state.suspended(now):
            return False
        return self._presence.overhear(now, frame) or (self._crowded and self._overhear_crossing(now, frame))

    def _overhear_crossing(self, now: Instant, frame: Received) -> bool:
        """Take in what a robot in the bottleneck says, which all of a crowd hear and which concerns hardly any."""
        if frame.source not in self._peers.known or not self._coordination.overhear(now, frame.payload):
            return False
        self._peers.heard(now, frame.source, frame.rssi_dbm)
        return True

    def awaits(self, outcome: Confirmed) -> bool:
        """Return whether `outcome` matters here: else it need not be handed over."""
        return self._coordination.awaits(outcome)

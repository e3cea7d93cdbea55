"""What a robot says and hears besides coordination: hellos, deliveries, failure broadcasts.

A frame that does not parse, or that no robot of this program could have sent, is the sender's mistake: it is
counted, noted and dropped.
"""

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Final, final

from rmr.base.geometry import Point
from rmr.base.streams import stream
from rmr.base.time import Instant
from rmr.base.values import Robot, Symbol, Value
from rmr.node import wire
from rmr.node.crossing.destination import bound_for, redirect
from rmr.node.crossing.turn import Phase, Turn
from rmr.node.logic.deliveries import Deliveries
from rmr.node.logic.exchange import Exchange
from rmr.node.motion.hearing import OVERDUE
from rmr.node.motion.priority import Heard
from rmr.node.peers.hello import STAYS, STAYS_SPARE, HelloClock
from rmr.node.peers.perception import driving_of
from rmr.node.ports import Received
from rmr.node.wire import Hello, Kind, WireError
from rmr.radio.phy import LOSS_AT_1_M_DB

if TYPE_CHECKING:
    from rmr.node.node import Node

_hello_in = lru_cache(maxsize=256)(wire.decode_hello)
"""`decode_hello`, remembered: in virtual time many robots hear the same octets."""


@final
class _Last:
    """The hello that anybody has overheard last: in virtual time many robots hear the same one after the other."""

    def __init__(self) -> None:
        self._payload, self._source, self._at = b"", 0, -1
        self.driving: Heard | None = None
        """What it says of a robot that drives."""
        self._hello: Hello | None = None

    def hello(self, payload: bytes, source: int, at: Instant) -> Hello | None:
        """Return the hello that `payload` is; None if it is none."""
        if at != self._at or source != self._source or payload != self._payload:
            self._payload, self._source, self._at = payload, source, at
            self._hello = self.driving = None
            with suppress(WireError):
                self._hello = _hello_in(payload)
                self.driving = driving_of(source, self._hello, at)
        return self._hello


_LAST: Final = _Last()


def dated(read: Instant, frame: Received) -> Instant:
    """Return from when on what a hello says counts that was `read` then: since it was said, if it has waited long."""
    return read if read - frame.stamp <= OVERDUE else frame.stamp


UNNAMED_FAILURE: Final = "broadcast"
"""The event of a failure broadcast that no missed deadline derived."""


class Talk:
    """One robot's conversation."""

    def __init__(self, node: "Node", exchange: Exchange, digest: int) -> None:
        self._node = node
        self.exchange = exchange
        self.deliveries = Deliveries(node, exchange)
        self.digest = digest & 0xFFFF
        self.malformed = 0
        self._parked: Sequence[Point] | None = None
        """Where others stand, as the navigator was told last."""
        self._hello: HelloClock | None = None
        """None: a robot without a body."""
        if node.driver is not None:
            rng = stream(f"{node.config.seed}/robot{node.robot}/hello")
            self._hello = HelloClock(rng, node.config.profile)

    @property
    def next_wake(self) -> Instant:
        """When there is something to say or to repeat."""
        hello, wake = self._hello, self.exchange.next_wake
        return hello.due if hello is not None and hello.due < wake else wake

    def start(self, now: Instant) -> None:
        """Plan the first hello."""
        if self._hello is not None:
            self._hello.start(now)

    def hello_soon(self, now: Instant) -> None:
        """Say hello at once: something that matters to the others has changed."""
        if self._hello is not None:
            self._hello.soon(now)

    def telemetry(self, now: Instant) -> None:
        """Notice a change that matters to others, as between parked and moving."""
        node = self._node
        if self._hello is not None and node.driver is not None:
            self._hello.poll(now, parked=node.actions.driving is None, back=node.driver.speed < 0.0)

    def wake(self, now: Instant) -> None:
        """Say what is due."""
        if self._hello is not None and now >= self._hello.due:
            self._rewind(now, self._hello)
            self._say_hello(now, parked=self._hello.parked)
        if now >= self.exchange.next_wake:
            self.exchange.wake(now)
        self.flush(now)

    def flush(self, now: Instant) -> None:
        """Hand the radio what is to leave at once, and see to what became of what has left."""
        exchange = self.exchange
        if exchange.outbox:
            for payload, destination in exchange.outbox:
                self._node.transmit(payload, destination)
            exchange.outbox.clear()
        if exchange.news:
            self.deliveries.look(now)

    def _rewind(self, now: Instant, clock: HelloClock) -> None:
        """Plan the next hello."""
        node, turn = self._node, self._node.turns.current
        if not node.config.profile.promises_to_stay:
            clock.rewind(now, waits=turn is not None)
            return
        leaves = turn is not None and turn.phase is Phase.SLOTTED and not self._stays(now)
        clock.rewind(now, waits=turn is not None, leaves=leaves, driving=len(node.peers.driving(now)))

    def _stays(self, now: Instant) -> bool:
        """Return whether the robot, parked in a crowd, will stand for a while: it has finished, or its slot is far."""
        node, turn = self._node, self._node.turns.current
        if not node.config.profile.promises_to_stay or node.driver is None or node.actions.driving is not None:
            return False
        return node.finished() if turn is None else turn.leaves_after(now + STAYS + STAYS_SPARE)

    def _say_hello(self, now: Instant, *, parked: bool) -> None:
        node = self._node
        pose = node.percept().pose
        if pose is not None:
            v = 0.0 if node.driver is None else node.driver.speed
            stays = parked and self._stays(now)
            if stays and node.driver is not None:
                node.driver.stays_until = now + STAYS + STAYS_SPARE
            hello = Hello(pose.x, pose.y, pose.theta, v, parked, node.turns.rank, bound_for(node), self.digest, stays)
            node.transmit(wire.encode_hello(hello), None)

    def receive(self, now: Instant, frame: Received) -> None:
        """Handle a frame of another robot."""
        try:
            self._dispatch(now, frame)
        except WireError as error:
            self.drop(now, frame.source, str(error))

    def drop(self, now: Instant, source: int, why: str) -> None:
        """Count a frame that no robot of this program sends."""
        self.malformed += 1
        self._node.trace(now, "malformed", source=source, why=why)

    def _dispatch(self, now: Instant, frame: Received) -> None:
        match frame.payload[0]:
            case Kind.HELLO:
                self._met(now, frame, _hello_in(frame.payload))
            case Kind.FACT | Kind.FRAGMENT:
                body = self.exchange.received(frame.payload, frame.source)
                if body is not None:
                    self._node.stir()
                    self.deliveries.arrived(now, body, frame.source)
            case Kind.FACT_ACK:
                self.exchange.acknowledged(now, frame.payload, frame.source)
            case Kind.FAILURE:
                self._failure(now, frame)
            case kind:
                raise WireError(f"a frame of the unknown kind {kind:#04x}")

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` if it is a hello that says only where a robot is that is known; else return False."""
        payload, source = frame.payload, frame.source
        if not payload or payload[0] != Kind.HELLO:
            return False
        peers = self._node.peers
        peer = peers.known.get(source)
        if peer is None or peer.hello is None:
            return False
        at = dated(now, frame)
        hello = _LAST.hello(payload, source, at)
        if hello is None or hello.digest != self.digest or self._disputes(source, hello):
            return False
        peer.heard, peer.rssi_dbm = now, frame.rssi_dbm
        peers.hello(at, source, hello, _LAST.driving, said=frame.stamp)
        self._tell_parked(now)
        return True

    def _met(self, now: Instant, frame: Received, hello: Hello) -> None:
        node, source = self._node, frame.source
        known = node.peers.known[source].hello
        if hello.digest != self.digest and (known is None or known.digest != hello.digest):
            node.trace(now, "other_program", source=source)
        node.peers.hello(dated(node.heard_at, frame), source, hello, said=frame.stamp)
        if self._disputes(source, hello):
            self._heed(now)
        self._tell_parked(now)

    def _disputes(self, source: int, hello: Hello) -> bool:
        """Return whether `hello` is a reason to look for another place than the one that the robot goes to."""
        driver = self._node.driver
        if driver is None or driver.place is None:
            return False
        running = self._node.actions.driving
        if running is None:
            return False
        turn = running.turn if isinstance(running.turn, Turn) else None
        bound = driver.navigator.goal if turn is None or turn.bound is None else turn.bound
        if bound != driver.place:  # another action has the wheels, such as `face`: it keeps them
            return False
        outside = turn is not None and turn.phase in (Phase.ASKING, Phase.SLOTTED)
        return driver.disputes(source, hello, outside=outside)

    def _heed(self, now: Instant) -> None:
        """Go to another place: a robot that goes first has taken this one's."""
        node = self._node
        running, driver = node.actions.driving, node.driver
        assert running is not None
        assert driver is not None
        place = driver.choose_again(now, node.peers)
        if place is None:
            return
        if isinstance(running.turn, Turn):
            redirect(node, now, place, running.turn)
        else:
            node.depart(place, final_heading=None, turn=None)

    def _tell_parked(self, now: Instant) -> None:
        """Let the navigator know where others stand, if that has changed; one without a goal need not."""
        node = self._node
        if node.driver is None or node.driver.navigator.goal is None:
            return
        if (parked := node.peers.parked(now)) is not self._parked:
            self._parked = parked
            node.driver.navigator.update_parked(parked)

    def _failure(self, now: Instant, frame: Received) -> None:
        digest, assertion = wire.decode_failure(frame.payload)
        assertions = self._node.program.assertions
        if digest != self.digest or (assertion is not None and assertion >= len(assertions)):
            return
        self._node.stir()
        name = UNNAMED_FAILURE if assertion is None else assertions[assertion].name
        self._node.senses.add(now, "failed", (Robot(frame.source), Symbol(name)))

    def ranges(self, now: Instant) -> list[tuple[Value, ...]]:
        """Return (robot, metres) for each neighbor, from signal strength by the log-distance law, to 10 cm."""
        radio, known = self._node.config.radio, self._node.peers.known
        at_1_m = radio.tx_power_dbm - LOSS_AT_1_M_DB
        return [
            (Robot(robot), round(10 ** ((at_1_m - known[robot].rssi_dbm) / (10 * radio.exponent)), 1))
            for robot in self._node.peers.neighbors(now)
        ]

"""A node that logs what it is given and what it gives (`mind_log`), and is a `Node` in all else.

Its ports are wrapped, and its calls begin with an entry in the log. Once a second of lab time, at the first call, it
logs digests of its outputs and of a part of its state, and hands the log's batch over. Pure queries (`awaits`,
`finished`, ...) are not logged.

This module is compiled where a build is, as `Node` is: an interpreted class cannot inherit from a compiled one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from struct import Struct
from typing import Any, Final

from rmr.base.geometry import Pose, Twist
from rmr.base.time import NEVER, Duration, Instant
from rmr.base.values import Value
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.mind.fact_values import pack
from rmr.mind.mind_format import CHANGE, INSERT, OVERHEAR, START, TICK
from rmr.mind.mind_header import encode_header
from rmr.mind.mind_log import MindLog, MindSink, next_second
from rmr.mind.recorded_actions import recorded_handlers
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler, check_handlers
from rmr.node.config import NodeConfig
from rmr.node.executive import FRAME_BUDGET
from rmr.node.node import Node
from rmr.node.ports import BodyPort, Confirmed, Ports, RadioPort, Received, Sensed
from rmr.node.program_change import ProgramChanged
from rmr.node.trace import EVENTS, Trace, TraceLevel

_WORDS: Final = {word: number for number, word in enumerate(EVENTS)}
_pack_state: Final[Callable[..., bytes]] = Struct("<qqqqdddd").pack
_pack_peer: Final[Callable[..., bytes]] = Struct("<Iqddd").pack


class RecordedLink:
    """A radio port whose traffic is logged."""

    def __init__(self, link: RadioPort, log: MindLog) -> None:
        self._link = link
        self._log = log

    @property
    def payload_max(self) -> int:
        """Octets of payload that a frame holds."""
        return self._link.payload_max

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Queue a frame."""
        self._log.transmit(payload, destination, handle)
        self._link.transmit(payload, destination, handle, due)

    def receive(self) -> list[Received]:
        """Return what has arrived."""
        frames = self._link.receive()
        if frames:
            self._log.received(frames)
        return frames

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that have become known."""
        outcomes = self._link.confirmations()
        if outcomes:
            self._log.confirmed(outcomes)
        return outcomes


class RecordedBody:
    """A body port whose samples and commands are logged."""

    def __init__(self, body: BodyPort, log: MindLog) -> None:
        self._body = body
        self._log = log

    def sense(self) -> list[Sensed]:
        """Return the new samples."""
        samples = self._body.sense()
        if samples:
            self._log.sensed(samples)
        return samples

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Command the wheels."""
        self._log.act(twist, stamp)
        self._body.act(twist, stamp)

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Let another one drive; a replay decides the same."""
        self._body.head(serial, target, stamp)


class RecordedHost:
    """What else a host answers, logged: processor time where a frame's is used up, and who is in range."""

    def __init__(self, ports: Ports, log: MindLog) -> None:
        self._spent = ports.spent
        self._neighbors = ports.neighbors
        self._log = log
        self._offered: Sequence[tuple[int, float]] | None = None

    def spent(self) -> Duration:
        """Return the processor time of the present call."""
        assert self._spent is not None
        spent = self._spent()
        if spent > FRAME_BUDGET:
            self._log.overrun()
        self._log.asks += 1
        return spent

    def neighbors(self) -> Sequence[tuple[int, float]]:
        """Return who is in range."""
        assert self._neighbors is not None
        offered = self._neighbors()
        if offered is not self._offered:
            self._offered = offered
            self._log.neighbors(pack([[robot, float(metres)] for robot, metres in offered]))
        return offered


class RecordedTrace(Trace):
    """A trace whose entries are logged as numbers and check sums; those that depend on its level are not."""

    def __init__(self, robot: int, level: TraceLevel, log: MindLog, noted: bool) -> None:
        super().__init__(robot, level)
        self._log = log
        self._noted = noted

    def note(self, now: Instant, what: str, **fields: Any) -> None:
        """Note that `what`, a word of `EVENTS`, has happened."""
        # Whether there are entries of these depends on the level of the trace.
        if self._noted and what not in ("fired", "inserted", "removed"):
            self._log.note(_WORDS[what], f"{now} {fields}".encode("utf-8", "backslashreplace"))
        super().note(now, what, **fields)


class RecordedNode(Node):
    """One robot whose inputs are logged."""

    def __init__(
        self,
        config: NodeConfig,
        program: Program,
        ports: Ports,
        handlers: Mapping[str, Handler],
        digest: int,
        sink: MindSink | None,
        noted: bool | None = None,
    ) -> None:
        """`sink` takes the batches of the log; a replay, which compares the log, has none.

        `noted` says whether the trace is logged: by default where there is one.
        """
        body = ports.body
        header = b""
        if sink is not None:
            header = encode_header(
                config,
                digest,
                handlers,
                payload_max=ports.link.payload_max,
                bodily=body is not None,
                timed=ports.spent is not None,
                neighbors=ports.neighbors is not None,
                witnessed=config.witness is not None,
            )
        self.log = log = MindLog(config.robot, config.epoch, header, sink)
        host = RecordedHost(ports, log)
        tapped = Ports(
            RecordedLink(ports.link, log),
            None if body is None else RecordedBody(body, log),
            None if ports.spent is None else host.spent,
            None if ports.neighbors is None else host.neighbors,
        )
        own = handlers if sink is None else recorded_handlers(handlers, log)
        self._inside = False
        self._log_begun = False
        self._witness = config.witness
        self._witnessing = False
        self.events = 0
        """Events of which the witness has been told in this call."""
        if config.witness is not None:
            config = replace(config, witness=self._told)
        super().__init__(config, program, tapped, own, digest)
        if noted is None:
            noted = config.trace > TraceLevel.NOTHING
        self.notes = self.state.notes = RecordedTrace(config.robot, config.trace, log, noted)
        self._second: Instant = 0
        """When the next digest is due."""

    # -- the calls of the host ------------------------------------------------------------------------------------

    def start(self, now: Instant) -> None:
        """Insert the initial facts and begin."""
        self._begin_log(now)
        self._begin(START, now)
        try:
            super().start(now)
        except BaseException as error:
            self._raised(error)
            raise
        self._inside = False

    def tick(self, now: Instant) -> None:
        """Run all that is due at `now`."""
        self._begin(TICK, now)
        try:
            super().tick(now)
        except BaseException as error:
            self._raised(error)
            raise
        self._inside = False

    def overhear(self, now: Instant, frame: Received) -> bool:
        """Take in `frame` as it arrives, if no task has to look at it."""
        log = self.log
        self._begin(OVERHEAR, now)
        log.overheard(frame)
        try:
            taken = super().overhear(now, frame)
        except BaseException as error:
            self._raised(error)
            raise
        if taken:
            log.taken()
        else:
            log.refused = frame
        self._inside = False
        return taken

    def insert(self, now: Instant, name: str, args: Sequence[Value]) -> None:
        """Insert a fact of this robot from outside."""
        if self._inside:
            if self._witnessing:
                self.log.nested(pack([self.events, name, list(args)]))
            super().insert(now, name, args)
            return
        self._begin(INSERT, now)
        self.log.inserted(pack([name, list(args)]))
        try:
            super().insert(now, name, args)
        except BaseException as error:
            self._raised(error)
            raise
        self._inside = False

    def change_program(self, now: Instant, program: Program, digest: int) -> ProgramChanged:
        """Go on with another program; the log holds it."""
        check_handlers(program, {**PROVIDED, **self._handlers})
        self._begin_log(now)
        self._begin(CHANGE, now)
        self.log.program(pack([digest, codec.encode(program, debug=program.debug is not None)]))
        try:
            changed = super().change_program(now, program, digest)
        except BaseException as error:
            self._raised(error)
            raise
        self._inside = False
        return changed

    def _begin_log(self, now: Instant) -> None:
        if not self._log_begun:
            self._log_begun = True
            self.log.begin(now)

    def _told(self, robot: int, now: Instant, event: object) -> None:
        """Pass an event on to the witness, which may insert facts."""
        self.events += 1
        self._witnessing = True
        try:
            assert self._witness is not None
            self._witness(robot, now, event)
        finally:
            self._witnessing = False

    def _begin(self, call: int, now: Instant) -> None:
        log = self.log
        if now >= self._second:
            state = self.state_octets()
            self._second = next_second(now)
            log.flush()
            log.call(call, now)
            log.digest(state)
        else:
            log.call(call, now)
        self.events = 0
        self._inside = True

    def _raised(self, error: BaseException) -> None:
        self._inside = False
        self.log.raised(f"{type(error).__name__}: {error}")

    # -- the log --------------------------------------------------------------------------------------------------

    def state_octets(self) -> bytes:
        """Return a part of the state, for the digest: what the outputs of one second may not show."""
        finish = self.finish_at
        pose = None if self.driver is None else self.driver.localiser.pose
        x = y = theta = travelled = 0.0
        if self.driver is not None:
            travelled = self.driver.localiser.travelled_m
        if pose is not None:
            x = pose.x
            y = pose.y
            theta = pose.theta
        known = self.peers.known
        octets = [
            _pack_state(
                self.machine.firings,
                self.next_wake,
                -1 if finish is None else finish,
                len(known),
                x,
                y,
                theta,
                travelled,
            )
        ]
        for robot, peer in known.items():
            hello = peer.hello
            x = y = 0.0
            if hello is not None:
                x = hello.x
                y = hello.y
            octets.append(_pack_peer(robot, peer.heard, peer.rssi_dbm, x, y))
        return b"".join(octets)

    def not_delivered(self, samples: int, frames: int, refused: int = 0) -> None:
        """Take totals of samples and frames that the host has dropped, and of frames that it has refused."""
        self.log.not_delivered(samples, frames, refused)

    def end_log(self) -> None:
        """End the log: the node is not called any more."""
        if not self.log.closed:
            self.log.end(self.state_octets())

"""The ports of a node in a replay: the inputs of each call come from the log, and outputs go nowhere."""

from typing import Any, Final

from rmr.base.geometry import Pose, Twist
from rmr.base.time import NEVER, Duration, Instant
from rmr.mind import mind_format as form
from rmr.mind.mind_log import MindLog
from rmr.mind.mind_reader import LoggedOperation
from rmr.node.executive import FRAME_BUDGET
from rmr.node.ports import Confirmed, Received, Sensed


class ReplayFeed:
    """Gives the node of a replay the inputs of the present call: radio port, body port, and what a host answers."""

    def __init__(self, payload_max: int) -> None:
        self.payload_max: Final = payload_max
        self._inputs: list[LoggedOperation] = []
        self._next = 0
        self._asks = 0
        self._refused: Received | None = None
        self.log: MindLog | None = None
        """The log of the replay itself."""
        self.actions = 0
        """Actions of users that have begun."""
        self._offered: tuple[tuple[int, float], ...] = ()

    def begin(self, inputs: list[LoggedOperation]) -> None:
        """Begin a call with these inputs."""
        self._inputs = inputs
        self._next = 0
        self._asks = 0

    def peek(self, kind: int) -> Any:
        """Return the value of the next input if it is of this kind; else None."""
        if self._next < len(self._inputs) and self._inputs[self._next].kind == kind:
            return self._inputs[self._next].value
        return None

    def take(self, kind: int) -> Any:
        """Return the value of the next input, and go on to the one after it, if it is of this kind; else None."""
        value = self.peek(kind)
        if value is not None:
            self._next += 1
        return value

    def acted(self, action: int, codes: tuple[str, ...] = ()) -> Any:
        """Return the next step of the handler of `action`, of one of `codes` if there are any, and log it again.

        Return None if the next input is another one.
        """
        step = self.peek(form.ACTED)
        if step is None or step[1] != action or (codes and step[0] not in codes):
            return None
        assert self.log is not None
        self.log.again(self._inputs[self._next].octets)
        self._next += 1
        return step

    def nested(self, event: int) -> Any:
        """Return (predicate, arguments) of the next fact that the witness inserted at this event; None if none."""
        fact = self.peek(form.NESTED)
        if fact is None or fact[0] != event:
            return None
        self._next += 1
        return fact[1:]

    def offer(self) -> Received:
        """Return the frame that is overheard."""
        frame: Received = self.take(form.OFFERED)
        self._refused = frame
        return frame

    # -- ports --------------------------------------------------------------------------------------------------

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Do nothing: the log of the replay has it."""

    def receive(self) -> list[Received]:
        """Return the frames that were received."""
        found = self.take(form.RECEIVED)
        if found is None:
            return []
        again, frames = found
        return [self._refused, *frames] if again and self._refused is not None else frames

    def confirmations(self) -> list[Confirmed]:
        """Return the outcomes that became known."""
        return self.take(form.CONFIRMED) or []

    def sense(self) -> list[Sensed]:
        """Return the samples."""
        return self.take(form.SENSED) or []

    def act(self, twist: Twist, stamp: Instant) -> None:
        """Do nothing: the log of the replay has it."""

    def head(self, serial: int, target: Pose | None, stamp: Instant) -> None:
        """Do nothing: a drive of others is no part of a mind."""

    def spent(self) -> Duration:
        """Return more than a frame's time where that was used up, else 0."""
        ask = self._asks
        self._asks += 1
        if self.peek(form.OVERRUN) == ask:
            self.take(form.OVERRUN)
            return FRAME_BUDGET + 1
        return 0

    def neighbors(self) -> tuple[tuple[int, float], ...]:
        """Return who was in range."""
        found = self.take(form.NEIGHBORS)
        if found is not None:
            self._offered = tuple((robot, metres) for robot, metres in found)
        return self._offered

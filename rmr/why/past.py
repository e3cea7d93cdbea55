"""The past of a run: the minds of its robots, each made when it is first needed."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

from rmr.base.time import Instant
from rmr.bytecode.program import Program
from rmr.vm.provenance import DeliveredCause, SentKey
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastItem, PastSend

Variables = tuple[Mapping[int, str], ...]
"""For each rule of a program the names of its slots, which byte-code does not keep."""


class PastSource(Protocol):
    """What knows the minds of a run: the replays of a recording."""

    @property
    def program(self) -> Program:
        """The program that the robots run."""

    @property
    def robots(self) -> Sequence[int]:
        """The ids of the robots of the run, ascending."""

    @property
    def known_until(self) -> Instant:
        """The instant up to which the run is known."""

    def minds(self, robot: int) -> Sequence[MindIndex]:
        """Return the incarnations of `robot`, the oldest first; none if nothing of it was recorded."""


class Past:
    """The minds of a run."""

    def __init__(self, source: PastSource, variables: Variables = ()) -> None:
        """`variables` are the names of the rules' variables, where they are known."""
        self.source = source
        self._variables = variables
        self._minds: dict[int, Sequence[MindIndex]] = {}

    @property
    def program(self) -> Program:
        """The program of the run."""
        return self.source.program

    @property
    def robots(self) -> Sequence[int]:
        """The ids of all robots."""
        return self.source.robots

    @property
    def known_until(self) -> Instant:
        """The instant up to which the run is known."""
        return self.source.known_until

    def variables(self, rule: int) -> Mapping[int, str]:
        """Return the names of a rule's slots, as far as they are known."""
        return self._variables[rule] if rule < len(self._variables) else {}

    def minds(self, robot: int) -> Sequence[MindIndex]:
        """Return the incarnations of `robot`, the oldest first."""
        if robot not in self._minds:
            self._minds[robot] = self.source.minds(robot)
        return self._minds[robot]

    def mind_at(self, robot: int, now: Instant) -> MindIndex | None:
        """Return the incarnation that has begun last at `now`."""
        return next((mind for mind in reversed(self.minds(robot)) if mind.begins <= now), None)

    def sender(self, cause: DeliveredCause, receiver: int, at: Instant) -> tuple[MindIndex, PastSend] | None:
        """Return what was sent, with its sender, that arrived at `receiver` at `at`; None if nobody knows."""
        key = SentKey(receiver, cause.epoch, cause.sequence)
        for mind in reversed(self.minds(cause.source)):
            if mind.begins <= at and isinstance(sent := mind.deliveries.get(key), PastSend):
                return mind, sent
        return None

    def item(self, robot: int, number: int) -> tuple[MindIndex, PastItem] | None:
        """Return the item of `robot` with `number`."""
        for mind in self.minds(robot):
            if mind.first_number <= number < mind.next_number:
                return mind, mind.items[number - mind.first_number]
        return None

    def near(self, count: int) -> list[int]:
        """Return the robots whose minds are known already, and others up to `count` in all."""
        known = [robot for robot in self.robots if robot in self._minds]
        return known + [robot for robot in self.robots if robot not in self._minds][: max(0, count - len(known))]

    def all_minds(self, now: Instant) -> Iterator[MindIndex]:
        """Yield the present incarnation of each robot."""
        for robot in self.robots:
            mind = self.mind_at(robot, now)
            if mind is not None:
                yield mind

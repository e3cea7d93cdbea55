"""What one robot did, over all its incarnations: their items, and what was seen of its wheels, turns and calls.

Of several robots: what they wait for from each other, be it on its way or still to be sent.

Made by `rmr.why.history_listener` from the replay of the robot's minds. All instants are integer nanoseconds of lab
time.
"""

from bisect import bisect_right
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Instant
from rmr.node.standstill import Motion, MotionState
from rmr.vm.job import TimedJob
from rmr.vm.provenance import DeliveredCause, SentKey
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastAction, PastArrival, PastDelivery, PastFact

BROADCAST: Final = "broadcast"
"""The action that tells all others of a failure."""


class LostDelivery(NamedTuple):
    """A delivery that its sender has given up, or could not send."""

    at: Instant
    robot: int
    """The sender."""
    destination: int
    text: str
    why: str


class PassageSpan(NamedTuple):
    """The robot used a shared resource."""

    group: bytes
    entered: Instant
    left: Instant


@dataclass(slots=True)
class RobotHistory:
    """One robot."""

    robot: int
    minds: list[MindIndex] = field(default_factory=list)
    """Its incarnations, the oldest first."""
    ends: Instant = 0
    """The last instant that is known."""
    motion: list[tuple[Instant, MotionState]] = field(default_factory=list)
    late: list[tuple[Instant, Instant]] = field(default_factory=list)
    """The robot was due from the one instant on, and was called at the other."""
    undelivered: list[LostDelivery] = field(default_factory=list)
    passages: list[PassageSpan] = field(default_factory=list)

    @property
    def jobs(self) -> list[tuple[TimedJob, Instant | None]]:
        """Each job with when the robot learned of its end."""
        known = [each for mind in self.minds for each in mind.jobs.values()]
        return [(each.job, each.learned) for each in known if each.job is not None]

    def actions(self) -> Iterator[tuple[MindIndex, PastAction]]:
        """Yield the actions that the robot carries out itself, the newest first."""
        for mind in reversed(self.minds):
            for action in reversed(mind.own_actions):
                yield mind, action

    def sent(self, cause: DeliveredCause, receiver: int) -> tuple[MindIndex, PastDelivery] | None:
        """Return what the robot has sent, with the incarnation that sent it; None if there is no record of it."""
        key = SentKey(receiver, cause.epoch, cause.sequence)
        return next(((mind, mind.deliveries[key]) for mind in reversed(self.minds) if key in mind.deliveries), None)

    def arrival(self, cause: DeliveredCause) -> PastArrival | None:
        """Return when nothing earlier was missing before a delivery; None if it never came so far."""
        return next((mind.arrived[cause] for mind in self.minds if cause in mind.arrived), None)

    def newest_arrival(self, source: int, at: Instant) -> DeliveredCause | None:
        """Return what has arrived from `source` at that very instant, the last first."""
        arrived = [each for mind in self.minds for each in mind.arrived.items()]
        found = [(arrival.place, cause) for cause, arrival in arrived if cause.source == source and arrival.at == at]
        return max(found)[1] if found else None

    def motion_between(self, begin: Instant, end: Instant) -> list[tuple[Instant, Instant, MotionState]]:
        """Return what the wheels did, as parts of [begin, end) without gap."""
        states = self.motion
        first = max(0, bisect_right(states, begin, key=_at) - 1)
        parts: list[tuple[Instant, Instant, MotionState]] = []
        at = begin
        state = MotionState(Motion.IDLE)
        for since, new in states[first:]:
            if since >= end:
                break
            if since > at:
                parts.append((at, since, state))
                at = since
            state = new
        if at < end:
            parts.append((at, end, state))
        return parts

    def absences(self, *, stopped: bool) -> list[tuple[Instant, Instant]]:
        """Return from when to when the robot was dead after it had lived, or had been `stopped` in order."""
        begins = [mind.begins for mind in self.minds[1:]]
        return [
            (mind.died, begin)
            for mind, begin in zip(self.minds, [*begins, NEVER], strict=True)
            if mind.died < begin and mind.stopped == stopped
        ]


def _at(state: tuple[Instant, MotionState]) -> Instant:
    return state[0]


def on_its_way(histories: Mapping[int, RobotHistory], robot: int, at: Instant) -> tuple[MindIndex, PastDelivery] | None:
    """Return the first that was sent of all deliveries to `robot` that were under way, with its sender."""
    found = []
    for mind, sent in _sent_to(histories, robot):
        assert sent.key is not None
        arrival = histories[robot].arrival(DeliveredCause(mind.robot, *sent.key[1:]))
        goes_on = sent.given_up is None or sent.given_up > at
        if sent.begun <= at and goes_on and (NEVER if arrival is None else arrival.at) > at:
            found.append((mind, sent))
    return min(found, key=lambda each: (each[1].begun, each[0].robot, each[1].key), default=None)


def next_supplier(histories: Mapping[int, RobotHistory], robot: int, at: Instant, asked: Container[int]) -> int | None:
    """Return the robot that sends `robot` something next, and has something under way; those `asked` are left out."""
    found = [
        (sent.begun, mind.robot)
        for mind, sent in _sent_to(histories, robot)
        if sent.begun > at and mind.robot not in asked
    ]
    for _, source in sorted(found):
        if any(action.at <= at < mind.ended(action) for mind, action in histories[source].actions()):
            return source
    return None


def _sent_to(histories: Mapping[int, RobotHistory], robot: int) -> list[tuple[MindIndex, PastDelivery]]:
    minds = [mind for history in histories.values() for mind in history.minds]
    return [(mind, sent) for mind in minds for key, sent in mind.deliveries.items() if key.destination == robot]


def failure_broadcast(minds: Sequence[MindIndex], failed: PastFact) -> tuple[MindIndex, PastAction] | None:
    """Return the broadcast by which a fact ``failed`` became known, of all by the robot whose `minds` these are."""
    for mind in reversed(minds):
        for action in reversed(mind.own_actions):
            name = mind.program.predicates[action.predicate].name
            if name == BROADCAST and action.begun is not None and action.begun <= failed.at:
                return mind, action
    return None


def shared_fact(minds: Sequence[MindIndex], heard: PastFact) -> tuple[MindIndex, PastFact] | None:
    """Return the fact of the robot whose `minds` these are, of which another one had `heard`; None: not recorded."""
    for mind in reversed(minds):
        shared = next((each.other for each in mind.program.ensemble if each.predicate == heard.predicate), None)
        for fact in reversed(mind.by_predicate[shared] if shared is not None else []):
            if fact.at <= heard.at and fact.args == heard.args[1:]:
                return mind, fact
    return None


def told_of(history: RobotHistory | None, heard: PastFact, *, gone: bool = False) -> tuple[MindIndex, PastFact] | None:
    """Return the fact of a neighbour of which a robot had `heard`, or, `gone`, been told that it is no more."""
    told = None if history is None else shared_fact(history.minds, heard)
    return None if told is None or (gone and told[1].until > heard.until) else told

"""What robots wait for from each other: deliveries that have arrived, are on their way, or are still to be sent."""

from collections.abc import Container, Mapping, Sequence
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.vm.provenance import DeliveredCause
from rmr.why.mind_index import MindIndex
from rmr.why.past_items import PastAction, PastDelivery, PastFact
from rmr.why.robot_history import RobotHistory

BROADCAST: Final = "broadcast"
"""The action that tells all others of a failure."""


def newest_arrival(history: RobotHistory, source: int, at: Instant) -> DeliveredCause | None:
    """Return what has arrived from `source` at that very instant, the last first."""
    arrived = [each for mind in history.minds for each in mind.arrived.items()]
    found = [(arrival.place, cause) for cause, arrival in arrived if cause.source == source and arrival.at == at]
    return max(found)[1] if found else None


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

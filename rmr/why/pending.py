"""What robots wait for from each other: deliveries that have arrived, are on their way, or are still to be sent."""

from collections.abc import Container, Mapping
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.base.values import Robot
from rmr.why.robot_history import ActionSpan, Change, DeliveryKey, RobotHistory

BROADCAST: Final = "broadcast"
"""The action that tells all others of a failure."""


def newest_arrival(history: RobotHistory, source: int, at: Instant) -> DeliveryKey | None:
    """Return what has arrived from `source` at that very instant, the last first."""
    found = [(order, key) for key, (when, order) in history.received.items() if key[0] == source and when == at]
    return max(found)[1] if found else None


def on_their_way(histories: Mapping[int, RobotHistory], robot: int, at: Instant) -> list[DeliveryKey]:
    """Return the deliveries to `robot` that were under way, the first sent first."""
    received = histories[robot].received
    found = [
        (span.begun, key)
        for history in histories.values()
        for key, span in history.sent.items()
        if key[1] == robot and span.begun <= at and received.get(key, (NEVER, 0))[0] > at
        and (span.given_up is None or span.given_up > at)
    ]  # fmt: skip
    return [key for _, key in sorted(found)]


def next_supplier(histories: Mapping[int, RobotHistory], robot: int, at: Instant, asked: Container[int]) -> int | None:
    """Return the robot that sends `robot` something next, and has something under way; those `asked` are left out."""
    found = [
        (span.begun, history.robot)
        for history in histories.values()
        for key, span in history.sent.items()
        if key[1] == robot and span.begun > at and history.robot not in asked
    ]
    for _, source in sorted(found):
        if any(span.derived <= at < span.ended for span in histories[source].actions):
            return source
    return None


def failure_broadcast(histories: Mapping[int, RobotHistory], change: Change) -> tuple[int, ActionSpan] | None:
    """Return the robot that a fact ``failed`` names, and the broadcast by which the fact became known."""
    source = change.args[0]
    if not isinstance(source, Robot) or source not in histories:
        return None
    for span in reversed(histories[source].actions):
        if span.name == BROADCAST and span.started is not None and span.started <= change.at:
            return int(source), span
    return None

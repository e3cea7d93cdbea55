"""What a robot asks for with its turn: the times that its way needs, as it knows them when it asks.

Through the bottleneck these are the way to the gate's line, the time inside and the drive behind it; an action that is
no passage of the bottleneck excludes all others for as long as it takes.
"""

from typing import TYPE_CHECKING

from rmr.base.time import Instant
from rmr.coord.events import JobRequest
from rmr.coord.values import EXCLUSIVE_WAY
from rmr.node.crossing.turn import Turn, stands_in_way, stands_within

if TYPE_CHECKING:
    from rmr.node.node import Node


def estimate(node: "Node", now: Instant, turn: Turn) -> bool:
    """Work out approach, inside and way of `turn`; False while the robot does not know where it is, or has to stand."""
    driver = node.driver
    if driver is None:
        turn.inside = turn.headway = node.config.turn
        turn.notice = 0
        return True
    if turn.goal is None:
        return True
    pose = driver.localiser.pose
    if pose is None:
        return False
    found = driver.approach.estimate(pose, turn.goal.places[0])
    if found is None:
        return True
    turn.gated = found.inside > 0
    if turn.gated:
        turn.approach, turn.inside, turn.way, turn.after, within = found
        turn.within = within or stands_within(node.arena, turn.goal, pose)
        turn.in_way = stands_in_way(node.arena, turn.goal, pose)
        turn.headway = driver.approach.headway(turn.goal, turn.way)
        if not turn.requested and not turn.within and _has_to_listen(node, now):
            turn.revised_at = now
            return False
    else:
        turn.approach, turn.inside, turn.headway = 0, found.approach, found.approach
        turn.way, turn.after, turn.within = EXCLUSIVE_WAY, 0, False
    return True


def _has_to_listen(node: "Node", now: Instant) -> bool:
    """Return whether the robot stands until it has heard where all others are: few have heard each other sooner."""
    return node.config.profile.listens_first and node.driver is not None and node.driver.listens(now, node.peers)


def finds_itself_within(node: "Node", turn: Turn, slack_m: float = 0.0) -> bool:
    """Return whether the robot stands in the bottleneck, or within `slack_m` of that, as far as it knows."""
    pose = None if node.driver is None else node.driver.localiser.pose
    return pose is not None and turn.goal is not None and stands_within(node.arena, turn.goal, pose, slack_m)


def request_of(turn: Turn) -> JobRequest:
    """Return what the leader is told."""
    return JobRequest(
        event=turn.event,
        trigger=turn.trigger,
        release=turn.release,
        duration=turn.inside,
        deadline=turn.deadline,
        headway=turn.headway,
        way=turn.way,
        inside=turn.within,
        underway=turn.underway,
        postpones=turn.gated,
    )

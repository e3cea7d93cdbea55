"""What a recording shows of a running node, beside its trace."""

from collections.abc import Sequence
from typing import Any

from rmr.base.geometry import Point, Pose
from rmr.base.time import Instant
from rmr.node.report import ReportedNode, progress


def pose_of(node: ReportedNode) -> Pose | None:
    """Return the pose that the robot believes to have; None while it does not know, or without a body."""
    return None if node.driver is None else node.driver.localiser.pose


def route_of(node: ReportedNode) -> Sequence[Point] | None:
    """Return the points of the route that the robot follows; None without one."""
    route = None if node.driver is None else node.driver.navigator.route
    return None if route is None else route.points


def status_of(node: ReportedNode, now: Instant, queue: int) -> dict[str, Any]:
    """Return the robot's state; `queue` is the number of frames that wait for the channel."""
    crossings = node.crossings
    return {
        "robot": node.robot,
        "progress": progress(node, now),
        "finished": node.finished(),
        "leads": [
            str(crossings.name_of(event) or event.hex())
            for event, schedule in crossings.schedules.items()
            if schedule.leader == node.robot
        ],
        "queue": queue,
    }

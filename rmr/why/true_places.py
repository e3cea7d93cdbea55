"""Where the robots of a recorded run really were: the topic `/tf`, which the world writes and no robot reads."""

from bisect import bisect_right
from collections import defaultdict
from typing import Any

from rmr.base.geometry import Pose, hypot
from rmr.base.time import Instant
from rmr.record.recording import Recording

TOPIC = "/tf"


class TruePlaces:
    """The true places of one robot, ten times a second while any robot moves."""

    def __init__(self) -> None:
        self._at: list[Instant] = []
        self._places: list[tuple[float, float]] = []

    def add(self, at: Instant, x: float, y: float) -> None:
        """Add a place; instants ascend."""
        self._at.append(at)
        self._places.append((x, y))

    def off_m(self, at: Instant, pose: Pose) -> float:
        """Return how far `pose` is from the nearer of the places before and after `at`, metres; 0 without any."""
        after = bisect_right(self._at, at)
        around = self._places[max(0, after - 1) : after + 1]
        return min([hypot(pose.x - x, pose.y - y) for x, y in around], default=0.0)


def true_places(recording: Recording) -> dict[int, TruePlaces]:
    """Return the true places of each robot of `recording`; what is damaged is left out."""
    found: defaultdict[int, TruePlaces] = defaultdict(TruePlaces)
    for message in recording.messages((TOPIC,)):
        transforms: Any = message.data.get("transforms", ())
        for each in transforms:
            try:
                kind, _, robot = each["child_frame_id"].partition("/")
                where = each["translation"]
                if kind == "robot" and robot.isdigit():
                    found[int(robot)].add(message.at, float(where["x"]), float(where["y"]))
            except (KeyError, TypeError, ValueError, AttributeError):
                continue
    return dict(found)

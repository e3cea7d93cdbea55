"""The bodies around: those in view, and those that have just left it.

The field of view is narrow. A body that has left it is remembered for a moment where it would be now, and if it crept,
where it was, for it may have stopped; so turning away from a body does not make it vanish. It is forgotten as soon as
its robot says where it is, and when it ought to be in view but is not.
"""

import math
from collections.abc import Sequence
from typing import Final, final

from rmr.base.arena import RobotShape
from rmr.base.geometry import Point, Pose, hypot
from rmr.base.motion_scale import scale_of
from rmr.base.time import Instant, in_seconds
from rmr.node.motion.avoid import CREEPING_MPS, STILL_MPS
from rmr.node.motion.hearing import ReportedState
from rmr.node.ports import SeenBody

MEMORY_S: Final = 0.8
"""How long a body that has left the field of view is remembered."""
REMEMBERED_MAX: Final = 8
"""Bodies remembered at once; no more fit around a robot within its view."""
VIEW_DEPTH_SLACK_M: Final = 0.02
"""A body this near to the far edge of the field of view need not be seen."""
VIEW_ANGLE_SLACK_RAD: Final = 0.05
"""A body this near to the side edges of the field of view need not be seen."""


@final
class _Sighting:
    """A body on the floor: where it was and how it moved when last seen. It is never changed."""

    __slots__ = ("at", "vx", "vy", "x", "y")

    def __init__(self, x: float, y: float, vx: float, vy: float, at: Instant) -> None:
        self.x: Final = x
        self.y: Final = y
        self.vx: Final = vx
        self.vy: Final = vy
        self.at: Final = at

    @property
    def stood(self) -> bool:
        """Whether it did not move."""
        return hypot(self.vx, self.vy) < STILL_MPS

    def superseded_by(self, other: ReportedState, radius: float) -> bool:
        """Return whether this is the robot `other`, which has reported its place since."""
        age = in_seconds(other.at - self.at)
        away = hypot(self.x + self.vx * age - other.x, self.y + self.vy * age - other.y)
        return age > 0.0 and away < radius


class BodyMemory:
    """The bodies that one robot has seen, on the floor."""

    __slots__ = ("_near_m", "_remembers", "_shape", "_sightings")

    def __init__(self, shape: RobotShape, *, remembers: bool = True) -> None:
        self._shape = shape
        self._near_m: Final = scale_of(shape).near_m
        """A body that stood is remembered within this distance, while some robot near may not be heard."""
        self._remembers = remembers
        self._sightings: list[_Sighting] = []

    def update(
        self,
        now: Instant,
        pose: Pose,
        bodies: Sequence[SeenBody],
        heard: Sequence[ReportedState] = (),
        keeps_still: bool = False,
    ) -> Sequence[SeenBody]:
        """Take in what is seen from `pose` and was `heard`; `keeps_still`: some robot near may not be heard at all.

        Returns `bodies`, and behind them those remembered, all in the robot's frame.
        """
        if not bodies and not self._sightings:
            return bodies
        cos = math.cos(pose.theta)
        sin = math.sin(pose.theta)
        # From the robot's frame to the floor: rotate by the heading, then shift by the position.
        fresh = [
            _Sighting(
                pose.x + b.x * cos - b.y * sin,
                pose.y + b.x * sin + b.y * cos,
                b.vx * cos - b.vy * sin,
                b.vx * sin + b.vy * cos,
                now,
            )
            for b in bodies
        ]
        around = list(bodies)
        kept = fresh
        for sighting in self._sightings if self._remembers else ():
            old = sighting
            if in_seconds(now - old.at) > MEMORY_S:
                # No robot has said that it is there, and none that does not speak drives off. So it still stands.
                if not keeps_still or not old.stood or hypot(old.x - pose.x, old.y - pose.y) > self._near_m:
                    continue
                old = _Sighting(old.x, old.y, 0.0, 0.0, old.at)
            age = in_seconds(now - old.at)
            x = old.x + old.vx * age
            y = old.y + old.vy * age
            if any(hypot(x - f.x, y - f.y) < self._shape.radius for f in fresh):
                continue
            if any(old.superseded_by(other, self._shape.radius) for other in heard):
                continue
            moving = _in_frame(pose, cos, sin, x, y, old.vx * cos + old.vy * sin, old.vy * cos - old.vx * sin)
            if not self._in_view(moving):
                kept.append(old)
                around.append(moving)
                if 0.0 < hypot(old.vx, old.vy) < CREEPING_MPS:
                    around.append(_in_frame(pose, cos, sin, old.x, old.y, 0.0, 0.0))
        self._sightings = kept[:REMEMBERED_MAX]
        return around

    def _in_view(self, body: SeenBody) -> bool:
        """Return whether the body would surely be seen if it were there."""
        away = hypot(body.x, body.y)
        return (
            away < self._shape.view_depth + self._shape.radius - VIEW_DEPTH_SLACK_M
            and abs(math.atan2(body.y, body.x)) < 0.5 * self._shape.view_angle - VIEW_ANGLE_SLACK_RAD
        )

    def places(self, now: Instant) -> list[Point]:
        """Return where the bodies around are now, on the floor."""
        ages = [in_seconds(now - seen.at) for seen in self._sightings]
        pairs = zip(self._sightings, ages, strict=True)
        return [Point(seen.x + seen.vx * age, seen.y + seen.vy * age) for seen, age in pairs]


def _in_frame(pose: Pose, cos: float, sin: float, x: float, y: float, vx: float, vy: float) -> SeenBody:
    """Return a body at floor point (x, y) in the frame of a robot at `pose`; (vx, vy) is in that frame already."""
    dx = x - pose.x
    dy = y - pose.y
    return SeenBody(dx * cos + dy * sin, dy * cos - dx * sin, vx, vy)

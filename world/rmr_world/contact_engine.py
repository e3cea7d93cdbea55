"""Contacts of hulls with each other, obstacles and walls: pymunk's rigid-body engine, seen from above, without gravity.

Without contact a body is integrated in `physics`. The engine runs only for ticks in which a hull comes near something;
before that, the poses that changed in the meantime are copied into it.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import pymunk

from rmr.base.arena import Arena, Disc
from rmr.base.geometry import Pose
from rmr.base.time import Instant

MASS_KG: Final = 0.5

_FRICTION: Final = 0.3
_ROBOT: Final = 1
_FIXED: Final = 2
"""Collision types, and categories of shapes (a bit each)."""
_OPAQUE: Final = pymunk.ShapeFilter(mask=_FIXED)
"""Filter of the ray cast of `hides`: obstacles and walls block the view, robots do not."""

Touch = Callable[[list[int], tuple[float, float] | None], None]
"""Callback with one or two robots, the lower id first, and the point of contact if it is known."""


class Contact(NamedTuple):
    """The beginning of a contact."""

    at: Instant
    """Beginning of the tick of the contact."""
    robot: int
    other: int | None
    """The other robot's id; None: an obstacle or a wall."""
    x: float
    """Metres."""
    y: float


class ContactEngine:
    """Hulls, obstacles and walls."""

    def __init__(self, arena: Arena, begin: Touch, end: Touch) -> None:
        """`begin` and `end` are called, from `step`, when a contact begins and ends."""
        self._radius = arena.shape.radius
        self._begin = begin
        self._end = end
        self._space = pymunk.Space()
        # Metres by which bodies in contact may overlap; pymunk's default is 0.1.
        self._space.collision_slop = 0.0002
        self._bodies: dict[int, pymunk.Body] = {}
        self._robots: dict[pymunk.Shape, int] = {}
        self.extents: list[tuple[float, float, float, float]] = []
        """Left, bottom, right and top of each obstacle."""
        self._fix(arena)
        for other in (_ROBOT, _FIXED):
            self._space.on_collision(_ROBOT, other, begin=self._touching, separate=self._parted)

    def _fix(self, arena: Arena) -> None:
        """Add walls and obstacles."""
        ground = self._space.static_body
        shapes: list[pymunk.Shape] = []
        for obstacle in arena.obstacles:
            if isinstance(obstacle, Disc):
                shapes.append(pymunk.Circle(ground, obstacle.radius, (obstacle.centre.x, obstacle.centre.y)))
            else:
                shapes.append(pymunk.Poly(ground, [(x, y) for x, y in obstacle.corners]))
        w = arena.width
        h = arena.height
        t = 0.1  # thickness of the walls, metres; they lie outside the arena
        corners = [(-t, -t), (w + t, -t), (w + t, h + t), (-t, h + t)]
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            shapes.append(pymunk.Segment(ground, a, b, t))
        for shape in shapes:
            shape.collision_type = _FIXED
            shape.friction = _FRICTION
            shape.filter = pymunk.ShapeFilter(categories=_FIXED)
        self._space.add(*shapes)
        for shape in shapes[: len(arena.obstacles)]:
            box = shape.bb
            self.extents.append((box.left, box.bottom, box.right, box.top))

    def add(self, robot: int, pose: Pose) -> None:
        """Put the body of `robot` on the floor."""
        body = pymunk.Body(MASS_KG, pymunk.moment_for_circle(MASS_KG, 0.0, self._radius))
        body.position = (pose.x, pose.y)
        body.angle = pose.theta
        hull = pymunk.Circle(body, self._radius)
        hull.collision_type = _ROBOT
        hull.friction = _FRICTION
        hull.filter = pymunk.ShapeFilter(categories=_ROBOT)
        self._space.add(body, hull)
        self._bodies[robot] = body
        self._robots[hull] = robot

    def place(self, robot: int, x: float, y: float, theta: float) -> None:
        """Set the pose of `robot`."""
        body = self._bodies[robot]
        body.position = (x, y)
        body.angle = theta

    def drive(self, robot: int, vx: float, vy: float, w: float) -> None:
        """Set the velocity of `robot`, m/s and rad/s."""
        body = self._bodies[robot]
        body.velocity = (vx, vy)
        body.angular_velocity = w

    def where(self, robot: int) -> tuple[float, float, float]:
        """Return the position and heading of `robot`."""
        body = self._bodies[robot]
        x, y = body.position
        return x, y, body.angle

    def step(self, duration_s: float) -> None:
        """Advance all bodies by one step."""
        self._space.step(duration_s)

    def hides(self, a: tuple[float, float], b: tuple[float, float]) -> bool:
        """Return whether an obstacle or a wall lies between two points."""
        return self._space.segment_query_first(a, b, 0.0, _OPAQUE) is not None

    def _touching(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:  # noqa: ARG002
        points = arbiter.contact_point_set.points
        where = None
        if points:
            # Which of the two shapes is `a` depends on earlier queries of the engine; the middle does not.
            ax, ay = points[0].point_a
            bx, by = points[0].point_b
            where = 0.5 * (ax + bx), 0.5 * (ay + by)
        self._begin(self._of(arbiter), where)

    def _parted(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:  # noqa: ARG002
        self._end(self._of(arbiter), None)

    def _of(self, arbiter: pymunk.Arbiter) -> list[int]:
        """Return the robots in a contact, the lower id first."""
        return sorted([robot for shape in arbiter.shapes if (robot := self._robots.get(shape)) is not None])

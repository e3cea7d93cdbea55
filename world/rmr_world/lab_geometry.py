"""Geometry of the lab file: obstacles, areas with their places, queues, grids of starts.

Each function takes one part of the file that conforms to the schema. A part that cannot be built raises ValueError with
a message for the author of the file; the caller adds the place.
"""

from itertools import pairwise

from rmr.base.arena import Area, Disc, Obstacle, Polygon
from rmr.base.geometry import Point, Pose, distance
from rmr_world.convex_parts import convex_parts
from rmr_world.schema import AreaSpec, GridSpec, LineSpec, ObstacleSpec, QueueSpec

Box = tuple[float, float, float, float]

QUEUE_PLACES_MAX = 1000
_EPSILON = 1e-9
"""Tolerance of rounding for equal lengths, metres."""


def _point(x: float, y: float) -> Point:
    """Return a computed point rounded to a nanometre, as it would be written by hand."""
    return Point(round(x, 9), round(y, 9))


def obstacles_of(spec: ObstacleSpec) -> list[Obstacle]:
    """Return the obstacles that make up what `spec` describes, corners counter-clockwise. Raises ValueError."""
    if spec.circle is not None:
        x, y, radius = spec.circle
        return [Disc(Point(x, y), radius)]
    if spec.box is not None:
        return [Polygon(box_corners(spec.box))]
    return [Polygon(part) for part in convex_parts([Point(*corner) for corner in spec.polygon or ()])]


def box_corners(box: Box) -> tuple[Point, ...]:
    """Return the corners of (x0, y0, x1, y1) counter-clockwise. Raises ValueError when it has no inside."""
    x0, y0, x1, y1 = box
    if not (x0 < x1 and y0 < y1):
        raise ValueError("box should be [x0, y0, x1, y1] with x0 < x1 and y0 < y1")
    return Point(x0, y0), Point(x1, y0), Point(x1, y1), Point(x0, y1)


def area_of(name: str, spec: AreaSpec) -> Area:
    """Return the area that `spec` describes. Raises ValueError."""
    queue = queue_places(spec.queue) if spec.queue else ()
    if spec.box is not None:
        corners = box_corners(spec.box)
        centre = Point((corners[0].x + corners[2].x) / 2, (corners[0].y + corners[2].y) / 2)
        return Area(name, (centre,), box=spec.box, queue=queue)
    if spec.at is not None:
        return Area(name, (Point(*spec.at),), queue=queue)
    places = line_places(spec.line) if spec.line else tuple(Point(*place) for place in spec.slots or ())
    return Area(name, places, slotted=True, queue=queue)


def line_places(line: LineSpec) -> tuple[Point, ...]:
    """Return `count` places evenly spaced from one end of the line to the other."""
    ax, ay = line.from_
    bx, by = line.to
    last = line.count - 1
    return tuple(_point(ax + (bx - ax) * k / last, ay + (by - ay) * k / last) for k in range(line.count))


def queue_places(queue: QueueSpec) -> tuple[Point, ...]:
    """Return the places of a queue: the first at the beginning of the path, then as many as fit at its spacing.

    Raises ValueError when there would be more than QUEUE_PLACES_MAX.
    """
    corners = [Point(*corner) for corner in queue.path]
    length = sum(distance(*a, *b) for a, b in pairwise(corners))
    if length / queue.spacing >= QUEUE_PLACES_MAX:
        raise ValueError(f"queue has more than {QUEUE_PLACES_MAX} places")
    return tuple(_along(corners, k * queue.spacing) for k in range(int(length / queue.spacing + _EPSILON) + 1))


def _along(corners: list[Point], way: float) -> Point:
    """Return the point `way` metres along the path, or its end if it is shorter."""
    for a, b in pairwise(corners):
        length = distance(*a, *b)
        if way <= length and length > 0.0:
            return _point(a.x + (b.x - a.x) * way / length, a.y + (b.y - a.y) * way / length)
        way -= length
    return corners[-1]


def grid_poses(grid: GridSpec, count: int) -> list[Pose]:
    """Return `count` starts, row by row."""
    x, y = grid.from_
    dx, dy = grid.step
    return [Pose(*_point(x + k % grid.columns * dx, y + k // grid.columns * dy), grid.facing) for k in range(count)]


def overlaps(obstacle: Obstacle, width: float, height: float) -> bool:
    """Return whether a part of `obstacle` may lie in the arena (by its bounding box)."""
    if isinstance(obstacle, Disc):
        x, y = obstacle.centre
        r = obstacle.radius
        corners = [Point(x - r, y - r), Point(x + r, y + r)]
    else:
        corners = list(obstacle.corners)
    xs = [c.x for c in corners]
    ys = [c.y for c in corners]
    return max(xs) > 0.0 and min(xs) < width and max(ys) > 0.0 and min(ys) < height

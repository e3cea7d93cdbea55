"""Geometry of the lab file: obstacles, areas with their places, queues, grids of starts.

Each function takes one part of the file that conforms to the schema. A part that cannot be built raises ValueError with
a message for the author of the file; the caller adds the place.
"""

from collections.abc import Sequence
from itertools import combinations, pairwise

from rmr.base.arena import Area, Disc, Obstacle, Polygon
from rmr.base.geometry import Point, Pose, distance
from rmr_world.schema import AreaSpec, GridSpec, LineSpec, ObstacleSpec, QueueSpec

Box = tuple[float, float, float, float]

QUEUE_PLACES_MAX = 1000


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
    # Tolerance of rounding for equal lengths, metres.
    return tuple(_along(corners, k * queue.spacing) for k in range(int(length / queue.spacing + 1e-9) + 1))


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


# ---- convex parts of a polygon: what engine, planner and sensors work on
#
# A simple polygon is cut into triangles by ear clipping; triangles that share an edge are then joined again while
# the union is convex (Hertel and Mehlhorn, 1983: at most four times the least number of parts).

Corners = tuple[Point, ...]

STRAIGHT_M2 = 1e-12
"""Twice the area of three corners up to which they lie on a line, square metres: the rounding of lengths as written."""


def convex_parts(corners: Sequence[Point]) -> list[Corners]:
    """Return convex polygons, counter-clockwise, that make up the polygon with these corners and do not overlap.

    A convex polygon is its own only part. Corners on a straight edge are left out. Raises ValueError unless the outline
    is simple: it does not cross or touch itself, and has an inside.
    """
    if len(set(corners)) < len(corners):
        raise ValueError("polygon should name each corner once; the last one need not repeat the first")
    outline = _without_straight(corners)
    if len(outline) < 3:
        raise ValueError("polygon should have an inside: its corners lie on a line")
    edges = list(zip(outline, outline[1:] + outline[:1], strict=True))
    for (i, first), (j, second) in combinations(enumerate(edges), 2):
        if j - i not in (1, len(edges) - 1) and _meet(*first, *second):
            raise ValueError(f"polygon crosses or touches itself: {_written(*first)} and {_written(*second)}")
    if _twice_area(outline) < 0.0:
        outline = outline[::-1]
    if _is_convex(outline):
        return [outline]
    return _joined(_triangles(outline))


def _triangles(outline: Corners) -> list[Corners]:
    """Return the triangles of a simple polygon that runs counter-clockwise."""
    left = list(outline)
    triangles: list[Corners] = []
    while len(left) > 3:
        for i, tip in enumerate(left):
            before, after = left[i - 1], left[(i + 1) % len(left)]
            ear = (before, tip, after)
            others = [corner for corner in left if corner not in ear]
            if _turn(*ear) > 0.0 and not any(_within(corner, ear) for corner in others):
                break
        else:
            raise ValueError("polygon is too narrow somewhere to be told apart from a line")
        triangles.append(ear)
        del left[i]
    return [*triangles, tuple(left)]


def _joined(parts: list[Corners]) -> list[Corners]:
    """Return the parts with neighbours joined wherever the union is convex."""
    for first, second in combinations(parts, 2):
        union = _union(first, second)
        if union is not None:
            return _joined([*(part for part in parts if part is not first and part is not second), union])
    return [_without_straight(part) for part in parts]


def _union(first: Corners, second: Corners) -> Corners | None:
    """Return the union of two convex polygons that share an edge if it is convex, else None."""
    for i, end in enumerate(first):
        start = first[i - 1]
        if end in second and second[(second.index(end) + 1) % len(second)] == start:
            k = second.index(end)
            # From `end` around the first one to `start`, then the corners of the second one that are not shared.
            rest = (second[(k + 2 + n) % len(second)] for n in range(len(second) - 2))
            union = (*first[i:], *first[:i], *rest)
            return union if _is_convex(union) else None
    return None


def _without_straight(corners: Sequence[Point]) -> Corners:
    """Return the corners without those that lie on the line from the one before to the one after."""
    kept = list(corners)
    for corner in corners:
        i = kept.index(corner)
        if len(kept) > 2 and abs(_turn(kept[i - 1], corner, kept[(i + 1) % len(kept)])) <= STRAIGHT_M2:
            del kept[i]
    return tuple(kept)


def _is_convex(corners: Corners) -> bool:
    """Return whether a simple outline that runs counter-clockwise turns right nowhere."""
    threes = zip(corners, corners[1:] + corners[:1], corners[2:] + corners[:2], strict=True)
    return all(_turn(*three) >= -STRAIGHT_M2 for three in threes)


def _turn(a: Point, b: Point, c: Point) -> float:
    """Return twice the area of the triangle a, b, c: positive if it turns left."""
    return (b.x - a.x) * (c.y - b.y) - (b.y - a.y) * (c.x - b.x)


def _twice_area(corners: Corners) -> float:
    """Return twice the signed area: positive if the corners run counter-clockwise."""
    return sum(a.x * b.y - b.x * a.y for a, b in zip(corners, corners[1:] + corners[:1], strict=True))


def _within(point: Point, triangle: Corners) -> bool:
    """Return whether a point lies in a triangle that runs counter-clockwise, or on its edge."""
    a, b, c = triangle
    return _turn(a, b, point) >= 0.0 and _turn(b, c, point) >= 0.0 and _turn(c, a, point) >= 0.0


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Return whether the segments a-b and c-d have a point in common."""
    sides = (_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b))
    if sides[0] * sides[1] < 0.0 and sides[2] * sides[3] < 0.0:
        return True
    ends = ((a, b, c), (a, b, d), (c, d, a), (c, d, b))
    return any(side == 0.0 and _between(*three) for side, three in zip(sides, ends, strict=True))


def _between(a: Point, b: Point, point: Point) -> bool:
    """Return whether a point on the line through a and b lies between them."""
    return min(a.x, b.x) <= point.x <= max(a.x, b.x) and min(a.y, b.y) <= point.y <= max(a.y, b.y)


def _written(a: Point, b: Point) -> str:
    """Return an edge as the author of the file wrote it."""
    return f"the edge from [{a.x:g}, {a.y:g}] to [{b.x:g}, {b.y:g}]"

"""Messages under Foxglove's schemas: poses, the scene, the occupied cells, log lines.

The z axis points up; robots and obstacles have heights so that they show in three dimensions.
"""

import base64
import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, Final

from rmr.base.arena import Area, Arena, Disc, Obstacle, Polygon
from rmr.base.time import NS_PER_S, Instant

MAP: Final = "map"
"""The frame of the arena: its origin is the corner at which x and y are least."""
ROBOT_HEIGHT_M: Final = 0.1
WALL_HEIGHT_M: Final = 0.15
LEVELS: Final = {"debug": 1, "info": 2, "warning": 3, "error": 4, "critical": 5}
"""Foxglove's numbers of levels, by Python's names."""

_LEVEL: Final = {"x": 0, "y": 0, "z": 0, "w": 1}
_BODY: Final = {"r": 0.16, "g": 0.42, "b": 0.72, "a": 1.0}
_WALL: Final = {"r": 0.35, "g": 0.35, "b": 0.38, "a": 1.0}
_AREA: Final = {"r": 0.2, "g": 0.6, "b": 0.3, "a": 0.5}
_BEACON: Final = {"r": 0.85, "g": 0.55, "b": 0.1, "a": 1.0}
_INK: Final = {"r": 0.1, "g": 0.1, "b": 0.1, "a": 1.0}


def stamp(now: Instant) -> dict[str, int]:
    """Return an instant as Foxglove writes it; one before 0 counts as 0."""
    sec, nsec = divmod(max(0, now), NS_PER_S)
    return {"sec": sec, "nsec": nsec}


def robot_frame(robot: int) -> str:
    """Return the name of a robot's frame."""
    return f"robot/{robot}"


def estimate_frame(robot: int) -> str:
    """Return the name of the frame of the pose that a robot believes to have."""
    return f"robot/{robot}/estimate"


def transforms_json(now: Instant, poses: Iterable[tuple[str, float, float, float]]) -> bytes:
    """Return FrameTransforms of (frame, x, y, heading) in `map`, encoded.

    Written out, as a run has thousands. Metres to 0.1 mm, headings to 0.02 degrees: the numbers are whole numbers of
    1e-4, with that exponent. Digits after a point take ten times as long to write.
    """
    sec, nsec = divmod(max(0, now), NS_PER_S)
    head = f'{{"timestamp":{{"sec":{sec},"nsec":{nsec}}},"parent_frame_id":"{MAP}","child_frame_id":"'
    each = [
        f'{head}{frame}","translation":{{"x":{_e4(x)}e-4,"y":{_e4(y)}e-4,"z":0}},"rotation":{{"x":0,"y":0,'
        f'"z":{_e4(math.sin(0.5 * heading))}e-4,"w":{_e4(math.cos(0.5 * heading))}e-4}}}}'
        for frame, x, y, heading in poses
    ]
    return f'{{"transforms":[{",".join(each)}]}}'.encode()


def _e4(value: float) -> int:
    """Return `value` in units of 1e-4, rounded."""
    return math.floor(value * 1e4 + 0.5)


def heading_of(rotation: dict[str, float]) -> float:
    """Return the heading of a rotation about the z axis, radians."""
    return 2.0 * math.atan2(rotation["z"], rotation["w"])


def log_message(now: Instant, level: str, name: str, message: str) -> dict[str, Any]:
    """Return a Log of `level`, a name of `logging` in lower case."""
    return {
        "timestamp": stamp(now),
        "level": LEVELS.get(level, 0),
        "message": message,
        "name": name,
        "file": "",
        "line": 0,
    }


def grid(arena: Arena) -> dict[str, Any]:
    """Return the occupied cells of the arena, row by row from y = 0: 1 where an obstacle is, else 0.

    A cell is occupied if an obstacle comes nearer to its middle than half of its edge.
    """
    cell = arena.cell
    columns = max(1, math.ceil(arena.width / cell - 1e-9))
    rows = max(1, math.ceil(arena.height / cell - 1e-9))
    data = bytearray(rows * columns)
    for obstacle in arena.obstacles:
        _occupy(data, obstacle, cell, columns, rows)
    return {
        "timestamp": stamp(0),
        "frame_id": MAP,
        "pose": _pose(0.0, 0.0),
        "column_count": columns,
        "cell_size": {"x": cell, "y": cell},
        "row_stride": columns,
        "cell_stride": 1,
        "fields": [{"name": "occupied", "offset": 0, "type": 1}],
        "data": base64.b64encode(data).decode(),
    }


def _occupy(data: bytearray, obstacle: Obstacle, cell: float, columns: int, rows: int) -> None:
    """Mark the cells of one obstacle; only those that its bounding box touches are looked at."""
    reach = 0.5 * cell - 1e-9
    x0, y0, x1, y1 = obstacle.extent
    for row in range(max(0, int(y0 / cell) - 1), min(rows, int(y1 / cell) + 2)):
        for column in range(max(0, int(x0 / cell) - 1), min(columns, int(x1 / cell) + 2)):
            if obstacle.distance((column + 0.5) * cell, (row + 0.5) * cell) < reach:
                data[row * columns + column] = 1


def scene(arena: Arena, roster: Sequence[int]) -> dict[str, Any]:
    """Return the scene: the arena, and each robot in its own frame, so that it moves with the robot's pose."""
    entities = [_floor(arena), *(_area(area) for area in arena.areas)]
    entities += [_robot(arena, robot) for robot in roster]
    return {"deletions": [], "entities": entities}


def _pose(x: float, y: float, z: float = 0.0) -> dict[str, Any]:
    return {"position": {"x": x, "y": y, "z": z}, "orientation": _LEVEL}


def _entity(name: str, frame: str, **primitives: list[dict[str, Any]]) -> dict[str, Any]:
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": stamp(0),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
    } | {kind: primitives.get(kind, []) for kind in kinds}


def _cylinder(x: float, y: float, radius: float, height: float, color: dict[str, float]) -> dict[str, Any]:
    return {
        "pose": _pose(x, y, 0.5 * height),
        "size": {"x": 2.0 * radius, "y": 2.0 * radius, "z": height},
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": color,
    }


def _line(points: Iterable[tuple[float, float]], color: dict[str, float], *, closed: bool = True) -> dict[str, Any]:
    return {
        "type": 1 if closed else 0,
        "pose": _pose(0.0, 0.0),
        "thickness": 0.01,
        "scale_invariant": False,
        "points": [{"x": x, "y": y, "z": 0.0} for x, y in points],
        "color": color,
        "colors": [],
        "indices": [],
    }


def _triangles(corners: Sequence[tuple[float, float, float]], color: dict[str, float]) -> dict[str, Any]:
    return {
        "pose": _pose(0.0, 0.0),
        "points": [{"x": x, "y": y, "z": z} for x, y, z in corners],
        "color": color,
        "colors": [],
        "indices": [],
    }


def _text(x: float, y: float, z: float, words: str) -> dict[str, Any]:
    return {
        "pose": _pose(x, y, z),
        "billboard": True,
        "font_size": 0.08,
        "scale_invariant": False,
        "color": _INK,
        "text": words,
    }


def _prism(polygon: Polygon) -> dict[str, Any]:
    """Return a convex obstacle as a prism of triangles: its sides, and its top as a fan."""
    h = WALL_HEIGHT_M
    corners = [(corner.x, corner.y) for corner in polygon.corners]
    found: list[tuple[float, float, float]] = []
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        found += [(ax, ay, 0.0), (bx, by, 0.0), (bx, by, h), (ax, ay, 0.0), (bx, by, h), (ax, ay, h)]
    (x0, y0), *rest = corners
    for (ax, ay), (bx, by) in pairwise(rest):
        found += [(x0, y0, h), (ax, ay, h), (bx, by, h)]
    return _triangles(found, _WALL)


def _floor(arena: Arena) -> dict[str, Any]:
    """Return the entity with the edge of the arena, its obstacles and beacons."""
    edge = [(0.0, 0.0), (arena.width, 0.0), (arena.width, arena.height), (0.0, arena.height)]
    discs = [obstacle for obstacle in arena.obstacles if isinstance(obstacle, Disc)]
    return _entity(
        "arena",
        MAP,
        lines=[_line(edge, _WALL)],
        cylinders=[_cylinder(*disc.centre, disc.radius, WALL_HEIGHT_M, _WALL) for disc in discs],
        triangles=[_prism(obstacle) for obstacle in arena.obstacles if isinstance(obstacle, Polygon)],
        spheres=[
            {"pose": _pose(x, y, WALL_HEIGHT_M), "size": {"x": 0.04, "y": 0.04, "z": 0.04}, "color": _BEACON}
            for x, y in arena.beacons
        ],
    )


def _area(area: Area) -> dict[str, Any]:
    lines = []
    if area.box is not None:
        x0, y0, x1, y1 = area.box
        lines.append(_line([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], _AREA))
    if area.queue:
        lines.append(_line([(x, y) for x, y in area.queue], _AREA, closed=False))
    x, y = area.places[0]
    return _entity(
        f"area/{area.name}",
        MAP,
        lines=lines,
        cylinders=[_cylinder(*place, 0.03, 0.005, _AREA) for place in area.places],
        texts=[_text(x, y, 0.02, area.name)],
    )


def _robot(arena: Arena, robot: int) -> dict[str, Any]:
    shape = arena.shape
    reach = shape.radius + shape.view_depth
    arc = [shape.view_angle * (step / 8 - 0.5) for step in range(9)]
    rim = [(reach * math.cos(angle), reach * math.sin(angle), 0.002) for angle in arc]
    cone = [corner for a, b in pairwise(rim) for corner in ((0.0, 0.0, 0.002), a, b)]
    nose = {
        "pose": _pose(0.0, 0.0, ROBOT_HEIGHT_M),
        "shaft_length": 0.6 * shape.radius,
        "shaft_diameter": 0.02,
        "head_length": 0.4 * shape.radius,
        "head_diameter": 0.04,
        "color": _INK,
    }
    return _entity(
        robot_frame(robot),
        robot_frame(robot),
        cylinders=[_cylinder(0.0, 0.0, shape.radius, ROBOT_HEIGHT_M, _BODY)],
        triangles=[_triangles(cone, {"r": 0.16, "g": 0.42, "b": 0.72, "a": 0.2})],
        arrows=[nose],
        texts=[_text(0.0, 0.0, ROBOT_HEIGHT_M + 0.05, str(robot))],
    )

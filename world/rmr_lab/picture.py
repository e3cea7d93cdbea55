"""Drawings of a lab before a run: as an SVG, and as a text that fits into a terminal.

The layers of the SVG are obstacles, areas with their slots, boxes and queues, beacons, narrow passages, named passages,
the robots with their headings and fields of view, and the route of each robot to its destination, from the robots' own
planner. Metres are scaled to pixels; y points up.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from itertools import combinations

from rmr.base.arena import Area, Arena, Disc
from rmr.base.geometry import Point
from rmr.node.driver import spots
from rmr.node.motion.keep_right import gated_route
from rmr_world.bound import bound_s
from rmr_world.lab import Lab, RobotStart
from rmr_world.narrow_places import NarrowPassage

MARGIN_PX = 30.0
"""Margin around the floor, which holds the coordinates of the grid."""
HEADER_PX = 26.0
"""Height of the title."""
ROUTES_MAX = 100
"""Bound of the routes that are planned and drawn: each plan takes milliseconds."""
STYLE = """
.floor { fill: #fbfbf8; stroke: #333; stroke-width: 2 }
.grid { stroke: #e4e4de; stroke-width: 1 }
.obstacle { fill: #8d8d86; stroke: #55554f }
.slot { fill: #dcebdc; stroke: #3f8f4f; stroke-width: 1.5 }
.box { fill: #3f8f4f; fill-opacity: 0.12; stroke: #3f8f4f; stroke-width: 1.5 }
.queue { fill: none; stroke: #b8860b; stroke-dasharray: 3 3 }
.mouth { fill: none; stroke: #c22; stroke-width: 3 }
.narrow { fill: none; stroke: #c22; stroke-opacity: 0.15 }
.passage { stroke: #c22; stroke-width: 2; stroke-dasharray: 8 4 }
.beacon { fill: #7a3fb0 }
.view { fill: #3465a4; fill-opacity: 0.10 }
.way { fill: none; stroke: #3465a4; stroke-width: 1.5; stroke-opacity: 0.55 }
.robot { fill: #3465a4; stroke: #1b3f6e }
.heading { stroke: #fff; stroke-width: 2.5; stroke-linecap: round }
text { font-family: sans-serif; font-size: 13px; fill: #222 }
.small { font-size: 10px; fill: #555; text-anchor: middle }
.id { font-size: 11px; fill: #1b3f6e; font-weight: bold; text-anchor: middle }
.name { fill: #2b6437; font-weight: bold; paint-order: stroke; stroke: #fbfbf8; stroke-width: 3 }
"""


def draw(lab: Lab, goals: Mapping[int, Area], passages: Sequence[NarrowPassage] = ()) -> str:
    """Return `lab` as the text of an SVG; `goals` holds the destination of each robot by its id."""
    return _Picture(lab, goals, passages).text()


class _Picture:
    """One picture."""

    def __init__(self, lab: Lab, goals: Mapping[int, Area], passages: Sequence[NarrowPassage]) -> None:
        self._lab = lab
        self._goals = goals
        self._passages = passages
        self._arena: Arena = lab.arena
        self._scale = 900.0 / max(lab.arena.width, lab.arena.height)  # length of the longer side of the floor

    def text(self) -> str:
        width = self._arena.width * self._scale + 2 * MARGIN_PX
        height = self._arena.height * self._scale + 2 * MARGIN_PX + HEADER_PX
        parts = [
            *self._floor(),
            *self._obstacles(),
            *self._areas(),
            *self._found(),
            *self._named(),
            *self._routes(),
        ]
        parts += [*self._beacons(), *self._robots(), *self._labels()]
        size = f'width="{width:.0f}" height="{height:.0f}" viewBox="0 0 {width:.0f} {height:.0f}"'
        head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<style>{STYLE}</style>\n'
        return head + "\n".join(parts) + "\n</svg>\n"

    # -- places -------------------------------------------------------------------------------------------------

    def _x(self, x: float) -> float:
        return MARGIN_PX + x * self._scale

    def _y(self, y: float) -> float:
        return MARGIN_PX + HEADER_PX + (self._arena.height - y) * self._scale

    def _circle(self, kind: str, at: Point, radius_m: float, least_px: float = 0.0) -> str:
        radius = max(least_px, radius_m * self._scale)
        return f'<circle class="{kind}" cx="{self._x(at.x):.1f}" cy="{self._y(at.y):.1f}" r="{radius:.1f}"/>'

    def _rect(self, kind: str, x0: float, y0: float, x1: float, y1: float) -> str:
        at = f'x="{self._x(x0):.1f}" y="{self._y(y1):.1f}"'
        size = f'width="{(x1 - x0) * self._scale:.1f}" height="{(y1 - y0) * self._scale:.1f}"'
        return f'<rect class="{kind}" {at} {size}/>'

    def _line(self, kind: str, a: Point, b: Point) -> str:
        ends = f'x1="{self._x(a.x):.1f}" y1="{self._y(a.y):.1f}" x2="{self._x(b.x):.1f}" y2="{self._y(b.y):.1f}"'
        return f'<line class="{kind}" {ends}/>'

    def _points(self, points: Iterable[Point]) -> str:
        return " ".join(f"{self._x(x):.1f},{self._y(y):.1f}" for x, y in points)

    def _text(self, kind: str, at: Point, words: str, up_px: float = 0.0) -> str:
        place = f'x="{self._x(at.x):.1f}" y="{self._y(at.y) - up_px:.1f}"'
        return f'<text class="{kind}" {place}>{escape(words)}</text>'

    # -- layers -------------------------------------------------------------------------------------------------

    def _floor(self) -> Iterator[str]:
        arena = self._arena
        lab = self._lab
        least = bound_s(lab)
        bound = f"; nothing finishes sooner than {least:.1f} s" if 0.0 < least < math.inf else ""
        title = f"{lab.name}: {arena.width:g} m x {arena.height:g} m, {len(lab.robots)} robots{bound}"
        yield f'<text x="{MARGIN_PX:.0f}" y="{MARGIN_PX:.0f}">{escape(title)}</text>'
        yield self._rect("floor", 0.0, 0.0, arena.width, arena.height)
        step = _grid_step(max(arena.width, arena.height))
        for k in range(1, math.ceil(arena.width / step)):
            yield self._line("grid", Point(k * step, 0.0), Point(k * step, arena.height))
            yield self._text("small", Point(k * step, 0.0), f"{k * step:g}", -13)
        for k in range(1, math.ceil(arena.height / step)):
            yield self._line("grid", Point(0.0, k * step), Point(arena.width, k * step))
            yield f'<text class="small" x="{MARGIN_PX - 14:.0f}" y="{self._y(k * step) + 4:.1f}">{k * step:g}</text>'

    def _obstacles(self) -> Iterator[str]:
        for obstacle in self._arena.obstacles:
            if isinstance(obstacle, Disc):
                yield self._circle("obstacle", obstacle.centre, obstacle.radius)
            else:
                yield f'<polygon class="obstacle" points="{self._points(obstacle.corners)}"/>'

    def _areas(self) -> Iterator[str]:
        radius = self._arena.shape.radius
        for area in self._arena.areas:
            if area.box is not None:
                yield self._rect("box", *area.box)
            else:
                for number, place in enumerate(area.places, 1):
                    yield self._circle("slot", place, radius)
                    if area.slotted:
                        yield self._text("small", place, str(number), -4)
            for number, place in enumerate(area.queue, 1):
                yield self._circle("queue", place, radius)
                yield self._text("small", place, str(number), -4)

    def _named(self) -> Iterator[str]:
        for passage in self._arena.passages:
            for mouth in passage.mouths:
                yield self._circle("mouth", mouth, self._arena.shape.radius)
            for ends in combinations(passage.mouths, 2):
                yield self._line("passage", *ends)

    def _found(self) -> Iterator[str]:
        for passage in self._passages:
            width = passage.width * self._scale
            points = self._points(passage.line)
            yield f'<polyline class="narrow" stroke-width="{width:.1f}" points="{points}"/>'
            yield self._text("small", passage.line[len(passage.line) // 2], passage.name, -4)

    def _routes(self) -> Iterator[str]:
        taken: dict[str, int] = {}
        for robot in self._lab.robots[:ROUTES_MAX]:
            goal = self._goals.get(robot.id)
            if goal is None:
                continue
            places = spots(self._arena, goal)
            number = taken[goal.name] = taken.get(goal.name, -1) + 1
            place = places[number % len(places)]
            route = gated_route(self._arena, Point(robot.pose.x, robot.pose.y), place, ())
            if route is not None:
                yield f'<polyline class="way" points="{self._points(route.points)}"/>'

    def _beacons(self) -> Iterator[str]:
        for x, y in self._arena.beacons:
            px = self._x(x)
            py = self._y(y)
            corners = f"{px - 6:.1f},{py + 5:.1f} {px + 6:.1f},{py + 5:.1f} {px:.1f},{py - 7:.1f}"
            yield f'<polygon class="beacon" points="{corners}"/>'

    def _robots(self) -> Iterator[str]:
        for robot in self._lab.robots:
            yield self._view(robot)
        for robot in self._lab.robots:
            x, y, theta = robot.pose
            radius = self._arena.shape.radius
            front = Point(x + radius * math.cos(theta), y + radius * math.sin(theta))
            yield self._circle("robot", Point(x, y), radius, 2.0)
            yield self._line("heading", Point(x, y), front)

    def _view(self, robot: RobotStart) -> str:
        x, y, theta = robot.pose
        shape = self._arena.shape
        half = min(shape.view_angle, math.tau * 0.999) / 2.0
        a, b = (
            Point(x + shape.view_depth * math.cos(t), y + shape.view_depth * math.sin(t))
            for t in (theta - half, theta + half)
        )
        reach = shape.view_depth * self._scale
        wide = int(half > math.pi / 2.0)  # the large-arc flag of an SVG path
        arc = f"A {reach:.1f} {reach:.1f} 0 {wide} 0 {self._points([b])}"
        return f'<path class="view" d="M {self._points([Point(x, y), a])} {arc} Z"/>'

    def _labels(self) -> Iterator[str]:
        radius = self._arena.shape.radius
        for robot in self._lab.robots:
            yield self._text("id", Point(robot.pose.x, robot.pose.y), str(robot.id), radius * self._scale + 4)
        ends = {area.name: passage.name for passage in self._arena.passages for area in passage.entrances}
        for area in self._arena.areas:
            top = max(place.y for place in area.places) + radius
            left = min(place.x for place in area.places) - radius
            if area.box is not None:
                left = area.box[0]
                top = area.box[3]
            capacity = self._arena.capacity(area.name)
            station = f" (station, {capacity})" if capacity else ""
            role = f" ({ends[area.name]})" if area.name in ends else station
            yield self._text("name", Point(left, min(top, self._arena.height)), area.name + role, 5)


def _grid_step(side_m: float) -> float:
    """Return the spacing of the grid, 1, 2 or 5 times a power of ten, so that `side_m` has 3 to 8 lines."""
    power = 10.0 ** math.floor(math.log10(side_m / 3.0))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= side_m / 3.0)


# ---- as text

COLUMNS_MAX = 98
"""Characters across, without the frame."""
ROWS_MAX = 40
"""Characters upwards."""


def text_map(
    arena: Arena, lines: Mapping[str, Iterable[tuple[Point, Point]]], points: Mapping[str, list[Point]]
) -> str:
    """Return the floor as lines of text, north at the top.

    `lines` and `points` hold what to mark by its character; later marks cover earlier ones.
    """
    aspect = 2.0  # height of a character over its width
    columns = COLUMNS_MAX
    rows = round(columns * arena.height / arena.width / aspect)
    if rows > ROWS_MAX:
        rows = ROWS_MAX
        columns = max(1, round(rows * aspect * arena.width / arena.height))
    rows = max(1, rows)
    cell_x = arena.width / columns
    cell_y = arena.height / rows
    marks = [[_floor(arena, (c + 0.5) * cell_x, (r + 0.5) * cell_y) for c in range(columns)] for r in range(rows)]

    def mark(at: Point, sign: str) -> None:
        column = min(columns - 1, max(0, int(at.x / cell_x)))
        row = min(rows - 1, max(0, int(at.y / cell_y)))
        marks[row][column] = sign

    for sign, ends in lines.items():
        for a, b in ends:
            for k in range(201):  # points of a line that are marked: more than there are characters across
                t = k / 200
                mark(Point(a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t), sign)
    for sign, places in points.items():
        for place in places:
            mark(place, sign)
    frame = f"+{'-' * columns}+"
    return "\n".join([frame, *(f"|{''.join(row)}|" for row in reversed(marks)), frame])


def _floor(arena: Arena, x: float, y: float) -> str:
    return "#" if arena.clearance(x, y) <= 0.0 else " "

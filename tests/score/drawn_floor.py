"""Floors that nobody chose: size, walls, racks and obstacles, drawn at the scale of the robots that drive there.

A floor is open or has one wall with doors, rooms with doors, aisles between racks, four arms that cross, or single
obstacles. Its openings (`Gate`) are as wide as one robot or as two, with some room to spare. Lengths grow with the
robot: with its radius, and for fast robots with the way that they cover in some seconds.

Places to stand are drawn so that a way exists whatever stands on all others: discs around them that another robot
drives past do not overlap each other and touch no obstacle, but at the outer wall. No planner is asked, so that the
floor of a seed does not change with the product.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from random import Random
from typing import Any, Final

from rmr.base.arena import Disc, Obstacle, Polygon
from rmr.base.geometry import Point, distance

Box = tuple[float, float, float, float]

DEFAULT_RADIUS_M: Final = 0.07
DEFAULT_SPEED_MPS: Final = 0.2
SPARE_M: Final = 0.06
"""Least difference between the width of an opening and that of what drives through, metres: the planner needs 0.03."""
TRIES: Final = 400
"""Points that are tried for one place."""


@dataclass(frozen=True, slots=True)
class Gate:
    """An opening between two parts of the floor."""

    ends: tuple[Point, Point]
    """The middle of either side of it."""
    width: float
    """Metres."""
    narrow: bool
    """Whether it is as wide as one robot, not as two."""


@dataclass(frozen=True, slots=True)
class Shape:
    """The robots, for which a floor is drawn."""

    radius: float
    """Metres."""
    speed: float
    """Metres per second."""

    @property
    def scale(self) -> float:
        """Lengths of a floor relative to those for the default robot."""
        return max(self.radius / DEFAULT_RADIUS_M, 0.5 * self.speed / DEFAULT_SPEED_MPS)


@dataclass(frozen=True, slots=True)
class Floor:
    """A drawn floor."""

    kind: str
    width: float
    """Metres."""
    height: float
    obstacles: tuple[tuple[dict[str, list[Any]], Obstacle], ...]
    """Each as the lab file has it, and as a value that knows distances."""
    gates: tuple[Gate, ...]

    def clearance(self, at: Point) -> float:
        """Return the distance of `at` from the nearest obstacle, metres; infinite without any."""
        return min((obstacle.distance(*at) for _, obstacle in self.obstacles), default=math.inf)


class FloorDraft:
    """What the kinds of floors are drawn with: the stream, the robots, the size, and the step of all coordinates."""

    def __init__(self, rng: Random, shape: Shape, robots: int, step: float, room: float) -> None:
        """`step` is the grid of all coordinates, metres: that of the pixels where the floor becomes an image. `room` is
        the area relative to a usual one."""
        self.rng = rng
        self.shape = shape
        self.step = step
        scale = shape.scale
        area = max(robots, 3) * math.exp(rng.uniform(math.log(0.45), math.log(1.8))) * scale**2 * room
        ratio = rng.uniform(1.0, 2.0)
        self.width = self.at(max(math.sqrt(area * ratio), 1.5 * scale))
        self.height = self.at(max(math.sqrt(area / ratio), 1.2 * scale))
        self.obstacles: list[tuple[dict[str, list[Any]], Obstacle]] = []
        self.gates: list[Gate] = []

    def at(self, value: float) -> float:
        """Return the multiple of the step next to `value`."""
        return round(round(value / self.step) * self.step, 4)

    def between(self, low: float, high: float) -> float:
        """Return a drawn multiple of the step."""
        return self.at(self.rng.uniform(low, high))

    def opening(self) -> tuple[float, bool]:
        """Return the width of an opening, and whether it is narrow."""
        radius = self.shape.radius
        narrow = self.rng.random() < 0.65
        least = 2.0 * radius + SPARE_M if narrow else 4.0 * radius + 0.09
        more = self.rng.uniform(0.0, 1.4 * radius) if narrow else self.rng.uniform(0.02, 5.0 * radius)
        return math.ceil((least + more) / self.step) * self.step, narrow

    def box(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Add an obstacle along the axes, unless nothing of it is left."""
        x0, y0, x1, y1 = (self.at(value) for value in (x0, y0, x1, y1))
        if x1 - x0 > 0.0 and y1 - y0 > 0.0:
            corners = (Point(x0, y0), Point(x1, y0), Point(x1, y1), Point(x0, y1))
            self.obstacles.append(({"box": [x0, y0, x1, y1]}, Polygon(corners)))

    def gate(self, one: tuple[float, float], other: tuple[float, float], width: float, *, narrow: bool) -> None:
        """Add an opening whose ends are moved outwards until they are as far from each other as a robot is wide."""
        long = distance(*one, *other)
        away = max(self.rng.choice((0.0, 0.5, 1.0)) * self.shape.radius, self.shape.radius + 0.02 - long / 2.0)
        dx, dy = ((other[0] - one[0]) / long * away, (other[1] - one[1]) / long * away)
        ends = (
            Point(round(one[0] - dx, 3), round(one[1] - dy, 3)),
            Point(round(other[0] + dx, 3), round(other[1] + dy, 3)),
        )
        self.gates.append(Gate(ends, width, narrow))

    def wall_with_openings(
        self, low: float, high: float, begin: float, end: float, count: int, *, upright: bool
    ) -> None:
        """Add a wall from `begin` to `end` along one axis, `low` to `high` along the other, with `count` openings."""
        share = (end - begin) / max(count, 1)
        edge = begin
        for number in range(count):
            width, narrow = self.opening()
            rest = share - width - 4.0 * self.step
            if rest <= 0.0:
                continue
            first = self.at(begin + number * share + 2.0 * self.step + self.rng.uniform(0.0, rest))
            self._wall(low, high, edge, first, upright=upright)
            edge = self.at(first + width)
            middle = round((first + edge) / 2.0, 4)
            ends = ((low, middle), (high, middle)) if upright else ((middle, low), (middle, high))
            self.gate(*ends, width, narrow=narrow)
        self._wall(low, high, edge, end, upright=upright)

    def _wall(self, low: float, high: float, begin: float, end: float, *, upright: bool) -> None:
        if upright:
            self.box(low, begin, high, end)
        else:
            self.box(begin, low, end, high)


def _open(_draft: FloorDraft) -> None:
    """No obstacle at all."""


def _doors(draft: FloorDraft) -> None:
    """One wall, thin or as thick as a corridor is long, with one opening or two."""
    thick = draft.between(0.1 * draft.shape.scale, 0.25 * draft.width)
    left = draft.between(0.3 * draft.width, 0.65 * draft.width - thick)
    draft.wall_with_openings(
        left, draft.at(left + thick), 0.0, draft.height, draft.rng.choice((1, 1, 1, 2)), upright=True
    )


def _rooms(draft: FloorDraft) -> None:
    """Two to six rooms in a grid, each with a door to the next one in its row, and rows with one door at least."""
    columns, rows = draft.rng.choice(((2, 1), (3, 1), (2, 2), (3, 2)))
    thick = draft.between(0.05 * draft.shape.scale, 0.15 * draft.shape.scale)
    xs = [draft.at(draft.width * k / columns) for k in range(columns + 1)]
    ys = [draft.at(draft.height * k / rows) for k in range(rows + 1)]
    half = draft.at(thick / 2.0) or draft.step
    for x in xs[1:-1]:
        for low, high in pairwise(ys):
            bottom, top = low + half * (low > 0.0), high - half * (high < draft.height)
            draft.wall_with_openings(draft.at(x - half), draft.at(x + half), bottom, top, 1, upright=True)
    for y in ys[1:-1]:
        certain = draft.rng.randrange(columns)
        for column, (left, right) in enumerate(pairwise(xs)):
            count = 1 if column == certain or draft.rng.random() < 0.5 else 0
            draft.wall_with_openings(draft.at(y - half), draft.at(y + half), left, right, count, upright=False)


def _aisles(draft: FloorDraft) -> None:
    """Racks from wall to wall with two to four aisles between and beside them."""
    long = draft.between(0.2 * draft.width, 0.35 * draft.width)
    left = draft.between(0.3 * draft.width, 0.7 * draft.width - long)
    draft.wall_with_openings(left, draft.at(left + long), 0.0, draft.height, draft.rng.randint(2, 4), upright=True)


def _crossing(draft: FloorDraft) -> None:
    """Two wide ways that cross, between four blocks."""
    radius = draft.shape.radius

    def arm(length: float) -> tuple[float, float]:
        wide = min(draft.rng.uniform(6.5, 14.0) * radius + 0.2, 0.7 * length)
        begin = draft.between(0.15 * length, 0.85 * length - wide)
        return begin, draft.at(begin + wide)

    (left, right), (low, high) = arm(draft.width), arm(draft.height)
    for x0, x1 in ((0.0, left), (right, draft.width)):
        for y0, y1 in ((0.0, low), (high, draft.height)):
            draft.box(x0, y0, x1, y1)


def _corridors(draft: FloorDraft) -> None:
    """Narrow corridors that meet, three or four, with yards at their ends; most of the yards are divided by walls."""
    rng = draft.rng
    left, right = (
        draft.between(0.2 * draft.width, 0.35 * draft.width),
        draft.between(0.65 * draft.width, 0.8 * draft.width),
    )
    low, high = (
        draft.between(0.2 * draft.height, 0.35 * draft.height),
        draft.between(0.65 * draft.height, 0.8 * draft.height),
    )
    top = high if rng.random() < 0.5 else draft.height  # with four arms, or three
    radius = draft.shape.radius

    def arm(begin: float, end: float) -> tuple[float, float]:
        wide = math.ceil((2.0 * radius + SPARE_M + rng.uniform(0.0, 1.4 * radius)) / draft.step) * draft.step
        first = draft.at(begin + rng.uniform(0.25, 0.75) * (end - begin - wide))
        return first, draft.at(first + wide)

    (x0, x1), (y0, y1) = arm(left, right), arm(low, high)
    thick = draft.at(0.05 * draft.shape.scale)
    for near, far, edge in ((left, x0, left), (x1, right, right - thick)):
        draft.box(near, low, far, y0)
        draft.box(near, y1, far, top)
        for begin, end in ((0.0, low), (top, draft.height)):
            if rng.random() < 0.8:
                draft.box(edge, begin, edge + thick, end)


def _obstacles(draft: FloorDraft) -> None:
    """Boxes, discs and turned boxes, so far from each other and from the walls that a robot fits through, or two."""
    rng, radius = draft.rng, draft.shape.radius
    gap = 2.0 * radius + SPARE_M + rng.choice((0.0, 0.5, 2.5)) * radius
    extents: list[Box] = []
    for _ in range(rng.randint(2, 9)):
        size = rng.uniform(0.1, 0.5) * draft.shape.scale
        extent = _room_for(draft, size + gap, extents)
        if extent is None:
            continue
        extents.append(extent)
        x, y = (extent[0] + extent[2]) / 2.0, (extent[1] + extent[3]) / 2.0
        _obstacle(draft, rng.choice(("box", "circle", "polygon")), draft.at(x), draft.at(y), size)


def _room_for(draft: FloorDraft, reach: float, others: Iterable[Box]) -> Box | None:
    """Return a square with half side `reach` in the arena that overlaps the others by no gap; None if there is none."""
    if 2.0 * reach >= min(draft.width, draft.height):
        return None
    for _ in range(TRIES):
        x = draft.rng.uniform(reach, draft.width - reach)
        y = draft.rng.uniform(reach, draft.height - reach)
        square = (x - reach, y - reach, x + reach, y + reach)
        if not any(a[0] < square[2] and square[0] < a[2] and a[1] < square[3] and square[1] < a[3] for a in others):
            return square
    return None


def _obstacle(draft: FloorDraft, form: str, x: float, y: float, size: float) -> None:
    """Add one obstacle within `size` of (x, y)."""
    if form == "circle":
        radius = round(size * 0.9, 3)
        draft.obstacles.append(({"circle": [x, y, radius]}, Disc(Point(x, y), radius)))
        return
    wide, high = (size * draft.rng.uniform(0.3, 0.7) for _ in "xy")
    if form == "box":
        draft.box(x - wide, y - high, x + wide, y + high)
        return
    angle = draft.rng.uniform(0.2, 1.3)
    cos, sin = math.cos(angle), math.sin(angle)
    corners = [(-wide, -high), (wide, -high), (wide, high), (-wide, high)]
    turned = [Point(round(x + a * cos - b * sin, 3), round(y + a * sin + b * cos, 3)) for a, b in corners]
    draft.obstacles.append(({"polygon": [list(point) for point in turned]}, Polygon(tuple(turned))))


FLOORS: Final[dict[str, Callable[[FloorDraft], None]]] = {
    "open": _open,
    "doors": _doors,
    "rooms": _rooms,
    "aisles": _aisles,
    "crossing": _crossing,
    "obstacles": _obstacles,
    "corridors": _corridors,
}
"""The kinds of floors."""


def draw_floor(rng: Random, kind: str, shape: Shape, robots: int, step: float, room: float = 1.0) -> Floor:
    """Return a floor of a kind for so many robots, all of its coordinates multiples of `step`."""
    draft = FloorDraft(rng, shape, robots, step, room)
    FLOORS[kind](draft)
    return Floor(kind, draft.width, draft.height, tuple(draft.obstacles), tuple(draft.gates))


def pixels(floor: Floor, step: float) -> bytes:
    """Return the floor as an image (PGM, binary), its pixels `step` wide, obstacles black."""
    columns, rows = round(floor.width / step), round(floor.height / step)
    light = [bytearray(b"\xfe" * columns) for _ in range(rows)]
    for _, obstacle in floor.obstacles:
        x0, y0, x1, y1 = (round(edge / step) for edge in obstacle.extent)
        for row in range(max(0, y0 - 1), min(rows, y1 + 1)):
            for column in range(max(0, x0 - 1), min(columns, x1 + 1)):
                if obstacle.distance((column + 0.5) * step, (row + 0.5) * step) == 0.0:
                    light[rows - 1 - row][column] = 0
    return f"P5\n{columns} {rows}\n255\n".encode() + b"".join(light)


def places(
    rng: Random, floor: Floor, radius: float, count: int, *, beside: Sequence[Point] = (), parked: bool = True
) -> list[Point]:
    """Return up to `count` places to stand, apart from those in `beside`; the module says what keeps them apart.

    Where robots park for good (`parked`), the openings have room to their ends, too.
    """
    found: list[Point] = []
    for place in _candidates(rng, floor, radius, count):
        apart = all(distance(*place, *other) >= 4.0 * radius + 0.1 for other in (*beside, *found))
        clear = floor.clearance(place) >= 3.0 * radius + 0.08
        ends = (end for gate in floor.gates for end in gate.ends)
        if apart and clear and not (parked and any(distance(*place, *end) < 5.0 * radius for end in ends)):
            found.append(place)
        if len(found) == count:
            break
    return found


def _candidates(rng: Random, floor: Floor, radius: float, count: int) -> Iterator[Point]:
    """Yield points of the arena at which the outer wall lets a robot stand."""
    margin = radius + 0.03
    if 2.0 * margin >= min(floor.width, floor.height):
        return
    for _ in range(TRIES * count):
        x, y = rng.uniform(margin, floor.width - margin), rng.uniform(margin, floor.height - margin)
        yield Point(round(x, 3), round(y, 3))

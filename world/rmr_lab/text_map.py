"""A floor as text: a map that fits into a terminal, 98 characters wide at most and twice as coarse upwards."""

from collections.abc import Iterable, Mapping

from rmr.base.arena import Arena
from rmr.base.geometry import Point

COLUMNS_MAX = 98
"""Characters across, without the frame."""
ROWS_MAX = 40
"""Characters upwards."""
ASPECT = 2.0
"""Height of a character over its width."""
LINE_STEPS = 200
"""Points of a line that are marked: more than there are characters across."""


def text_map(
    arena: Arena, lines: Mapping[str, Iterable[tuple[Point, Point]]], points: Mapping[str, list[Point]]
) -> str:
    """Return the floor as lines of text, north at the top.

    `lines` and `points` hold what to mark by its character; later marks cover earlier ones.
    """
    columns = COLUMNS_MAX
    rows = round(columns * arena.height / arena.width / ASPECT)
    if rows > ROWS_MAX:
        rows = ROWS_MAX
        columns = max(1, round(rows * ASPECT * arena.width / arena.height))
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
            for k in range(LINE_STEPS + 1):
                t = k / LINE_STEPS
                mark(Point(a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t), sign)
    for sign, places in points.items():
        for place in places:
            mark(place, sign)
    frame = f"+{'-' * columns}+"
    return "\n".join([frame, *(f"|{''.join(row)}|" for row in reversed(marks)), frame])


def _floor(arena: Arena, x: float, y: float) -> str:
    return "#" if arena.clearance(x, y) <= 0.0 else " "

"""A path over the grid: a first cell and steps to one of the eight neighbours, three bits each (paper IV.D)."""

import math
from dataclasses import dataclass
from typing import Final

STEPS: Final[tuple[tuple[int, int], ...]] = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""Step code 0..7: column and row difference, counter-clockwise from east."""


@dataclass(frozen=True, slots=True)
class GridPath:
    """Cells are (column, row), row 0 at y = 0."""

    first: tuple[int, int]
    steps: tuple[int, ...]

    @property
    def length(self) -> float:
        """Its length, in edges of a cell."""
        return sum(math.hypot(*STEPS[step]) for step in self.steps)

    def cells(self) -> list[tuple[int, int]]:
        """Return all cells in order, the first included."""
        column, row = self.first
        cells = [(column, row)]
        for step in self.steps:
            dc, dr = STEPS[step]
            column = column + dc
            row = row + dr
            cells.append((column, row))
        return cells

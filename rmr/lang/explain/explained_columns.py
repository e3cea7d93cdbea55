"""Whether a program's robots can be run all at once, as columns, and what stands in the way."""

from dataclasses import dataclass

from rmr.analysis.column_obstacles import Obstacle, obstacles
from rmr.bytecode.program import Program
from rmr.lang.explain.texts import Spot

OBSTACLES_MAX = 1000
"""Largest number of listed obstacles; of further ones only the number."""


@dataclass(frozen=True, slots=True)
class ExplainedObstacle:
    """A property of the program that rules out columns."""

    text: str
    place: Spot | None
    """The place in the source; None if it concerns the whole program."""


@dataclass(frozen=True, slots=True)
class ExplainedColumns:
    """Whether a program suits columns."""

    suited: bool
    obstacles: tuple[ExplainedObstacle, ...]
    obstacles_left_out: int


def explain_columns(program: Program) -> ExplainedColumns:
    """Return whether `program` suits columns, and if not, why."""
    found = obstacles(program)
    listed = tuple([ExplainedObstacle(each.text, _spot(each)) for each in found[:OBSTACLES_MAX]])
    return ExplainedColumns(not found, listed, len(found) - len(listed))


def _spot(obstacle: Obstacle) -> Spot | None:
    place = obstacle.place
    return None if place is None else Spot(place.file, place.line, place.column)

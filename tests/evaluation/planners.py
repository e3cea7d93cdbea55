"""Planners over one floor: ours, and those of others, each of which makes of the floor what it likes best.

*The same moves.* A robot steps to a side, or across a corner where neither cell beside the step is blocked. networkx
gets a graph of these steps, and pathfinding has a setting for them. scikit-image's solver takes a function for the
cost of a step (`MCP_Flexible`): that of one that a robot cannot do is infinite. The function is Python, and slow.

*Corners cut.* `route_through_array` as it stands also passes between two blocked cells that touch at a corner, and past
the corner of one. Its cost is a lower bound of what a robot can do.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from typing import NamedTuple

from rmr.node.motion import astar

STEPS = tuple((dc, dr) for dc in (-1, 0, 1) for dr in (-1, 0, 1) if dc or dr)
Search = Callable[[], Sequence[int] | None]


class Floor(NamedTuple):
    """Cells with a frame of blocked ones around them, as `rmr.node.motion.grid` lays them out."""

    side: int
    blocked: bytearray
    start: int
    goal: int

    @property
    def stride(self) -> int:
        return self.side + 2

    def free(self) -> list[int]:
        return [cell for cell, blocked in enumerate(self.blocked) if not blocked]

    def moves(self, cell: int) -> list[tuple[int, float]]:
        """Return where a robot can go from `cell`, and at which cost."""
        found = []
        for dc, dr in STEPS:
            there = cell + dr * self.stride + dc
            beside = self.blocked[cell + dc] or self.blocked[cell + dr * self.stride]
            if not self.blocked[there] and not (dc and dr and beside):
                found.append((there, math.hypot(dc, dr)))
        return found


def length(floor: Floor, cells: Sequence[int]) -> float:
    """Return the cost of a path of cells."""
    return sum(1.0 if abs(a - b) in {1, floor.stride} else math.sqrt(2.0) for a, b in pairwise(cells))


def cuts(floor: Floor, cells: Sequence[int]) -> bool:
    """Return whether a path makes a move that a robot must not make."""
    return any(there not in [cell for cell, _ in floor.moves(here)] for here, there in pairwise(cells))


def ours(floor: Floor) -> list[int] | None:
    return astar.search(floor.stride, floor.blocked, floor.start, floor.goal)[0]


def by_skimage(floor: Floor) -> Search:
    """Search by scikit-image with the moves of a robot: it is told where a step leads from and to instead of costs."""
    import numpy as np
    from skimage.graph import MCP_Flexible

    blocked, stride = floor.blocked, floor.stride
    cells = np.arange(len(blocked), dtype=float).reshape(stride, -1)
    places = np.where(np.frombuffer(bytes(blocked), np.uint8).reshape(stride, -1), -1.0, cells)

    class Planner(MCP_Flexible):  # type: ignore[misc]
        def travel_cost(self, old_cost: float, new_cost: float, offset_length: float) -> float:
            step, here = int(new_cost - old_cost), int(old_cost)
            if offset_length > 1.0:
                across = 1 if (step + 1) % stride == 2 else -1
                if blocked[here + across] or blocked[here + step - across]:
                    return math.inf
            return offset_length

    def search() -> list[int]:
        planner = Planner(places)
        goal = divmod(floor.goal, stride)
        planner.find_costs([divmod(floor.start, stride)], [goal])
        return [row * stride + column for row, column in planner.traceback(goal)]

    return search


def by_skimage_cutting(floor: Floor) -> Search:
    """Search by scikit-image as it stands."""
    import numpy as np
    from skimage.graph import route_through_array

    costs = np.where(np.frombuffer(bytes(floor.blocked), np.uint8).reshape(floor.stride, -1), -1.0, 1.0)
    start, goal = divmod(floor.start, floor.stride), divmod(floor.goal, floor.stride)

    def search() -> list[int]:
        path, _ = route_through_array(costs, start, goal, fully_connected=True, geometric=True)
        return [row * floor.stride + column for row, column in path]

    return search


def by_networkx(floor: Floor) -> Search:
    import networkx

    graph = networkx.Graph()
    graph.add_weighted_edges_from(
        (cell, there, cost) for cell in floor.free() for there, cost in floor.moves(cell) if there > cell
    )
    goal = divmod(floor.goal, floor.stride)

    def aim(cell: int, _: int) -> float:
        row, column = divmod(cell, floor.stride)
        return math.hypot(row - goal[0], column - goal[1])

    return partial(networkx.astar_path, graph, floor.start, floor.goal, aim, "weight")


def by_pathfinding(floor: Floor) -> Search:
    from pathfinding.core.diagonal_movement import DiagonalMovement
    from pathfinding.core.grid import Grid
    from pathfinding.finder.a_star import AStarFinder

    free = [1 - cell for cell in floor.blocked]
    grid = Grid(matrix=[free[at : at + floor.stride] for at in range(0, len(free), floor.stride)])
    finder = AStarFinder(diagonal_movement=DiagonalMovement.only_when_no_obstacle)
    nodes = [grid.node(cell % floor.stride, cell // floor.stride) for cell in (floor.start, floor.goal)]

    def search() -> list[int]:
        grid.cleanup()
        path, _ = finder.find_path(*nodes, grid)
        return [node.y * floor.stride + node.x for node in path]

    return search


CUTTING = "skimage_cutting"
OTHERS: dict[str, Callable[[Floor], Search]] = {
    "skimage": by_skimage,
    CUTTING: by_skimage_cutting,
    "networkx": by_networkx,
    "pathfinding": by_pathfinding,
}  # fmt: skip


def installed() -> list[str]:
    return [name for name in OTHERS if find_spec(name.removesuffix("_cutting")) is not None]

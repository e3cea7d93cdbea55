"""The planner: how near A* comes to the optimum and how long it takes, beside others; what a shared path saves.

*Cost.* Floors of square cells with random boxes. scikit-image's `route_through_array` may pass between two cells that
touch at a corner, and cut a blocked corner, which a robot must not: its cost is a lower bound of ours, and where its
path happens to cut nothing the two must be equal. networkx's Dijkstra walks a graph of just the moves that a robot
may make: its cost must be equal always. Costs are 1 for a side and the root of 2 for a diagonal.

*Time.* Processor time of one search, on the same floors. The others get their floor in the form that they like
best, and what it takes to make that does not count. None of ours is compiled: a robot process carries no numpy.

*Sharing.* Six robots of the test-bed from random starts plan their ways to the exit: each by A* of its own, or five of
them along the part of the leader's path that all need (paper IV.D.1). Counted are the cells that A* takes from its
queue. A robot alone searches three times where its way passes the bottleneck: for the whole way, and for both parts of
one through the bottleneck's very point; beside it stands what a single search for each robot would take.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from random import Random
from types import SimpleNamespace
from typing import Any, NamedTuple

from experiment import Data, figure, panel, series, table, target
from intervals import quantile, text
from runs import LABS, Row, pooled

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance
from rmr.base.streams import stream
from rmr.node.motion import astar
from rmr.node.motion.astar import plan
from rmr.node.motion.route import follower_route, leader_route, shared_part
from rmr_world.lab import load_lab

NAME = "planning"
SEEDS = range(1, 101)
QUICK = range(1, 4)
SIDES = (30, 1000)
"""The paper's N, and a hall of 50 m x 50 m in cells of 5 cm."""
LARGE_RUNS = 5
BLOCKED = 0.25
"""Share of blocked cells, at least."""
RATIO_MAX = 1.2
SAVED_MIN = 70.0
"""Per cent of the expansions that sharing saves at six robots."""
ROBOTS = 6
REPEATED_S = 0.02
"""A search is repeated until it has taken so long."""
STEPS = tuple((dc, dr) for dc in (-1, 0, 1) for dr in (-1, 0, 1) if dc or dr)


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


def floor_of(side: int, seed: int) -> Floor:
    """Return a floor with random boxes, and a start and a goal on opposite sides of it between which there is a way."""
    rng = stream(f"evaluation/floor/{side}/{seed}")
    while True:
        blocked = boxes(side, rng)
        margin = range(1, 1 + max(2, side // 10))
        start, goal = ends(blocked, side, margin, rng)
        floor = Floor(side, blocked, start, goal)
        if not blocked[start] and not blocked[goal] and ours(floor) is not None:
            return floor


def boxes(side: int, rng: Random) -> bytearray:
    stride = side + 2
    blocked = bytearray([1]) * (stride * stride)
    for row in range(1, side + 1):
        blocked[row * stride + 1 : row * stride + 1 + side] = bytes(side)
    frame = stride * stride - side * side
    while sum(blocked) - frame < BLOCKED * side * side:
        wide, high = rng.randint(1, side // 6), rng.randint(1, side // 6)
        column, row = rng.randint(1, side + 1 - wide), rng.randint(1, side + 1 - high)
        for each in range(row, row + high):
            blocked[each * stride + column : each * stride + column + wide] = bytes([1]) * wide
    return blocked


def ends(blocked: bytearray, side: int, margin: Sequence[int], rng: Random) -> tuple[int, int]:
    """Return a random cell at the left and one at the right."""
    rows = rng.randint(1, side), rng.randint(1, side)
    columns = rng.choice(margin), side + 1 - rng.choice(margin)
    start, goal = (row * (side + 2) + column for row, column in zip(rows, columns, strict=True))
    return start, goal


def length(floor: Floor, cells: Sequence[int]) -> float:
    """Return the cost of a path of cells."""
    return sum(1.0 if abs(a - b) in {1, floor.stride} else math.sqrt(2.0) for a, b in pairwise(cells))


def cuts(floor: Floor, cells: Sequence[int]) -> bool:
    """Return whether a path makes a move that a robot must not make."""
    return any(there not in [cell for cell, _ in floor.moves(here)] for here, there in pairwise(cells))


def ours(floor: Floor) -> list[int] | None:
    return astar.search(SimpleNamespace(stride=floor.stride), floor.blocked, floor.start, floor.goal)[0]  # type: ignore


# --- the others: each makes of a floor what it likes best, and returns a search over it -------------------------------

Search = Callable[[], Sequence[int] | None]


def by_skimage(floor: Floor) -> Search:
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


OTHERS: dict[str, Callable[[Floor], Search]] = {
    "skimage": by_skimage,
    "networkx": by_networkx,
    "pathfinding": by_pathfinding,
}  # fmt: skip


def installed() -> list[str]:
    return [name for name in OTHERS if find_spec(name) is not None]


def taken(search: Search) -> tuple[Sequence[int], float]:
    """Return the path of a search and its processor time, the least of several where it is short."""
    times: list[float] = []
    while not times or (sum(times) < REPEATED_S and len(times) < 50):
        began = time.process_time()
        path = search()
        times.append(time.process_time() - began)
    assert path is not None, "floors have a way"
    return path, min(times)


def compared(point: tuple[int, int]) -> Row:
    """Compare all planners on one floor."""
    side, seed = point
    floor = floor_of(side, seed)
    searches: dict[str, Search] = {"rmr": partial(ours, floor)}
    row: Row = {"side": side, "seed": seed}
    for name in ("rmr", *installed()):
        path, row[f"{name}_s"] = taken(searches[name] if name in searches else OTHERS[name](floor))
        row[f"{name}_cost"] = round(length(floor, path), 6)
        if name == "skimage":
            row["skimage_cuts"] = cuts(floor, path)
    return row


# --- what a shared path saves ----------------------------------------------------------------------------------------


@contextmanager
def counted() -> Iterator[list[int]]:
    """Count the expansions of each search that is made meanwhile."""
    counts: list[int] = []
    before = astar.search

    def search(*arguments: Any) -> Any:
        found = before(*arguments)
        counts.append(found[1])
        return found

    astar.search = search  # type: ignore[assignment]
    try:
        yield counts
    finally:
        astar.search = before


def starts(arena: Arena, rng: Random) -> list[Point]:
    """Return random places left of the corridor, where robots keep clear of walls and of each other."""
    found: list[Point] = []
    while len(found) < ROBOTS:
        x, y = rng.uniform(0.1, 0.45), rng.uniform(0.1, 1.4)
        if arena.clearance(x, y) >= arena.shape.radius + 0.02 and all(distance(x, y, *other) > 0.21 for other in found):
            found.append(Point(x, y))
    return found


def shared(seed: int) -> Row:
    """Plan the ways of six robots with and without the leader's path; return what A* expanded."""
    arena = load_lab(LABS / "testbed").arena
    area = arena.area("exit")
    assert area is not None
    places = starts(arena, stream(f"evaluation/starts/{seed}"))
    gate = arena.area("entry")
    assert gate is not None
    order = sorted(places, key=lambda place: distance(*place, *gate.places[0]))
    trips = list(zip(order, area.places, strict=False))
    with counted() as alone:
        for start, goal in trips:
            leader_route(arena, start, goal, (), through_gate=True)
    with counted() as once:
        for start, goal in trips:
            plan(arena, start, goal)
    with counted() as together:
        route = leader_route(arena, *trips[0], (), through_gate=True)
        assert route is not None
        path = shared_part(arena, route)
        assert path is not None
        leading = sum(together)
        for start, goal in trips[1:]:
            follower_route(arena, start, goal, (), path)
    followers = sum(together) - leading
    return {
        "seed": seed,
        "alone": sum(alone),
        "once": sum(once),
        "together": sum(together),
        "followers_alone": sum(alone) - alone_of_leader(alone, trips),
        "followers": followers,
    }


def alone_of_leader(alone: Sequence[int], trips: Sequence[Any]) -> int:
    """Return the share of the leader, whose searches come first; each robot makes equally many."""
    return sum(alone[: len(alone) // len(trips)])


# --- the experiment --------------------------------------------------------------------------------------------------


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Compare planners on floors of both sizes, and count what sharing saves."""
    points = [(SIDES[1], seed) for seed in seeds[:LARGE_RUNS]] if len(seeds) > LARGE_RUNS else []
    runs = pooled(compared, [*points, *((SIDES[0], seed) for seed in seeds)], jobs)
    savings = pooled(shared, seeds, jobs)
    rows = [summary(side, name, picked) for side, picked in by_side(runs) for name in ("rmr", *installed())]
    saved = [100.0 * (1.0 - run["together"] / run["alone"]) for run in savings]
    of_once = [100.0 * (1.0 - run["together"] / run["once"]) for run in savings]
    by_followers = [100.0 * (1.0 - run["followers"] / run["followers_alone"]) for run in savings]
    data: Data = {
        "options": {"sides": SIDES, "blocked": BLOCKED},
        "not_installed": [name for name in OTHERS if name not in installed()],
        "rows": rows,
        "saved": {
            "all": quantile(saved, 0.5),
            "once": quantile(of_once, 0.5),
            "followers": quantile(by_followers, 0.5),
            "least": min(saved),
        },
        "targets": targets(runs, saved),
        "runs": [*runs, *savings],
    }
    return data | {"figure": drawn(rows)}


def by_side(runs: Sequence[Row]) -> list[tuple[int, list[Row]]]:
    found = [(side, [run for run in runs if run["side"] == side]) for side in SIDES]
    return [(side, picked) for side, picked in found if picked]


def summary(side: int, name: str, runs: Sequence[Row]) -> Row:
    """Return what the table tells of one planner on floors of one size."""
    return {
        "side": side,
        "planner": name,
        "ms": quantile([1e3 * run[f"{name}_s"] for run in runs], 0.5),
        "over": quantile([run["rmr_cost"] / run[f"{name}_cost"] for run in runs], 0.5),
        "over_most": max(run["rmr_cost"] / run[f"{name}_cost"] for run in runs),
        "equal": sum(abs(run["rmr_cost"] - run[f"{name}_cost"]) < 1e-3 for run in runs),
    }


def targets(runs: Sequence[Row], saved: Sequence[float]) -> list[Data]:
    """Return the targets that the installed planners allow to judge."""
    found = []
    if "skimage" in installed():
        worst = max(run["rmr_cost"] / run["skimage_cost"] for run in runs)
        found.append(target("A*: cost over scikit-image's optimum, worst floor", worst, at_most=RATIO_MAX))
        same = [abs(run["rmr_cost"] - run["skimage_cost"]) for run in runs if not run["skimage_cuts"]]
        if same:
            where = f"on the {len(same)} floors where it cuts no corner"
            found.append(target(f"A*: cost beyond it {where}", max(same), at_most=1e-3))
    if "networkx" in installed():
        apart = max(abs(run["rmr_cost"] - run["networkx_cost"]) for run in runs)
        found.append(target("A*: cost beyond the optimum of the same moves (networkx)", apart, at_most=1e-3))
    share = sum(saved) / len(saved)
    return [*found, target("shared path: expansions saved at six robots, mean", share, at_least=SAVED_MIN, unit="%")]


def drawn(rows: Sequence[Row]) -> Data:
    """Return the times as a figure."""
    panels = []
    names = list(dict.fromkeys(row["planner"] for row in rows))
    for side in dict.fromkeys(row["side"] for row in rows):
        shown = [row["ms"] for row in rows if row["side"] == side]
        bars = series(
            "one search", range(len(shown)), [each["value"] for each in shown],
            kind="points", low=[each["low"] for each in shown], high=[each["high"] for each in shown],
        )  # fmt: skip
        ticks = [{"at": at, "label": name} for at, name in enumerate(names)]
        title = f"{side} x {side} cells, {shown[0]['n']} floors"
        panels.append(panel("", "processor time, ms", [bars], title=title, ticks=ticks, y_log=True))
    return figure("One search for a way", "Medians over the floors; bars: 95 % intervals of the median.", panels)


def ratios(row: Row) -> tuple[str, str, str]:
    """Return how our costs compare with another's, as cells of a table."""
    return f"{row['over']['value']:.4f}", f"{row['over_most']:.4f}", str(row["equal"])


def tables(data: Data) -> dict[str, list[str]]:
    """Return the tables of the page."""
    header = ("cells", "planner", "floors", "one search, ms: median", "our cost / its cost: median", "most", "equal")
    lines = [
        (
            f"{row['side']} x {row['side']}",
            row["planner"],
            str(row["ms"]["n"]),
            text(row["ms"], 2 if row["side"] < 100 else 0),
            *(("", "", "") if row["planner"] == "rmr" else ratios(row)),
        )
        for row in data["rows"]
    ]  # fmt: skip
    saved = data["saved"]
    sharing = [
        ("all six", text(saved["all"], 1, " %"), str(saved["all"]["n"])),
        ("all six, against a single search each", text(saved["once"], 1, " %"), str(saved["once"]["n"])),
        ("the five followers", text(saved["followers"], 1, " %"), str(saved["followers"]["n"])),
    ]
    missing = data["not_installed"]
    absent = ["", f"Not installed: {', '.join(missing)}."] if missing else []
    return {
        NAME: [*table(header, lines), *absent],
        "sharing": table(("expansions saved", "median", "seeds"), sharing),
    }

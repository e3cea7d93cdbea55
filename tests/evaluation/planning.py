"""The planner: how near A* comes to the optimum and how long it takes, beside others; what a shared path saves.

*Cost.* Floors of square cells with random boxes; a side costs 1, a diagonal the root of 2. scikit-image, networkx and
pathfinding are given the moves of a robot (`planners`): their costs are the optimum under the same rules, on every
floor. Beside them stands scikit-image as it is, with `route_through_array`, which cuts corners of obstacles, as a robot
must not: that is a lower bound, and says what keeping off corners costs.

*Time.* Processor time of one search, on the same floors. The others get their floor in the form that they like
best, and what it takes to make that does not count. Ours is as `make fast` makes it, where that has been done, and
without numpy, which a robot process does not carry.

*Sharing.* Six robots of the test-bed from random starts plan their ways to the exit: each by A* of its own, or five of
them along the part of the leader's path that all need (paper IV.D.1). Counted are the cells that A* takes from its
queue. A robot alone searches three times where its way passes the bottleneck: for the whole way, and for both parts of
one through the bottleneck's very point; beside it stands what a single search for each robot would take.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from experiment import Data, figure, panel, series, table, target
from intervals import quantile, text
from planners import CUTTING, OTHERS, Floor, Search, cuts, installed, length, ours
from runs import LABS, Row, pooled

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance
from rmr.base.streams import stream
from rmr.node.motion import astar
from rmr.node.motion.astar import plan
from rmr.node.motion.leader_path import follower_route, shared_part
from rmr.node.motion.route import leader_route
from rmr_world.lab_file import load_lab

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
NAMES = {CUTTING: "skimage, cutting"}
"""What tables and figures call a planner, where not by its name."""


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
        row[f"{name}_cuts"] = cuts(floor, path)
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


def interpreted(seeds: Sequence[int]) -> list[Row]:
    """Return `shared` of each seed from a process without compiled modules, whose searches nobody can count."""
    code = (
        "import json, sys; from planning import shared; print(json.dumps([shared(int(seed)) for seed in sys.argv[1:]]))"
    )
    words = [sys.executable, "-c", code, *map(str, seeds)]
    environment = {**os.environ, "RMR_COMPILED": ""}
    answer = subprocess.run(
        words, cwd=Path(__file__).parent, env=environment, capture_output=True, text=True, check=True
    )
    rows: list[Row] = json.loads(answer.stdout)
    return rows


def alone_of_leader(alone: Sequence[int], trips: Sequence[Any]) -> int:
    """Return the share of the leader, whose searches come first; each robot makes equally many."""
    return sum(alone[: len(alone) // len(trips)])


# --- the experiment --------------------------------------------------------------------------------------------------


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Compare planners on floors of both sizes, and count what sharing saves."""
    points = [(SIDES[1], seed) for seed in seeds[:LARGE_RUNS]] if len(seeds) > LARGE_RUNS else []
    runs = pooled(compared, [*points, *((SIDES[0], seed) for seed in seeds)], jobs)
    savings = interpreted(seeds)
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
        "cuts": sum(run[f"{name}_cuts"] for run in runs),
    }


def targets(runs: Sequence[Row], saved: Sequence[float]) -> list[Data]:
    """Return the targets that the installed planners allow to judge."""
    found = []
    for name, words in (("skimage", "scikit-image"), ("networkx", "networkx")):
        if name not in installed():
            continue
        worst = max(run["rmr_cost"] / run[f"{name}_cost"] for run in runs)
        apart = max(abs(run["rmr_cost"] - run[f"{name}_cost"]) for run in runs)
        found += [
            target(f"A*: cost over {words}'s optimum of the same moves, worst floor", worst, at_most=RATIO_MAX),
            target(f"A*: cost beyond {words}'s optimum of the same moves, worst floor", apart, at_most=1e-3),
        ]
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
        ticks = [{"at": at, "label": NAMES.get(name, name)} for at, name in enumerate(names)]
        title = f"{side} x {side} cells, {shown[0]['n']} floors"
        panels.append(panel("", "processor time, ms", [bars], title=title, ticks=ticks, y_log=True))
    return figure("One search for a way", "Medians over the floors; bars: 95 % intervals of the median.", panels)


def tables(data: Data) -> dict[str, list[str]]:
    """Return the tables of the page; the data have how our costs compare with those of others."""
    header = ("cells", "planner", "floors", "one search, ms: median")
    lines = [
        (
            f"{row['side']} x {row['side']}",
            NAMES.get(row["planner"], row["planner"]),
            str(row["ms"]["n"]),
            text(row["ms"], 2 if row["side"] < 100 else 0),
        )
        for row in data["rows"]
        if row["planner"] != "skimage_cutting"  # a lower bound: the data have it
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

"""Opposing traffic: deadlines met at a corridor one robot wide, beside simpler orders and the optimum.

Each seed draws the deadlines anew, so that not all of them can be met (`deploy/labs/twoway`). The robots carry out our
order, the order of deadlines alone and first come, first served. What they told of themselves when they asked for their
turns (when at the gate, how long inside, how far to each place) is also the pure problem of the same run: in it the
order of deadlines, the best batch (all of one side first, each side by deadline) and the optimum are worked out.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from experiment import Data, figure, panel, series, table, target
from intervals import mean, quantile, share, text
from runs import Row, Run, simulated

from rmr.base.motion_scale import scale_of
from rmr.base.time import in_seconds
from rmr.coord.timing import Order, Timing
from rmr.node.crossing.approach import departures
from rmr_sim.simulation import Simulation
from rmr_world.bound import destinations

NAME = "twoway"
SEEDS = range(1, 21)
QUICK = range(1, 3)
ORDERS = {"ours": "ours", "edf": "by deadline alone", "fcfs": "first come, first served"}
"""What `rmr sim --order` knows, carried out by the robots."""
PURE = {"optimum": "optimum", "batch": "best batch", "edf": "by deadline alone"}
"""Worked out on the pure problem."""


class Trip(NamedTuple):
    """What one robot asked for, seconds of lab time."""

    release: float
    inside: float
    tails: tuple[float, ...]
    """From out of the corridor to the K-th place of its side."""
    direction: int
    deadline: float


class Problem(NamedTuple):
    """One run as the scheduler sees it."""

    trips: tuple[Trip, ...]
    headway: float
    opposed: float
    """Between opposite ways, beside the time inside."""

    def entry(self, trip: Trip, last: Trip | None, at: float) -> float:
        """Return when `trip` may enter at the earliest if `last` has entered at `at`."""
        if last is None:
            return trip.release
        gap = self.headway if last.direction == trip.direction else last.inside + self.opposed
        return max(trip.release, at + gap)


def problem_of(simulation: Simulation, report: dict[str, Any]) -> Problem:
    """Return the pure problem of a run: what each robot asked for first."""
    arena, goals = simulation.lab.arena, destinations(simulation.lab)
    asked: dict[int, dict[str, Any]] = {}
    for entry in simulation.trace():
        if entry["what"] == "asks":
            asked.setdefault(entry["robot"], entry)
    trips = []
    for robot, entry in sorted(asked.items()):
        ways = departures(arena, arena.passages[0].entrance(entry["way"]), goals[robot].name)
        tails = tuple(entry["after_s"] + (direction - ways[0]) / arena.shape.speed for direction in ways)
        (job,) = report["robots"][str(robot)]["assertions"]
        release = entry["t"] + entry["approach_s"]
        trips.append(Trip(release, entry["inside_s"], tails, entry["way"], job["deadline_s"]))
    timing = Timing()
    headway = (2 * arena.shape.radius + scale_of(arena.shape).headway_m) / arena.shape.speed
    gap = timing.schedule.window + 2 * timing.clock_error + timing.schedule.clear
    return Problem(tuple(trips), headway, in_seconds(gap))


def met_by(problem: Problem, order: Sequence[Trip]) -> int:
    """Return how many deadlines `order` meets when each goes as early as it may."""
    met, at, last, placed = 0, 0.0, None, [0, 0]
    for trip in order:
        at, last = problem.entry(trip, last, at), trip
        met += at + trip.inside + trip.tails[placed[trip.direction]] <= trip.deadline
        placed[trip.direction] += 1
    return met


def due_out(trip: Trip) -> float:
    """Return by when a robot must be out of the corridor, which is what leaders order by."""
    return trip.deadline - trip.tails[0]


def by_deadline(problem: Problem) -> int:
    """Return how many deadlines the order of deadlines meets."""
    return met_by(problem, sorted(problem.trips, key=due_out))


def best_batch(problem: Problem) -> int:
    """Return how many deadlines are met when all of one side go first, of the better side."""
    ordered = sorted(problem.trips, key=due_out)
    sides = [[trip for trip in ordered if trip.direction == direction] for direction in (0, 1)]
    return max(met_by(problem, [*sides[first], *sides[1 - first]]) for first in (0, 1))


def optimum(problem: Problem) -> int:
    """Return the most deadlines that any order meets; those that cannot be met go last and take the last places.

    By dynamic programming over (set, last): an earlier entry is never worse, for who keeps the gap to the one before
    keeps it to all before.
    """
    trips = problem.trips
    layer: dict[tuple[int, int], float] = {(0, -1): 0.0}
    count = 0
    while True:
        after: dict[tuple[int, int], float] = {}
        for (done, last), at in layer.items():
            for i, trip in enumerate(trips):
                if done >> i & 1:
                    continue
                start = problem.entry(trip, trips[last] if last >= 0 else None, at)
                place = sum(done >> k & 1 for k, other in enumerate(trips) if other.direction == trip.direction)
                key = (done | 1 << i, i)
                if start + trip.inside + trip.tails[place] <= trip.deadline and start < after.get(key, float("inf")):
                    after[key] = start
        if not after:
            return count
        layer, count = after, count + 1


def measured(simulation: Simulation, report: dict[str, Any]) -> Row:
    """Return what the pure problem of a run says."""
    problem = problem_of(simulation, report)
    return {
        "entries": sum(entry["what"] == "entered" for entry in simulation.trace()),
        "pure": {"optimum": optimum(problem), "batch": best_batch(problem), "edf": by_deadline(problem)},
    }


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run each order with each seed."""
    runs = [Run("twoway", seed, {"order": Order(order)}, measured) for order in ORDERS for seed in seeds]
    found = simulated(runs, jobs)
    by_order = {order: found[at * len(seeds) : (at + 1) * len(seeds)] for at, order in enumerate(ORDERS)}
    rows = [{"order": order, **summary(those)} for order, those in by_order.items()]
    ours = by_order["ours"]
    rows += [{"order": f"pure {key}", "met": mean([each["pure"][key] for each in ours])} for key in PURE]
    return {
        "rows": rows,
        "targets": targets(rows),
        "figure": drawn(rows, len(seeds)),
        "runs": [{"order": order, **each} for order, those in by_order.items() for each in those],
    }


def summary(runs: Sequence[Row]) -> Row:
    """Return what a table tells of the runs of one order."""
    return {
        "finished": share(sum(run["finished"] for run in runs), len(runs)),
        "contacts": sum(run["collisions"] for run in runs),
        "met": mean([run["met"] for run in runs]),
        "time_s": quantile([run["time_s"] for run in runs], 0.5),
        "ratio": quantile([run["ratio"] for run in runs], 0.5),
    }


def targets(rows: Sequence[Row]) -> list[Data]:
    """Return what must hold."""
    of = {row["order"]: row for row in rows}
    ours = of["ours"]
    return [
        target("twoway: runs finished", 100.0 * ours["finished"]["value"], at_least=100.0, unit="%"),
        target("twoway: contacts", ours["contacts"], at_most=0),
        target("twoway: met / optimum", ours["met"]["value"] / of["pure optimum"]["met"]["value"], at_least=0.9),
        target("twoway: met - best batch", ours["met"]["value"] - of["pure batch"]["met"]["value"], at_least=0.0),
    ]


def drawn(rows: Sequence[Row], count: int) -> Data:
    """Return the means as a figure."""
    shown = []
    for at, row in enumerate(rows):
        met = row["met"]
        label = _label(row["order"])
        shown.append(series(label, [at], [met["value"]], kind="bars", low=[met["low"]], high=[met["high"]]))
    note = f"four and four robots, {count} seeds, random deadlines from 14 to 36 s; bars: 95 % intervals of the mean"
    ticks = [{"at": at, "label": ""} for at in range(len(rows))]
    return figure("Opposing traffic", note, [panel("", "deadlines met of 8", shown, y_from=0.0, ticks=ticks)])


def _label(order: str) -> str:
    return f"{PURE[order.removeprefix('pure ')]} (pure)" if order.startswith("pure ") else ORDERS[order]


def tables(data: Data) -> dict[str, list[str]]:
    """Return the table of the page."""
    header = ("order", "deadlines met of 8", "time, median", "time / bound, median")
    lines = []
    for row in data["rows"]:
        rest = [text(row["time_s"], 1, " s"), text(row["ratio"])] if "finished" in row else ["", ""]
        lines.append([_label(row["order"]), text(row["met"]), *rest])
    return {NAME: table(header, lines)}

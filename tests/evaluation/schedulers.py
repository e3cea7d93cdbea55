"""Who goes first: deadlines met, contacts and time of our order beside simpler ones, and how near its heuristics come.

*Carried out*: the test bed in a hurry (`deploy/labs/testbed/rush.yaml`): deadlines drawn from the seed, a tenth of the
frames lost. The robots carry out our order, the order of deadlines alone, first come first served, and no coordination
at all. From what they told of themselves when they asked for their turns (when at the gate, how long inside, by when
out) the best of all orders is worked out by trying them (`schedule_bruteforce`), without what it takes to agree; and
once more for robots that stand until the first slots are given.

*On paper*: random jobs at one place, those on time by the optimum, the beam, the insertion, and the two simple orders.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

from experiment import Data, figure, panel, series, table, target
from intervals import Estimate, mean, percent, share, text
from runs import Row, Run, pooled, simulated

from rmr.base.streams import stream
from rmr.base.time import seconds
from rmr.coord.insertion import insertion
from rmr.coord.schedule import Rules, Task, by_deadline, on_time, place, problem_of
from rmr.coord.search import layers, punctual
from rmr.coord.timing import MS, Order
from rmr_sim.simulation import Simulation
from rmr_world.bound import destinations

sys.path.append(str(Path(__file__).parents[1]))

from schedule_bruteforce import optimum

NAME = "schedulers"
SEEDS = range(1, 41)
QUICK = range(1, 3)
LAB = "testbed/rush.yaml"
ORDERS = {
    Order.OURS: "ours",
    Order.EDF: "earliest deadline first",
    Order.FCFS: "first come, first served",
    Order.NONE: "no coordination",
}
AS_GOOD_MIN = 95.0
"""Per cent of the seeds in which as many deadlines are met as by the optimum."""
COUNTS = (4, 8, 12)
WIDTH = 30
"""States of a layer of the beam."""
KINDS = {
    "tight, one way": (500, 1),
    "tight, two ways": (500, 2),
    "loose, one way": (1500, 1),
    "loose, two ways": (1500, 2),
}
"""Slack up to so many milliseconds times the number of jobs, and the ways."""
RULES = Rules(600 * MS, 280 * MS)


def up(value: int, unit: int) -> int:
    """Return `value` as frames carry it, in whole units."""
    return -(-value // unit) * unit


def best_of(simulation: Simulation, report: dict[str, Any]) -> Row:
    """Return how many deadlines the best order meets of what the robots asked for first.

    `optimum`: of robots that know the best order as soon as they have asked, and set out.
    `standing`: of robots that stand until the first slots are given, as they do, for nobody has a turn before.
    """
    asked: dict[int, dict[str, Any]] = {}
    begun = None
    for entry in simulation.trace():
        if entry["what"] == "asks":
            asked.setdefault(entry["robot"], entry)
        elif entry["what"] == "scheduled" and begun is None:
            begun = entry["t"]
    if not asked:
        return {"optimum": None, "standing": None}
    jobs = {robot: part["assertions"][0] for robot, part in report["robots"].items()}
    found = {}
    for name, since in (("optimum", 0.0), ("standing", begun or 0.0)):
        tasks = [asked_task(simulation, entry, jobs[str(robot)]["deadline_s"], since) for robot, entry in asked.items()]
        found[name] = optimum(tasks, [], Rules(0, RULES.opposed)).met
    return found


def asked_task(simulation: Simulation, asked: dict[str, Any], deadline_s: float, since_s: float) -> Task:
    """Return what a robot asked for as the leader takes it, if the robot cannot set out before `since_s`."""
    robot = asked["robot"]
    driver = simulation.robots[0].node.driver
    assert driver is not None
    headway = up(
        driver.approach.headway(destinations(simulation.lab)[robot], simulation.lab.arena.passages[0], asked["way"]),
        20 * MS,
    )
    release = up(seconds(max(asked["t"], since_s) + asked["approach_s"]), 10 * MS)
    out = seconds(deadline_s - asked["after_s"]) // MS * MS
    return Task(robot, release, up(seconds(asked["inside_s"]), 10 * MS), out, headway, asked["way"])


class Drawn(NamedTuple):
    """Random jobs to be ordered on paper."""

    kind: str
    count: int
    seed: int


def jobs_of(drawn: Drawn) -> list[Task]:
    """Return random jobs whose releases lie within 0.8 s for each of them."""
    slack, ways = KINDS[drawn.kind]
    rng: Random = stream(f"evaluation/schedulers/{drawn.kind}/{drawn.count}/{drawn.seed}")
    tasks = []
    for robot in range(1, drawn.count + 1):
        duration, release = rng.randrange(2000, 4000, 10), rng.randrange(0, 800 * drawn.count, 10)
        deadline = release + duration + int(rng.uniform(0.1, 1.0) * slack * drawn.count)
        tasks.append(Task(robot, release * MS, duration * MS, deadline * MS, 950 * MS, rng.randrange(ways), release))
    return tasks


def on_paper(drawn: Drawn) -> Row:
    """Return how many jobs each method keeps on time."""
    tasks = jobs_of(drawn)
    problem = problem_of(sorted(tasks, key=by_deadline), [], RULES)
    inserted = punctual(problem, insertion(problem))
    exact = layers(problem, inserted)
    first_come = sorted(tasks, key=lambda task: (task.release, task.robot))
    return {
        **drawn._asdict(),
        "optimum": -exact[0],
        "beam": -min(inserted, layers(problem, inserted, WIDTH))[0],
        "insertion": -inserted[0],
        "edf": met(sorted(tasks, key=by_deadline)),
        "fcfs": met(first_come),
    }


METHODS = ("optimum", "beam", "insertion", "edf", "fcfs")


def met(order: Sequence[Task]) -> int:
    return on_time(order, place(order, [], RULES))


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run each order with each seed, and order as many random instances of each kind on paper."""
    runs = [Run(LAB, seed, {"order": order}, best_of) for order in ORDERS for seed in seeds]
    found = simulated(runs, jobs)
    by_order = {order: found[at * len(seeds) : (at + 1) * len(seeds)] for at, order in enumerate(ORDERS)}
    drawn = [Drawn(kind, count, seed) for kind in KINDS for count in COUNTS for seed in seeds]
    paper = pooled(on_paper, drawn, jobs)
    rows = [summary(order, rows) for order, rows in by_order.items()]
    return {
        "options": {"lab": LAB},
        "rows": rows,
        "paper": [distances(paper[at : at + len(seeds)]) for at in range(0, len(paper), len(seeds))],
        "targets": targets(rows[0]),
        "figure": shown(rows, len(seeds)),
        "runs": [{"order": order.value, **row} for order, rows in by_order.items() for row in rows],
    }


def summary(order: Order, rows: Sequence[Row]) -> Row:
    """Return what the table tells of the runs by one order."""
    asked = [row for row in rows if row["optimum"] is not None]
    as_good = sum(row["met"] >= row["optimum"] for row in asked)
    standing = sum(row["met"] >= row["standing"] for row in asked)
    return {
        "order": order.value,
        "met": mean([row["met"] for row in rows]),
        "optimum": mean([row["optimum"] for row in asked]) if asked else None,
        "as_good": share(as_good, len(asked)) if asked else None,
        "as_good_standing": share(standing, len(asked)) if asked else None,
        "contacts": sum(row["collisions"] for row in rows),
        "touched": share(sum(row["collisions"] > 0 for row in rows), len(rows)),
        "time_s": mean([row["time_s"] for row in rows]),
        "finished": share(sum(row["finished"] for row in rows), len(rows)),
    }


def distances(rows: Sequence[Row]) -> Row:
    """Return the mean numbers on time of one kind and count."""
    return {"kind": rows[0]["kind"], "count": rows[0]["count"], **{m: mean([r[m] for r in rows]) for m in METHODS}}


def targets(ours: Row) -> list[Data]:
    """Return what our order must keep."""
    as_good = 100.0 * ours["as_good"]["value"]
    return [
        target("rush: seeds with as many deadlines met as the optimum", as_good, at_least=AS_GOOD_MIN, unit="%"),
        target("rush: contacts", ours["contacts"], at_most=0),
    ]


def shown(rows: Sequence[Row], count: int) -> Data:
    """Return deadlines met and time, order beside order."""
    panels = []
    for what, words in (("met", "deadlines met of 6"), ("time_s", "time of the run, s")):
        bars = [
            series(ORDERS[Order(row["order"])], [0], [row[what]["value"]], kind="bars", **limits(row[what]))
            for row in rows
        ]
        panels.append(panel("", words, bars, y_from=0.0, ticks=[{"at": 0, "label": ""}]))
    note = f"test bed in a hurry, {count} seeds an order, 10 % of frames lost; bars: 95 % intervals of the mean"
    return figure("Who goes first", note, panels)


def limits(estimate: Estimate) -> dict[str, list[float | None]]:
    return {side: [estimate[side]] for side in ("low", "high")}


def tables(data: Data) -> dict[str, list[str]]:
    """Return the tables of what was carried out and of what was on paper, of this for the most jobs alone."""
    most = max((row["count"] for row in data["paper"]), default=0)
    best = ("optimum", "as many as it", "as many as it from the first slots on")
    header = ("order", "deadlines met of 6", *best, "time, s")
    lines = [
        (
            ORDERS[Order(row["order"])],
            text(row["met"]),
            "-" if row["optimum"] is None else text(row["optimum"]),
            *("-" if row[key] is None else percent(row[key]) for key in ("as_good", "as_good_standing")),
            text(row["time_s"], 1),
        )
        for row in data["rows"]
    ]
    paper = [
        (row["kind"], str(row["count"]), *(f"{row[method]['value']:.2f}" for method in METHODS))
        for row in data["paper"]
        if row["count"] == most
    ]
    return {NAME: table(header, lines), "orders": table(("jobs", "n", *METHODS), paper)}

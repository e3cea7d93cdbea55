"""The waiting time n (paper IV.C): deadlines met and time against it, beside the n that leaders work out.

Groups of ten robots whose jobs start within a short time, at a place that one robot needs two to three seconds
for, in one way or two; a tenth of the frames is lost. The robots run the real core of coordination, their motion is
ideal (`coord_harness`), so that nothing but who knows what when makes a difference. Deadlines are drawn so that most
jobs can be in time, but not all in any order.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import NamedTuple

from experiment import Data, figure, panel, series, table, target
from intervals import Estimate, mean, text
from runs import Row, pooled

from rmr.base.streams import stream
from rmr.base.time import in_seconds
from rmr.coord.timing import ScheduleTiming, Timing

sys.path.append(str(Path(__file__).parents[1]))

from coord_harness import Air, Model, ms

NAME = "waiting"
SEEDS = range(1, 31)
QUICK = range(1, 6)
WAITS_MS = (0, 100, 300, 600, 1000)
"""Fixed ones; None is the derived one."""
ROBOTS = 10
LOSS = 0.1
SPREADS_MS = (20, 300)
"""Within which the jobs start: at one signal, and as the derivation takes it to be usual."""
WITHIN_MS = 300
"""Of the targets: the spread for which the derivation is made."""
LIMIT = ms(120_000)


class Case(NamedTuple):
    """One run."""

    seed: int
    spread_ms: int
    wait_ms: int | None


def carried_out(case: Case) -> Row:
    """Carry out one run; return jobs in time and seconds from the first start until all are through."""
    wait = None if case.wait_ms is None else ms(case.wait_ms)
    rng = stream(f"evaluation/waiting/{case.seed}")
    model = Model(case.seed, ROBOTS, Air(loss=LOSS), Timing(schedule=ScheduleTiming(wait=wait)))
    deadlines = {robot: started(model, rng, robot, case.spread_ms) for robot in model.ids}
    model.run(ms(case.spread_ms + 2000))
    model.run_until(model.all_served, LIMIT)
    met = sum(entry.end <= deadlines[entry.robot] for entry in model.entries)
    return {**case._asdict(), "met": met, "time_s": in_seconds(max(entry.end for entry in model.entries))}


def started(model: Model, rng: Random, robot: int, spread_ms: int) -> int:
    """Let a job of `robot` start some time; return its deadline. Draws the same whatever the spread."""
    start, release, duration = ms(rng.random() * spread_ms), rng.randint(0, 3000), rng.randint(2000, 3000)
    deadline = start + ms(release + duration + rng.randint(1000, 14_000))
    direction = rng.randrange(2)
    model.trigger(
        start, robot, deadline=deadline, release=start + ms(release), duration=ms(duration), direction=direction
    )
    return deadline


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run every waiting time and spread with each seed."""
    cases = [Case(seed, spread, wait) for spread in SPREADS_MS for wait in (None, *WAITS_MS) for seed in seeds]
    found = pooled(carried_out, cases, jobs)
    rows = []
    for at in range(0, len(found), len(seeds)):
        those = found[at : at + len(seeds)]
        rows.append(
            {
                "spread_ms": those[0]["spread_ms"],
                "wait_ms": those[0]["wait_ms"],
                "met": mean([each["met"] for each in those]),
                "time_s": mean([each["time_s"] for each in those]),
            }
        )
    return {
        "options": {"robots": ROBOTS, "loss": LOSS},
        "rows": rows,
        "targets": [least(rows)],
        "figure": drawn(rows, len(seeds)),
    }


def least(rows: Sequence[Row]) -> Data:
    """Return whether the derived n meets as many deadlines as the best fixed one, or nearly so."""
    those = [row for row in rows if row["spread_ms"] == WITHIN_MS]
    derived = next(row["met"]["value"] for row in those if row["wait_ms"] is None)
    best = max(row["met"]["value"] for row in those if row["wait_ms"] is not None)
    return target("waiting: deadlines met with derived n / best fixed n", derived / best, at_least=0.95)


def drawn(rows: Sequence[Row], count: int) -> Data:
    """Return deadlines met and time against n, the derived n as a point at the left."""
    return figure(
        "Waiting time n",
        f"{ROBOTS} robots, {count} seeds a point, {LOSS:.0%} of frames lost; bars: 95 % intervals of the mean; "
        "at -100 ms: n as leaders work it out",
        [
            panel("n, ms", "deadlines met", lines(rows, "met")),
            panel("n, ms", "time until all are through, s", lines(rows, "time_s")),
        ],
    )


def lines(rows: Sequence[Row], what: str) -> list[Data]:
    """Return a series for each spread."""
    found = []
    for spread in SPREADS_MS:
        those = [row for row in rows if row["spread_ms"] == spread]
        estimates: list[Estimate] = [row[what] for row in those]
        found.append(
            series(
                f"starts within {spread} ms",
                [-100 if row["wait_ms"] is None else row["wait_ms"] for row in those],
                [each["value"] for each in estimates],
                kind="points",
                low=[each["low"] for each in estimates],
                high=[each["high"] for each in estimates],
            )
        )
    return found


def tables(data: Data) -> dict[str, list[str]]:
    """Return a line for each waiting time."""
    header = ["n", *(f"starts within {spread} ms: met of {ROBOTS}; time, s" for spread in SPREADS_MS)]
    lines = []
    for wait in (None, WAITS_MS[0], WAITS_MS[-1]):  # the figure has all
        those = {row["spread_ms"]: row for row in data["rows"] if row["wait_ms"] == wait}
        cells = [f"{text(those[s]['met'])}; {text(those[s]['time_s'], 1)}" for s in SPREADS_MS]
        lines.append(["derived" if wait is None else f"{wait} ms", *cells])
    return {NAME: table(header, lines)}

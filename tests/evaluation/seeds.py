"""The two labs of the corridor over many seeds: finished, contacts, and time over the physical bound.

Nothing disturbs the robots here but what always does: noise of the sensors, slipping wheels, the radio's losses and
collisions, chance in medium access. Each seed draws all of these anew.
"""

from collections.abc import Sequence

from experiment import Data, figure, panel, series, table, target
from intervals import quantile, share, text
from runs import Row, Run, simulated

NAME = "seeds"
SEEDS = range(1, 61)
QUICK = range(1, 4)
LABS = {"testbed": (1.42, 1.6), "corridor": (1.6, 1.8)}
"""Time over bound: median and p99, at most."""


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run both labs with each seed."""
    found = simulated([Run(lab, seed) for lab in LABS for seed in seeds], jobs)
    by_lab = {lab: found[at * len(seeds) : (at + 1) * len(seeds)] for at, lab in enumerate(LABS)}
    rows = [{"lab": lab, **summary(runs)} for lab, runs in by_lab.items()]
    return {
        "rows": rows,
        "targets": [each for row in rows for each in targets(row)],
        "figure": drawn(by_lab),
        "runs": [{"lab": lab, **each} for lab, runs in by_lab.items() for each in runs],
    }


def summary(runs: Sequence[Row]) -> Row:
    """Return what a table tells of the runs of one lab."""
    ratios = [run["ratio"] for run in runs]
    return {
        "finished": share(sum(run["finished"] for run in runs), len(runs)),
        "contacts": sum(run["collisions"] for run in runs),
        "touched": share(sum(run["collisions"] > 0 for run in runs), len(runs)),
        "missed": sum(run["missed"] for run in runs),
        "deadlines": sum(run["met"] + run["missed"] for run in runs),
        "median": quantile(ratios, 0.5),
        "p99": quantile(ratios, 0.99),
        "worst": max(ratios),
        "min_gap_mm": min(run["min_gap_m"] for run in runs) * 1e3,
        "bound_s": runs[0]["bound_s"],
    }


def targets(row: Row) -> list[Data]:
    """Return the targets of one lab."""
    lab, (median, p99) = row["lab"], LABS[row["lab"]]
    return [
        target(f"{lab}: runs finished", 100.0 * row["finished"]["value"], at_least=100.0, unit="%"),
        target(f"{lab}: contacts", row["contacts"], at_most=0),
        target(f"{lab}: time / bound, median", row["median"]["value"], at_most=median),
        target(f"{lab}: time / bound, p99", row["p99"]["value"], at_most=p99),
    ]


def drawn(by_lab: dict[str, list[Row]]) -> Data:
    """Return the distributions as a figure."""
    shown = []
    for lab, runs in by_lab.items():
        ordered = sorted(run["ratio"] for run in runs)
        shares = [100.0 * (at + 1) / len(ordered) for at in range(len(ordered))]
        shown.append(series(lab, ordered, shares))
    count = len(next(iter(by_lab.values())))
    note = f"{count} seeds a lab, six robots, no faults; each mark is a run"
    axes = panel("time of the run / physical bound", "runs at most so long, %", shown, y_from=0.0)
    return figure("Time over bound, all seeds", note, [axes])


def tables(data: Data) -> dict[str, list[str]]:
    """Return the table of the page."""
    ratios = ("time / bound, median", "p99", "worst")
    header = ("lab", "seeds", "missed deadlines", "smallest gap", *ratios)
    lines = [
        (
            row["lab"],
            str(row["median"]["n"]),
            f"{row['missed']} of {row['deadlines']:,}",
            f"{row['min_gap_mm']:.0f} mm",
            text(row["median"], 3),
            text(row["p99"], 3),
            f"{row['worst']:.3f}",
        )
        for row in data["rows"]
    ]
    return {NAME: table(header, lines)}

"""Summary of a sweep: runs finished, times, failures, and for a terminal a histogram of the times.

Quantiles are of the finished runs, by nearest rank: the least measured value that so many percent of the runs do not
exceed.
"""

import math
from collections.abc import Sequence
from typing import Any, TextIO

from rmr_sim.seed_run import Row, fails, reasons

QUANTILES = {"median": 50, "p95": 95, "p99": 99, "max": 100}
"""Quantiles of the summary, in percent of the runs."""
TOLD_MAX = 20
"""Failing seeds that are listed; `sweep.json` has all of them."""
BINS_MAX = 12
"""Bins, and so lines, at most."""
BAR_WIDTH = 40
"""Length of the longest bar, characters."""
EIGHTHS = " ▏▎▍▌▋▊▉█"
"""Blocks from empty to full, in eighths of a character."""


def summary_of(rows: Sequence[Row]) -> dict[str, Any]:
    """Return the figures of a sweep's `rows`."""
    ratios = sorted(row["time_to_bound"] for row in rows if row["finished"] and row["time_to_bound"] is not None)
    times = sorted(row["time_s"] for row in rows if row["finished"])
    violations: dict[str, int] = {}
    for row in rows:
        for check, count in row["violations"].items():
            violations[check] = violations.get(check, 0) + count
    return {
        "runs": len(rows),
        "finished": sum(row["finished"] for row in rows),
        "failed": sum(map(fails, rows)),
        "broken": sum(row["error"] is not None for row in rows),
        "collisions": sum(row["collisions"] for row in rows),
        "deadlines": {
            **{key: sum(row["deadlines"][key] for row in rows) for key in ("met", "missed")},
            "best_possible": _sum_if_known([row["deadlines"]["best_possible"] for row in rows]),
        },
        "time_s": {name: quantile(times, percent) for name, percent in QUANTILES.items()},
        "time_to_bound": {name: quantile(ratios, percent) for name, percent in QUANTILES.items()},
        "violations": {check: violations[check] for check in sorted(violations)},
    }


def _sum_if_known(values: Sequence[int | None]) -> int | None:
    """Return the sum of `values`; None if any of them is not known."""
    known = [value for value in values if value is not None]
    return sum(known) if len(known) == len(values) else None


def quantile(ascending: Sequence[float], percent: int) -> float | None:
    """Return the least of the values that `percent` percent of them do not exceed; None when there are none."""
    if not ascending:
        return None
    return ascending[max(0, math.ceil(len(ascending) * percent / 100) - 1)]


def lines_of(summary: dict[str, Any], speed: float | None) -> list[str]:
    """Return the table that people read; `speed` is seconds simulated in a second of one processor, None: unknown."""
    deadlines = summary["deadlines"]
    best = deadlines["best_possible"]
    at_best = "the best possible is not known" if best is None else f"{best} met at best"
    violations = summary["violations"]
    broken = f", {summary['broken']} broke down" if summary["broken"] else ""
    table = {
        "runs": f"{summary['runs']}",
        "finished": f"{summary['finished']}{_percent(summary['finished'], summary['runs'])}{broken}",
        "contacts": f"{summary['collisions']}",
        "deadlines": f"{deadlines['met']} met, {deadlines['missed']} missed, {at_best}",
        "time": _quantiles(summary["time_s"], " s"),
        "time / bound": _quantiles(summary["time_to_bound"], ""),
        **({} if speed is None else {"simulated at": f"{speed:.1f} x real time on one processor"}),
        "violations": ", ".join(f"{check} {count}" for check, count in violations.items()) or "none",
    }
    width = max(map(len, table))
    return [f"{name.ljust(width)}  {text}" for name, text in table.items()]


def _percent(part: int, whole: int) -> str:
    return f" ({100 * part / whole:.1f} %)" if whole else ""


def _quantiles(values: dict[str, float | None], unit: str) -> str:
    told = [f"{name} {value:.2f}{unit}" for name, value in values.items() if value is not None]
    return ", ".join(told) or "-"


def failing_lines(rows: Sequence[Row], command: str) -> list[str]:
    """Return for each failing seed why it failed, and the command that repeats it: `command` and the seed."""
    failing = [row for row in rows if fails(row)]
    lines = []
    for row in failing[:TOLD_MAX]:
        lines += [f"seed {row['seed']}: {', '.join(reasons(row))}", f"    {command} --seed {row['seed']}"]
    if len(failing) > TOLD_MAX:
        lines.append(f"and {len(failing) - TOLD_MAX} more seeds; sweep.json has all of them")
    return lines


def histogram_lines(rows: Sequence[Row], out: TextIO) -> list[str]:
    """Return a histogram of time / bound of the finished runs, or of their times where no bound is known.

    Bars are of Unicode blocks, or of ``#`` where the encoding of `out` has no blocks.
    """
    finished = [row for row in rows if row["finished"]]
    ratios = [row["time_to_bound"] for row in finished]
    known = None not in ratios
    values: list[float] = ratios if known else [row["time_s"] for row in finished]
    if len(values) < 2:
        return []
    counts, step = binned(values)
    blocks = encodes(out, EIGHTHS)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    ends = [f"{place * step:.{decimals}f} to {(place + 1) * step:.{decimals}f}" for place in counts]
    width = max(map(len, ends))
    highest = max(counts.values())
    head = f"{'time / bound' if known else 'time, s'} of {len(values)} finished runs"
    bars = [_bar(count / highest, blocks) for count in counts.values()]
    rows_ = zip(ends, bars, counts.values(), strict=True)
    return [head, *(f"  {end.rjust(width)}  {bar}{' ' * bool(bar)}{count}" for end, bar, count in rows_)]


def binned(values: Sequence[float]) -> tuple[dict[int, int], float]:
    """Return the number of values in each bin, `BINS_MAX` at most, without gaps, and the width of a bin.

    Bin k is from k to k + 1 widths; a width is 1, 2 or 5 times a power of ten.
    """
    low = min(values)
    high = max(values)
    least = max((high - low) / (BINS_MAX - 1), 1e-3 * max(1.0, abs(high)))
    power = 10.0 ** math.floor(math.log10(least))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= least * (1 - 1e-9))
    places = [math.floor(value / step + 1e-9) for value in values]
    counts = dict.fromkeys(range(min(places), max(places) + 1), 0)
    for place in places:
        counts[place] += 1
    return counts, step


def _bar(share: float, blocks: bool) -> str:
    """Return a bar of `share` of the greatest length; anything above zero is visible."""
    if not blocks:
        return "#" * math.ceil(share * BAR_WIDTH)
    eighths = math.ceil(share * BAR_WIDTH * 8)
    return EIGHTHS[8] * (eighths // 8) + EIGHTHS[eighths % 8].strip()


def encodes(out: Any, text: str) -> bool:
    """Return whether the encoding of the stream `out` has all characters of `text`."""
    try:
        text.encode(getattr(out, "encoding", None) or "utf-8")
    except (UnicodeEncodeError, LookupError):
        return False
    return True

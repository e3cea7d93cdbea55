"""Histogram of a sweep's times for a terminal: a line for each bin, of a bounded width."""

import math
from collections.abc import Sequence
from typing import Any, TextIO

from rmr_sim.seed_run import Row

BINS_MAX = 12
"""Bins, and so lines, at most."""
BAR_WIDTH = 40
"""Length of the longest bar, characters."""
RUNS_MIN = 2
"""Finished runs that a histogram needs."""
EIGHTHS = " ▏▎▍▌▋▊▉█"
"""Blocks from empty to full, in eighths of a character."""


def histogram_lines(rows: Sequence[Row], out: TextIO) -> list[str]:
    """Return a histogram of time / bound of the finished runs, or of their times where no bound is known.

    Bars are of Unicode blocks, or of ``#`` where the encoding of `out` has no blocks.
    """
    finished = [row for row in rows if row["finished"]]
    ratios = [row["time_to_bound"] for row in finished]
    known = None not in ratios
    values: list[float] = ratios if known else [row["time_s"] for row in finished]
    if len(values) < RUNS_MIN:
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

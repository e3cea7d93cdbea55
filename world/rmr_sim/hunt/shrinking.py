"""Reduction of a list of harms that breaks a property to the smallest one that still breaks it.

First fewer harms: delta debugging (Zeller and Hildebrandt, IEEE TSE 2002) by complements. Then shorter windows, by
halving each from either end. Then rounder numbers. Each step asks for the first of some candidates that still breaks
the property; each candidate is a run.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from rmr_sim.hunt.harm import Harm

Harms = tuple[Harm, ...]
FirstBreaking = Callable[[Sequence[Harms]], int | None]
"""Returns the index of the first of some lists that still breaks the property; None if none does."""

SHARES = (0.5, 0.75, 0.9)
"""Parts of a window that are tried in place of the whole, the shortest first."""
SHORTEST_MS = 100
"""Length below which a window is not shortened."""
STEPS_MS = (10_000, 5_000, 1_000, 500, 100)
"""Steps to which times are rounded, the roundest first."""


def shrunk(harms: Harms, first_breaking: FirstBreaking) -> Harms:
    """Return the smallest list found; `harms` itself breaks the property."""
    harms = _fewer(harms, first_breaking)
    harms = _accepted(harms, _shorter, first_breaking)
    return _accepted(_fewer(harms, first_breaking), _rounder, first_breaking)


def _fewer(harms: Harms, first_breaking: FirstBreaking) -> Harms:
    """Return a list from which no harm can be left out (ddmin)."""
    parts = 2
    while len(harms) > 1:
        ends = [round(len(harms) * part / parts) for part in range(parts + 1)]
        complements = [harms[:begin] + harms[end:] for begin, end in pairwise(ends)]
        found = first_breaking(complements)
        if found is not None:
            harms = complements[found]
            parts = max(2, parts - 1)
        elif parts >= len(harms):
            break
        else:
            parts = min(len(harms), 2 * parts)
    return harms


def _accepted(harms: Harms, simpler: Callable[[Harm], Iterator[Harm]], first_breaking: FirstBreaking) -> Harms:
    """Return `harms` with each replaced by simpler ones as long as the property stays broken."""
    for index in range(len(harms)):
        while candidates := [(*harms[:index], one, *harms[index + 1 :]) for one in simpler(harms[index])]:
            found = first_breaking(candidates)
            if found is None:
                break
            harms = candidates[found]
    return harms


def _shorter(harm: Harm) -> Iterator[Harm]:
    """Yield the harm with a shorter window, the shortest first."""
    for share in SHARES:
        length_ms = round(harm.length_ms * share / SHORTEST_MS) * SHORTEST_MS
        if SHORTEST_MS <= length_ms < harm.length_ms:
            yield harm._replace(until_ms=harm.since_ms + length_ms)
            yield harm._replace(since_ms=harm.until_ms - length_ms)


def _rounder(harm: Harm) -> Iterator[Harm]:
    """Yield the harm with rounder times, the roundest first, and nothing once they are as round as that."""
    for step_ms in STEPS_MS:
        if 2 * step_ms > harm.length_ms:  # so rounded, it would be longer than need be
            continue
        since_ms = round(harm.since_ms / step_ms) * step_ms
        until_ms = round(harm.until_ms / step_ms) * step_ms
        if since_ms == harm.since_ms and until_ms == harm.until_ms:
            return
        if since_ms != harm.since_ms:
            yield harm._replace(since_ms=since_ms, until_ms=max(until_ms, since_ms + step_ms))
        elif until_ms > since_ms:
            yield harm._replace(until_ms=until_ms)

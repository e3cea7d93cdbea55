"""The search for the order that keeps most jobs on time: exact while it may be, else two heuristics.

A problem is given by indices in order of (deadline, robot): the earliest and the latest start of each job, its
duration, and the least time from the start of one to the start of the next. Wanted are most jobs on time, then
the earliest end, then the smallest sequence of indices.

- **Exact** (`layers` without a width). Layer k holds, for each set of k jobs and its last one, the earliest start
  of the last with the whole set on time; the last layer that is not empty tells how many, its earliest end when.
  A pass back gives for each state the latest start from which that can still be reached, a walk forward then takes
  the smallest index at each step: O(2^n n^2). States from which fewer can follow than the insertion has found are
  left out: no more follow than fit by their latest starts, one least gap apart (equal work in order of deadline,
  Moore 1968). So are those from which as many can follow, but not as early.
- That an earlier start is never worse needs gap(a, c) <= gap(a, b) + gap(b, c). Where headways are longer than
  whole passages it fails, and `branch` searches all orders with the earliest starts of all remaining jobs as state,
  up to `STEPS_MAX` of them.
- **Beam** (`layers` with a width): each layer is cut to the states from which most can follow, earliest first.
  The insertion (`rmr.coord.insertion`) is the other heuristic.
"""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from rmr.base.time import NEVER, Duration, Instant


class Problem(NamedTuple):
    """Jobs by index, in order of (deadline, robot)."""

    first: Sequence[Instant]
    """Earliest start of each when it goes first."""
    latest: Sequence[Instant]
    """Latest start that is on time."""
    duration: Sequence[Duration]
    gaps: Sequence[Sequence[Duration]]
    """``gaps[a][b]``: least time from the start of a to the start of b behind it."""

    def part(self, jobs: Sequence[int]) -> "Problem":
        """Return the problem of some jobs alone."""
        rows = [[self.gaps[a][b] for b in jobs] for a in jobs]
        first, latest, duration = ([of[i] for i in jobs] for of in (self.first, self.latest, self.duration))
        return Problem(first, latest, duration, rows)


Found = tuple[int, Instant, tuple[int, ...]]
"""Minus the jobs on time, the end of the last, the order: the smaller, the better."""

NOTHING: Final[Found] = (0, NEVER, ())

STEPS_MAX: Final = 12_000
"""Search budget of `branch`, a fifth of a second: no leader may stand still for longer, whatever gaps robots report.
The worst of 2,500 random instances of eight jobs took 7,800, of nine jobs 23,000."""


def triangular(problem: Problem) -> bool:
    """Return whether what keeps its gap to the one before keeps it to all before: O(n^3)."""
    gaps = problem.gaps
    return all(
        direct <= to_b + after[c] or a == c
        for a, row in enumerate(gaps)
        for b, (to_b, after) in enumerate(zip(row, gaps, strict=True))
        if a != b
        for c, direct in enumerate(row)
        if c != b
    )


def _pace(problem: Problem) -> Duration:
    """Return the least gap of all."""
    return min((g for a, row in enumerate(problem.gaps) for b, g in enumerate(row) if a != b), default=0)


def punctual(problem: Problem, order: Iterable[int]) -> Found:
    """Return `order` without the jobs that would be late in it, whatever the gaps."""
    first, latest, duration, gaps = problem
    ready = list(first)
    kept = []
    end = NEVER
    for i in order:
        start = ready[i]
        if start <= latest[i]:
            kept.append(i)
            end = start + duration[i]
            ready = [max(at, start + g) for at, g in zip(ready, gaps[i], strict=True)]
    return -len(kept), end, tuple(kept)


def chain(problem: Problem, order: Sequence[int]) -> list[Instant]:
    """Return the start of each job of `order` as the one before it allows; with triangular gaps those are all."""
    starts: list[Instant] = []
    for k, i in enumerate(order):
        before = starts[-1] + problem.gaps[order[k - 1]][i] if k else -NEVER
        starts.append(max(problem.first[i], before))
    return starts


def fill(problem: Problem, punctual: Sequence[int]) -> list[int]:
    """Return `punctual` with the other jobs put in, each where it starts earliest without delaying one put in before.

    Whatever the gaps.
    """
    order: list[int] = []
    starts: list[Instant] = []
    on_time = set(punctual)
    for job in [*punctual, *(i for i in range(len(problem.first)) if i not in on_time)]:
        at = len(order) if len(order) < len(punctual) else _idle(problem, order, starts, job)
        starts.insert(at, _after(problem, order[:at], starts, job))
        order.insert(at, job)
    return order


def _after(problem: Problem, order: Sequence[int], starts: Sequence[Instant], job: int) -> Instant:
    """Return when `job` can start behind `order`."""
    return max([problem.first[job], *(at + problem.gaps[i][job] for i, at in zip(order, starts, strict=False))])


def _idle(problem: Problem, order: list[int], starts: list[Instant], job: int) -> int:
    """Return the first place where `job` delays no other one."""
    first = problem.first[job]
    after = problem.gaps[job]
    for at, (i, start) in enumerate(zip(order, starts, strict=True)):
        if first + after[i] <= start:
            own = _after(problem, order[:at], starts, job)
            if all(own + after[j] <= other for j, other in zip(order[at:], starts[at:], strict=True)):
                return at
    return len(order)


# -- layers --------------------------------------------------------------------------------------------------

_Layer = dict[int, Instant]
"""Earliest start of the last job by state: the set in the low bits, the last one above them."""


def layers(problem: Problem, known: Found = NOTHING, width: int = 0) -> Found:
    """Return the best order, if it is as good as the `known` one; `width` bounds the states of a layer (0: none).

    The gaps must be triangular.
    """
    count = len(problem.first)
    least = -known[0]
    layer = {i << count | 1 << i: at for i, at in enumerate(problem.first) if at <= problem.latest[i]}
    kept: list[_Layer] = []
    while layer:
        kept.append(layer)
        layer = _extend(problem, layer, least - len(kept), known[1], width)
    if len(kept) < max(least, 1):
        return NOTHING
    end = min(start + problem.duration[state >> count] for state, start in kept[-1].items())
    return -len(kept), end, _smallest(problem, kept, end)


def _extend(problem: Problem, layer: _Layer, least: int, end: Instant, width: int) -> _Layer:
    """Return the next layer without states that fewer than `least` jobs can follow, or as many but not by `end`."""
    first, latest, duration, gaps = problem
    count = len(first)
    pace = _pace(problem)
    last_start = end - min(duration)
    by_latest = sorted(range(count), key=latest.__getitem__)
    ranked: list[tuple[int, Instant, int, list[tuple[int, Instant]]]] = []
    for state, start in layer.items():
        row = gaps[state >> count]
        options = []
        reach = 0
        latest_end = start
        for i in by_latest:
            if state >> i & 1:
                continue
            at = start + row[i]
            at = max(at, first[i])
            if at <= latest[i]:
                options.append((i, at))
                if latest_end + pace <= latest[i]:
                    latest_end += pace
                    reach += 1
        if reach > least or (reach == least and start + reach * pace <= last_start):
            ranked.append((-reach, start, state, options))
    if width and len(ranked) > width:
        ranked = sorted(ranked)[:width]
    wider: _Layer = {}
    members = (1 << count) - 1
    for _, _, state, options in ranked:
        chosen = state & members
        for i, at in options:
            key = i << count | chosen | 1 << i
            if at < wider.get(key, NEVER):
                wider[key] = at
    return wider


def _smallest(problem: Problem, kept: list[_Layer], end: Instant) -> tuple[int, ...]:
    """Return the smallest order through the layers that ends at `end`."""
    first, latest, duration, gaps = problem
    count = len(first)
    members = (1 << count) - 1
    ends = {s: min(end - duration[s >> count], latest[s >> count]) for s in kept[-1]}
    limits = [{s: limit for s, limit in ends.items() if kept[-1][s] <= limit}]
    for layer in reversed(kept[:-1]):
        limits.append(_limits(problem, layer, limits[-1]))
    order: list[int] = []
    chosen = 0
    earliest = list(first)
    for allowed in reversed(limits):
        i = min(
            s >> count
            for s, limit in allowed.items()
            if s & members == chosen | 1 << (s >> count) and earliest[s >> count] <= limit
        )
        order.append(i)
        chosen |= 1 << i
        start = earliest[i]
        earliest = [max(first[j], start + gaps[i][j]) for j in range(count)]
    return tuple(order)


def _limits(problem: Problem, layer: _Layer, following: _Layer) -> _Layer:
    """Return, for the states of `layer` that lead to one of `following`, the latest start that does."""
    first, latest, _, gaps = problem
    count = len(first)
    members = (1 << count) - 1
    found: _Layer = {}
    for after, limit in following.items():
        i = after >> count
        chosen = after & members & ~(1 << i)
        if first[i] > limit:
            continue
        for last in range(count):
            state = last << count | chosen
            if not chosen >> last & 1 or state not in layer:
                continue
            allowed = min(limit - gaps[last][i], latest[last])
            if layer[state] <= allowed and allowed > found.get(state, -NEVER):
                found[state] = allowed
    return found


# -- all orders ----------------------------------------------------------------------------------------------


def branch(problem: Problem, known: Found = NOTHING) -> Found:
    """Return the best order, if it is as good as the `known` one, whatever the gaps; of `STEPS_MAX` orders at most.

    Depth first in order of the indices, so that of equals the smallest order is found first. An order is given up
    when a smaller one of the same jobs leaves every remaining job as early.
    """
    first, latest, duration, gaps = problem
    everyone = range(len(first))
    pace = _pace(problem)
    by_latest = sorted(everyone, key=latest.__getitem__)
    best: Found = (known[0], NEVER, ())
    seen: dict[int, list[tuple[Instant, ...]]] = {}
    stack: list[tuple[tuple[int, ...], int, Instant, tuple[Instant, ...]]] = [((), 0, -NEVER, tuple(first))]
    for _ in range(STEPS_MAX):
        if not stack:
            break
        order, chosen, start, ready = stack.pop()
        if order:
            best = min(best, (-len(order), start + duration[order[-1]], order))
        reach = 0
        at = start
        for i in by_latest:
            if not chosen >> i & 1 and max(ready[i], at + pace) <= latest[i]:
                at = at + pace
                reach = reach + 1
        before = seen.setdefault(chosen, [])
        if len(order) + reach < -best[0] or any(all(map(int.__le__, other, ready)) for other in before):
            continue
        before.append(ready)
        for i in reversed(everyone):
            if not chosen >> i & 1 and ready[i] <= latest[i]:
                wider = chosen | 1 << i
                at = ready[i]
                then = tuple(0 if wider >> j & 1 else max(ready[j], at + gaps[i][j]) for j in everyone)
                stack.append(((*order, i), wider, at, then))
    return best if best[2] else NOTHING

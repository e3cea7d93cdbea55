"""An order that keeps many jobs on time, by insertion: Moore-Hodgson with release times and gaps.

By deadline, latest start, release and duration in turn each job is put in where all stay on time and the end is
earliest; else it is exchanged for the one whose removal brings the end forward most; the rejected are tried once
more. The best of the four orders is taken. `_Profile` judges a place in O(1), so a run takes O(n^2). By the same
profile `settle` puts those that must be late into an order of the others, where robots are so many that none gets past.
"""

from collections.abc import Sequence
from typing import Final

from rmr.base.time import NEVER, Instant
from rmr.coord.search import Found, Problem, fill, punctual

KEYS_MAX: Final = 50
"""Of more jobs only the order by deadline is tried: no leader may stand still for longer than a tenth of a second."""


class _Profile:
    """An order with all on time: its starts, and what a later start of its k-th job would do to the end."""

    def __init__(self, problem: Problem, order: Sequence[int]) -> None:
        first, latest, duration, gaps = problem
        self._problem = problem
        self._order = order
        self._starts: list[Instant] = []
        for k, i in enumerate(order):
            before = self._starts[-1] + gaps[order[k - 1]][i] if k else -NEVER
            self._starts.append(max(first[i], before))
        self._limits = [NEVER] * len(order)
        self._tails = [0] * len(order)
        self._floors = [-NEVER] * len(order)
        for k in reversed(range(len(order))):
            i = order[k]
            self._limits[k] = latest[i]
            self._tails[k] = duration[i]
            if k + 1 < len(order):
                step = gaps[i][order[k + 1]]
                self._limits[k] = min(latest[i], self._limits[k + 1] - step)
                self._tails[k] = step + self._tails[k + 1]
                self._floors[k] = max(self._floors[k + 1], first[order[k + 1]] + self._tails[k + 1])

    @property
    def end(self) -> Instant:
        """End of the last job."""
        return self._starts[-1] + self._tails[-1] if self._order else -NEVER

    def _end_from(self, before: int, start: Instant, after: int) -> Instant:
        """Return the end when job `before` starts at `start` and the order goes on from place `after`; NEVER: late."""
        first, _, duration, gaps = self._problem
        if after == len(self._order):
            return start + duration[before]
        at = max(first[self._order[after]], start + gaps[before][self._order[after]])
        return NEVER if at > self._limits[after] else max(at + self._tails[after], self._floors[after])

    def spot(self, job: int) -> tuple[Instant, int]:
        """Return the earliest end with `job` inserted, and its place; NEVER if a job would be late."""
        problem = self._problem
        best = (NEVER, 0)
        for at in range(len(self._order) + 1):
            start = problem.first[job]
            if at:
                start = max(start, self._starts[at - 1] + problem.gaps[self._order[at - 1]][job])
            if start <= problem.latest[job]:
                best = min(best, (self._end_from(job, start, at), at))
        return best

    def longest(self) -> int:
        """Return the place of the job whose removal brings the end forward most."""
        ends = [
            (self._end_from(self._order[at - 1], self._starts[at - 1], at + 1) if at else self._end_without_head(), at)
            for at in range(len(self._order))
        ]
        return min(ends)[1]

    def _end_without_head(self) -> Instant:
        if len(self._order) == 1:
            return -NEVER
        return max(self._problem.first[self._order[1]] + self._tails[1], self._floors[1])


def insertion(problem: Problem) -> tuple[int, ...]:
    """Return the best of the orders that inserting the jobs by four keys gives; of very many that by deadline alone.

    All are on time in it if the gaps are triangular.
    """
    first, latest, duration, _ = problem
    everyone = range(len(first))
    keys = (
        list(everyone),
        sorted(everyone, key=latest.__getitem__),
        sorted(everyone, key=first.__getitem__),
        sorted(everyone, key=duration.__getitem__),
    )
    return min(_insert_all(problem, key) for key in keys[: 1 if len(first) > KEYS_MAX else None])[2]


def _insert_all(problem: Problem, jobs: Sequence[int]) -> Found:
    order: list[int] = []
    rejected: list[int] = []
    for job in jobs:
        profile = _Profile(problem, order)
        end, at = profile.spot(job)
        if end < NEVER:
            order.insert(at, job)
        else:
            order, out = _exchange(problem, order, profile, job)
            rejected.append(out)
    for job in rejected:
        end, at = _Profile(problem, order).spot(job)
        if end < NEVER:
            order.insert(at, job)
    return -len(order), _Profile(problem, order).end, tuple(order)


def _exchange(problem: Problem, order: list[int], profile: _Profile, job: int) -> tuple[list[int], int]:
    """Put `job` in for the one whose removal brings the end forward most, if that helps; return who is left out."""
    if not order:
        return order, job
    at = profile.longest()
    rest = order[:at] + order[at + 1 :]
    end, place = _Profile(problem, rest).spot(job)
    if end >= profile.end:
        return order, job
    return [*rest[:place], job, *rest[place:]], order[at]


def settle(problem: Problem, kept: Sequence[int]) -> list[int]:
    """Return an order of all jobs of a crowd; those in `kept` are on time.

    Those go by deadline if then all stay on time and end no later, each other one as early as makes none of them late.
    A job with little time left stands near the entrance, as a rule: any other order has robots pass each other where
    they stand.
    """
    number, end, order = punctual(problem, sorted(kept))
    if -number < len(kept) or end > punctual(problem, kept)[1]:
        order = tuple(kept)
    mixed = list(order)
    on_time = set(order)
    latest = [at if i in on_time else NEVER for i, at in enumerate(problem.latest)]
    for job in (i for i in range(len(latest)) if i not in on_time):
        at = _Profile(problem._replace(latest=latest), mixed).spot(job)[1]
        mixed.insert(at, job)
    if -punctual(problem, mixed)[0] < len(order):  # gaps that are not triangular
        return fill(problem, order)
    return mixed

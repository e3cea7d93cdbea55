"""The order and the start times of the jobs of a group: pure functions of what the leader knows (docs/scheduling.md).

A job occupies the shared place from its start for its duration. Between two starts lies at least `gap`: the
headway in the same direction, the whole passage in opposite directions. The order by deadline is taken whenever it
keeps every job on time (paper IV.C: the list is maintained according to the deadline). Otherwise the order with most
jobs on time is searched, then the earliest end, then the smallest sequence of (deadline, robot): exactly for up to
`EXACT_MAX` jobs, by the better of a beam and insertion beyond (`rmr.coord.search`). Late jobs go by (deadline, robot)
where they delay no job that is on time, most often last.

A known order is kept, with new jobs inserted, unless that costs a job or a headway: robots are under way in it. The
order by deadline replaces it only if a job is new.

More than `EXACT_MAX` robots stand in each other's way, as a rule with those that are due first in front. So all that
are on time go by deadline if that costs nothing, and late ones as early as they can without making another one late.
"""

from bisect import insort
from collections.abc import Sequence
from itertools import permutations
from typing import Final, NamedTuple

from rmr.base.direction import may_follow
from rmr.base.time import NEVER, Duration, Instant
from rmr.coord.insertion import insertion, settle
from rmr.coord.search import Found, Problem, branch, chain, fill, layers, punctual, triangular
from rmr.coord.timing import GRID, Order

EXACT_MAX: Final = 11
"""Jobs ordered exactly: 60 ms at worst where gaps are triangular, and each further one doubles that."""
BEAM_WORK: Final = 64_000
"""Steps that the beam may take; its width is this over the cube of the number of jobs, so none beyond 40."""

PLACES_EXACT_MAX: Final = 5
"""Jobs of a station with several places of which all orders are tried: 120 orders, a few milliseconds."""
NEW_MAX: Final = 5
"""Greatest number of new jobs that are inserted into the known order; with more there is little to keep."""


class Task(NamedTuple):
    """A job as the order sees it. Instants and durations in nanoseconds."""

    robot: int
    release: Instant
    duration: Duration
    deadline: Instant
    headway: Duration
    direction: int
    joined: Instant = 0
    """When the leader first heard of it."""
    grace: Duration = 0
    """Tolerance: in the search the job counts as on time up to this much after its deadline. Whether the order by
    deadline keeps all on time is decided without it."""


class Placed(NamedTuple):
    """A passage that stands: frozen, or a robot known inside."""

    start: Instant
    duration: Duration
    headway: Duration
    direction: int


class Rules(NamedTuple):
    """Conditions of order and gaps, besides the jobs."""

    floor: Instant
    """No new slot is before this."""
    opposed: Duration
    """Least gap between opposite directions, in addition to the duration."""
    order: Order = Order.OURS
    capacity: int = 1
    """Greatest number of robots inside at a time; more than one only of turns that exclude each other."""


def gap(first: Task | Placed, second: Task | Placed, opposed: Duration) -> Duration:
    """Return the least time from the start of `first` to the start of `second` behind it."""
    if not may_follow(first.direction, second.direction):
        return first.duration + opposed
    headway = max(first.headway, second.headway)
    return max(headway, first.duration + headway - second.duration)


def by_deadline(task: Task) -> tuple[Instant, int]:
    """Return the key of the paper's order."""
    return (task.deadline, task.robot)


def by_arrival(task: Task) -> tuple[Instant, int]:
    """Return the key of first come, first served."""
    return (task.joined, task.robot)


class _Front:
    """Running maxima over the passages already scheduled in one direction: exactly what `gap` needs."""

    __slots__ = ("clear", "end", "paced", "start")

    def __init__(self) -> None:
        self.start = self.paced = self.end = self.clear = -NEVER
        """The latest start, start and headway, end, end and headway."""

    def add(self, start: Instant, passage: Task | Placed) -> None:
        """Take in a passage that begins at `start`."""
        end = start + passage.duration
        self.start = max(self.start, start)
        self.paced = max(self.paced, start + passage.headway)
        self.end = max(self.end, end)
        self.clear = max(self.clear, end + passage.headway)

    def frees(self, task: Task) -> Instant:
        """Return when `task`, of the same direction, may start at the earliest."""
        own = task.headway
        return max(self.start + own, self.paced, max(self.end + own, self.clear) - task.duration)


class _Chart:
    """Everything that has been placed: when further passages may start."""

    def __init__(self, standing: Sequence[Placed], rules: Rules) -> None:
        self._rules = rules
        self._fronts: dict[int, _Front] = {}
        self._ends: list[Instant] = []
        """Where several may be inside: the ends of all that has been placed, in order."""
        for item in standing:
            self._add(item.start, item)

    def start(self, task: Task) -> Instant:
        """Return when `task` may start at the earliest, on the grid."""
        start = max(self._rules.floor, task.release)
        capacity = self._rules.capacity
        if capacity > 1:
            if len(self._ends) >= capacity:
                start = max(start, self._ends[-capacity] + self._rules.opposed)
            return _up(start)
        for direction, front in self._fronts.items():
            start = max(
                start,
                front.frees(task) if may_follow(direction, task.direction) else front.end + self._rules.opposed,
            )
        return _up(start)

    def add(self, task: Task) -> Instant:
        """Place `task` as early as it may start, and return when that is."""
        start = self.start(task)
        self._add(start, task)
        return start

    def _add(self, start: Instant, passage: Task | Placed) -> None:
        if self._rules.capacity > 1:
            insort(self._ends, start + passage.duration)
        else:
            self._fronts.setdefault(passage.direction, _Front()).add(start, passage)


def place(order: Sequence[Task], standing: Sequence[Placed], rules: Rules) -> list[Instant]:
    """Return the start of each job of `order`, behind everything in `standing`, on the grid."""
    chart = _Chart(standing, rules)
    return [chart.add(task) for task in order]


def merge(
    first: Sequence[Task], slots: Sequence[Instant], rest: Sequence[Task], standing: Sequence[Placed], rules: Rules
) -> list[Task]:
    """Return both in one order: `first`, and before each of them those of the `rest` that do not hold it up.

    `slots` are the slots that those of `first` have had: they set out for these, and none of them is held up by one
    that leaves it its slot. For none is given: it is held up by all that make it later than it could be.
    """
    chart = _Chart(standing, rules)
    left = list(rest)
    order: list[Task] = []
    for task, slot in zip(first, slots, strict=True):
        behind: list[Task] = []
        for other in left:
            fits = chart.start(other) + gap(other, task, rules.opposed) <= max(chart.start(task), slot)
            if fits:
                chart.add(other)
            (order if fits else behind).append(other)
        chart.add(task)
        order.append(task)
        left = behind
    return order + left


def _up(time: int) -> int:
    """Return `time` on the grid, never earlier."""
    return -(-time // GRID) * GRID


def on_time(order: Sequence[Task], starts: Sequence[Instant]) -> int:
    """Return how many jobs end by their deadline."""
    return sum(start + task.duration <= task.deadline for task, start in zip(order, starts, strict=True))


def order_jobs(tasks: Sequence[Task], standing: Sequence[Placed], rules: Rules, old: Sequence[int] = ()) -> list[Task]:
    """Return `tasks` in the order to take. `old` is the known order, by robot."""
    if rules.order is Order.FCFS:
        return sorted(tasks, key=by_arrival)
    jobs = sorted(tasks, key=by_deadline)
    index = {task.robot: i for i, task in enumerate(jobs)}
    known = [index[robot] for robot in old if robot in index]
    whole = on_time(jobs, place(jobs, standing, rules)) == len(jobs)
    if rules.order is not Order.OURS or not jobs or (whole and len(known) < len(jobs)):
        return jobs
    jobs = [task._replace(deadline=task.deadline + task.grace) for task in jobs]
    if rules.capacity > 1:
        return _order_places(jobs, standing, rules, old)
    problem = problem_of(jobs, standing, rules)
    best = range(len(jobs)) if whole else _with_late(problem, search(problem)[2])
    kept = _with_new(problem, known, best)
    return _steady([jobs[i] for i in best], [jobs[i] for i in kept], standing, rules)


def _order_places(jobs: list[Task], standing: Sequence[Placed], rules: Rules, old: Sequence[int]) -> list[Task]:
    """Return the order of `jobs` (by deadline) where several may be inside: most on time, then the least sum of ends.

    All orders are tried of up to `PLACES_EXACT_MAX` jobs. Of more: by deadline, and by deadline with the longest job of
    those up to the first late one put last until none is late (Moore 1968). The known order is kept, with new jobs
    behind it, unless that costs a job on time or a headway.
    """
    by_robot = {task.robot: task for task in jobs}
    kept = [by_robot[robot] for robot in old if robot in by_robot]
    kept += [task for task in jobs if task not in kept]

    def cost(order: Sequence[Task]) -> tuple[int, int]:
        starts = place(order, standing, rules)
        ends = sum(start + task.duration for task, start in zip(order, starts, strict=True))
        return -on_time(order, starts), ends

    if len(jobs) <= PLACES_EXACT_MAX:
        orders = [list(order) for order in permutations(jobs)]
    else:
        orders = [jobs, _longest_last(jobs, standing, rules)]
    best = min(orders, key=cost)
    late, ends = cost(best)
    kept_late, kept_ends = cost(kept)
    return kept if kept_late <= late and kept_ends < ends + min(task.headway for task in jobs) else best


def _longest_last(jobs: Sequence[Task], standing: Sequence[Placed], rules: Rules) -> list[Task]:
    """Return `jobs` with as many put last, longest first, as are late otherwise."""
    order = list(jobs)
    last: list[Task] = []
    while order:
        starts = place(order, standing, rules)
        late = [k for k, start in enumerate(starts) if start + order[k].duration > order[k].deadline]
        if not late:
            break
        longest = max(range(late[0] + 1), key=lambda k: order[k].duration)
        last.append(order.pop(longest))
    return order + last


def problem_of(jobs: Sequence[Task], standing: Sequence[Placed], rules: Rules) -> Problem:
    """Return what the search needs to know of `jobs`, which are sorted by (deadline, robot)."""
    # Most of many jobs are of few kinds: gaps are computed once for each pair of kinds.
    kinds = [(task.duration, task.headway, task.direction) for task in jobs]
    samples = dict(zip(kinds, jobs, strict=True))
    gaps = {one: {two: _up(gap(a, b, rules.opposed)) for two, b in samples.items()} for one, a in samples.items()}
    return Problem(
        [place((task,), standing, rules)[0] for task in jobs],
        [task.deadline - task.duration for task in jobs],
        [task.duration for task in jobs],
        [[row[two] for two in kinds] for row in [gaps[one] for one in kinds]],
    )


def search(problem: Problem) -> Found:
    """Return the best order found of jobs that are on time together: the optimum for up to `EXACT_MAX` of them.

    Where gaps are not triangular, only as far as `branch` comes.
    """
    hopeful = [i for i, at in enumerate(problem.first) if at <= problem.latest[i]]
    less, end, order = _search(problem.part(hopeful))
    return less, end, tuple(hopeful[i] for i in order)


def _search(problem: Problem) -> Found:
    count = len(problem.first)
    found = punctual(problem, insertion(problem))
    if count <= EXACT_MAX:
        exact = layers if triangular(problem) else branch
        return min(found, exact(problem, found))
    width = BEAM_WORK // count**3
    if width == 0 or -found[0] == count:
        return found
    return min(found, punctual(problem, layers(problem, found, width)[2]))


def _with_late(problem: Problem, kept: Sequence[int]) -> list[int]:
    """Return `kept`, who are on time, with the others put in."""
    return fill(problem, kept) if len(problem.first) <= EXACT_MAX else settle(problem, kept)


def _with_new(problem: Problem, old: list[int], best: Sequence[int]) -> list[int]:
    """Return the `old` order with the rest of `best` put in, each where most are on time and the end is earliest.

    Of such places the last is taken, of more than `EXACT_MAX` jobs the nearest to that by deadline.
    """
    known = set(old)
    new = [job for job in best if job not in known]
    if not old or len(new) > NEW_MAX:
        return list(best)
    for job in new:
        wanted = sum(other < job for other in old) if len(problem.first) > EXACT_MAX else len(old)
        places = sorted(range(len(old) + 1), key=lambda at: abs(at - wanted))
        old = min(([*old[:at], job, *old[at:]] for at in places), key=lambda order: _cost(problem, order))
    return old


def _cost(problem: Problem, order: Sequence[int]) -> tuple[int, Instant]:
    starts = chain(problem, order)
    late = sum(start > problem.latest[i] for i, start in zip(order, starts, strict=True))
    return late, starts[-1] + problem.duration[order[-1]]


def _steady(best: list[Task], kept: list[Task], standing: Sequence[Placed], rules: Rules) -> list[Task]:
    """Return `kept`, which follows the known order, instead of `best` if it costs neither a job nor a headway."""
    new_starts = place(best, standing, rules)
    old_starts = place(kept, standing, rules)
    if on_time(kept, old_starts) < on_time(best, new_starts):
        return best
    headway = min(task.headway for task in best)
    new_end = max(start + task.duration for task, start in zip(best, new_starts, strict=True))
    old_end = max(start + task.duration for task, start in zip(kept, old_starts, strict=True))
    return kept if old_end < new_end + headway else best

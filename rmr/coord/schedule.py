"""In which order the jobs of a group go, and when: pure functions of what the leader knows.

A job occupies the shared place from its start for its duration. Between two starts lies at least `gap`: the
headway in the same way, the whole passage in opposite ways. The order of deadlines is taken whenever it
keeps every job on time (paper IV.C: the list is maintained according to the deadline). When it does not, the
order that keeps most jobs on time is looked for, then the earliest end, then the smallest sequence of
(deadline, robot): exactly for up to ten jobs, by a beam for up to twenty, by insertion beyond. Late jobs
follow by (deadline, robot).

The exact search goes by layers of the number of jobs placed. Its state is (set, last job), its value the
earliest start of the last one with the whole set on time, ties by sequence; the last layer that is not empty
is optimal, in O(2^n n^2). That needs gap(a, c) <= gap(a, b) + gap(b, c), which holds while headways are
shorter than passages; placing checks every earlier job in any case.
"""

from collections.abc import Sequence
from typing import NamedTuple

from rmr.base.time import Duration, Instant
from rmr.coord.values import GRID, same_way

EXACT_MAX = 10
"""Jobs ordered exactly: about 50,000 extensions at most."""
BEAM_MAX = 20
"""Jobs ordered by the beam."""
BEAM_WIDTH = 60
"""States that a layer of the beam keeps."""


class Task(NamedTuple):
    """A job as the order sees it. Instants and durations in nanoseconds."""

    robot: int
    release: Instant
    duration: Duration
    deadline: Instant
    headway: Duration
    way: int


class Placed(NamedTuple):
    """A passage that stands: frozen, or a robot known inside."""

    start: Instant
    duration: Duration
    headway: Duration
    way: int


class Rules(NamedTuple):
    """What the gaps depend on beside the jobs."""

    floor: Instant
    """No new slot is before this."""
    opposed: Duration
    """Beside the duration, between opposite ways."""


def gap(first: Task | Placed, second: Task | Placed, opposed: Duration) -> Duration:
    """Return the least time from the start of `first` to the start of `second` behind it."""
    if not same_way(first.way, second.way):
        return first.duration + opposed
    headway = max(first.headway, second.headway)
    return max(headway, first.duration + headway - second.duration)


def by_deadline(task: Task) -> tuple[Instant, int]:
    """Return the key of the paper's order."""
    return (task.deadline, task.robot)


def place(order: Sequence[Task], standing: Sequence[Placed], rules: Rules) -> list[Instant]:
    """Return the start of each job of `order`, behind everything in `standing`, on the grid."""
    before: list[Task | Placed] = list(standing)
    starts = [item.start for item in standing]
    result = []
    for task in order:
        start = max(rules.floor, task.release)
        for other, at in zip(before, starts, strict=True):
            start = max(start, at + gap(other, task, rules.opposed))
        start = -(-start // GRID) * GRID
        before.append(task)
        starts.append(start)
        result.append(start)
    return result


def on_time(order: Sequence[Task], starts: Sequence[Instant]) -> int:
    """Return how many jobs end by their deadline."""
    return sum(start + task.duration <= task.deadline for task, start in zip(order, starts, strict=True))


def order_jobs(tasks: Sequence[Task], standing: Sequence[Placed], rules: Rules, old: Sequence[int] = ()) -> list[Task]:
    """Return `tasks` in the order in which they shall go. `old` is the order so far, by robot."""
    firsts = _first_starts(tasks, standing, rules)
    hopeful = sorted((t for t in tasks if firsts[t.robot] + t.duration <= t.deadline), key=by_deadline)
    late = sorted((t for t in tasks if firsts[t.robot] + t.duration > t.deadline), key=by_deadline)
    if on_time(hopeful, place(hopeful, standing, rules)) == len(hopeful):
        return hopeful + late
    best = _best(hopeful, firsts, rules)
    chosen = {task.robot for task in best}
    rest = sorted([task for task in hopeful if task.robot not in chosen] + late, key=by_deadline)
    return _steady(best + rest, standing, rules, old)


def _first_starts(tasks: Sequence[Task], standing: Sequence[Placed], rules: Rules) -> dict[int, Instant]:
    return {task.robot: place((task,), standing, rules)[0] for task in tasks}


def _best(tasks: list[Task], firsts: dict[int, Instant], rules: Rules) -> list[Task]:
    """Return the jobs that can be on time together, in order."""
    if len(tasks) <= EXACT_MAX:
        return _layers(tasks, firsts, rules, 0)
    if len(tasks) <= BEAM_MAX:
        return _layers(tasks, firsts, rules, BEAM_WIDTH)
    return _insertion(tasks, firsts, rules)


_State = tuple[Instant, tuple[int, ...]]


def _layers(tasks: list[Task], firsts: dict[int, Instant], rules: Rules, width: int) -> list[Task]:
    """Search by layers; `tasks` are sorted by deadline, so that indices compare as (deadline, robot)."""
    count = len(tasks)
    first = [firsts[task.robot] for task in tasks]
    latest = [task.deadline - task.duration for task in tasks]
    gaps = [[gap(a, b, rules.opposed) for b in tasks] for a in tasks]
    layer: dict[tuple[int, int], _State] = {
        (1 << i, i): (first[i], (i,)) for i in range(count) if first[i] <= latest[i]
    }
    best: tuple[int, ...] = ()
    while layer:
        best = min((start + tasks[last].duration, order) for (_, last), (start, order) in layer.items())[1]
        if width and len(layer) > width:
            layer = _cut(layer, first, latest, gaps, width)
        layer = _extend(layer, first, latest, gaps)
    return [tasks[i] for i in best]


def _extend(
    layer: dict[tuple[int, int], _State], first: list[Instant], latest: list[Instant], gaps: list[list[Duration]]
) -> dict[tuple[int, int], _State]:
    wider: dict[tuple[int, int], _State] = {}
    indices = range(len(first))
    for (chosen, last), (start, order) in layer.items():
        row = gaps[last]
        for i in indices:
            bit = 1 << i
            if chosen & bit:
                continue
            at = start + row[i]
            at = max(at, first[i])
            if at > latest[i]:
                continue
            key = (chosen | bit, i)
            known = wider.get(key)
            if known is None or at < known[0] or (at == known[0] and (*order, i) < known[1]):
                wider[key] = (at, (*order, i))
    return wider


def _cut(
    layer: dict[tuple[int, int], _State],
    first: list[Instant],
    latest: list[Instant],
    gaps: list[list[Duration]],
    width: int,
) -> dict[tuple[int, int], _State]:
    """Keep the states from which most jobs are still reachable, then those of earliest start."""

    def rank(item: tuple[tuple[int, int], _State]) -> tuple[int, Instant, tuple[int, ...]]:
        (chosen, last), (start, order) = item
        row = gaps[last]
        reachable = sum(
            1 for i, limit in enumerate(latest) if not chosen >> i & 1 and start + row[i] <= limit and first[i] <= limit
        )
        return (-reachable, start, order)

    return dict(sorted(layer.items(), key=rank)[:width])


def _insertion(tasks: list[Task], firsts: dict[int, Instant], rules: Rules) -> list[Task]:
    """Insert the jobs by deadline, latest start, release and duration in turn; return the best of four."""
    keys = (
        lambda t: (t.deadline, t.robot),
        lambda t: (t.deadline - t.duration, t.robot),
        lambda t: (t.release, t.robot),
        lambda t: (t.duration, t.robot),
    )
    results = [_insert_all(sorted(tasks, key=key), firsts, rules) for key in keys]
    return min(results, key=lambda r: (-len(r), _end(r, firsts, rules) or 0, [by_deadline(t) for t in r]))


def _insert_all(tasks: list[Task], firsts: dict[int, Instant], rules: Rules) -> list[Task]:
    order: list[Task] = []
    rejected: list[Task] = []
    for task in tasks:
        wider = _insert(order, task, firsts, rules)
        if wider is not None:
            order = wider
            continue
        order, out = _exchange(order, task, firsts, rules)
        rejected.append(out)
    for task in rejected:
        order = _insert(order, task, firsts, rules) or order
    return order


def _insert(order: list[Task], task: Task, firsts: dict[int, Instant], rules: Rules) -> list[Task] | None:
    """Return `order` with `task` where all are on time and the end is earliest; None when there is no such place."""
    best: list[Task] | None = None
    best_end: Instant | None = None
    for at in range(len(order) + 1):
        trial = [*order[:at], task, *order[at:]]
        end = _end(trial, firsts, rules)
        if end is not None and (best_end is None or end < best_end):
            best, best_end = trial, end
    return best


def _exchange(order: list[Task], task: Task, firsts: dict[int, Instant], rules: Rules) -> tuple[list[Task], Task]:
    """Put `task` in for the job whose removal brings the end forward most (Moore-Hodgson), if that helps."""
    ends = [(_end(order[:at] + order[at + 1 :], firsts, rules) or 0, at) for at in range(len(order))]
    end = _end(order, firsts, rules)
    if not ends or end is None:
        return order, task
    at = min(ends)[1]
    trial = _insert(order[:at] + order[at + 1 :], task, firsts, rules)
    trial_end = None if trial is None else _end(trial, firsts, rules)
    if trial is None or trial_end is None or trial_end >= end:
        return order, task
    return trial, order[at]


def _end(order: Sequence[Task], firsts: dict[int, Instant], rules: Rules) -> Instant | None:
    """Return the end of the last job; None when one is late."""
    start: Instant | None = None
    last: Task | None = None
    for task in order:
        at = firsts[task.robot]
        if last is not None and start is not None:
            at = max(at, start + gap(last, task, rules.opposed))
        if at + task.duration > task.deadline:
            return None
        start, last = at, task
    return None if start is None or last is None else start + last.duration


def _steady(best: list[Task], standing: Sequence[Placed], rules: Rules, old: Sequence[int]) -> list[Task]:
    """Return the old order of the jobs instead of `best` when it costs neither a job nor a headway."""
    by_robot = {task.robot: task for task in best}
    kept = [by_robot[robot] for robot in old if robot in by_robot]
    for task in best:
        if task.robot not in old:
            kept = _fit(kept, task, standing, rules)
    new_starts, old_starts = place(best, standing, rules), place(kept, standing, rules)
    if on_time(kept, old_starts) < on_time(best, new_starts):
        return best
    headway = min(task.headway for task in best)
    new_end = max(start + task.duration for task, start in zip(best, new_starts, strict=True))
    old_end = max(start + task.duration for task, start in zip(kept, old_starts, strict=True))
    return kept if old_end < new_end + headway else best


def _fit(order: list[Task], task: Task, standing: Sequence[Placed], rules: Rules) -> list[Task]:
    """Return `order` with `task` where most are on time, then the end is earliest, then as late as possible."""
    best, best_cost = order, (1, 0)
    for at in range(len(order), -1, -1):
        trial = [*order[:at], task, *order[at:]]
        starts = place(trial, standing, rules)
        cost = (-on_time(trial, starts), max(s + t.duration for t, s in zip(trial, starts, strict=True)))
        if cost < best_cost:
            best, best_cost = trial, cost
    return best

"""The best order of few jobs by trying all orders of all subsets, with arithmetic of its own.

It shares nothing with the scheduler but the types of its input: times are milliseconds here, gaps are written out
again from the protocol, every pair is checked, and starts are rounded up to 10 ms.
"""

from random import Random
from typing import NamedTuple

from rmr.base.direction import EXCLUSIVE
from rmr.coord.schedule import Placed, Rules, Task
from rmr.coord.timing import MS

GRID_MS = 10


class Best(NamedTuple):
    """What no order beats."""

    met: int
    end_ms: int
    order: tuple[int, ...]
    """Robots on time; of equals the one smallest in (deadline, robot)."""


def apart_ms(first: Task | Placed, second: Task | Placed, rules: Rules) -> int:
    """Return the milliseconds that must lie between the starts of two passages."""
    ahead, behind = first.duration // MS, second.duration // MS
    if not follows(first.direction, second.direction):
        return ahead + rules.opposed // MS
    headway = max(first.headway, second.headway) // MS
    overtaken = ahead - behind  # the second must not be through before the first by less than a headway
    return headway + max(overtaken, 0)


def follows(one: int, other: int) -> bool:
    """Return whether two directions may be under way together, written out again: 2 to 13 lead from arm to arm."""
    if EXCLUSIVE in (one, other) or min(one, other) < 2:
        return one == other != EXCLUSIVE
    arms = [(entrance, end) for entrance in range(4) for end in range(4) if entrance != end]
    (entrance, end), (its_entrance, its_end) = arms[one - 2], arms[other - 2]
    return entrance == its_entrance or end == its_end


def optimum(tasks: list[Task], standing: list[Placed], rules: Rules) -> Best:
    """Return the best of all orders of all subsets. Values must be whole milliseconds."""
    jobs = sorted(tasks, key=lambda t: (t.deadline, t.robot))
    count = len(jobs)
    apart = [[apart_ms(a, b, rules) for b in jobs] for a in jobs]
    behind_standing = [
        max([rules.floor // MS, t.release // MS, *(s.start // MS + apart_ms(s, t, rules) for s in standing)])
        for t in jobs
    ]
    lasts = [(t.duration // MS, t.deadline // MS) for t in jobs]
    best = (0, 0, ())

    def extend(order: tuple[int, ...], starts: tuple[int, ...]) -> None:
        nonlocal best
        for i in range(count):
            if i in order:
                continue
            start = behind_standing[i]
            for other, at in zip(order, starts, strict=True):
                start = max(start, at + apart[other][i])
            start = (start + GRID_MS - 1) // GRID_MS * GRID_MS
            duration, deadline = lasts[i]
            if start + duration <= deadline:
                longer = (*order, i)
                best = min(best, (-len(longer), start + duration, longer))
                extend(longer, (*starts, start))

    extend((), ())
    return Best(-best[0], best[1], tuple(jobs[i].robot for i in best[2]))


WAYS = ((0,), (0, 1), (0, 1), (0, 1, 2), (0, EXCLUSIVE), (EXCLUSIVE,), (2, 3, 5, 6, 8, 9), range(2, 14))


def instance(rng: Random, most: int = 8) -> tuple[list[Task], list[Placed], Rules]:
    """Return random jobs of every kind: headways longer than passages, odd milliseconds, slots that stand."""
    ways = rng.choice(WAYS)
    step = rng.choice((1, 10))
    headways = rng.choice(((950,), (950,), (300, 950, 1700), (0, 2000, 5100)))
    shortest, longest = rng.choice(((2000, 4000), (100, 3000), (3000, 3010)))
    count = max(rng.randint(1, most), rng.randint(1, most))
    horizon = rng.choice((0, 300, 1000)) * count
    slack = rng.choice((200, 600, 1500, 3000)) * count

    def some(low: int, high: int) -> int:
        return rng.randint(low // step, high // step) * step

    tasks = []
    for robot in rng.sample(range(1, 100), count):
        release, duration = some(0, horizon), some(shortest, longest)
        deadline = release + duration + some(0, slack)
        direction, headway = rng.choice(ways), rng.choice(headways)
        tasks.append(Task(robot, release * MS, duration * MS, deadline * MS, headway * MS, direction))
    standing = [
        Placed(some(-2000, 1100) * MS, some(0, longest) * MS, rng.choice(headways) * MS, rng.choice(ways))
        for _ in range(rng.choice((0, 0, 1, 3)))
    ]
    return tasks, standing, Rules(some(0, 600) * MS, 280 * MS)

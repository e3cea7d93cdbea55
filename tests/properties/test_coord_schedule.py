"""The order of jobs: exact for small groups, never worse than first come, and safe whatever the order."""

from itertools import permutations

from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.coord.schedule import EXACT_MAX, Placed, Rules, Task, gap, on_time, order_jobs, place
from rmr.coord.values import GRID, MS

RULES = Rules(floor=600 * MS, opposed=280 * MS)


def tasks(count: int, ways: int = 2) -> st.SearchStrategy[list[Task]]:
    unit = st.integers(0, 500).map(lambda k: k * GRID)
    one = st.tuples(unit, st.integers(100, 300).map(lambda k: k * GRID), unit, st.integers(0, ways - 1))
    return st.lists(one, min_size=1, max_size=count).map(
        lambda rows: [
            Task(i + 1, release, duration, release + duration + slack * 2, 950 * MS, way)
            for i, (release, duration, slack, way) in enumerate(rows)
        ]
    )


def met(order: list[Task], standing: list[Placed]) -> int:
    return on_time(order, place(order, standing, RULES))


@settings(max_examples=60, deadline=None)
@given(tasks(5))
def test_small_groups_meet_as_many_deadlines_as_any_order_could(jobs: list[Task]) -> None:
    best = max(met(list(order), []) for order in permutations(jobs))
    assert met(order_jobs(jobs, [], RULES), []) == best


@settings(max_examples=60, deadline=None)
@given(tasks(7))
def test_the_order_of_deadlines_is_taken_where_it_keeps_all_on_time(jobs: list[Task]) -> None:
    by_deadline = sorted(jobs, key=lambda t: (t.deadline, t.robot))
    if met(by_deadline, []) == len(jobs):
        assert order_jobs(jobs, [], RULES) == by_deadline


@settings(max_examples=40, deadline=None)
@given(tasks(26, ways=2))
def test_every_job_is_ordered_once_and_no_fewer_meet_their_deadlines_than_first_come(jobs: list[Task]) -> None:
    order = order_jobs(jobs, [], RULES)
    assert sorted(task.robot for task in order) == sorted(task.robot for task in jobs)
    if len(jobs) <= EXACT_MAX:
        assert met(order, []) >= met(sorted(jobs, key=lambda t: (t.release, t.robot)), [])


@settings(max_examples=60, deadline=None)
@given(tasks(8), st.lists(st.tuples(st.integers(0, 400), st.integers(50, 300), st.integers(0, 1)), max_size=3))
def test_placed_jobs_keep_every_gap_to_all_before_them(jobs: list[Task], standing: list[tuple[int, int, int]]) -> None:
    fixed = [Placed(start * GRID, duration * GRID, 950 * MS, way) for start, duration, way in standing]
    starts = place(jobs, fixed, RULES)
    before: list[tuple[Task | Placed, int]] = [(item, item.start) for item in fixed]
    for task, start in zip(jobs, starts, strict=True):
        assert start % GRID == 0
        assert start >= max(RULES.floor, task.release)
        assert all(start >= at + gap(other, task, RULES.opposed) for other, at in before)
        before.append((task, start))

"""The order of jobs: exact for small groups, never worse than first come, and safe whatever the order."""

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from schedule_bruteforce import instance
from schedule_campaign import differences

from rmr.coord import search as searching
from rmr.coord.insertion import insertion
from rmr.coord.schedule import EXACT_MAX, Placed, Rules, Task, gap, on_time, order_jobs, place, search
from rmr.coord.search import Problem, branch, layers, punctual, triangular
from rmr.coord.timing import GRID, MS, Order

RULES = Rules(floor=600 * MS, opposed=280 * MS)


def tasks(count: int, ways: int = 2) -> st.SearchStrategy[list[Task]]:
    unit = st.integers(0, 500).map(lambda k: k * GRID)
    one = st.tuples(unit, st.integers(100, 300).map(lambda k: k * GRID), unit, st.integers(0, ways - 1))
    return st.lists(one, min_size=1, max_size=count).map(
        lambda rows: [
            Task(i + 1, release, duration, release + duration + slack * 2, 950 * MS, direction)
            for i, (release, duration, slack, direction) in enumerate(rows)
        ]
    )


def met(order: list[Task], standing: list[Placed]) -> int:
    return on_time(order, place(order, standing, RULES))


@pytest.mark.medium
@pytest.mark.parametrize("block", range(6))
def test_as_many_deadlines_are_met_as_by_the_best_of_all_orders_and_ties_go_as_stated(block: int) -> None:
    seeds = range(50 * block + 1, 50 * block + 51)
    assert {seed: found for seed in seeds if (found := differences(seed))} == {}


def test_the_instances_compared_are_of_every_kind() -> None:
    drawn = [instance(Random(f"schedule/{seed}")) for seed in range(1, 301)]
    assert {len(jobs) for jobs, _, _ in drawn} == set(range(1, 9))
    assert sum(not triangular(problem(jobs)) for jobs, _, _ in drawn) >= 15
    assert sum(bool(standing) for _, standing, _ in drawn) >= 100
    assert sum(met(order_jobs(jobs, [], RULES), []) < len(jobs) for jobs, _, _ in drawn) >= 100


def problem(jobs: list[Task]) -> Problem:
    ordered = sorted(jobs, key=lambda t: (t.deadline, t.robot))
    return Problem(
        [place([task], [], RULES)[0] for task in ordered],
        [task.deadline - task.duration for task in ordered],
        [task.duration for task in ordered],
        [[gap(a, b, RULES.opposed) for b in ordered] for a in ordered],
    )


@settings(max_examples=60, deadline=None)
@given(tasks(7))
def test_both_exact_searches_find_the_same_order(jobs: list[Task]) -> None:
    drawn = problem(jobs)
    assert triangular(drawn)
    assert layers(drawn) == branch(drawn)


def test_a_search_of_all_orders_ends_after_so_many_and_is_no_worse_than_insertion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    chance = Random("schedule/bounded")
    better = 0
    for _ in range(20):
        drawn = problem([_with_long_headway(chance, robot) for robot in range(1, 8)])
        assert not triangular(drawn)
        best, by_insertion = search(drawn), punctual(drawn, insertion(drawn))
        better += best < by_insertion
        with monkeypatch.context() as bounded:
            bounded.setattr(searching, "STEPS_MAX", 20)
            assert best <= search(drawn) <= by_insertion
            bounded.setattr(searching, "STEPS_MAX", 0)
            assert search(drawn) == by_insertion
    assert better >= 5


def _with_long_headway(chance: Random, robot: int) -> Task:
    """Return a job whose headway is longer than two passages the opposite way: that breaks the triangle rule."""
    duration, slack = chance.randint(10, 60) * GRID, chance.randint(100, 900) * GRID
    return Task(robot, 0, duration, 600 * MS + duration + slack, chance.randint(200, 400) * GRID, robot % 2)


@settings(max_examples=40, deadline=None)
@given(tasks(7), st.sampled_from([Order.EDF, Order.FCFS]))
def test_the_rules_to_compare_with_are_what_they_are_called(jobs: list[Task], rule: Order) -> None:
    told = [task._replace(joined=(7 * task.robot) % 5) for task in jobs]
    order = order_jobs(told, [], RULES._replace(order=rule))
    keys = [task.deadline if rule is Order.EDF else task.joined for task in order]
    assert keys == sorted(keys)
    assert sorted(task.robot for task in order) == sorted(task.robot for task in jobs)


@settings(max_examples=60, deadline=None)
@given(tasks(7))
def test_the_order_of_deadlines_is_taken_where_it_keeps_all_on_time(jobs: list[Task]) -> None:
    by_deadline = sorted(jobs, key=lambda t: (t.deadline, t.robot))
    if met(by_deadline, []) == len(jobs):
        assert order_jobs(jobs, [], RULES) == by_deadline


def test_no_jobs_are_in_no_order_even_by_one_that_was_known() -> None:
    assert order_jobs([], [], RULES, [1, 2]) == []


def under_way() -> tuple[Task, Task]:
    """Return one that can be there soon and has time, and one that takes longer and has none."""
    near = Task(1, 1000 * MS, 3000 * MS, 20_000 * MS, 950 * MS, 0)
    return near, Task(2, 4000 * MS, 3000 * MS, 7300 * MS, 950 * MS, 0)


def test_an_order_that_robots_are_under_way_in_stays_though_that_of_deadlines_keeps_all_on_time_too() -> None:
    near, far = under_way()
    assert order_jobs([near, far], [], RULES, [1, 2]) == [near, far]
    assert order_jobs([near, far], [], RULES, []) == [far, near]
    assert order_jobs([near, far], [], RULES, [1]) == [far, near], "one of them is new"
    assert order_jobs([near._replace(deadline=4500 * MS), far], [], RULES, [2, 1])[0].robot == 1, "it costs a job"


def test_grace_keeps_a_slot_in_the_order_and_makes_no_order_of_deadlines_of_late_jobs() -> None:
    near, far = under_way()
    late = far._replace(deadline=6900 * MS)
    urgent = near._replace(deadline=12_000 * MS)
    assert order_jobs([urgent, late], [], RULES, []) == [urgent, late], "it is late anyway"
    spared = late._replace(grace=400 * MS)
    assert [task.robot for task in order_jobs([urgent, spared], [], RULES, [])] == [1, 2], "the end is earlier"
    assert [task.robot for task in order_jobs([urgent, spared], [], RULES, [2, 1])] == [1, 2], "by more than a headway"


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
    fixed = [Placed(start * GRID, duration * GRID, 950 * MS, direction) for start, duration, direction in standing]
    starts = place(jobs, fixed, RULES)
    before: list[tuple[Task | Placed, int]] = [(item, item.start) for item in fixed]
    for task, start in zip(jobs, starts, strict=True):
        assert start % GRID == 0
        assert start >= max(RULES.floor, task.release)
        assert all(start >= at + gap(other, task, RULES.opposed) for other, at in before)
        before.append((task, start))

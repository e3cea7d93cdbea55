"""A crowd before a door: robots stand in each other's way, so the order is kept close to that of deadlines."""

from itertools import pairwise

import pytest
from coord_harness import EVENT, ms

from rmr.coord.fence import Fence
from rmr.coord.ledger import Ledger
from rmr.coord.messages import Job
from rmr.coord.schedule import EXACT_MAX, Placed, Rules, Task, merge, on_time, order_jobs, place
from rmr.coord.term import Term
from rmr.coord.timing import GRID, MS, Timing

RULES = Rules(floor=600 * MS, opposed=280 * MS)
COUNT = EXACT_MAX + 9
HEADWAY_MS = 1000


def jobs(count: int = COUNT, late: tuple[int, ...] = ()) -> list[Task]:
    """Return jobs that come due 1.5 s apart, the first after 5 s; those of the robots `late` cannot be on time."""
    return [
        Task(k, 0, 3000 * MS, (500 if k in late else 3500 + 1500 * k) * MS, HEADWAY_MS * MS, 0)
        for k in range(1, count + 1)
    ]


def robots(order: list[Task]) -> list[int]:
    return [task.robot for task in order]


def met(order: list[Task], rules: Rules = RULES) -> int:
    return on_time(order, place(order, [], rules))


def test_late_jobs_go_as_early_as_delays_no_other_deadline() -> None:
    order = robots(order_jobs(jobs(late=(1, 2)), [], RULES))
    assert [robot for robot in order if robot > 2] == list(range(3, COUNT + 1))
    assert met(order_jobs(jobs(late=(1, 2)), [], RULES)) == COUNT - 2
    assert order.index(1) < 3
    assert order.index(2) < 3
    few = robots(order_jobs(jobs(EXACT_MAX, late=(1, 2)), [], RULES))
    assert few[-2:] == [1, 2], "a few robots get past each other"


def test_late_start_does_not_reverse_the_deadline_order_of_a_crowd() -> None:
    begun = RULES._replace(floor=9000 * MS)
    order = order_jobs(jobs(), [], begun)
    late = [
        task.robot
        for task, start in zip(order, place(order, [], begun), strict=True)
        if start + 3000 * MS > task.deadline
    ]
    rest = [robot for robot in robots(order) if robot not in late]
    assert 0 < len(late) < COUNT // 2
    assert rest == sorted(rest)
    assert max(abs(k - robot) for k, robot in enumerate(robots(order), 1)) < COUNT // 2


def test_job_that_rejoins_is_inserted_by_its_deadline() -> None:
    late, known = jobs(late=(1,)), list(range(1, COUNT + 1))
    known.remove(7)
    order = robots(order_jobs(late, [], RULES, known))
    assert order.index(6) < order.index(7) < order.index(8)


def test_jobs_that_do_not_delay_a_robot_under_way_go_before_it() -> None:
    rest, far = jobs(5), Task(9, 4000 * MS, 3000 * MS, 0, HEADWAY_MS * MS, 0)
    order = merge([far], [0], rest, [], RULES)
    assert robots(order) == [1, 2, 3, 9, 4, 5]
    assert place(order, [], RULES)[3] == 4000 * MS
    busy = [Placed(2000 * MS, 3000 * MS, HEADWAY_MS * MS, 0)]
    assert robots(merge([far], [0], rest, busy, RULES)) == [1, 9, 2, 3, 4, 5]
    assert merge([], [], rest, [], RULES) == rest


def test_a_robot_under_way_for_its_slot_is_not_held_up_by_those_who_leave_it_that_slot() -> None:
    rest, far = jobs(5), Task(9, 4000 * MS, 3000 * MS, 0, HEADWAY_MS * MS, 0)
    assert robots(merge([far], [5500 * MS], rest, [], RULES)) == [1, 2, 3, 4, 9, 5]


def told(
    ledger: Ledger, robot: int, now_ms: int, approach_ms: int, deadline_ms: int, *, underway: bool = False
) -> None:
    """Let `robot` tell its job at `now_ms`, when it needs `approach_ms` to the gate."""
    now = ms(now_ms)
    release = now + ms(approach_ms)
    job = Job(EVENT, now, Term(1, 1), 0, 0, release, ms(3000), ms(deadline_ms), ms(HEADWAY_MS), 0, None, underway)
    ledger.note(now, robot, job, Fence(1, Timing()))


def order(ledger: Ledger, now_ms: int) -> list[int]:
    """Plan at `now_ms` and return the robots in the order of their slots."""
    ledger.open = True
    ledger.plan(ms(now_ms), True)
    return sorted(ledger.bookings, key=lambda robot: ledger.bookings[robot].start or 0)


def test_robot_under_way_keeps_its_place_even_if_another_order_meets_one_more_deadline() -> None:
    for count, first in ((EXACT_MAX - 1, [1, EXACT_MAX]), (COUNT, [1, 2])):
        ledger = Ledger(99, Timing(), 0, 0)
        for robot in range(1, count + 1):
            told(ledger, robot, 0, 2500, 6500 + 1000 * robot)
        assert order(ledger, 10)[:3] == [1, 2, 3]
        told(ledger, count + 1, 1000, 2500, 6900)
        assert order(ledger, 1010)[:2] == first


def test_a_near_robot_keeps_its_slot_when_those_who_set_out_earlier_from_farther_away_have_set_out() -> None:
    ledger = Ledger(99, Timing(), 0, 0)
    for robot in range(1, COUNT + 1):
        told(ledger, robot, 0, 4000 if robot in (6, 8, 10) else 500, 30000 + 1000 * robot)
    by_deadline = order(ledger, 10)
    starts = {robot: booking.start for robot, booking in ledger.bookings.items()}
    for now_ms in range(100, 8000, 100):
        assert order(ledger, now_ms) == by_deadline
    assert {robot: booking.start for robot, booking in ledger.bookings.items()} == starts


def test_robots_that_ask_at_once_may_all_go_before_the_one_that_was_heard_first() -> None:
    ledger = Ledger(99, Timing(), 0, 0)
    count = Timing().schedule.bypass_max + 5
    for robot in range(1, count + 1):
        told(ledger, robot, robot, 500, 100_000 - 1000 * robot)
    first = order(ledger, 100)
    assert first == sorted(first, reverse=True)
    for robot in first[:-2]:
        ledger.bookings[robot].inside = True
        ledger.finish(robot, 0, entered=True)
        assert order(ledger, 200) == [each for each in first if each in ledger.bookings]


@pytest.mark.parametrize("count", [5, COUNT])
def test_a_job_overtaken_for_too_long_goes_before_all_whose_slots_can_move(count: int) -> None:
    ledger = Ledger(99, Timing(), 0, 0)
    for robot in range(1, count + 1):
        told(ledger, robot, 0, 500, 30000 + 1000 * robot)
    first, *rest = order(ledger, 10)
    ledger.bookings[count].bypassed = Timing().schedule.bypass_max
    assert order(ledger, 20) == [first, count, *rest[:-1]], "the slot of the first one is fixed"


def test_a_job_overtaken_for_too_long_holds_up_no_robot_under_way_before_it_can_be_there() -> None:
    ledger = Ledger(99, Timing(), 0, 0)
    told(ledger, 1, 0, 20_000, 30_000)
    told(ledger, 2, 0, 1000, 30_000, underway=True)
    ledger.bookings[1].bypassed = Timing().schedule.bypass_max
    assert order(ledger, 10) == [2, 1]


def test_slots_of_a_crowd_lie_on_the_grid_a_headway_apart() -> None:
    starts = place(order_jobs(jobs(late=(1, 2, 5)), [], RULES), [], RULES)
    assert all(start % GRID == 0 for start in starts)
    assert all(b - a >= HEADWAY_MS * MS for a, b in pairwise(starts))

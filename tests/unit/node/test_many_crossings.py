"""Many crossings of one robot at a time: which action goes by which, and what looking after them costs."""

import sys

from flock import Flock

CHARGES = """
type action charge(R: robot, N: int) -o charged(R, N).
type need(robot, int).
type wanted(robot, int).
job: assert(need(R, N), charged(R, N), 600, broadcast(R)).
need(R, N) -o wanted(R, N).
wanted(R, N) -o charge(R, N).
"""


def with_jobs(count: int) -> Flock:
    """Return a robot, and an idle one that it asks, with `count` open jobs: their actions wait for their crossings."""
    flock = Flock(CHARGES, 2, action_s=5.0)
    for number in range(count):
        flock.insert(1, "need", number)
    return flock.wait(0.05)


def steps(function, *args) -> int:
    """Return how many lines `function` and what it calls run through, each round of a comprehension counted."""
    lines = 0

    def count(_frame, event, _arg):
        nonlocal lines
        lines += event == "line"
        return count

    before = sys.gettrace()
    sys.settrace(count)
    try:
        function(*args)
    finally:
        sys.settrace(before)
    return lines


def test_looking_after_eight_times_the_jobs_costs_eight_times_as_much():
    few, many = with_jobs(5), with_jobs(40)
    assert [len(flock.node(1).actions.held) for flock in (few, many)] == [5, 40]
    assert steps(many.node(1).crossings.step, many.kernel.now) < 9 * steps(few.node(1).crossings.step, few.kernel.now)


def test_a_crossing_knows_its_action_until_that_has_ended():
    flock = with_jobs(1)
    running = flock.node(1).actions.held[0]
    assert running.permit.action is running
    flock.wait(10.0)
    assert running.over
    assert running.permit.action is None

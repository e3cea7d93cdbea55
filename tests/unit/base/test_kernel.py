"""The kernel makes calls in the order of time, priority and request."""

from rmr.base.kernel import RADIO, ROBOT, Alarm, Kernel
from rmr.base.time import NEVER


def test_equal_times_break_by_priority_and_then_by_order_of_request():
    kernel, made = Kernel(), []
    for name, when, priority in (("c", 5, ROBOT), ("b", 5, RADIO), ("d", 5, ROBOT), ("a", 1, ROBOT)):
        kernel.at(when, priority, lambda now, name=name: made.append((now, name)))
    kernel.run_until(10)
    assert made == [(1, "a"), (5, "b"), (5, "c"), (5, "d")]


def test_a_call_for_the_past_is_made_now_and_time_never_goes_back():
    kernel, made = Kernel(), []
    kernel.run_until(7)
    kernel.at(3, RADIO, made.append)
    kernel.run_until(8)
    assert made == [7]


def test_what_is_not_due_waits():
    kernel, made = Kernel(), []
    kernel.at(9, RADIO, made.append)
    kernel.run_until(8)
    assert made == []


def test_an_alarm_rings_once_at_the_time_set_last():
    kernel, rung = Kernel(), []
    alarm = Alarm(kernel, RADIO, rung.append)
    alarm.set(5)
    alarm.set(3)
    alarm.set(8)
    kernel.run_until(20)
    assert rung == [8]


def test_calls_may_be_made_one_by_one():
    kernel, made = Kernel(), []
    assert kernel.due == NEVER
    for when in (7, 3):
        kernel.at(when, ROBOT, made.append)
    assert kernel.due == 3
    kernel.step()
    assert (made, kernel.now, kernel.due) == ([3], 3, 7)

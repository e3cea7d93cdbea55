"""Steps of a job's time: each up to the end of an action, with its share of every owner."""

from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.vm.job import TimedJob
from rmr.why.delay import Delay, Interval, PathAction, TimeOwner, steps_of
from rmr.why.delay_text import delay_data, delay_text

DRIVE = TimeOwner.DRIVE
TURN = TimeOwner.TURN
RULE = TimeOwner.RULE


def delay(actions, *parts):
    """Return a delay of robot 1 from 0 s on; a part is an owner and the instant of its end."""
    intervals = []
    at = 0
    for owner, end in parts:
        intervals.append(Interval(seconds(at), seconds(end), owner, 1))
        at = end
    job = TimedJob(1, 0, "trip", "trip(b)", "at(@1, b)", 0, seconds(8), (Robot(1),), Robot(1), seconds(at), True)
    ends = tuple(PathAction(seconds(end), 1, text) for end, text in actions)
    return Delay(1, job, seconds(at), seconds(at), tuple(intervals), ends)


def told(found):
    return [
        (step.text, step.begin / 1e9, step.end / 1e9, {owner.value: time / 1e9 for owner, time in step.owners})
        for step in steps_of(found)
    ]


def test_each_action_of_a_chain_has_the_time_since_the_one_before():
    found = delay([(4, "to(@1, a)"), (10, "to(@1, b)")], (TURN, 1), (DRIVE, 6), (TURN, 7), (DRIVE, 10))
    assert told(found) == [
        ("to(@1, a)", 0, 4, {"drive": 3, "turn": 1}),
        ("to(@1, b)", 4, 10, {"drive": 5, "turn": 1}),
    ]


def test_time_after_the_last_action_is_a_step_of_its_own():
    found = delay([(4, "to(@1, a)")], (DRIVE, 4), (RULE, 10))
    assert told(found) == [("to(@1, a)", 0, 4, {"drive": 4}), ("after the last action", 4, 10, {"rule": 6})]
    assert [step["action"] for step in delay_data(found)["steps"]] == ["to(@1, a)", None]


def test_job_without_an_action_is_one_step():
    found = delay([], (RULE, 10))
    assert told(found) == [("no action", 0, 10, {"rule": 10})]
    assert "by step" not in delay_text(found)


def test_action_that_had_ended_before_the_job_began_is_no_step():
    assert [step.text for step in steps_of(delay([(0, "to(@1, a)"), (10, "to(@1, b)")], (DRIVE, 10)))] == ["to(@1, b)"]


def test_steps_of_a_chain_stand_below_the_owners():
    text = delay_text(delay([(4, "to(@1, a)"), (10, "to(@1, b)")], (TURN, 1), (DRIVE, 10)))
    assert text.splitlines()[-3:] == [
        "by step, until it ended:",
        "      4.000 s     4.000 s  to(@1, a): drive 3.000 s, turn 1.000 s",
        "     10.000 s     6.000 s  to(@1, b): drive 6.000 s",
    ]

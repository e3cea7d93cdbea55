"""Steps of a job's time: each up to the end of an action, with its share of every owner."""

from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.vm.job import TimedJob
from rmr.vm.provenance import OutsideCause
from rmr.why.delay import Delay, Interval, PathAction, TimeOwner, steps_of
from rmr.why.delay_text import delay_data, delay_text
from rmr.why.past_items import PastAction

DRIVE = TimeOwner.DRIVE
TURN = TimeOwner.TURN
RULE = TimeOwner.RULE


def delay(actions, *parts):
    """Return a delay of robot 1 from 0 s on; a part is an owner, the instant of its end, and the other robots.

    An action is the instant of its end, its text, and by when it is due: None without a turn of the job.
    """
    intervals = []
    at = 0
    for owner, end, *whom in parts:
        intervals.append(Interval(seconds(at), seconds(end), owner, 1, tuple(whom)))
        at = end
    job = TimedJob(1, 0, "trip", "trip(b)", "at(@1, b)", 0, seconds(8), (Robot(1),), Robot(1), seconds(at), True)
    ends = tuple(PathAction(seconds(end), 1, text, past(job, end, *due)) for end, text, *due in actions)
    return Delay(1, job, seconds(at), seconds(at), tuple(intervals), ends)


def past(job, end, due=None):
    """Return an action that has begun a second before its end."""
    action = PastAction(1, 1, 0, 1, (), 0, 0, OutsideCause(), (), begun=seconds(end - 1), ended=seconds(end))
    if due is not None:
        action.job, action.due = job, seconds(due)
    return action


def told(found):
    return [
        (step.text, step.begin / 1e9, step.end / 1e9, {owner.value: time / 1e9 for owner, _, time in step.owners})
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


def test_steps_of_a_chain_stand_below_the_owners_with_their_lateness_and_who_held_them():
    found = delay(
        [(4, "to(@1, a)", 5), (10, "to(@1, b)", 8)], (TURN, 1, 2), (DRIVE, 4), (TURN, 6, 3), (TURN, 9, 2), (DRIVE, 10)
    )
    assert delay_text(found).splitlines()[-4:] == [
        "by step:",
        "        due       began       ended        late",
        "    5.000 s     3.000 s     4.000 s    -1.000 s  to(@1, a): drive 3.000 s, turn behind robot 2 1.000 s",
        "    8.000 s     9.000 s    10.000 s    +2.000 s  to(@1, b): turn behind robot 2 3.000 s, turn behind robot 3 "
        "2.000 s, drive 1.000 s",
    ]
    first, last = delay_data(found)["steps"]
    assert (first["due_ns"], first["begun_ns"], first["late_ns"]) == (seconds(5), seconds(3), -seconds(1))
    assert [(each["owner"], each["whom"]) for each in last["owners"]] == [("turn", [2]), ("turn", [3]), ("drive", [])]


def test_step_without_a_turn_of_the_job_and_one_that_has_not_ended_have_no_lateness():
    found = delay([(4, "rest(@1)"), (10, "to(@1, b)", 8)], (RULE, 10))
    found.actions[1].action.ended = None
    assert [(each["due_ns"], each["late_ns"]) for each in delay_data(found)["steps"]] == [
        (None, None),
        (seconds(8), None),
    ]
    assert delay_text(found).splitlines()[-1].startswith("    8.000 s     9.000 s           -           -  to(@1, b):")

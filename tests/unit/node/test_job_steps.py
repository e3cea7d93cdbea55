"""Steps of a job in the report: the actions that serve it, each with its time until derived, turn, wheels and run."""

from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.lang.compiler import compile_source
from rmr.node.actions.dispatcher import Handler, RunningAction
from rmr.node.actions.job_steps import ACTIONS_MAX, JOBS_MAX, JobSteps
from rmr.vm.job import TimedJob

PROGRAM = """
type action rest(R: robot).
type action to(R: robot, A: int) -o at(R, A).
type action blink(R: robot).
type sensor at(robot, int).
begin(R).
trip: watch(begin(R), at(R, 2), 8, blink(R)).
begin(R) -o rest(R) then to(R, 1) then to(R, 2).
"""


async def nothing(*args):
    del args


class Steps:
    """Steps of one job from 0 s to its finish at 10 s, by instants in seconds."""

    def __init__(self, finish=10):
        self.program = compile_source(PROGRAM).program
        self.job = new_job(finish)
        self.steps = JobSteps()

    def add(self, name, *args, at=(), wheels=False, jobs=None, due=None, behind=()):
        running = RunningAction(1, name, args, Handler(name, nothing, wheels=wheels), behind=behind)
        if due is not None:
            running.job, running.due = self.job, seconds(due)
        stages = [*[None if each is None else seconds(each) for each in at], None, None, None, None]
        running.derived, running.admitted, running.started, running.ended = stages[:4]
        action = self.program.index(name)
        self.steps.derived(self.program, running, action, [self.job] if jobs is None else jobs)

    def told(self, now=20):
        return [
            (
                each["action"],
                each["begin_ns"] / 1e9,
                each["end_ns"] / 1e9,
                {word: time / 1e9 for word, time in each["time_ns"].items()},
            )
            for each in self.steps.entries(1, self.job, seconds(now))
        ]


def new_job(finish=10):
    end = None if finish is None else seconds(finish)
    return TimedJob(1, 0, "trip", "trip(2)", "at(@1, 2)", 0, seconds(8), (Robot(1),), Robot(1), end, True)


def test_step_of_a_chain_that_has_no_effect_serves_the_job_by_the_steps_after_it():
    steps = Steps()
    steps.add("rest", at=(0, 0, 0, 3))
    steps.add("to", 1, at=(3, 4, 5, 7), wheels=True)
    steps.add("to", 2, at=(7, 7, 7, 10), wheels=True)
    assert steps.told() == [
        ("rest(@1)", 0, 3, {"action": 3}),
        ("to(@1, 1)", 3, 7, {"turn": 1, "wheels": 1, "drive": 2}),
        ("to(@1, 2)", 7, 10, {"drive": 3}),
    ]


def test_action_that_leads_nowhere_is_no_step():
    steps = Steps()
    steps.add("blink", at=(0, 0, 0, 9))
    assert steps.told() == []


def test_time_before_an_action_was_derived_is_the_rules_and_that_after_the_last_one_a_step():
    steps = Steps()
    steps.add("to", 2, at=(2, 2, 2, 6), wheels=True)
    assert steps.told() == [("to(@1, 2)", 0, 6, {"rule": 2, "drive": 4}), (None, 6, 10, {"rule": 4})]


def test_actions_side_by_side_have_neither_gap_nor_overlap():
    steps = Steps()
    steps.add("rest", at=(0, 0, 0, 6))
    steps.add("to", 2, at=(0, 0, 0, 4), wheels=True)
    assert steps.told() == [
        ("to(@1, 2)", 0, 4, {"drive": 4}),
        ("rest(@1)", 4, 6, {"action": 2}),
        (None, 6, 10, {"rule": 4}),
    ]


def test_action_that_waits_for_its_turn_at_the_deadline_of_an_unfinished_job_owns_the_rest():
    steps = Steps(finish=None)
    steps.add("to", 2, at=(1,), wheels=True)
    assert steps.told() == [("to(@1, 2)", 0, 8, {"rule": 1, "turn": 7})]
    assert steps.told(now=5) == [("to(@1, 2)", 0, 5, {"rule": 1, "turn": 4})]


def test_action_that_waits_for_the_wheels_is_told_so():
    steps = Steps(finish=None)
    steps.add("to", 2, at=(0, 3), wheels=True)
    assert steps.told() == [("to(@1, 2)", 0, 8, {"turn": 3, "wheels": 5})]


def test_step_with_a_turn_tells_when_it_was_due_how_late_it_was_and_who_held_it():
    steps = Steps()
    steps.add("to", 1, at=(0, 3, 3, 5), due=4, behind=(2, 3))
    steps.add("to", 2, at=(5, 5, 5, 10), due=8, behind=(2,))
    first, second = steps.steps.entries(1, steps.job, seconds(20))
    assert (first["due_ns"], first["begun_ns"], first["late_ns"]) == (seconds(4), seconds(3), seconds(1))
    assert (first["behind"], second["behind"]) == ([2, 3], []), "the second one did not wait"
    assert second["late_ns"] == seconds(2)


def test_step_without_a_turn_of_the_job_or_without_an_end_has_no_lateness():
    steps = Steps(finish=None)
    steps.add("rest", at=(0, 0, 0, 3))
    steps.add("to", 2, at=(3, 9, 9, 10), due=8)
    told = [
        (each["due_ns"], each["begun_ns"], each["late_ns"]) for each in steps.steps.entries(1, steps.job, seconds(20))
    ]
    assert told == [(None, 0, None), (seconds(8), None, None)]


def test_actions_and_jobs_that_are_kept_are_bounded():
    steps = Steps()
    for _ in range(ACTIONS_MAX + 5):
        steps.add("to", 2, at=(0, 0, 0, 10), wheels=True)
    assert len(steps.steps._actions[steps.job]) == ACTIONS_MAX
    for _ in range(JOBS_MAX):
        steps.add("to", 2, at=(0, 0, 0, 10), jobs=[new_job()])
    assert len(steps.steps._actions) == JOBS_MAX
    assert steps.told() == []

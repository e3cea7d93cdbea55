"""``order deadline.``: of the firings of one rank those for the job that is due first."""

import pytest
from vm_hand import machine_of

from rmr.base.time import NS_PER_S
from rmr.base.values import Robot
from rmr.lang.compiler import compile_source
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived, FactInserted, FactSent, RuleFired

pytestmark = pytest.mark.usefixtures("each_engine")

ORDERS = """
{order}
type task(robot, int, float).
type free(robot).
type done(robot, int).
type action stop(robot).
type action fetch(R: robot, N: int) -o done(R, N), free(R).
free(R).
task(R, N, _), free(R) -o fetch(R, N).
done(R, _) -o 1.
fetched: watch(task(R, N, D), done(R, N), D, stop(R)).
"""


def machine(text: str, **more: object) -> Machine:
    compilation = compile_source(text)
    assert compilation.program is not None, compilation.diagnostics
    made = machine_of(compilation.program, **more)
    made.start(0)
    return made


def insert(made: Machine, name: str, *args: object, at: int = 0) -> None:
    index = made.program.index(name)
    assert index is not None
    made.insert(at, index, args)  # type: ignore[arg-type]


def fetched(made: Machine, at: int = 0) -> list[object]:
    """Run, and complete each action at once; return what was fetched, in order."""
    found: list[object] = []
    while True:
        made.run(at)
        actions = [event for event in made.drain() if isinstance(event, ActionDerived)]
        if not actions:
            return found
        for action in actions:
            if made.program.predicates[action.predicate].name == "fetch":
                found.append(action.args[0])
            made.complete(at, action.serial, True)


@pytest.mark.parametrize(("order", "expected"), [("order deadline.", [3, 1, 2]), ("order textual.", [1, 2, 3])])
def test_several_orders_of_one_robot_go_by_deadline_only_where_the_program_says_so(
    order: str, expected: list[int]
) -> None:
    made = machine(ORDERS.format(order=order), firing_budget=1)
    for number, deadline in ((1, 5.0), (2, 9.0), (3, 2.0)):
        insert(made, "task", number, deadline)
    assert fetched(made) == expected


def test_an_urgent_order_that_comes_later_goes_first() -> None:
    made = machine(ORDERS.format(order="order deadline."))
    insert(made, "task", 1, 5.0)
    insert(made, "task", 2, 9.0)
    made.run(0)
    insert(made, "task", 3, 1.0, at=5)
    made.complete(5, 1, True)
    assert fetched(made, 5) == [1, 3, 2]


def test_a_job_that_has_missed_its_deadline_has_no_precedence() -> None:
    made = machine(ORDERS.format(order="order deadline.").replace("free(R).\ntask", "task"))
    insert(made, "task", 1, 9.0)
    insert(made, "task", 2, 1.0)
    insert(made, "free", at=2 * NS_PER_S)
    assert fetched(made, 2 * NS_PER_S) == [1, 2]


def test_equally_urgent_matches_go_by_age_and_equally_urgent_rules_are_drawn() -> None:
    made = machine(ORDERS.format(order="order deadline."))
    for number in (4, 7, 5):
        insert(made, "task", number, 3.0)
    assert fetched(made) == [4, 7, 5]
    text = "order deadline. a(R). a(R) -o b(R). a(R) -o c(R). b(R) -o d(R). c(R) -o d(R). d(R) -o 1."
    text += "type action stop(robot). j: watch(a(R), d(R), 5, stop(R))."
    found = set()
    for seed in range(20):
        drawn = machine(text, seed=str(seed))
        drawn.run(0)
        found.add(next(event.rule for event in drawn.drain() if isinstance(event, RuleFired)))
    assert found == {0, 1}


def test_the_rank_comes_before_the_deadline() -> None:
    text = (
        "order deadline. ?g(R). a(R). b(R). a(R) -o g(R). b(R) -o d(R). type action stop(robot). g(R) -o 1. d(R) -o 1."
    )
    text += "j: watch(b(R), d(R), 5, stop(R))."
    made = machine(text)
    made.run(0)
    assert [event.rule for event in made.drain() if isinstance(event, RuleFired)][:2] == [0, 1]


def test_an_urgent_job_goes_before_routine_through_several_steps() -> None:
    text = "order deadline. type routine(robot, int). type seen(robot, int). type action stop(robot).\n"
    text += "routine(R, N) -o seen(R, N). start(R) -o middle(R). middle(R) -o end(R). seen(R, _) -o 1. end(R) -o 1.\n"
    text += "j: watch(start(R), end(R), 1, stop(R))."
    made = machine(text, trace=True)
    for number in range(300):
        insert(made, "routine", number)
    insert(made, "start")
    made.run(0)
    names = [made.program.predicates[e.predicate].name for e in made.drain() if isinstance(e, FactInserted)]
    assert names[301:303] == ["middle", "end"]


def test_what_is_for_a_job_with_its_finish_elsewhere_goes_first() -> None:
    text = "order deadline. type routine(robot, int). type ask(robot, robot). type asked(robot, robot).\n"
    text += "type answered(robot). type action stop(robot). type other(robot, int). answered(R) -o 1.\n"
    text += "routine(R, N) -o other(@3, N). ask(R, B) -o asked(B, R). asked(R, _) -o answered(R). other(R, _) -o 1.\n"
    text += "j: watch(ask(R, B), answered(B), 1, stop(R))."
    made = machine(text, robot=1)
    for number in range(5):
        insert(made, "routine", number)
    insert(made, "ask", Robot(2))
    made.run(0)
    sent = [event for event in made.drain() if isinstance(event, FactSent)]
    assert sent[0].destination == 2


def test_a_job_that_ends_and_one_that_restarts_change_the_order() -> None:
    made = machine(ORDERS.format(order="order deadline.").replace("free(R).\ntask", "task"))
    insert(made, "task", 1, 4.0)
    insert(made, "task", 2, 6.0)
    made.run(0)
    insert(made, "done", 1)
    insert(made, "task", 3, 9.0)
    insert(made, "free")
    assert fetched(made) == [2, 3, 1]

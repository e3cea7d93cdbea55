"""Deadlines that deliveries inherit: from the job that they serve, over several robots."""

import pytest

from rmr.base.streams import Choices
from rmr.base.time import NEVER, milliseconds, seconds
from rmr.base.values import Robot
from rmr.lang.compiler import compile_source
from rmr.node import payloads
from rmr.node.logic.deliveries import Deadlines
from rmr.node.payloads import Delivery, DeliveryRole
from rmr.vm.engines import new_machine
from rmr.vm.predicate_reach import Reach

SOURCE = """
type begin(robot, robot).
type !done(robot).
type step(robot, robot).
type last(robot).
type routine(robot).
begin(A, B) -o step(B, A), routine(B).
step(B, A) -o last(A).
last(A) -o act(A).
type action act(A: robot) -o done(A).
routine(B) -o 1.
job: watch(begin(A, B), done(A), 0.5, say(A, "late")).
"""


@pytest.fixture
def program():
    compiled = compile_source(SOURCE).program
    assert compiled is not None
    return compiled


def delivery(program, name, due=NEVER):
    return Delivery(DeliveryRole.FACT, program.index(name), (), 0, due)


def test_what_can_lead_from_the_start_of_a_job_to_its_end_inherits_the_deadline(program, made):
    machine = made(program)
    machine.insert(seconds(1), program.index("begin"), (Robot(2),))
    deadlines = Deadlines(program, machine)
    due, jobs = deadlines.of(seconds(1), 2, delivery(program, "step"))
    assert due == seconds(1.5)
    assert [job.name for job in jobs] == ["job"]
    assert deadlines.of(seconds(1), 2, delivery(program, "routine")) == (NEVER, [])


def test_the_deadline_travels_on_from_robot_to_robot_until_it_has_passed(program, made):
    deadlines = Deadlines(program, made(program))
    deadlines.arrived(0, 1, delivery(program, "step", due=milliseconds(500)))
    assert deadlines.of(milliseconds(400), 1, delivery(program, "last"))[0] == milliseconds(500)
    assert deadlines.of(milliseconds(400), 1, delivery(program, "routine"))[0] == NEVER
    assert deadlines.of(milliseconds(501), 1, delivery(program, "last"))[0] == NEVER


def test_a_robot_that_is_asked_for_a_finish_fact_hurries_with_what_leads_to_it(program, made):
    deadlines = Deadlines(program, made(program))
    deadlines.arrived(0, 1, Delivery(DeliveryRole.FINISH_AWAITED, 0, (), 0, milliseconds(500)))
    assert deadlines.of(0, 1, delivery(program, "last"))[0] == milliseconds(500)
    assert deadlines.of(0, 1, Delivery(DeliveryRole.FINISH_SEEN, 0, ()))[0] == milliseconds(500)


def test_reach_follows_rules_and_effects_of_actions(program):
    reach = Reach(program)
    assert reach.leads(program.index("begin"), program.index("done"))
    assert not reach.leads(program.index("routine"), program.index("done"))
    assert reach.leads(program.index("routine"), program.index("routine"))


@pytest.mark.parametrize("due", [0, 1, milliseconds(1500), NEVER])
def test_a_deadline_survives_the_wire_to_the_millisecond(due):
    body = payloads.encode_delivery(Delivery(DeliveryRole.FACT, 3, (1,), 0, due), {})
    read = payloads.decode_delivery(body, ())
    assert due <= read.due < due + milliseconds(1) if due != NEVER else read.due == NEVER
    assert len(body) == 6 + 4 * (due != NEVER)


SEVERAL = """
type waiting(robot, int).
type served(robot, int).
waiting(A, X), free(B, X), peer(A, B) -o served(A, X), gave(B, X).
job: watch(waiting(A, X), served(A, X), 0.5, say(A, "late")).
"""


def test_an_offer_and_its_answer_carry_the_deadline_of_the_job_that_they_serve(made):
    program = compile_source(SEVERAL).program
    assert program is not None
    home = made(program)
    home.insert(seconds(1), program.index("waiting"), (7,))
    due, jobs = Deadlines(program, home).of(seconds(1), 2, delivery(program, "offer__1"))
    assert (due, [job.name for job in jobs]) == (seconds(1.5), ["job"])
    remote = Deadlines(program, made(program))
    remote.arrived(seconds(1), 1, delivery(program, "offer__1", due=due))
    assert [remote.of(seconds(1), 1, delivery(program, name))[0] for name in ("fired__1", "refused__1")] == [due, due]


@pytest.fixture
def made():
    return lambda program: new_machine(program, 1, Choices("1"))

"""The machine's edges: what hosts hand in, jobs and deadlines."""

import pytest
from vm_hand import AREA, FLOAT, INT, OPEN, ROBOT, Hand, V, _, actions, code, fired, sent

from rmr.base.time import NEVER, Instant, seconds
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import ANY, Base, Constant, Effect, Kind, Serving, Slot, Type
from rmr.vm.assertions import LIVE_MAX
from rmr.vm.machine_events import JobFinished, JobMissed, JobStarted

pytestmark = pytest.mark.usefixtures("each_engine")

EXIT = Symbol("exit")


@pytest.mark.parametrize(
    ("name", "args"),
    [
        ("at", ()),
        ("at", (EXIT, EXIT)),
        ("at", ("exit",)),
        ("speed", (Symbol("fast"),)),
        ("speed", (float("nan"),)),
        ("count", (1.0,)),
        ("count", (True,)),
        ("count", (Robot(1),)),
        ("count", (2**63,)),
        ("go", (EXIT,)),
    ],
)
def test_inserted_fact_of_wrong_type_or_arity_is_refused_by_name(name: str, args: tuple[Value, ...]) -> None:
    hand = Hand()
    hand.sensed("at", AREA), hand.temporary("speed", FLOAT), hand.temporary("count", INT), hand.action("go", AREA)
    machine = hand.machine()
    index = machine.program.index(name)
    assert index is not None
    with pytest.raises(ValueError, match=name):
        machine.insert(0, index, args)


def test_an_int_becomes_a_float_where_one_is_declared() -> None:
    hand = Hand()
    speed = hand.temporary("speed", FLOAT)
    machine = hand.machine()
    machine.insert(0, speed, (2,))
    assert machine.facts() == ["speed(@1, 2.0)"]


def test_ints_become_floats_within_lists_too() -> None:
    hand = Hand()
    route = hand.temporary("route", Type(Base.LIST, element=Type(Base.LIST, element=FLOAT)))
    machine = hand.machine()
    machine.insert(0, route, (((1, 2.5), ()),))
    assert machine.facts() == ["route(@1, [[1.0, 2.5], []])"]
    with pytest.raises(ValueError, match="route"):
        machine.insert(0, route, ((1, 2.5),))
    with pytest.raises(ValueError, match="route"):
        machine.insert(0, route, (((10**400,),),))


def test_only_sensed_facts_are_withdrawn() -> None:
    hand = Hand()
    at, edge = hand.sensed("at", AREA), hand.persistent("edge", AREA)
    machine = hand.machine()
    machine.withdraw(0, at, (EXIT,))
    with pytest.raises(ValueError, match="edge is not sensed"):
        machine.withdraw(0, edge, (EXIT,))


def test_a_provided_id_is_the_robots_number_and_not_listed() -> None:
    hand = Hand()
    number = hand.predicate("id", Kind.PERSISTENT, INT, provided=True)
    machine = hand.machine(robot=6)
    assert machine.holds(number, (Constant(6),))
    assert machine.facts() == []


def acting() -> tuple[Hand, int, int, int]:
    """An action whose effects touch a temporary and a sensed predicate."""
    hand = Hand()
    there, at, stuck = hand.temporary("there", AREA), hand.sensed("at", AREA), hand.temporary("stuck", INT)
    effects = (Effect(there, (code(V(1)),)), Effect(at, (code(V(1)),)))
    failed = (Effect(stuck, (code(1, 0, Op.MOD),)), Effect(stuck, (code(7),)))
    hand.action("go", AREA, effects=effects, failed=failed)
    return hand, 3, there, at


def test_completion_inserts_the_effects_but_not_those_that_are_sensed() -> None:
    hand, go, there, at = acting()
    machine = hand.machine()
    machine.derive_action(0, go, (EXIT,))
    (action,) = actions(machine.drain())
    assert machine.complete(1, action.serial, True)
    assert not machine.complete(1, action.serial, True)
    assert machine.facts() == ["there(@1, exit)"]
    assert machine.holds(there, (ANY,))
    assert not machine.holds(at, (ANY,))


def test_failure_inserts_the_else_effects_that_have_a_value() -> None:
    hand, go, *_rest = acting()
    machine = hand.machine()
    machine.derive_action(0, go, (EXIT,))
    (action,) = actions(machine.drain())
    machine.complete(1, action.serial, False)
    assert machine.facts() == ["stuck(@1, 7)"]
    assert machine.expression_failures == 1


def giving() -> tuple[Hand, int, int]:
    """``give(R, B, N) -o has(B, N) else lost(B, N), kept(R, N)``, and goals for what it brings."""
    hand = Hand()
    has, lost, kept = hand.temporary("has", INT), hand.temporary("lost", INT), hand.temporary("kept", INT)
    effects = (Effect(has, (code(V(2)),), code(V(1))),)
    failed = (Effect(lost, (code(V(2)),), code(V(1))), Effect(kept, (code(V(2)),)))
    return hand, hand.action("give", OPEN, INT, effects=effects, failed=failed), has


def test_the_effect_on_another_robot_is_sent_to_it() -> None:
    hand, give, has = giving()
    machine = hand.machine()
    for number, ok in ((7, True), (8, False)):
        machine.derive_action(0, give, (Robot(4), number))
        machine.complete(1, actions(machine.drain())[0].serial, ok)
        assert sent(machine.drain()) == [(4, has if ok else has + 1, (number,))]
    assert machine.facts() == ["kept(@1, 8)"]


def test_an_effect_whose_robot_is_the_executor_stays_and_one_that_names_no_robot_is_left_out() -> None:
    hand, give, _has = giving()
    machine = hand.machine()
    for taker in (Robot(1), 5):
        machine.derive_action(0, give, (taker, 7))
        assert machine.complete(1, actions(machine.drain())[0].serial, True)
    assert machine.facts() == ["has(@1, 7)"]
    assert sent(machine.drain()) == []
    assert machine.expression_failures == 1


def test_an_action_of_another_robot_that_brings_a_fact_here_leads_to_the_goal() -> None:
    hand, give, has = giving()
    token = hand.temporary("token")
    hand.fact(token)
    hand.goal(has, 3)
    for number, taker in ((1, V(0)), (3, Robot(9)), (3, V(0)), (2, V(0))):
        hand.rule([hand.atom(token)], [hand.head(give, taker, number, to=Robot(4))])
    for seed in range(20):
        assert fired(hand.machine(seed=seed).drain()) == [2]


def test_the_robot_itself_may_stand_in_stated_facts_and_goals() -> None:
    hand = Hand()
    knows = hand.temporary("knows", ROBOT, ROBOT)
    hand.fact(knows, V(0), Robot(5))
    hand.goal(knows, V(0), Robot(6))
    machine = hand.machine(robot=3)
    assert machine.facts() == ["knows(@3, @3, @5)"]
    machine.insert(0, knows, (Robot(4), Robot(6)))
    assert machine.goals()["open"] == ["knows(@3, @3, @6)"]
    machine.insert(0, knows, (Robot(3), Robot(6)))
    assert machine.goals()["open"] == []


def test_a_variable_that_stands_twice_in_a_goal_is_one_value() -> None:
    hand = Hand()
    pair = hand.temporary("pair", INT, INT, INT)
    hand.goal(pair, V(1), V(1), _)
    machine = hand.machine()
    machine.insert(0, pair, (1, 2, 3))
    assert machine.goals()["achieved"] == []
    machine.insert(0, pair, (2, 2, 3))
    assert machine.goals()["open"] == []


def crossing(finish: Kind = Kind.SENSED, deadline: object = V(2)) -> tuple[Hand, int, int, int]:
    """``crossing: assert(due(A, P, D), at(A, P), D, alarm(A))`` served by ``go(A, P)``."""
    hand = Hand()
    due, at = hand.temporary("due", AREA, INT), hand.predicate("at", finish, AREA)
    alarm, go = hand.action("alarm"), hand.action("go", AREA)
    served = (Serving(go, (Slot(1),)),)
    start, end = hand.atom(due, V(1), V(2)), hand.atom(at, V(1))
    hand.asserts(start, end, deadline, hand.head(alarm), name="crossing", serving=served)
    return hand, due, at, go


def test_a_job_tells_its_event_its_fact_and_its_times() -> None:
    hand, due, _at, _go = crossing()
    machine = hand.machine(robot=4)
    machine.insert(seconds(1), due, (EXIT, 25))
    (job,) = machine.jobs
    assert machine.drain() == [JobStarted(job)]
    assert (job.name, job.event, job.text) == ("crossing", "crossing(exit)", "at(@4, exit)")
    assert (job.start, job.deadline, job.finish, job.missed) == (seconds(1), seconds(26), None, False)
    assert job.bindings[:3] == (Robot(4), EXIT, 25)
    assert machine.next_wake == seconds(26)


def test_a_later_start_starts_the_job_anew_with_its_own_deadline() -> None:
    hand, due, _at, _go = crossing()
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 25))
    machine.insert(seconds(1), due, (EXIT, 5))
    machine.insert(seconds(1), due, (Symbol("entry"), 9))
    first, other = machine.jobs
    assert (first.start, first.deadline) == (seconds(1), seconds(6))
    assert (other.serial, other.event) == (2, "crossing(entry)")
    machine.run(seconds(30))
    assert [event.job for event in machine.drain() if isinstance(event, JobMissed)] == [first, other]


@pytest.mark.parametrize(("kind", "ends"), [(Kind.SENSED, True), (Kind.PERSISTENT, True), (Kind.TEMPORARY, False)])
def test_a_job_whose_finish_holds_already_ends_at_once_unless_it_is_temporary(kind: Kind, ends: bool) -> None:
    hand, due, at, _go = crossing(kind)
    machine = hand.machine()
    machine.insert(0, at, (EXIT,))
    machine.insert(seconds(2), due, (EXIT, 5))
    (job,) = machine.jobs
    assert job.finish == (seconds(2) if ends else None)
    assert machine.next_wake == (NEVER if ends else seconds(7))


def test_a_sensed_fact_that_holds_already_ends_no_job() -> None:
    hand, due, at, _go = crossing()
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 5))
    machine.insert(1, at, (EXIT,))
    machine.insert(2, at, (EXIT,))
    assert len([event for event in machine.drain() if isinstance(event, JobFinished)]) == 1


def test_an_insertion_ends_jobs_before_it_starts_one() -> None:
    hand = Hand()
    lap, alarm = hand.temporary("lap", INT), hand.action("alarm")
    hand.asserts(hand.atom(lap, _), hand.atom(lap, _), 10, hand.head(alarm))
    machine = hand.machine()
    machine.insert(seconds(1), lap, (1,))
    machine.insert(seconds(4), lap, (2,))
    first, second = machine.jobs
    assert (first.finish, second.start, second.finish) == (seconds(4), seconds(4), None)
    assert [type(event) for event in machine.drain()] == [JobStarted, JobFinished, JobStarted]


def test_a_fact_at_the_instant_of_the_deadline_is_in_time_and_one_after_it_late_even_without_a_run() -> None:
    for at_ns, missed in ((seconds(5), False), (seconds(5) + 1, True)):
        hand, due, at, _go = crossing()
        machine = hand.machine()
        machine.insert(0, due, (EXIT, 5))
        machine.insert(at_ns, at, (EXIT,))
        (job,) = machine.jobs
        assert (job.missed, job.finish) == (missed, at_ns)
        machine.run(at_ns)
        assert len(actions(machine.drain())) == missed


def test_a_deadline_at_this_instant_waits_for_the_last_run_and_an_earlier_one_does_not() -> None:
    hand, due, at, _go = crossing()
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 5))
    machine.insert(0, due, (Symbol("entry"), 4))
    machine.run(seconds(5), last=False)
    first, other = machine.jobs
    assert (first.missed, other.missed) == (False, True)
    machine.insert(seconds(5), at, (EXIT,))
    machine.run(seconds(5))
    assert (first.missed, first.finish) == (False, seconds(5))
    machine.insert(seconds(6), due, (Symbol("dock"), 1))
    machine.run(seconds(7), last=False)
    machine.run(seconds(7))
    assert [event.job.deadline for event in machine.drain() if isinstance(event, JobMissed)] == [seconds(4), seconds(7)]


def test_a_start_after_the_miss_opens_a_new_job() -> None:
    hand, due, at, _go = crossing()
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 5))
    machine.run(seconds(6))
    machine.insert(seconds(7), due, (EXIT, 5))
    machine.insert(seconds(8), at, (EXIT,))
    old, new = machine.jobs
    assert (old.missed, old.finish) == (True, None)
    assert (new.missed, new.finish) == (False, seconds(8))


@pytest.mark.parametrize("deadline", [code("soon"), code(1, 0, Op.DIV)])
def test_a_deadline_without_value_starts_no_job_and_is_counted(deadline: object) -> None:
    hand, due, _at, _go = crossing(deadline=deadline)
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 5))
    assert machine.jobs == []
    assert machine.expression_failures == 1


def test_a_deadline_beyond_all_time_is_never_reached() -> None:
    hand, due, _at, _go = crossing(deadline=code(1e300))
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 5))
    machine.run(seconds(10**6))
    assert not machine.jobs[0].missed


def test_an_action_serves_the_jobs_of_its_arguments_first_due_first() -> None:
    hand, due, at, go = crossing()
    hand.asserts(
        hand.atom(due, V(1), V(2)), hand.atom(at, _), 1, hand.head(2), name="any", serving=(Serving(go, (_,)),)
    )
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 25))
    machine.insert(0, due, (Symbol("entry"), 5))
    assert [job.event for job in machine.serves(go, (EXIT,))] == ["any(_)", "crossing(exit)"]
    assert [job.event for job in machine.serves(go, (Symbol("entry"),))] == ["any(_)", "crossing(entry)"]
    machine.insert(seconds(1), at, (EXIT,))
    assert machine.serves(go, (EXIT,)) == []


def test_job_that_missed_its_deadline_is_still_served() -> None:
    hand, due, _at, go = crossing()
    machine = hand.machine()
    machine.insert(0, due, (EXIT, 5))
    machine.run(seconds(9))
    assert [job.missed for job in machine.serves(go, (EXIT,))] == [True]


def test_waiting_jobs_are_bounded_and_dropped_ones_are_counted() -> None:
    hand = Hand()
    start, end, alarm = hand.temporary("start", INT), hand.temporary("end", INT), hand.action("alarm")
    hand.asserts(hand.atom(start, V(1)), hand.atom(end, V(1)), 10, hand.head(alarm))
    machine = hand.machine()
    for number in range(LIVE_MAX + 3):
        machine.insert(0, start, (number,))
    assert machine.dropped["jobs"] == 3
    machine.drain()
    machine.run(seconds(11))
    assert len(actions(machine.drain())) == LIVE_MAX


def test_a_job_that_starts_anew_for_ever_takes_the_place_of_one_deadline() -> None:
    hand = Hand()
    start, end, alarm = hand.temporary("start", INT), hand.temporary("end"), hand.action("alarm")
    hand.asserts(hand.atom(start, V(1)), hand.atom(end), V(1), hand.head(alarm))
    machine = hand.machine()
    for number in range(6 * LIVE_MAX):
        machine.insert(0, start, (10 + number % 2,))
    assert len(machine._assertions._queue) <= 4 * LIVE_MAX + 1
    assert machine.due == seconds(11)
    machine.drain()
    machine.run(seconds(12))
    assert len(actions(machine.drain())) == 1


def test_a_quiet_machine_looks_for_no_match(monkeypatch: pytest.MonkeyPatch) -> None:
    hand = Hand()
    pose, other = hand.sensed("pose", FLOAT, FLOAT), hand.temporary("other")
    hand.rule([hand.atom(other)], [])
    machine = hand.machine()
    looks: list[Instant] = []
    monkeypatch.setattr(type(machine), "_fire", lambda _machine, now: looks.append(now))
    for now in range(100):
        machine.run(now)
        machine.insert(now, pose, (float(now), 1.0))
        machine.withdraw(now, pose, (float(now), 1.0))
        machine.run(now)
    assert looks == []
    machine.insert(100, other, ())
    machine.run(100)
    assert looks == [100]

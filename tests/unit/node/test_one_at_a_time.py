"""Deliveries take effect one at a time: each when no rule is satisfied any more, within bounds, and none is lost."""

from flock import Flock
from test_deliveries import tell

from rmr.base.time import NS_PER_S, TICK_HZ, milliseconds, seconds
from rmr.lang.compiler import compile_source
from rmr.node import payloads
from rmr.node.logic.exchange import WAITING_MAX
from rmr.node.logic.inbound import Arrival
from rmr.node.logic.machine_runner import RESTLESS_CALLS
from rmr.node.payloads import Delivery, DeliveryRole
from rmr.node.ports import Received
from rmr.node.trace import TraceLevel
from rmr.vm import ranks
from rmr.vm.machine import FIRING_BUDGET

LOG = """
order textual.
type log(robot, list int).
type got(robot, int).
log(R, []).
"""
LATEST_FIRST = LOG + "".join(f"got(R, {n}), log(R, L) -o log(R, L + [{n}]).\n" for n in range(9, 0, -1))
"""If several deliveries were there at a time, the latest would be noted first."""


def fact(flock: Flock, name: str, *args: object) -> Delivery:
    index = flock.program.index(name)
    assert index is not None
    return Delivery(DeliveryRole.FACT, index, args)  # type: ignore[arg-type]


def test_deliveries_of_one_instant_take_effect_in_the_order_of_their_derivation():
    flock = Flock(LATEST_FIRST + "go(@1). go(R) -o got(@2, 1), got(@2, 2), got(@2, 3).").run()
    assert flock.facts(2) == ["log(@2, [1, 2, 3])"]
    (instant,) = {entry["t"] for entry in flock.noted(2, "received")}
    assert instant == 0.005


def test_between_senders_they_take_effect_in_the_order_of_arrival():
    flock = Flock(LATEST_FIRST + "go(@2, 1). go(@3, 2). go(R, N) -o got(@1, N), got(@1, N + 2).", robots=3).run()
    assert [entry["source"] for entry in flock.noted(1, "received")] == [2, 2, 3, 3]
    assert flock.facts(1) == ["log(@1, [1, 3, 2, 4])"]


def test_what_rules_and_actions_do_at_once_is_done_before_the_next_delivery():
    flock = Flock(
        LOG
        + """
        type action note(R: robot, N: int) -o noted(R, N).
        type noted(robot, int).
        got(R, N) -o step(R, N).
        step(R, N) -o note(R, N).
        noted(R, N), log(R, L) -o log(R, L + [N]).
        got(R, N), noted(R, _) -o together(R).
        go(@1). go(R) -o got(@2, 1), got(@2, 2).
        """
    ).run()
    assert flock.facts(2) == ["log(@2, [1, 2])"]
    whats = [e["what"] for e in flock.node(2).trace_log if e["what"] in ("received", "action_ended")]
    assert whats == ["received", "action_ended"] * 2


def test_a_fact_that_is_sensed_or_inserted_at_that_instant_comes_first():
    flock = Flock(LATEST_FIRST).run()
    flock.insert(1, "got", 9)
    tell(flock, 1, fact(flock, "got", 1), source=2)
    assert flock.run().facts(1) == ["log(@1, [9, 1])"]


def test_a_job_whose_finish_comes_behind_another_delivery_at_the_instant_of_its_deadline_is_in_time():
    flock = Flock(
        LOG
        + """
        type action late(robot).
        quick: watch(begun(R), done(R), 1, late(R)).
        begun(R).
        """
    )
    flock.wait(0.5)
    (job,) = flock.node(1).machine.jobs
    assert job.deadline == seconds(1)
    flock.kernel.at(job.deadline, 0, lambda _: [tell(flock, 1, one, 2, 0x8000 + n) for n, one in enumerate(late)])
    late = [fact(flock, "got", 1), fact(flock, "got", 2), fact(flock, "done")]
    flock.wait(2)
    assert (job.finish, job.missed) == (job.deadline, False)


def test_a_deadline_of_that_instant_is_missed_when_all_deliveries_have_taken_effect():
    flock = Flock(LOG + "type action late(robot). quick: watch(begun(R), done(R), 1, late(R)). begun(R).")
    flock.wait(0.5)
    (job,) = flock.node(1).machine.jobs
    late = [fact(flock, "got", 1), fact(flock, "got", 2)]
    flock.kernel.at(job.deadline, 0, lambda _: [tell(flock, 1, one, 2, 0x8000 + n) for n, one in enumerate(late)])
    flock.run(5)
    assert job.missed
    assert len(flock.noted(1, "action_ended")) == 1


def test_news_of_a_job_does_not_wait_for_the_rules_of_its_robot():
    flock = Flock(
        """
        order textual.
        type action late(robot).
        type !done(robot, robot).
        type asks(robot, robot).
        quick: watch(begun(R, B), done(B, R), 0.3, late(R)).
        begun(@2, @1). count(@2, 20000).
        $begun(R, B), not sent(R) -o sent(R), asks(B, R).
        count(R, N), N > 0 -o count(R, N - 1).
        asks(B, R) -o done(B, R), got(R).
        """,
        trace=TraceLevel.NOTES,
    )
    flock.wait(0.2)
    (job,) = flock.node(2).machine.jobs
    assert job.finish == milliseconds(5)
    assert not flock.node(2).machine.quiescent
    assert [entry["predicate"] for entry in flock.noted(2, "received")] == ["quick"]
    assert len(flock.node(2).messenger.exchange.arrivals) == 1, "the fact waits"


COUNTS = (
    LOG
    + """
got(R, N), log(R, L) -o log(R, L + [N]), count(R, 400).
count(R, N), N > 0 -o count(R, N - 1).
count(R, 0) -o 1.
"""
)


def test_when_the_firings_of_a_call_are_used_up_the_others_wait_for_the_next_call():
    flock = Flock(
        COUNTS + "go(@1). go(R) -o got(@2, 1), got(@2, 2), got(@2, 3), got(@2, 4).", trace=TraceLevel.NOTES
    ).run()
    assert flock.facts(2) == ["log(@2, [1, 2, 3, 4])"]
    times = [entry["t"] for entry in flock.noted(2, "received")]
    # 402 firings each: with those of the second, more than 500 rules have fired in this call. The next one comes with
    # what the radio tells of the acknowledgements.
    assert times == [0.005, 0.005, 0.01, 0.01]
    assert flock.node(2).machine.firings == 4 * 402


def test_a_delivery_waits_for_rules_that_need_several_calls_to_become_quiet():
    flock = Flock(
        COUNTS.replace("400", "2000") + "go(@1). go(R) -o got(@2, 1), got(@2, 2).", trace=TraceLevel.NOTES
    ).run()
    assert flock.facts(2) == ["log(@2, [1, 2])"]
    first, second = [entry["t"] for entry in flock.noted(2, "received")]
    assert first == 0.005
    assert second == round(3 / TICK_HZ, 6), "2002 firings are five batches, one of them at 0.01 s"


SPINNING = LATEST_FIRST + "spin(@2). spin(R) -o spin(R). go(@1). go(R) -o got(@2, 1), got(@2, 2)."


def test_in_a_robot_that_never_becomes_quiet_deliveries_take_effect_all_the_same():
    flock = Flock(SPINNING, trace=TraceLevel.NOTES)
    flock.wait((RESTLESS_CALLS - 3) / TICK_HZ)
    assert flock.noted(2, "received") == []
    assert flock.node(2).outstanding[:2] == ("a satisfied rule", "a delivery that has arrived")
    assert flock.node(2).messenger.exchange.unsettled == 2
    flock.wait(2)
    assert [entry["source"] for entry in flock.noted(2, "received")] == [1, 1]
    tell(flock, 2, fact(flock, "got", 3), source=1)
    now = flock.kernel.now
    flock.wait(now / NS_PER_S + 0.001)
    assert len(flock.noted(2, "received")) == 3, "from then on they wait for nothing"
    assert FIRING_BUDGET * RESTLESS_CALLS == 30_000, "docs/language.md says it"


def test_what_waits_is_taken_over_by_a_new_program():
    flock = Flock(SPINNING)
    flock.wait(0.1)
    node = flock.node(2)
    assert node.messenger.waiting
    new = compile_source("type other(robot). " + LATEST_FIRST, "new.rmr").program
    assert new is not None
    node.change_program(flock.kernel.now, new, 8)
    flock.wait(0.2)
    assert node.machine.facts() == ["log(@2, [1, 2])"]
    assert not node.messenger.waiting


def test_more_than_may_wait_are_not_acknowledged_and_come_again():
    flock = Flock(LATEST_FIRST).run()
    node = flock.node(1)
    exchange = node.messenger.exchange
    exchange.arrivals = [Arrival(2, 0, 0, b"", False)] * WAITING_MAX
    body = payloads.encode_delivery(fact(flock, "got", 1), {})
    (payload,) = payloads.encode_fact_frames(node.state.digest, 0, 0, body)
    frame = Received(payload, 2, True, -50.0, 255, 0)
    node.messenger.receive(flock.kernel.now, frame)
    assert (exchange.delivered, exchange.outbox, len(exchange.arrivals)) == (0, [], WAITING_MAX)
    exchange.arrivals = []
    node.messenger.receive(flock.kernel.now, frame)
    assert (exchange.delivered, len(exchange.outbox), len(exchange.arrivals)) == (1, 1, 1)
    node.tick(flock.kernel.now + milliseconds(1))
    assert node.machine.facts() == ["log(@1, [1])"]


def test_a_delivery_waits_for_rules_whose_ranks_are_still_searched_for(monkeypatch):
    monkeypatch.setattr(ranks, "RANKING_STEPS", 3)
    doors = "".join(f"door(@2, {a}, {a + 1}). door(@2, {a + 1}, {a}).\n" for a in range(12))
    flock = Flock(
        LOG
        + doors
        + """
        type location(robot, int).
        type !door(robot, int, int).
        location(@2, 0).
        location(R, A), door(R, A, B), ?location(R, _) -o location(R, B).
        go(@1). go(R) -o ?location(@2, 12), got(@2, 1).
        $location(R, A), got(R, _), log(R, L) -o log(R, L + [A]).
        """,
        trace=TraceLevel.NOTES,
    ).run()
    first, second = [entry["t"] for entry in flock.noted(2, "received")]
    assert first < second
    assert "log(@2, [12])" in flock.facts(2)

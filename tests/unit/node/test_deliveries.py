"""What robots ask of each other comes about once, and what cannot come about leaves nobody waiting."""

from functools import cache
from random import Random

import pytest
from flock import Flock, losing
from hypothesis import given, settings
from hypothesis import strategies as st

from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.node import payloads
from rmr.node.logic.exchange import TIME_TO_LIVE, Outcome
from rmr.node.logic.inbound import UNORDERED
from rmr.node.payloads import Delivery, DeliveryRole, PayloadKind
from rmr.node.ports import Received

ERRAND = """
    type action fetch(R: robot, B: robot) -o has(R, B) else lost(R).
    type action tidy(robot).
    go(@1, {executor}).
    go(R, B) -o fetch(B, R) then done(R) then told(B).
"""

PING = """
    type action warn(robot).
    type action think(X: robot, R: robot) -o pong(X, R).
    type ask(robot, robot).
    echo: watch(ping(R, B), pong(B, R), {within}, warn(R)).
    ping(R, B), ask(R, B) -o think(B, R).
"""


def errand(executor: str = "@2", **options: object) -> Flock:
    return Flock(ERRAND.format(executor=executor), **options)  # type: ignore[arg-type]


def tell(flock: Flock, robot: int, delivery: Delivery, source: int, sequence: int = UNORDERED + 900) -> None:
    """Let `robot` hear a delivery as if `source` had sent it."""
    node = flock.node(robot)
    body = payloads.encode_delivery(delivery, {})
    for payload in payloads.encode_fact_frames(node.state.digest, 0, sequence, body):
        node.messenger.receive(flock.kernel.now, Received(payload, source, True, -50.0, 255, flock.kernel.now))
    flock.robots[robot].alarm.set(flock.kernel.now)
    flock.busy[robot] = True


def test_a_step_waits_for_the_end_of_another_robots_action():
    flock = errand(action_s=1.0)
    flock.wait(0.9)
    assert flock.facts(1) == []
    flock.run()
    assert flock.facts(1) == ["done(@1)"]
    assert flock.facts(2) == ["has(@2, @1)", "told(@2)"]
    assert 1.0 < flock.now_s < 1.1


def test_an_action_that_fails_at_its_executor_has_its_else_effect_there_and_ends_the_chain():
    flock = errand(failing=["fetch"]).run()
    assert flock.facts(1) == []
    assert flock.facts(2) == ["lost(@2)"]


def test_a_chain_ends_at_once_at_an_executor_that_does_not_exist():
    flock = errand("@9").run()
    assert flock.facts(1) == []
    assert flock.now_s < 0.1
    (entry,) = flock.noted(1, "undelivered")
    assert (entry["fact"], entry["why"]) == ("fetch(@9, @1)", "no such robot")


def test_a_chain_ends_when_its_action_has_outlived_its_time_and_not_before():
    flock = errand(passes=lambda *_: False)
    flock.wait(29)
    assert flock.node(1).outstanding == ("a fact under way",)
    flock.run()
    assert flock.kernel.now >= TIME_TO_LIVE
    assert flock.facts(1) == []
    assert flock.node(1).messenger.deliveries.undelivered == 1
    assert not flock.node(1).machine.complete(flock.kernel.now, 1, True), "nobody waits for the action any more"


@given(st.integers(0, 10**6), st.floats(0, 0.4))
@settings(max_examples=30, deadline=None)
def test_a_chain_goes_through_once_whatever_the_radio_loses(seed, loss):
    flock = errand(action_s=0.2, passes=losing(Random(seed), loss)).run(100)
    assert flock.facts(1) == ["done(@1)"]
    assert flock.facts(2) == ["has(@2, @1)", "told(@2)"]


def test_an_action_that_does_not_fit_is_refused_and_its_sender_told():
    flock = errand().run()
    fetch = flock.program.index("fetch")
    assert fetch is not None
    tell(flock, 2, Delivery(DeliveryRole.ACTION, fetch, (3,), 77), source=1)
    heard = []
    flock.passes = lambda now, source, destination, payload: heard.append(payload) is None
    flock.run()
    frames = [payloads.decode_fact_frame(payload) for payload in heard if payload[0] == PayloadKind.FACT]
    told = [payloads.decode_delivery(frame.piece, ()) for frame in frames]
    assert told == [Delivery(DeliveryRole.FAILED, fetch, (), 77)]
    assert flock.node(2).messenger.malformed == 1


def test_an_action_that_nobody_waits_for_is_not_reported():
    flock = Flock("type action fetch(robot). go(@1, @2). go(R, B) -o fetch(B).").run()
    assert [entry["fact"] for entry in flock.noted(1, "sent") + flock.noted(2, "sent")] == ["fetch(@2)"]


@pytest.mark.parametrize("source", [1, 3])
def test_nobody_but_the_executor_ends_an_action(source):
    flock = errand(robots=3, action_s=5.0)
    flock.wait(1)
    fetch = flock.program.index("fetch")
    assert fetch is not None
    tell(flock, 1, Delivery(DeliveryRole.COMPLETED, fetch, (), 1), source)
    flock.wait(2)
    assert flock.facts(1) == []
    tell(flock, 1, Delivery(DeliveryRole.COMPLETED, fetch, (), 1), source=2)
    flock.wait(3)
    assert flock.facts(1) == ["done(@1)"]


def test_a_report_for_an_earlier_life_of_the_robot_ends_nothing():
    flock = errand(action_s=5.0, epoch=1)
    flock.wait(1)
    fetch = flock.program.index("fetch")
    assert fetch is not None
    tell(flock, 1, Delivery(DeliveryRole.COMPLETED, fetch, (), 1), source=2)
    flock.wait(2)
    assert flock.facts(1) == []
    flock.run()
    assert flock.facts(1) == ["done(@1)"]


@pytest.mark.parametrize(
    "delivery",
    [
        Delivery(DeliveryRole.FACT, 999, ()),
        Delivery(DeliveryRole.FACT, 0, (1, 2, 3)),
        Delivery(DeliveryRole.GOAL, 999, ()),
        Delivery(DeliveryRole.ACTION, 999, (), 5),
        Delivery(DeliveryRole.ACTION, 0, ("x",), 5),
        Delivery(DeliveryRole.COMPLETED, 999, (), 1),
        Delivery(DeliveryRole.FINISH_AWAITED, 999, (), 0),
        Delivery(DeliveryRole.FINISH_AWAITED, 0, ("x",), 0),
        Delivery(DeliveryRole.FINISH_SEEN, 999, (), 0),
        Delivery(DeliveryRole.FINISH_SEEN, 0, ("x", 1), 0),
    ],
)
def test_a_delivery_that_no_robot_of_the_program_sends_is_counted_and_dropped(delivery):
    flock = Flock(PING.format(within=1))
    flock.run()
    before = flock.facts(1)
    tell(flock, 1, delivery, source=2)
    flock.run()
    assert flock.node(1).messenger.malformed == 1
    assert len(flock.noted(1, "malformed")) == 1
    assert flock.facts(1) == before


@cache
def garbaged() -> Flock:
    return Flock(PING.format(within=1))


@given(st.binary(max_size=60))
@settings(deadline=None)
def test_garbage_in_a_delivery_is_counted_and_dropped(octets):
    node = garbaged().node(1)
    before = (node.messenger.malformed, node.messenger.exchange.delivered)
    sequence = node.messenger.exchange.delivered & 0xFFFF
    for payload in payloads.encode_fact_frames(node.state.digest, 0, sequence, octets):
        node.messenger.receive(0, Received(payload, 2, True, -50.0, 255, 0))
    while node.messenger.waiting:
        node.messenger.take_up(0)
    assert node.messenger.exchange.delivered == before[1] + 1
    assert node.messenger.malformed in (before[0], before[0] + 1)


# -- what comes back


def test_what_cannot_be_delivered_comes_back_as_a_fact_that_names_it():
    flock = Flock(
        """
        type undelivered(robot, robot, message).
        type action fetch(robot).
        go(@1, @2). go(@1, @9).
        go(R, B) -o hello(B), ?hello(B), fetch(B).
        """,
        passes=lambda *_: False,
    ).run()
    lost = [f"undelivered(@1, @{robot}, {name})" for robot in (2, 9) for name in ("fetch", "hello", "hello")]
    assert flock.facts(1) == lost
    assert flock.node(1).messenger.deliveries.undelivered == 6


def test_a_program_may_leave_out_what_was_not_delivered():
    flock = Flock("type undelivered(robot, robot). go(@1, @9). go(R, B) -o hello(B).").run()
    assert flock.facts(1) == ["undelivered(@1, @9)"]


def test_a_predicate_of_the_programs_own_that_bears_the_name_is_left_alone():
    flock = Flock("type undelivered(robot, int). go(@1, @9). go(R, B) -o hello(B).").run()
    assert flock.facts(1) == []
    assert len(flock.noted(1, "undelivered")) == 1


# -- assertions across robots


def test_a_job_ends_with_another_robots_fact_as_of_its_insertion():
    flock = Flock(PING.format(within=3), action_s=1.0)
    flock.insert(1, "ask", Robot(2))
    flock.insert(1, "ping", Robot(2))
    flock.run()
    (job,) = flock.node(1).machine.jobs
    assert (job.finish, job.missed, job.cause) == (seconds(1.005), False, None)
    assert flock.noted(1, "action") == []


def test_a_job_whose_fact_never_comes_is_missed_for_want_of_it():
    flock = Flock(PING.format(within=3))
    flock.insert(1, "ping", Robot(2))
    flock.run()
    (job,) = flock.node(1).machine.jobs
    assert (job.finish, job.missed, job.cause) == (None, True, "local")
    assert [entry["action"] for entry in flock.noted(1, "action")] == ["warn(@1)"]
    assert flock.noted(1, "action")[0]["t"] == 3.0


def test_a_job_whose_news_comes_late_is_missed_by_the_networks_fault():
    flock = Flock(PING.format(within=3), action_s=1.0)
    flock.passes = lambda now, source, *_: source == 1 or not seconds(0.5) < now < seconds(6)
    flock.insert(1, "ask", Robot(2))
    flock.insert(1, "ping", Robot(2))
    flock.run()
    (job,) = flock.node(1).machine.jobs
    assert (job.finish, job.missed, job.cause) == (seconds(1.005), True, "network")
    assert [entry["action"] for entry in flock.noted(1, "action")] == ["warn(@1)"], "once, on time"


def test_a_fact_that_comes_before_the_request_for_it_counts():
    flock = Flock(PING.format(within=3))
    flock.passes = lambda now, source, *_: source == 2 or now > seconds(1)
    flock.insert(1, "ping", Robot(2))
    flock.wait(0.5)
    flock.insert(2, "pong", Robot(1))
    flock.run()
    (job,) = flock.node(1).machine.jobs
    assert (job.finish, job.missed) == (seconds(0.5), False)


# -- what an exchange tells


def test_every_outcome_of_a_delivery_is_noted():
    flock = Flock("go(@1, @2). go(R, B) -o hello(B).", passes=lambda now, *_: now > seconds(0.1)).run()
    assert [entry["fact"] for entry in flock.noted(1, "sent")] == ["hello(@2)"]
    assert [entry["fact"] for entry in flock.noted(1, "repeated")] == ["hello(@2)"]
    assert [entry["fact"] for entry in flock.noted(1, "delivered")] == ["hello(@2)"]
    assert [entry["fact"] for entry in flock.noted(2, "received")] == ["hello(@2)"]
    assert {outcome.value for outcome in Outcome} == {"delivered", "repeated", "undelivered", "outlived"}

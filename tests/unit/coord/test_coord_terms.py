"""Term counters are serial numbers: no counter is the last one, and a forged frame disturbs a group briefly."""

import pytest
from coord_harness import EVENT, MS, Model, ms

from rmr.coord.messages import Sched, encode
from rmr.coord.states import Role
from rmr.coord.term import COUNTER_MAX, NOBODY, Term, successor

STRANGER = 0x1234
RECOVERY = ms(2500)
"""Suspicion, the spread of the questions and the election."""


def waiting_group(seed: int = 1) -> Model:
    """Return a group whose leader has given slots that are far ahead."""
    model = Model(seed, 4)
    for robot in model.ids:
        model.trigger(ms(5 * robot), robot, deadline=ms(60_000 + robot), release=ms(20_000))
    model.run(ms(1500))
    assert model.all_slotted()
    return model


def forged(term: Term, now: int) -> bytes:
    return encode(Sched(EVENT, now - now % MS, term, False, NOBODY, 0, 0, 0, 1, ()))


@pytest.mark.parametrize("leader", [2, STRANGER])
@pytest.mark.parametrize("counter", [1, 2, 300, 32_767, 32_768, 32_769, COUNTER_MAX - 1, COUNTER_MAX])
def test_forged_schedule_of_any_term_costs_a_group_at_most_one_takeover(counter: int, leader: int) -> None:
    model = waiting_group()
    model.forge(ms(2000), STRANGER, lambda now: forged(Term(counter, leader), now))
    model.run(ms(2000) + RECOVERY)
    for _ in range(40):
        model.run(model.now + ms(100))
        assert len(model.leaders()) == 1
        assert model.all_slotted()
    assert model.run_until(model.all_served, ms(60_000))
    assert model.violations == []


def test_a_forged_schedule_that_only_some_hear_leaves_one_leader() -> None:
    for counter in (32_767, 32_768, COUNTER_MAX):
        model = waiting_group()
        octets = forged(Term(counter, STRANGER), ms(2000))
        model.at(ms(2000), lambda octets=octets, model=model: model._arrive(3, octets, STRANGER))  # type: ignore[misc]
        model.run(ms(2000) + RECOVERY)
        assert len(model.leaders()) == 1
        assert model.run_until(model.all_served, ms(60_000))
        assert model.violations == []


def test_the_term_after_the_last_counter_is_the_first_one_and_better() -> None:
    model = Model(3, 3)
    for robot in model.ids:
        model.minds[robot].core._group(EVENT).context.hear_of(COUNTER_MAX - 1)
        model.trigger(ms(robot), robot, deadline=ms(60_000 + robot), release=ms(12_000))
    model.run(ms(1000))
    (leader,) = model.leaders()
    assert (COUNTER_MAX, leader) in model.senders
    model.crash(ms(1100), leader)
    model.run(ms(5000))
    (heir,) = model.leaders()
    assert (successor(COUNTER_MAX), heir) in model.senders
    assert model.run_until(model.all_served, ms(60_000))
    assert model.violations == []


def test_a_restarted_leader_that_hears_its_old_term_after_the_wrap_has_lost_its_memory() -> None:
    model = Model(4, 2)
    context = model.minds[1].core._group(EVENT).context
    model.trigger(ms(500), 1, deadline=ms(9000))
    model.run(ms(501))
    model.minds[1].core.receive(model.now, forged(Term(40_000, 1), model.now), 2)
    assert context.led == Term(40_000, 1)
    assert context.role is Role.CANDIDATE
    assert context.timers[2] >= model.now + ms(900)  # it asks when the lease has run out

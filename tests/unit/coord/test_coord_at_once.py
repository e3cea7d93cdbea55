"""Slots at once: a robot that nobody else can be in the way of enters without waiting and without a claim."""

from random import Random
from statistics import median

import pytest
from coord_harness import EVENT, MS, Model, ms

from rmr.coord.coordination import Coordination, JobRequest
from rmr.coord.messages import Job, encode
from rmr.coord.term import NOBODY, Term
from rmr.coord.timing import Timing

pytestmark = pytest.mark.medium

TICK_MS = 16


def started(count: int, asking: int, seed: int) -> float:
    """Return milliseconds from the first of `asking` triggers to the first entry, in a roster of `count`."""
    model = Model(seed, count)
    rng = Random(seed)
    for robot in model.ids[:asking]:
        model.trigger(ms(100 + rng.uniform(0, 20)), robot, deadline=ms(60_000), duration=ms(500))
    assert model.run_until(lambda: bool(model.entries), ms(5000))
    return (model.now - ms(100)) / MS


def test_lone_robot_starts_within_a_few_ticks_of_its_trigger() -> None:
    assert max(started(1, 1, seed) for seed in range(10)) <= 20 + 3 * TICK_MS


def test_of_two_simultaneous_candidates_the_leader_enters_without_a_claim() -> None:
    times = [started(2, 2, seed) for seed in range(20)]
    assert median(times) < 200


@pytest.mark.parametrize("count", [2, 3, 6])
@pytest.mark.parametrize("loss", [0.3, 0.6])
def test_entries_without_a_claim_are_exclusive_under_loss(count: int, loss: float) -> None:
    for seed in range(12):
        model = Model(seed, count)
        model.air.loss = loss
        rng = Random(seed)
        for robot in model.ids:
            model.trigger(
                ms(rng.uniform(0, 30)), robot, deadline=ms(60_000), duration=ms(900), direction=rng.choice((0, 1, 15))
            )
        model.run(ms(6000))
        model.air.loss = 0.0
        assert model.run_until(model.all_served, ms(90_000))
        assert model.violations == []


def context_of(core: Coordination):  # type: ignore[no-untyped-def]
    return core._group(EVENT).context


def question(time: int, asked: int) -> bytes:
    return encode(Job(EVENT, time, Term(0, NOBODY), asked, ms(9000), time, ms(900), ms(60_000), ms(950), 0, None))


def asking(now: int) -> Coordination:
    core = Coordination(1, Random(1), 1)
    core.trigger(now, JobRequest(EVENT, now, now, ms(900), ms(60_000), ms(950), 0))
    core.wake(now + ms(60))
    return core


def test_stall_ends_entry_without_a_claim() -> None:
    now = ms(10_000)
    core = asking(now)
    core.receive(now + ms(70), question(now + ms(65), now + ms(65)), 2)
    context = context_of(core)
    assert context.undisputed(now + ms(80))
    core.wake(now + ms(400))
    assert not context.undisputed(now + ms(401))


def test_an_old_duplicate_of_a_question_does_not_count_as_asking() -> None:
    now = ms(10_000)
    core = asking(now)
    core.receive(now + ms(70), question(now - ms(3000), now - ms(3000)), 2)
    assert context_of(core).candidates == {}
    assert not context_of(core).undisputed(now + ms(80))


def test_a_robot_that_has_heard_another_one_is_not_alone_though_the_roster_says_so() -> None:
    core = Coordination(1, Random(1), 0)
    assert context_of(core).alone
    core.receive(ms(10), question(ms(5), ms(5)), 2)
    assert not context_of(core).alone
    assert context_of(core).quiet(ms(20)) == Timing().claim.quiet

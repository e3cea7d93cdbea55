"""Silence inside: what a robot has announced stands until its end, and its presumed end is not final."""

import pytest
from coord_harness import EVENT, MS, Model, ms

from rmr.coord.messages import Beacon, Entry, Phase, Sched, decode, encode
from rmr.coord.term import NOBODY, Term


def stalled(seed: int, duration: float, stall: float) -> Model:
    """Return a model in which robot 1 stalls inside and robot 2 wants to go the other way; 3 leads."""
    model = Model(seed, 3)
    model.trigger(0, 3, deadline=ms(300_000), release=ms(150_000), direction=0)
    model.trigger(ms(1500), 1, deadline=ms(60_000), duration=ms(duration), direction=0)
    model.run_until(lambda: bool(model.entries), ms(10_000))
    model.stall(model.now + ms(700), 1, ms(stall))
    model.trigger(model.now + ms(300), 2, deadline=ms(90_000), duration=ms(1000), direction=1)
    return model


@pytest.mark.parametrize("seed", range(20))
def test_entry_against_a_silent_robot_is_barred_until_its_announced_end(seed: int) -> None:
    model = stalled(seed, 20_000, 12_000)
    assert model.run_until(lambda: len(model.entries) == 2, ms(90_000))
    first, second = model.entries
    assert second.start >= first.end
    assert not second.cautious
    assert model.violations == model.excused == []


@pytest.mark.parametrize("seed", range(5))
def test_after_its_announced_end_a_silent_robot_is_passed_with_caution_only(seed: int) -> None:
    model = stalled(seed, 3000, 40_000)
    assert model.run_until(lambda: len(model.entries) == 2, ms(90_000))
    first, second = model.entries
    assert second.start < first.end
    assert second.start - first.start >= ms(10_000)
    assert second.cautious
    assert model.violations == []


def test_a_robot_that_was_presumed_gone_and_speaks_again_keeps_others_out() -> None:
    model = stalled(1, 3000, 14_000)
    model.minds[1].overrun = ms(0)
    model.run_until(lambda: len(model.entries) == 2, ms(90_000))
    first = model.entries[0]
    model.minds[1].leaves = first.end = first.end + ms(15_000)  # its body moves on slowly
    model.minds[1].core.inside_until(model.now, EVENT, first.end)
    model.trigger(first.end - ms(12_000), 2, deadline=first.end + ms(60_000), duration=ms(1000), direction=1)
    assert model.run_until(lambda: len(model.entries) == 3, ms(120_000))
    third = model.entries[2]
    assert third.start >= first.end
    assert not third.cautious


def test_presumed_end_is_listed_as_gone_and_keeps_every_beacon_in_the_fence() -> None:
    model = stalled(3, 3000, 40_000)
    phases: list[Phase] = []
    transmit = model._transmit

    def look(mind, item):  # type: ignore[no-untyped-def]
        message = decode(item.payload)
        if isinstance(message, Sched):
            phases.extend(entry.phase for entry in message.entries if entry.robot == 1)
        transmit(mind, item)

    model._transmit = look  # type: ignore[method-assign]
    assert model.run_until(lambda: len(model.entries) == 2, ms(90_000))
    assert Phase.GONE in phases
    assert Phase.OUT not in phases
    assert 1 in model.minds[2].core._groups[EVENT].context.fence.records


def test_newcomer_that_knows_a_silent_robot_from_the_schedule_only_enters_with_caution() -> None:
    model = stalled(4, 3000, 60_000)
    mind = model.minds[2]
    model.run(model.now + ms(14_000))
    if not model.entries[1:]:
        model.run_until(lambda: len(model.entries) == 2, ms(90_000))
    model.crash(model.now + ms(3000), 2)
    model.restart(model.now + ms(3100), 2)
    model.trigger(model.now + ms(3200), 2, deadline=ms(200_000), duration=ms(1000), direction=1)
    assert model.run_until(lambda: len(model.entries) == 3, ms(90_000))
    assert mind.alive
    assert model.entries[2].cautious


def test_a_robot_whose_presumed_end_is_listed_confirms_it() -> None:
    model = Model(5, 2)
    model.trigger(0, 1, deadline=ms(9000), duration=ms(600))
    assert model.run_until(lambda: bool(model.entries) and model.all_served(), ms(9000))
    core = model.minds[1].core
    core.drain()
    trigger = model.entries[0].trigger - model.entries[0].trigger % ms(10)
    entry = Entry(1, trigger, ms(700), ms(600), 0, Phase.GONE)
    now = model.now + ms(5000)
    core.receive(now, encode(Sched(EVENT, now - now % MS, Term(9, 2), False, NOBODY, 0, 0, 0, 1, (entry,))), 2)
    said = [decode(item.payload) for item in core.drain() if hasattr(item, "payload")]
    assert [(m.who, m.phase) for m in said if isinstance(m, Beacon)] == [(1, Phase.OUT)]

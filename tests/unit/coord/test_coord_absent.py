"""Jobs that are not ready for their slots: behind those that stand ready, with back-off, never for ever."""

from itertools import pairwise

import pytest
from coord_harness import EVENT, MS, Model, ms

from rmr.coord import events
from rmr.coord.timing import Timing

pytestmark = pytest.mark.medium

TIMING = Timing()


class Absentees(Model):
    """A group of which some robots are never ready by themselves."""

    def __init__(self, seed: int, count: int, absent: set[int]) -> None:
        super().__init__(seed, count)
        self.absent = absent

    def _set_ready(self, mind, request):  # type: ignore[no-untyped-def]
        if mind.robot not in self.absent:
            super()._set_ready(mind, request)

    def missed(self, robot: int) -> list[int]:
        """Return when `robot` let slots pass."""
        return [at for at, event in self.minds[robot].log if isinstance(event, events.EntryMissed)]


def keep_coming(model: Model, robot: int) -> None:
    """Let a new job of `robot`, which is on time, start as soon as the one before is done."""
    if model.minds[robot].job is None:
        model.trigger(model.now, robot, deadline=model.now + ms(3000), duration=ms(600), direction=15)
    model.at(model.now + ms(50), lambda: keep_coming(model, robot))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("absent", [1, 3, 5])
def test_ready_job_is_not_starved_by_absent_jobs_of_earlier_deadline(seed: int, absent: int) -> None:
    model = Absentees(seed, absent + 1, set(range(1, absent + 1)))
    for robot in range(1, absent + 1):
        model.trigger(ms(robot), robot, deadline=ms(8000 + robot), duration=ms(1000), direction=15)
    ready = absent + 1
    model.trigger(ms(100), ready, deadline=ms(90_000), duration=ms(1000), direction=15)
    assert model.run_until(lambda: bool(model.entries), ms(60_000))
    # Each absent job may waste the one slot that it had before the leader knew better.
    assert model.now < ms(2500 + 2000 * absent)
    assert all(len(model.missed(robot)) <= 2 for robot in model.absent)


def test_back_off_of_an_absent_job_doubles_up_to_its_bound() -> None:
    model = Absentees(2, 2, {1})
    model.trigger(0, 1, deadline=ms(8000), duration=ms(1000), direction=15)
    model.run(ms(90_000))
    gaps = [(b - a) / MS for a, b in pairwise(model.missed(1))]
    assert all(later > sooner - 60 for sooner, later in pairwise(gaps))
    assert gaps[0] >= TIMING.schedule.absent_wait / MS
    longest = TIMING.schedule.absent_wait_max / MS
    assert all(longest <= gap <= longest + 400 for gap in gaps[4:])
    assert len(gaps) >= 10


def test_absent_job_gets_a_slot_soon_after_it_becomes_ready_regardless_of_back_off() -> None:
    model = Absentees(3, 3, {1})
    model.trigger(0, 1, deadline=ms(8000), duration=ms(1000), direction=15)
    model.run(ms(40_000))
    assert len(model.missed(1)) >= 4
    model.minds[1].core.ready(model.now, EVENT, True)
    model.settle(model.minds[1])
    assert model.run_until(lambda: bool(model.entries), ms(60_000))
    assert model.now <= ms(40_000 + 1000)
    assert model.entries[0].robot == 1


def test_job_that_became_ready_is_ordered_by_deadline_again() -> None:
    model = Absentees(4, 4, {1})
    model.trigger(0, 1, deadline=ms(30_000), duration=ms(2000), direction=15)
    for robot in (2, 3, 4):
        model.trigger(ms(4000), robot, deadline=ms(60_000 + robot), duration=ms(2000), direction=15)
    model.run(ms(5000))
    model.minds[1].core.ready(model.now, EVENT, True)
    model.settle(model.minds[1])
    assert model.run_until(model.all_served, ms(60_000))
    assert model.order()[:2] == [2, 1]  # 2 had its slot already
    assert model.violations == []


@pytest.mark.parametrize("seed", range(3))
def test_absent_job_is_overtaken_by_a_bounded_number_of_passages_between_two_slots(seed: int) -> None:
    model = Absentees(seed, 4, {1})
    model.trigger(0, 1, deadline=ms(5000), duration=ms(600), direction=15)
    for robot in (2, 3, 4):
        keep_coming(model, robot)
    model.run(ms(150_000))
    slots = [0, *model.missed(1)]
    overtaken = [sum(a < entry.start <= b for entry in model.entries) for a, b in pairwise(slots)]
    assert len(slots) >= 5
    assert max(overtaken) <= TIMING.schedule.absent_passes_max + 3  # and those whose slots stand already
    assert len(model.entries) > 80
    assert model.violations == []


def test_ready_job_that_is_late_is_overtaken_by_a_bounded_number_of_later_jobs() -> None:
    model = Absentees(1, 4, set())
    for robot in (2, 3, 4):
        keep_coming(model, robot)
    model.trigger(ms(2000), 1, deadline=ms(2100), duration=ms(600), direction=15)
    assert model.run_until(lambda: 1 in model.order(), ms(120_000))
    assert len(model.entries) <= TIMING.schedule.bypass_max + 8
    assert model.violations == []


def test_miss_of_a_ready_robot_is_no_absence() -> None:
    model = Model(6, 2)
    model.trigger(0, 1, deadline=ms(5000), duration=ms(3000), direction=0)
    model.trigger(ms(5), 2, deadline=ms(9000), duration=ms(3000), direction=1)
    model.minds[1].overrun = ms(1500)  # holds up the other one beyond its window
    model.run(ms(100))
    assert model.run_until(model.all_served, ms(60_000))
    missed = [e for _, e in model.minds[2].log if isinstance(e, events.EntryMissed)]
    assert model.order() == [1, 2]
    assert len(missed) <= 2

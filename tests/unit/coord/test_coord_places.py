"""Places: where several robots may be inside, never more than that are, and all places are used."""

from itertools import permutations
from random import Random

import pytest
from coord_campaign import run_places
from coord_harness import EVENT, Air, Model, ms

from rmr.base.direction import EXCLUSIVE
from rmr.coord import events
from rmr.coord.fence import Claim, Fence
from rmr.coord.messages import Beacon, Phase
from rmr.coord.schedule import Placed, Rules, Task, by_arrival, on_time, order_jobs, place
from rmr.coord.term import Term
from rmr.coord.timing import Timing


def fleet(robots: int, places: int, *, air: Air | None = None, seed: int = 1) -> Model:
    """Return a model whose robots all want in at once, for 3 s each."""
    model = Model(seed, robots, air, capacity=places)
    for robot in model.ids:
        model.trigger(ms(5 * robot), robot, deadline=ms(60_000))
    model.run(ms(50))
    return model


def most_inside(model: Model) -> int:
    return max(sum(other.start <= one.start < other.end for other in model.entries) for one in model.entries)


@pytest.mark.parametrize("places", [2, 3, 5])
def test_all_places_are_used_and_no_more_than_there_are(places: int) -> None:
    model = fleet(6, places)
    assert model.run_until(model.all_served, ms(60_000))
    assert most_inside(model) == places
    assert model.violations == model.excused == []
    rounds = -(-6 // places)
    assert max(entry.end for entry in model.entries) < ms(1000 + rounds * 3500)


@pytest.mark.parametrize("seed", range(4))
def test_places_hold_while_half_of_all_frames_are_lost(seed: int) -> None:
    model = fleet(5, 2, air=Air(loss=0.5), seed=seed)
    assert model.run_until(model.all_served, ms(120_000))
    assert model.violations == []
    assert most_inside(model) <= 2


@pytest.mark.medium
@pytest.mark.parametrize("block", range(2))
def test_random_runs_keep_the_places(block: int) -> None:
    failed = [outcome for seed in range(8 * block + 1, 8 * block + 9) if not (outcome := run_places(seed)).ok]
    assert failed == []


def test_a_job_that_is_not_ready_loses_its_slots_to_others_and_is_served_when_it_is() -> None:
    model = Model(1, 4, capacity=2)
    model.trigger(0, 1, deadline=ms(20_000))  # due first; the others would wait for it
    model.at(ms(1), lambda: model.minds[1].core.ready(ms(1), EVENT, False))
    for robot in (2, 3, 4):
        model.trigger(ms(5 * robot), robot, deadline=ms(60_000))
    model.at(ms(12_000), lambda: model._set_ready(model.minds[1], model.minds[1].job))
    model.run(ms(50))
    assert model.run_until(model.all_served, ms(40_000))
    assert model.order()[-1] == 1
    missed = [event for _, event in model.minds[1].log if isinstance(event, events.EntryMissed)]
    assert 1 <= len(missed) <= 5, "it backs off"
    first = [entry.start for entry in model.entries if entry.robot != 1]
    assert max(first) < ms(9000), "the others lose next to nothing"


# -- the fence


def beacon(who: int, phase: Phase, *, start: int = 1000, end: int = 9000, at: int = 1000) -> Beacon:
    return Beacon(EVENT, ms(at), Term(1, 9), who, ms(10), phase, EXCLUSIVE, ms(start), ms(end))


def fence(places: int, *beacons: Beacon) -> Fence:
    made = Fence(1, Timing())
    made.capacity = places
    for each in beacons:
        made.note(each)
    return made


CLAIM = Claim(1, ms(1500), ms(4000), ms(3000), EXCLUSIVE)


@pytest.mark.parametrize(
    ("beacons", "listed", "is_open"),
    [
        ([], set(), True),
        ([beacon(2, Phase.IN)], set(), True),
        ([beacon(2, Phase.IN), beacon(3, Phase.IN)], set(), False),
        ([beacon(2, Phase.IN), beacon(3, Phase.OUT)], set(), True),
        ([beacon(2, Phase.IN), beacon(3, Phase.YIELD)], set(), True),
        ([beacon(2, Phase.IN), beacon(3, Phase.CLAIM)], set(), False),
        ([beacon(2, Phase.IN), beacon(3, Phase.CLAIM, start=1500)], set(), False),
        ([beacon(2, Phase.IN)], {2}, True),
        ([beacon(2, Phase.IN)], {3}, False),
        ([], {2, 3}, False),
    ],
)
def test_a_robot_enters_while_fewer_than_the_places_count(
    beacons: list[Beacon], listed: set[int], is_open: bool
) -> None:
    assert fence(2, *beacons).judge_places(ms(1510), CLAIM, listed).open is is_open


def test_of_two_claims_for_the_last_place_the_later_one_yields() -> None:
    earlier, later = beacon(3, Phase.CLAIM, start=1400), beacon(3, Phase.CLAIM, start=1600)
    inside = beacon(2, Phase.IN)
    assert fence(2, inside, earlier).judge_places(ms(1510), CLAIM, set()).lost
    verdict = fence(2, inside, later).judge_places(ms(1510), CLAIM, set())
    assert (verdict.open, verdict.lost) == (False, False)
    assert not fence(3, inside, earlier).judge_places(ms(1510), CLAIM, set()).lost


def test_one_that_has_been_silent_keeps_its_place_while_it_stands_there() -> None:
    made = fence(1, beacon(2, Phase.IN, end=2000))
    late = Claim(1, ms(30_000), ms(33_000), ms(3000), EXCLUSIVE)
    made.capacity = 2
    made.note(beacon(3, Phase.IN, end=2000))
    assert made.judge_places(ms(30_010), late, set()).open
    assert made.judge_places(ms(30_010), late, set()).cautious
    made.stands_inside = lambda _group, robot: robot in (2, 3)
    assert not made.judge_places(ms(30_010), late, set()).open


def test_a_witness_repeats_each_of_several_silent_robots_in_turn() -> None:
    made = fence(3, beacon(2, Phase.IN), beacon(3, Phase.IN))
    claim = beacon(4, Phase.CLAIM, start=2000, at=1900)
    assert [made.unheard(ms(1900), claim) for _ in range(4)] == [2, 3, 2, 3]


# -- the plan


def drawn(rng: Random, count: int) -> list[Task]:
    made = []
    for robot in range(1, count + 1):
        release = ms(10 * rng.randrange(400))
        duration = ms(10 * rng.randrange(50, 400))
        deadline = release + duration + ms(10 * rng.randrange(600))
        made.append(Task(robot, release, duration, deadline, duration, EXCLUSIVE, joined=robot))
    return made


@pytest.mark.parametrize("seed", range(60))
def test_no_more_slots_overlap_than_there_are_places(seed: int) -> None:
    rng = Random(f"places/{seed}")
    rules = Rules(ms(600), ms(280), capacity=rng.randint(2, 4))
    standing = [
        Placed(ms(10 * rng.randrange(100)), ms(10 * rng.randrange(50, 300)), 0, EXCLUSIVE)
        for _ in range(rng.randint(0, rules.capacity))
    ]
    tasks = drawn(rng, rng.randint(1, 9))
    order = order_jobs(tasks, standing, rules)
    assert sorted(task.robot for task in order) == [task.robot for task in tasks]
    starts = place(order, standing, rules)
    spans = [(at, at + task.duration + rules.opposed) for at, task in zip(starts, order, strict=True)]
    spans += [(each.start, each.start + each.duration + rules.opposed) for each in standing]
    for at in starts:
        assert sum(begin <= at < end for begin, end in spans) <= rules.capacity
    assert all(at >= max(rules.floor, task.release) for at, task in zip(starts, order, strict=True))
    arrival = sorted(tasks, key=by_arrival)
    assert len(tasks) > 5 or on_time(order, starts) >= on_time(arrival, place(arrival, standing, rules))


@pytest.mark.parametrize("seed", range(20))
def test_of_few_jobs_as_many_are_on_time_as_in_the_best_order(seed: int) -> None:
    tasks = drawn(Random(f"best/{seed}"), 5)
    rules = Rules(ms(600), ms(280), capacity=2)
    best = max(on_time(order, place(order, [], rules)) for order in permutations(tasks))
    order = order_jobs(tasks, [], rules)
    assert on_time(order, place(order, [], rules)) == best


def test_the_known_order_is_kept_unless_it_costs_a_job_or_a_headway() -> None:
    one, two = (Task(robot, 0, ms(3000), ms(60_000), ms(3000), EXCLUSIVE) for robot in (1, 2))
    assert [task.robot for task in order_jobs([one, two], [], Rules(0, ms(280), capacity=2), [2, 1])] == [2, 1]

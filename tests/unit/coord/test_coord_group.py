"""One group through the public seam: discovery, slots, claims, faults."""

from itertools import pairwise
from random import Random
from statistics import median

import pytest
from coord_campaign import SHORT, run, run_hard, run_wide
from coord_harness import EVENT, MS, Air, Model, ms
from schedule_bruteforce import follows

from rmr.base.grid_path import GridPath
from rmr.coord import events
from rmr.coord.coordination import Coordination, JobRequest
from rmr.coord.events import Send
from rmr.coord.messages import Beacon, Entry, FrameKind, Job, Phase, Sched, decode, encode
from rmr.coord.states import Role
from rmr.coord.term import NOBODY, Term


def fleet(
    seed: int, count: int, air: Air | None = None, *, ways: int = 1, spread: float = 20
) -> tuple[Model, list[int]]:
    """Return a model whose robots trigger within `spread` ms, and the robots in the order of their deadlines."""
    model = Model(seed, count, air)
    rng = Random(seed)
    places = list(range(count))
    rng.shuffle(places)
    for robot in model.ids:
        when = ms(rng.uniform(0, spread))
        model.trigger(when, robot, deadline=ms(20_000 + 4000 * places[robot - 1]), direction=rng.randrange(ways))
    return model, sorted(model.ids, key=lambda robot: places[robot - 1])


def served(model: Model, limit: float = 120_000) -> None:
    """Run until all are served; nothing may have gone wrong."""
    assert model.run_until(lambda: model.now > ms(100) and model.all_served(), ms(limit))
    assert model.violations == []


def test_lone_robot_leads_and_passes_without_delay() -> None:
    model, _ = fleet(1, 1)
    served(model)
    (entry,) = model.entries
    assert entry.rank == 1
    assert entry.start < ms(1200)


@pytest.mark.medium
@pytest.mark.parametrize("count", [2, 3, 6, 10])
def test_robots_triggered_together_get_one_leader_and_slots_by_deadline(count: int) -> None:
    times = []
    for seed in range(6):
        model, by_deadline = fleet(seed, count)
        assert model.run_until(lambda m=model: m.now > ms(21) and m.all_slotted(), ms(2000))
        times.append(model.now / MS)
        assert len(model.leaders()) == 1
        served(model)
        assert model.order() == by_deadline
        assert [entry.rank for entry in model.entries] == list(range(1, count + 1))
    assert median(times) < 200


def test_robots_of_one_direction_follow_at_their_headway() -> None:
    model, by_deadline = fleet(3, 6)
    served(model)
    starts = [entry.start for entry in model.entries]
    gaps = [(b - a) / MS for a, b in pairwise(starts)]
    assert model.order() == by_deadline
    assert all(950 <= gap <= 1000 for gap in gaps)


@pytest.mark.parametrize("seed", range(8))
def test_opposed_robots_never_meet_inside(seed: int) -> None:
    model, _ = fleet(seed, 6, ways=2, spread=3000)
    served(model)
    assert sorted(entry.rank for entry in model.entries) == list(range(1, 7))


def test_where_corridors_meet_robots_of_two_directions_are_inside_together_if_they_share_an_end() -> None:
    together = set()
    for seed in range(12):
        rng = Random(f"{seed}/meet")
        model = Model(seed, 8)
        for robot in model.ids:
            way = rng.choice((2, 3, 5, 6, 8, 9) if seed % 2 else range(2, 14))  # three ends, or four
            model.trigger(
                ms(rng.uniform(0, 3000)), robot, deadline=ms(20_000 + rng.uniform(0, 20_000)), direction=way,
                duration=ms(rng.uniform(2000, 5000)),
            )  # fmt: skip
        served(model)
        together |= {
            (one.direction, other.direction)
            for one in model.entries
            for other in model.entries
            if one.direction < other.direction and one.start < other.end and other.start < one.end
        }
    assert len(together) > 10
    assert all(follows(*pair) for pair in together)


def test_a_late_joiner_with_an_early_deadline_goes_before_those_that_can_wait() -> None:
    model = Model(5, 4)
    for robot in (1, 2, 3):
        model.trigger(ms(robot), robot, deadline=ms(30_000 + robot))
    model.trigger(ms(900), 4, deadline=ms(7000))
    served(model)
    assert model.order().index(4) == 1, "the first slot was frozen, the second was not"
    assert sorted(entry.rank for entry in model.entries) == [1, 2, 3, 4]
    assert [entry.rank for entry in model.entries] == [1, 2, 3, 4]


def test_a_leader_whose_own_job_is_done_leads_on_while_others_wait() -> None:
    model = Model(2, 3)
    model.trigger(0, 1, deadline=ms(5000))
    model.trigger(ms(1500), 2, deadline=ms(30_000), release=ms(9000))
    model.trigger(ms(1510), 3, deadline=ms(40_000), release=ms(9000))
    model.run(ms(8000))
    assert model.leaders() == [1]
    assert model.minds[1].job is None
    served(model)
    assert len(model.senders) == 1
    model.run(model.now + ms(3000))
    assert model.leaders() == []


def test_ranks_go_on_when_a_later_group_forms() -> None:
    model = Model(2, 3)
    model.trigger(0, 1, deadline=ms(9000))
    model.run(ms(10_000))
    assert model.leaders() == []
    model.trigger(ms(10_000), 2, deadline=ms(30_000))
    model.run(ms(20_000))
    model.trigger(ms(20_000), 3, deadline=ms(40_000))
    model.run(ms(20_100))
    served(model)
    assert [(entry.robot, entry.rank) for entry in model.entries] == [(1, 1), (2, 2), (3, 3)]


def test_job_finished_before_its_predecessor_leaves_the_ranks_unchanged() -> None:
    model = Model(4, 4)
    model.minds[1].overrun = ms(4000)
    for robot in model.ids:
        model.trigger(ms(robot), robot, deadline=ms(20_000 + 1000 * robot))
    served(model)
    assert {entry.robot: entry.rank for entry in model.entries} == {1: 1, 2: 2, 3: 3, 4: 4}


@pytest.mark.medium
@pytest.mark.parametrize("lost", range(45))
def test_any_single_frame_may_be_lost(lost: int) -> None:
    seen: list[bytes] = []

    def drop(source: int, target: int, payload: bytes, now: int) -> bool:
        if not seen or seen[-1] is not payload:
            seen.append(payload)
        return len(seen) != lost + 1

    model, by_deadline = fleet(7, 3, Air(filter=drop))
    served(model)
    assert model.order() == by_deadline
    assert [entry.rank for entry in model.entries] == [1, 2, 3]


@pytest.mark.parametrize("kind", list(FrameKind)[:3])
def test_all_frames_of_one_kind_may_be_lost_for_a_while(kind: FrameKind) -> None:
    model, _ = fleet(9, 3, Air(filter=lambda source, target, payload, now: payload[0] != kind or now > ms(3000)))
    served(model)


def test_doubled_and_reordered_frames_change_nothing() -> None:
    for seed in range(4):
        model, by_deadline = fleet(seed, 4, Air(duplicate=0.5, late=0.1, late_max=ms(300)))
        served(model)
        assert sorted(model.order()) == sorted(by_deadline)
        assert len({(e.robot, e.trigger) for e in model.entries}) == len(model.entries)


@pytest.mark.medium
@pytest.mark.parametrize("loss", [0.1, 0.3, 0.5])
def test_all_are_served_under_loss(loss: float) -> None:
    for seed in range(4):
        model, _ = fleet(seed, 5, Air(loss=loss), ways=2)
        served(model)


def test_two_leaders_become_one_when_they_hear_each_other() -> None:
    model, _ = fleet(3, 6)
    model.partition(0, {1: 0, 2: 0, 3: 0, 4: 1, 5: 1, 6: 1})
    model.run(ms(900))
    assert len(model.leaders()) == 2
    model.partition(ms(900), {})
    model.run(ms(2500))
    assert len(model.leaders()) == 1
    served(model)


def test_a_dead_leader_is_replaced_and_all_others_are_served() -> None:
    for seed in range(5):
        model, _ = fleet(seed, 5)
        model.run(ms(700))
        (leader,) = model.leaders()
        model.crash(model.now, leader)
        served(model)
        assert len(model.entries) >= 4


def test_dead_follower_delays_the_group_by_a_bounded_time() -> None:
    model, by_deadline = fleet(4, 4)
    model.run(ms(700))
    victim = next(robot for robot in by_deadline if robot not in model.leaders())
    model.crash(model.now, victim)
    served(model)
    assert max(entry.start for entry in model.entries) < ms(9000)


def test_withdrawing_leader_names_a_successor_that_keeps_the_slots() -> None:
    model = Model(6, 4)
    for robot in model.ids:
        model.trigger(ms(robot), robot, deadline=ms(20_000 + 1000 * robot), release=ms(3000))
    model.run(ms(900))
    (leader,) = model.leaders()
    slots = {r: m.slot.start for r, m in model.minds.items() if m.slot is not None and r != leader}
    model.withdraw(model.now, leader)
    model.run(ms(1100))
    assert len(model.leaders()) == 1
    assert model.leaders() != [leader]
    served(model)
    assert len(model.entries) == 3
    assert all(abs(entry.slot - slots[entry.robot]) <= ms(1000) for entry in model.entries)
    assert len({entry.rank for entry in model.entries}) == 3


def test_a_robot_that_is_not_ready_lets_its_slot_pass_and_gets_another() -> None:
    model = Model(3, 2)
    model.trigger(0, 1, deadline=ms(9000))
    model.trigger(ms(5), 2, deadline=ms(20_000))
    model.at(ms(10), lambda: model.minds[1].core.ready(model.now, EVENT, False))
    model.at(ms(2500), lambda: model.minds[1].core.ready(model.now, EVENT, True))
    served(model)
    assert any(isinstance(event, events.EntryMissed) for _, event in model.minds[1].log)
    assert model.order() == [2, 1]
    assert sorted(entry.rank for entry in model.entries) == [1, 2]


def test_a_stalled_robot_does_not_enter_on_its_old_claim() -> None:
    model, by_deadline = fleet(2, 3)
    model.run(ms(700))
    model.stall(ms(800), by_deadline[0], ms(900))
    served(model)


def test_the_leaders_path_reaches_its_followers() -> None:
    model, _ = fleet(2, 3)
    model.run(ms(700))
    (leader,) = model.leaders()
    path = GridPath((2, 15), tuple([0] * 300 + [7] * 11))
    model.minds[leader].core.offer_path(model.now, EVENT, 0, path)
    model.settle(model.minds[leader])
    model.run(ms(1500))
    for robot in model.ids:
        got = [event.path for _, event in model.minds[robot].log if isinstance(event, events.PathReceived)]
        assert got == ([] if robot == leader else [path])


@pytest.mark.medium
def test_a_group_larger_than_one_frame_is_served_in_order() -> None:
    model, by_deadline = fleet(2, 14)
    served(model)
    assert model.order() == by_deadline
    assert [entry.rank for entry in model.entries] == list(range(1, 15))


@pytest.mark.medium
@pytest.mark.parametrize("block", range(10))
def test_random_faults_break_no_safety_or_liveness_guarantee(block: int) -> None:
    outcomes = [run(seed) for seed in range(20 * block, 20 * block + 20)]
    assert [outcome for outcome in outcomes if not outcome.ok] == []


@pytest.mark.medium
@pytest.mark.parametrize("block", range(3))
def test_random_faults_break_no_guarantee_with_schedules_of_several_frames(block: int) -> None:
    outcomes = [run(seed, SHORT, (6, 12)) for seed in range(6 * block, 6 * block + 6)]
    assert [outcome for outcome in outcomes if not outcome.ok] == []


KEPT = {
    90: "a forged counter of 65535: two leaders stood side by side",
    496: "an old duplicate of a JOB brought a job back that was presumed over; its frozen slot moved",
    534: "a robot inside was listed as OUT after 10 s of silence, which members took as final: two were inside",
    798: "a job that was presumed over stood in the list twice, and its slot moved with each schedule",
    820: "as 534: the link between leader and robot had failed one way",
    1713: "as 90, with a stall of a minute",
    3038: "the winner of two claims entered after 500 ms of silence of a rival that had not yielded",
    10001943: "the checker took an owner that waits under another term for one that holds its slot of the old term",
    10005504: "as 10001943",
    10022695: "as 10001943",
}
"""Seeds of the wide draw that failed, and why."""


@pytest.mark.slow
@pytest.mark.parametrize("block", range(6))
def test_unequal_links_old_duplicates_restart_loops_and_long_stalls_break_no_guarantee(block: int) -> None:
    outcomes = [run_wide(seed) for seed in range(20 * block, 20 * block + 20)]
    assert [outcome for outcome in outcomes if not outcome.ok] == []


@pytest.mark.medium
def test_long_stalls_inside_do_not_end_what_was_announced() -> None:
    """Every run has unequal links, old duplicates, a restart loop and stalls, one or two of them of a robot inside."""
    outcomes = [run_hard(seed) for seed in (*range(20), 10006010)]  # the last: a slot moved when it was just over
    assert [outcome for outcome in outcomes if not outcome.ok] == []
    assert sum(outcome.overlaps["one term, as announced"] for outcome in outcomes) == 0
    assert all({"links", "echo", "loop", "long stall"} <= set(outcome.kinds) for outcome in outcomes)


def test_the_checker_reports_a_frozen_slot_that_moves_and_no_older_version_that_is_sent_later() -> None:
    def sched(issued: float, start: float) -> Sched:
        entries = (Entry(2, 0, ms(start), ms(3000), 0, Phase.WAITING),)
        return Sched(EVENT, ms(issued), Term(1, 1), False, NOBODY, 0, 0, 0, 1, entries)

    model = Model(1, 2)
    for issued, start in ((5000, 5500), (4990, 5400), (5010, 5500)):
        model._check_frozen(sched(issued, start))
    assert model.violations == []
    model._check_frozen(sched(5020, 5600))
    assert model.violations == ["frozen slot of 2 moved at 0.0"]


def test_seeds_of_the_plain_draw_that_once_failed_do_not_fail_again() -> None:
    assert run(10112800).ok, "the checker took an older version that was sent later for a slot that moved"


def test_an_overlap_of_a_robot_beyond_its_estimate_that_nobody_could_hear_is_counted_and_excused() -> None:
    outcome = run(141465)
    assert (outcome.violations, len(outcome.excused)) == ([], 1)
    assert outcome.overlaps == {"one term, beyond its estimate": 1}


@pytest.mark.medium
@pytest.mark.parametrize("seed", KEPT)
def test_seeds_of_the_wide_draw_that_once_failed_do_not_fail_again(seed: int) -> None:
    outcome = run_wide(seed)
    assert outcome.ok, outcome


@pytest.mark.medium
@pytest.mark.parametrize("seed", range(40))
def test_no_two_robots_ever_get_one_rank_without_faults(seed: int) -> None:
    """Late joiners, early finishers, missed slots, a lost OUT and a leader that withdraws included."""
    rng = Random(f"rank{seed}")
    until: dict[tuple[int, int], int] = {}

    def lose_outs(source: int, target: int, payload: bytes, now: int) -> bool:
        message = decode(payload)
        if not isinstance(message, Beacon) or message.phase is not Phase.OUT or seed % 3:
            return True
        return now >= until.setdefault((message.who, message.trigger), now + ms(rng.uniform(50, 1500)))

    model = Model(seed, rng.randint(2, 7), Air(filter=lose_outs))
    for robot in model.ids:
        when = rng.choice((rng.uniform(0, 20), rng.uniform(0, 6000)))
        release = ms(when + rng.choice((0, rng.uniform(0, 4000))))
        direction = rng.randrange(1 + seed % 2)
        model.trigger(
            ms(when), robot, deadline=ms(when + rng.uniform(4000, 30_000)), release=release, direction=direction
        )
        model.minds[robot].overrun = ms(rng.choice((0, rng.uniform(-800, 2500))))
        if rng.random() < 0.15:
            model.unready(ms(when + rng.uniform(0, 2000)), robot, ms(4000))
        elif rng.random() < 0.15:
            model.withdraw(ms(when + rng.uniform(0, 3000)), robot)
    model.run(ms(40_000))
    assert model.all_served()
    assert model.violations == []
    ranks = [entry.rank for entry in model.entries]
    assert len(set(ranks)) == len(ranks)


def request(trigger: int = 0, direction: int = 0) -> JobRequest:
    return JobRequest(EVENT, trigger, trigger, ms(3000), ms(20_000), ms(950), direction)


def test_an_impossible_request_is_refused_with_the_reason() -> None:
    core = Coordination(1, Random(1), 3)
    with pytest.raises(ValueError, match="six octets"):
        core.trigger(0, JobRequest(b"short", 0, 0, 1, 1, 1, 0))
    with pytest.raises(ValueError, match=r"0\.\.15"):
        core.trigger(0, request(direction=16))


def test_frame_of_another_kind_is_refused_and_malformed_coordination_frame_is_counted() -> None:
    core = Coordination(1, Random(1), 3)
    assert not core.receive(0, b"", 2)
    assert not core.receive(0, b"\x10hello", 2)
    assert core.malformed == 0
    assert not core.receive(0, b"\x01hello", 2)
    assert core.malformed == 1


def test_a_frame_from_the_future_is_refused() -> None:
    other = Coordination(2, Random(2), 3)
    other.trigger(ms(60_000), request())
    other.wake(other.next_wake)
    (frame,) = [item.payload for item in other.drain() if isinstance(item, Send)]
    core = Coordination(1, Random(1), 3)
    assert not core.receive(0, frame, 2)
    assert core.malformed == 1
    assert core.receive(ms(60_100), frame, 2)


def test_frames_and_wakes_are_reproducible() -> None:
    def trace() -> list[object]:
        model, _ = fleet(11, 4, Air(loss=0.2), ways=2)
        served(model)
        return [model.minds[robot].log for robot in model.ids]

    assert trace() == trace()


def test_a_revised_release_moves_a_slot_that_is_not_frozen() -> None:
    model = Model(8, 2)
    model.trigger(0, 1, deadline=ms(30_000))
    model.trigger(ms(3), 2, deadline=ms(40_000), release=ms(6000))
    model.run(ms(1500))
    model.minds[2].core.revise(model.now, EVENT, release=ms(8000))
    model.settle(model.minds[2])
    model.run(ms(2000))
    slot = model.minds[2].slot
    assert slot is not None
    assert slot.start >= ms(8000)


def test_revised_later_release_and_deadline_swap_the_slots() -> None:
    model = Model(8, 2)
    model.trigger(0, 1, deadline=ms(30_000), release=ms(5000))
    model.trigger(ms(3), 2, deadline=ms(40_000), release=ms(5000))
    model.run(ms(1500))
    slots = model.minds[1].slot, model.minds[2].slot
    assert slots[0] is not None
    assert slots[1] is not None
    assert slots[0].start < slots[1].start
    model.minds[1].core.revise(model.now, EVENT, release=ms(9000), deadline=ms(1500))
    model.settle(model.minds[1])
    model.run(ms(2500))
    slots = model.minds[1].slot, model.minds[2].slot
    assert slots[0] is not None
    assert slots[1] is not None
    assert slots[1].start < slots[0].start


def test_a_job_triggered_while_inside_begins_after_leaving() -> None:
    model = Model(8, 1)
    model.trigger(0, 1, deadline=ms(9000))
    model.run(ms(2000))
    core = model.minds[1].core
    assert model.minds[1].inside is not None
    core.trigger(model.now, request(trigger=model.now))
    model.run(ms(3900))
    core.leave(model.now, EVENT)
    model.minds[1].inside = None
    model.settle(model.minds[1])
    model.run(ms(4500))
    slots = [e for _, e in model.minds[1].log if isinstance(e, events.SlotAssigned)]
    assert slots[-1].trigger == ms(2000)
    assert slots[-1].rank == 2


def test_a_robot_without_a_job_remembers_who_is_inside() -> None:
    model = Model(4, 2)
    model.trigger(0, 1, deadline=ms(9000))
    model.run(ms(1500))
    assert model.minds[1].inside is not None
    model.crash(model.now, 1)
    model.trigger(ms(1600), 2, deadline=ms(60_000), direction=1)
    model.run(ms(10_000))
    assert len(model.entries) == 1, "the silent body inside holds the opposed robot up"
    served(model)
    assert model.entries[1].cautious


def test_election_question_and_join_are_distinguished_by_the_term() -> None:
    model, _ = fleet(1, 2)
    jobs: list[Job] = []
    scheds: list[Sched] = []

    def watch(source: int, target: int, payload: bytes, now: int) -> bool:
        message = decode(payload)
        if isinstance(message, Job):
            jobs.append(message)
        if isinstance(message, Sched):
            scheds.append(message)
        return True

    model.air.filter = watch
    served(model)
    assert jobs[0].term.leader == 0xFFFF
    assert all(entry.phase is not Phase.PROVISIONAL for sched in scheds for entry in sched.entries)
    assert model.role(1) in {Role.NONE, Role.LEADING}


@pytest.mark.parametrize("inside", [False, True])
def test_robot_presumed_gone_continues_under_a_new_identity(inside: bool) -> None:
    model = Model(4, 2)
    model.trigger(0, 1, deadline=ms(60_000), duration=ms(8000))
    model.run(ms(2000 if inside else 400))
    mind = model.minds[1]
    assert (mind.inside is not None) is inside
    gone = Entry(1, 0, None, ms(8000), 0, Phase.OUT)
    better = Sched(EVENT, model.now, Term(50, 9), False, 0xFFFF, 0, 1, 0, 1, (gone,))
    mind.core.receive(model.now, encode(better), 9)
    model.settle(mind)
    frames: list[Job | Beacon] = []

    def watch(source: int, target: int, payload: bytes, now: int) -> bool:
        message = decode(payload)
        if isinstance(message, Job | Beacon) and source == 1:
            frames.append(message)
        return True

    model.air.filter = watch
    served(model)
    assert len(model.entries) == 1
    assert frames
    assert all(frame.trigger > 0 for frame in frames), "the old one is final"

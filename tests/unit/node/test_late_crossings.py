"""Late crossings: a robot that cannot get to the entrance lets others go first; one that others must pass goes next."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from rmr.base.geometry import Point, Pose
from rmr.base.time import Duration, Instant, seconds
from rmr.base.values import Robot
from rmr.coord.events import EntryMissed, SlotAssigned
from rmr.node.actions.dispatcher import Handler, RunningAction
from rmr.node.crossing.crossing import POLL_EVERY, Crossing
from rmr.node.crossing.lateness import APPROACH_CHANGE, BACK_OFF, BACK_OFF_MAX, POLICIES, Symptom
from rmr.node.crossing.phases import Asking, Inside, Preparing, Slotted
from rmr.node.crossing.resource import in_entrance, obstructs_exit, stands_within
from rmr.node.crossing.situation import CrossingPlan, Revise, Situation, Withdraw
from rmr.node.motion.gate import PUT_OFF_S
from rmr.node.motion.navigator import Navigator
from rmr.vm.job import TimedJob
from rmr_world.lab_file import load_lab

LABS = Path(__file__).parents[3] / "deploy" / "labs"
GROUP = b"event."
WASTED_MAX = POLICIES[Symptom.SLOT_WASTED].in_a_row
STUCK_AFTER = POLICIES[Symptom.STUCK].after
BLOCKS_AFTER = POLICIES[Symptom.BLOCKING_ENTRANCE].after


def crossing(start_s: float = 0.0, approach_s: float = 2.0) -> Crossing:
    """Return the gated crossing of a robot with a slot at `start_s`."""
    job = TimedJob(1, 0, "crossing", "crossing(exit)", "at(@1, exit)", 0, seconds(20.0), (), Robot(1))
    plan = CrossingPlan(gated=True, approach=seconds(approach_s), after=seconds(3))
    return Crossing(job, GROUP, GROUP, 0, None, Slotted(seconds(start_s), 0), plan)


def revision(commands) -> Revise | None:
    """Return what the leader hears."""
    return next((command for command in commands if isinstance(command, Revise)), None)


def wastes_slot(one: Crossing, now: Instant, *, in_a_crowd: bool = False, set_out: bool = False) -> Revise | None:
    """Let a slot pass for which the robot is not ready."""
    one.handle(now, SlotAssigned(GROUP, 0, 1, 1, now, now, 1, 1), Situation())
    return revision(one.handle(now, EntryMissed(GROUP), Situation(late_goes_next=in_a_crowd, set_out=set_out)))


def poll(one: Crossing, now: Instant, *, set_out: bool = False, entrance: bool = False, pose=None) -> Revise | None:
    """Let the robot compare its estimate, which stays, with what the leader has heard."""
    one.phase.polled_at = now - POLL_EVERY
    return revision(one.step(now, Situation(pose=pose, set_out=set_out, in_entrance=entrance)))


def reaches(one: Crossing, approach: Duration) -> None:
    """Let the robot be as near to its commit line as `approach`."""
    one.plan = replace(one.plan, approach=approach)


def test_a_robot_that_is_alone_in_the_schedule_lets_nobody_go_first():
    one = crossing()
    situation = Situation(alone=True)
    for turn in range(1, WASTED_MAX + 3):
        now = seconds(10.0 * turn)
        one.handle(now, SlotAssigned(GROUP, 0, 1, 1, now, now, 1, 1), situation)
        told = revision(one.handle(now, EntryMissed(GROUP), situation))
        assert told is not None
        assert told.release == now + one.plan.approach
    assert one.late.demoted_at is None


def test_what_was_missed_at_one_passage_counts_at_no_other():
    one = crossing()
    for turn in range(1, WASTED_MAX + 2):
        wastes_slot(one, seconds(10.0 * turn))
    assert one.late.demoted_at is not None
    one.phase = Preparing()
    one.move(b"other.")
    assert (one.late.demoted_at, one.late.slots_wasted, one.release) == (None, 0, 0)


def test_every_symptom_has_one_policy():
    assert set(POLICIES) == set(Symptom)


def test_the_first_wasted_slot_changes_nothing_for_others():
    one = crossing()
    assert wastes_slot(one, seconds(5)) is None
    assert one.deadline == seconds(17)


def test_a_slot_missed_while_ready_is_not_wasted():
    one = crossing()
    for _ in range(2 * WASTED_MAX):
        one.handle(0, SlotAssigned(GROUP, 0, 1, 1, 0, 0, 1, 1), Situation())
        assert revision(one.handle(0, EntryMissed(GROUP), Situation(ready=True, set_out=True))) is None
    assert one.late.slots_wasted == 0


def test_second_wasted_slot_demotes_the_robot_and_doubles_its_back_off():
    one, waits = crossing(), []
    for k in range(8):
        now = seconds(10 * k)
        told = wastes_slot(one, now)
        if told is not None:
            assert told.deadline == now
            waits.append(told.release - now - one.plan.approach)
    assert len(waits) == 8 - (WASTED_MAX - 1)
    assert waits[:2] == [BACK_OFF, 2 * BACK_OFF]
    assert waits == sorted(waits)
    assert waits[-1] == BACK_OFF_MAX


def test_only_a_robot_that_has_set_out_and_was_deferred_since_is_committed():
    far = 2.0 + PUT_OFF_S + 0.1
    told = poll(crossing(far), 0, set_out=True)
    assert told is not None
    assert told.committed
    assert poll(crossing(far - 0.2), 0, set_out=True) is None
    assert poll(crossing(far), 0) is None


def test_a_slot_wasted_near_the_entrance_in_a_crowd_commits_instead_of_demoting():
    one = crossing(approach_s=0.5)
    for k in range(2 * WASTED_MAX):
        one.late.committed = False
        told = wastes_slot(one, seconds(k), in_a_crowd=True, set_out=True)
        assert told == Revise(seconds(k + 0.5), one.deadline, committed=True)
    assert one.late.slots_wasted == 0
    far = crossing()
    assert wastes_slot(far, 0, in_a_crowd=True, set_out=True) is None
    assert far.late.slots_wasted == 1
    assert not far.late.committed


def test_a_robot_that_stands_and_need_not_leave_for_a_while_knows_it():
    one = crossing(10.0)
    running = RunningAction(0, "moveto", (), Handler("moveto", lambda _: iter(())))
    running.started = 0
    one.serving.append(running)
    assert not one.leaves_after(0), "it is under way"
    one.serving.clear()
    assert one.leaves_after(seconds(7))
    assert not one.leaves_after(seconds(8))
    one.phase = Asking(0)
    assert not one.leaves_after(0)


def test_a_committed_robot_reports_its_approach_only_when_it_is_nearer_or_farther():
    one = crossing(100.0)
    assert poll(one, 0, set_out=True)
    assert poll(one, seconds(10), set_out=True) is None
    reaches(one, one.plan.approach - APPROACH_CHANGE)
    assert poll(one, seconds(10), set_out=True)
    one.phase = Slotted(seconds(11), 0)  # its slot has come: it stays in front
    assert poll(one, seconds(10), set_out=True) is None
    assert one.late.committed


def test_a_committed_robot_that_is_demoted_lets_others_go_first_for_a_while():
    one = crossing(100.0)
    poll(one, 0, set_out=True)
    while wastes_slot(one, seconds(5)) is None:
        assert one.late.committed
    assert not one.late.committed
    one.phase = Slotted(seconds(100), 0)
    assert poll(one, seconds(5), set_out=True) is None
    assert poll(one, seconds(5) + BACK_OFF, set_out=True)


def test_a_robot_that_blocks_an_entrance_is_committed_and_says_so_once():
    one, step = crossing(60.0), seconds(0.5)
    told = [poll(one, step * k, entrance=True) for k in range(8)]
    assert [bool(one) for one in told] == [step * k == BLOCKS_AFTER for k in range(8)]
    assert told[BLOCKS_AFTER // step] == Revise(BLOCKS_AFTER + one.plan.approach, one.deadline, committed=True)


def test_an_entrance_is_not_blocked_by_one_whose_slot_is_near_or_that_has_left_it_or_wasted_a_slot():
    one = crossing(3.0)
    one.release = seconds(100)
    assert poll(one, 0, entrance=True) is None
    assert poll(one, seconds(2.5), entrance=True) is None
    one.phase = Asking(0)
    assert poll(one, seconds(3)) is None
    assert poll(one, seconds(3.5), entrance=True) is None
    wastes_slot(one, seconds(5))
    assert poll(one, seconds(5.5), entrance=True) is None
    assert poll(one, seconds(5.5) + BLOCKS_AFTER, entrance=True)


def test_an_entry_that_is_not_used_for_long_is_given_up_and_demotes_at_once():
    one = crossing()
    one.phase = Inside(seconds(60), None)
    one.entered_at = seconds(10)
    last = seconds(10) + POLICIES[Symptom.ENTRY_UNUSED].after
    assert Withdraw() not in one.step(last, Situation(before_hold_line=True))
    commands = one.step(last + 1, Situation(before_hold_line=True))
    assert Withdraw() in commands
    assert isinstance(one.phase, Preparing)
    assert one.deadline == last + 1
    assert one.release == last + 1 + one.plan.approach + BACK_OFF_MAX


@pytest.mark.parametrize(
    ("lab", "goal", "place", "keeps_out"),
    [
        ("testbed", "exit", Point(0.42, 0.8), True),
        ("testbed", "exit", Point(0.5, 0.84), True),  # in the corner beside the entrance
        ("testbed", "exit", Point(0.33, 0.75), False),
        ("testbed", "exit", Point(0.4, 0.95), False),
        ("twoway", "right", Point(1.1, 0.75), False),  # others may come out: it makes room instead
    ],
)
def test_an_entrance_is_where_nobody_gets_past_a_robot(lab, goal, place, keeps_out):
    arena = load_lab(LABS / lab).arena
    area = arena.area(goal)
    assert area is not None
    navigator, pose = Navigator(arena, 1), Pose(place.x, place.y, 0.0)
    assert not in_entrance(navigator, navigator.arena.passages[0], area, None), "it does not know where it is"
    assert in_entrance(navigator, navigator.arena.passages[0], area, pose) is keeps_out, "it has not set out"
    assert navigator.go(0, pose, area.places[0], through_gate=True)
    assert in_entrance(navigator, navigator.arena.passages[0], area, pose) is keeps_out


@pytest.mark.parametrize(("step_m", "stuck"), [(0.0, True), (0.02, True), (0.2, False)])
def test_postponing_wastes_slots_only_for_a_robot_without_progress(step_m, stuck):
    one, wasted = crossing(), []
    one.phase = Asking(0)
    for k in range(2 * STUCK_AFTER // seconds(0.5)):
        now, to_and_fro = seconds(0.5) * k, k % 2 if step_m < 0.1 else k
        told = poll(one, now, pose=Pose(step_m * to_and_fro, 0.0, 0.0))
        assert told is not None
        assert told.release >= now + one.plan.approach
        wasted.append(one.late.slots_wasted > 0)
    assert any(wasted) is stuck
    assert not any(wasted[: STUCK_AFTER // seconds(0.5)])


@pytest.mark.parametrize(
    ("lab", "goal", "place", "within"),
    [
        ("corridor", "exit", Point(1.1, 0.75), False),  # the first place of the queue
        ("corridor", "exit", Point(1.33, 0.74), True),
        ("corridor", "exit", Point(1.5, 0.65), True),  # nearer to the wall than it can be
        ("corridor", "exit", Point(2.2, 0.75), False),
        ("corridor", "exit", Point(0.5, 1.3), False),
        ("testbed", "exit", Point(0.75, 0.75), True),
        ("testbed", "exit", Point(0.46, 0.7), False),
        ("twoway", "right", Point(1.5, 0.75), True),
        ("twoway", "left", Point(1.5, 0.75), True),
        ("twoway", "left", Point(1.81, 0.76), False),  # in the mouth: it has to make room
    ],
)
def test_a_robot_that_stands_inside_knows_it_whatever_its_heading_is(lab, goal, place, within):
    arena = load_lab(LABS / lab).arena
    area = arena.area(goal)
    assert area is not None
    for theta in (0.0, math.pi / 2, math.pi):
        assert stands_within(arena, arena.passages[0], area, Pose(place.x, place.y, theta)) is within


@pytest.mark.parametrize(
    ("x", "y", "in_way"),
    [
        (1.83, 0.77, True),
        (1.93, 0.77, True),
        (2.1, 0.77, False),
        (1.6, 0.77, True),
        (1.92, 0.65, True),  # beside the mouth, not in front of it
        (1.95, 0.95, True),
        (1.95, 1.35, False),
        (1.2, 0.77, True),  # coming out at the far end
        (1.08, 0.65, False),
    ],
)
def test_a_robot_that_begins_where_others_come_out_obstructs_the_exit(x, y, in_way):
    arena = load_lab(LABS / "twoway").arena
    assert obstructs_exit(arena, arena.passages[0], arena.area("left"), Pose(x, y, -2.8)) is in_way


def test_no_exit_is_obstructed_at_a_one_way_bottleneck():
    arena = load_lab(LABS / "testbed").arena
    assert not any(
        obstructs_exit(arena, arena.passages[0], arena.area("exit"), Pose(0.02 * k, 0.75, 0.0)) for k in range(1, 30)
    )


def test_a_robot_that_obstructs_an_exit_sets_out_before_its_slot_is_near():
    one = crossing(60.0)
    assert not one.released(seconds(1))
    one.plan = replace(one.plan, obstructs_exit=True)
    assert one.released(seconds(1))
    one.phase = Asking(0)
    assert not one.released(seconds(1)), "nobody sets out without a slot"

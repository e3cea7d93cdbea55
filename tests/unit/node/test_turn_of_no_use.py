"""A turn that is of no use: who cannot get to the gate lets others go first; who stands inside needs none."""

import math
from pathlib import Path

import pytest
from rmr.node.crossing.turn import (
    APPROACHES,
    HINDERED_MAX,
    HINDERED_WAIT,
    HINDERED_WAIT_MAX,
    PRESS_AFTER,
    SLIDES_MAX,
    Phase,
    Turn,
    in_mouth,
    stands_in_way,
    stands_within,
)

from rmr.base.geometry import Point, Pose
from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.node.actions.dispatcher import Running
from rmr.node.motion.gate import PUT_OFF_S
from rmr.node.motion.navigator import Navigator
from rmr.vm.job import Job
from rmr_world.lab import load_lab

LABS = Path(__file__).parents[3] / "deploy" / "labs"


def turn(deadline_s=20.0):
    job = Job(1, 0, "crossing", "crossing(exit)", "at(@1, exit)", 0, seconds(deadline_s), (), Robot(1))
    return Turn(job, b"e", 0, None, phase=Phase.SLOTTED, approach=seconds(2), after=seconds(3))


def test_one_slot_that_was_of_no_use_changes_nothing_for_others():
    one = turn()
    assert not one.hinder(seconds(5))
    assert one.deadline == seconds(17)


def test_who_is_hindered_again_goes_behind_all_that_are_due_and_waits_longer_each_time():
    one, waits = turn(), []
    for k in range(8):
        now = seconds(10 * k)
        if one.hinder(now):
            assert one.deadline == now
            waits.append(one.release - now - one.approach)
    assert len(waits) == 8 - (HINDERED_MAX - 1)
    assert waits[:2] == [HINDERED_WAIT, 2 * HINDERED_WAIT]
    assert waits == sorted(waits)
    assert waits[-1] == HINDERED_WAIT_MAX


def under_way(start_s: float, approach_s: float = 2.0) -> Turn:
    """Return a turn by which the robot has set out, with a slot at `start_s`."""
    one = turn()
    running = Running(0, "moveto", (), lambda _: iter(()))
    running.started = 0
    one.serving.append(running)
    one.start, one.approach = seconds(start_s), seconds(approach_s)
    return one


def test_only_who_has_set_out_and_was_put_off_since_says_that_it_is_under_way():
    far = 2.0 + PUT_OFF_S + 0.1
    assert under_way(far).put_off(0)
    assert not under_way(far - 0.2).put_off(0)
    waits = under_way(far)
    waits.serving.clear()
    assert not waits.put_off(0)


def test_one_of_a_crowd_that_is_late_near_the_gate_goes_next_and_is_not_hindered():
    one = under_way(0.0, approach_s=0.5)
    for k in range(2 * HINDERED_MAX):
        one.underway = False
        assert one.go_on(seconds(k))
        assert one.underway
        assert one.release == seconds(k + 0.5)
    assert one.hindered == 0
    far = under_way(0.0)
    far.go_on(0)
    assert far.hindered == 1
    assert not far.underway


def test_who_stands_and_need_not_leave_for_a_while_knows_it():
    one = under_way(10.0)
    assert not one.leaves_after(0), "it is under way"
    one.serving.clear()
    one.gated = True
    assert one.leaves_after(seconds(7))
    assert not one.leaves_after(seconds(8))
    one.phase = Phase.ASKING
    assert not one.leaves_after(0)


def test_who_is_under_way_says_so_again_only_when_it_is_nearer_or_farther():
    one = under_way(100.0)
    assert one.put_off(0)
    assert not one.put_off(seconds(10))
    one.approach -= APPROACHES
    assert one.put_off(seconds(10))
    one.start = seconds(11)  # its slot has come: it stays in front
    assert not one.put_off(seconds(10))
    assert one.underway


def test_who_is_hindered_though_under_way_lets_others_go_first_for_a_while():
    one = under_way(100.0)
    one.put_off(0)
    while not one.hinder(seconds(5)):
        assert one.underway
    assert not one.underway
    assert not one.put_off(seconds(5))
    assert one.put_off(seconds(5) + HINDERED_WAIT)


def test_who_stands_in_the_mouth_for_long_is_under_way_and_says_so_once():
    one = turn()
    one.start, step = seconds(60), seconds(0.5)
    told = [one.press(step * k, in_mouth=True) for k in range(8)]
    assert told == [step * k == PRESS_AFTER for k in range(8)]
    assert one.underway
    assert one.release == PRESS_AFTER + one.approach


def test_nobody_presses_whose_slot_is_near_or_who_has_left_the_mouth_or_had_a_slot_of_no_use():
    one = turn()
    one.start = seconds(3)
    assert not one.press(0, in_mouth=True)
    assert not one.press(seconds(2.5), in_mouth=True)
    one.phase = Phase.ASKING
    assert not one.press(seconds(3), in_mouth=False)
    assert not one.press(seconds(3.5), in_mouth=True)
    one.hinder(seconds(5))
    assert not one.press(seconds(5.5), in_mouth=True)
    assert one.press(seconds(5.5) + PRESS_AFTER, in_mouth=True)


@pytest.mark.parametrize(
    ("lab", "goal", "place", "keeps_out"),
    [
        ("testbed", "exit", Point(0.42, 0.8), True),
        ("testbed", "exit", Point(0.5, 0.84), True),  # in the corner beside the mouth
        ("testbed", "exit", Point(0.33, 0.75), False),
        ("testbed", "exit", Point(0.4, 0.95), False),
        ("twoway", "right", Point(1.1, 0.75), False),  # others may come out: it makes room instead
    ],
)
def test_the_mouth_is_where_nobody_gets_past_a_robot(lab, goal, place, keeps_out):
    arena = load_lab(LABS / lab).arena
    area = arena.area(goal)
    assert area is not None
    navigator, one, pose = Navigator(arena, 1), turn(), Pose(place.x, place.y, 0.0)
    one.goal, one.gated = area, True
    assert not in_mouth(one, navigator, None), "it does not know where it is"
    assert in_mouth(one, navigator, pose) is keeps_out, "it has not set out"
    assert navigator.go(0, pose, area.places[0], through_gate=True)
    assert in_mouth(one, navigator, pose) is keeps_out


@pytest.mark.parametrize(("step_m", "hindered"), [(0.0, True), (0.02, True), (0.2, False)])
def test_putting_off_is_being_hindered_only_for_a_robot_that_gets_nowhere(step_m, hindered):
    one, found = turn(), []
    for k in range(2 * SLIDES_MAX // seconds(0.5)):
        now, to_and_fro = seconds(0.5) * k, k % 2 if step_m < 0.1 else k
        found.append(one.slide(now, now + one.approach, Pose(step_m * to_and_fro, 0.0, 0.0)))
    assert any(found) is hindered
    assert not any(found[: SLIDES_MAX // seconds(0.5)])


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
def test_who_stands_in_the_bottleneck_knows_it_whatever_it_is_about_to_do(lab, goal, place, within):
    arena = load_lab(LABS / lab).arena
    area = arena.area(goal)
    assert area is not None
    for theta in (0.0, math.pi / 2, math.pi):
        assert stands_within(arena, area, Pose(place.x, place.y, theta)) is within


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
def test_who_begins_where_others_come_out_by_a_mouth_is_in_their_way(x, y, in_way):
    arena = load_lab(LABS / "twoway").arena
    assert stands_in_way(arena, arena.area("left"), Pose(x, y, -2.8)) is in_way


def test_nobody_comes_out_by_the_mouth_of_a_one_way_bottleneck():
    arena = load_lab(LABS / "testbed").arena
    assert not any(stands_in_way(arena, arena.area("exit"), Pose(0.02 * k, 0.75, 0.0)) for k in range(1, 30))


def test_who_stands_in_the_way_sets_out_before_its_slot_is_near():
    one = turn()
    one.gated, one.start = True, seconds(60)
    assert not one.released(seconds(1))
    one.in_way = True
    assert one.released(seconds(1))
    one.phase = Phase.ASKING
    assert not one.released(seconds(1)), "nobody sets out without a slot"

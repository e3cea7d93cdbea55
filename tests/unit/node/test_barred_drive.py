"""When the drive of a robot fails because others bar its way: those that count as dead, or all that stand."""

from types import SimpleNamespace

import pytest

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose
from rmr.base.time import seconds
from rmr.node.actions.drives import BarredDrive
from rmr.node.actions.handle import ActionFailed

ARENA = Arena(4.0, 2.0, 0.05)
GOAL = Point(1.0, 1.0)


def barred():
    """Return a host whose way the dead bar, and its drive."""
    host = SimpleNamespace(
        now=seconds(1),
        arena=ARENA,
        config=SimpleNamespace(roster=(1, 2, 3)),
        pose=Pose(3.0, 1.0, 0.0),
        blocked="",
        barred_by_lost=lambda _: "the way is blocked by robot 2",
        peers=SimpleNamespace(lost=lambda _: {2: None}, standing=lambda _: {2: GOAL}),
        motion=SimpleNamespace(may_be_barred=True, barred=lambda _: True, passed_gate=False, cleared=False),
        trace=lambda *_, **__: None,
    )
    return host, BarredDrive(host)


def barred_by_living():
    """Return a host on whose goal a living robot stands, and its drive."""
    host, drive = barred()
    host.barred_by_lost = lambda _: ""
    host.peers.lost = lambda _: {}
    return host, drive


def look(host, drive, since_s, until_s, before_turn=False):
    """Look once a second."""
    for second in range(since_s, until_s):
        host.now = seconds(second)
        drive.look(GOAL, before_turn=before_turn)


def test_drive_fails_after_its_way_was_barred_for_twenty_seconds():
    host, drive = barred()
    look(host, drive, 1, 22)
    host.now = seconds(22)
    with pytest.raises(ActionFailed, match="robot 2"):
        drive.look(GOAL, before_turn=False)


def test_time_for_which_the_robot_itself_was_stopped_does_not_count():
    """As it wakes it has heard nobody for long: the others seem dead, but have had no chance to be heard."""
    host, drive = barred()
    look(host, drive, 1, 5)
    look(host, drive, 60, 75)
    host.now = seconds(90)
    drive.look(GOAL, before_turn=False)
    look(host, drive, 91, 92)


def test_time_before_the_robot_was_stopped_counts():
    host, drive = barred()
    look(host, drive, 1, 15)
    with pytest.raises(ActionFailed):
        look(host, drive, 60, 75)


def test_drive_fails_after_a_living_robot_has_stood_on_its_goal_for_twenty_seconds():
    host, drive = barred_by_living()
    look(host, drive, 1, 22)
    with pytest.raises(ActionFailed, match="robot 2 stands at the goal"):
        look(host, drive, 22, 23)


def test_before_its_turn_a_drive_waits_for_each_robot_that_goes_first():
    host, drive = barred_by_living()
    look(host, drive, 1, 62, before_turn=True)
    with pytest.raises(ActionFailed, match="robot 2 stands at the goal"):
        look(host, drive, 62, 63, before_turn=True)


def test_the_dead_are_waited_for_no_longer_before_a_turn():
    host, drive = barred()
    with pytest.raises(ActionFailed, match="blocked by robot 2"):
        look(host, drive, 1, 23, before_turn=True)


def test_a_way_that_is_free_for_a_moment_does_not_begin_the_time_anew():
    host, drive = barred_by_living()
    look(host, drive, 1, 15)
    host.motion.barred = lambda _: False
    look(host, drive, 15, 19)
    host.motion.barred = lambda _: True
    with pytest.raises(ActionFailed):
        look(host, drive, 19, 23)


def test_a_way_that_is_free_for_longer_begins_the_time_anew():
    host, drive = barred_by_living()
    look(host, drive, 1, 15)
    host.motion.barred = lambda _: False
    look(host, drive, 15, 25)
    host.motion.barred = lambda _: True
    look(host, drive, 25, 45)


def test_what_was_in_the_way_before_its_turn_has_time_to_leave_in_it():
    host, drive = barred_by_living()
    look(host, drive, 1, 55, before_turn=True)
    look(host, drive, 55, 75)
    with pytest.raises(ActionFailed):
        look(host, drive, 75, 76)


def test_a_drive_that_the_living_bar_does_not_fail_inside_a_passage_but_behind_it():
    host, drive = barred_by_living()
    host.motion.passed_gate = True
    look(host, drive, 1, 60)
    host.motion.cleared = True
    host.now = seconds(60)
    with pytest.raises(ActionFailed):
        drive.look(GOAL, before_turn=False)


def test_a_goal_that_one_robot_after_the_other_stands_on_is_not_kept():
    host, drive = barred_by_living()
    for begins_s, robot in ((1, 2), (16, 3), (31, 2)):
        host.peers.standing = lambda _, robot=robot: {robot: GOAL}
        look(host, drive, begins_s, begins_s + 15)
    host.now = seconds(52)
    with pytest.raises(ActionFailed, match="no way there"):
        look(host, drive, 46, 53)

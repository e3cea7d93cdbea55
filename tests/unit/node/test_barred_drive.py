"""When the drive of a robot fails because robots that count as dead bar its way."""

from types import SimpleNamespace

import pytest

from rmr.base.geometry import Point
from rmr.base.time import seconds
from rmr.node.actions.drives import BarredDrive
from rmr.node.actions.handle import ActionFailed


def barred():
    """Return a host whose way is barred, and its drive."""
    host = SimpleNamespace(
        now=seconds(1),
        blocked="",
        barred_by_lost=lambda _: "the way is blocked by robot 2",
        peers=SimpleNamespace(lost=lambda _: {2: None}),
        trace=lambda *_, **__: None,
    )
    return host, BarredDrive(host, Point(1.0, 1.0))


def look(host, drive, since_s, until_s):
    """Look once a second."""
    for second in range(since_s, until_s):
        host.now = seconds(second)
        drive.look()


def test_drive_fails_after_its_way_was_barred_for_twenty_seconds():
    host, drive = barred()
    look(host, drive, 1, 22)
    host.now = seconds(22)
    with pytest.raises(ActionFailed, match="robot 2"):
        drive.look()


def test_time_for_which_the_robot_itself_was_stopped_does_not_count():
    """As it wakes it has heard nobody for long: the others seem dead, but have had no chance to be heard."""
    host, drive = barred()
    look(host, drive, 1, 5)
    look(host, drive, 60, 75)
    host.now = seconds(90)
    drive.look()
    look(host, drive, 91, 92)


def test_time_before_the_robot_was_stopped_counts():
    host, drive = barred()
    look(host, drive, 1, 15)
    with pytest.raises(ActionFailed):
        look(host, drive, 60, 75)

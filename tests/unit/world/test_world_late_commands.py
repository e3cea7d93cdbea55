"""Wheel commands that a delayed bus brings too late: the world drops them, counts them, and says why robots brake."""

import logging

import pytest
from test_world_server import Held

from rmr.base.time import NS_PER_S, TICK_HZ, Instant, milliseconds, tick_start
from rmr.bus import wire
from rmr.bus.late_messages import ROW_MIN, TELL_EVERY
from rmr_world.run_warnings import run_warnings

ROBOT = 1


@pytest.fixture
def world(monkeypatch):
    held = Held(monkeypatch)
    held.server._alive.add(ROBOT)
    return held


def commanded(held: Held, delay: int, ticks: int, first: int = 12) -> Instant:
    """Let commands arrive once a tick, `delay` after they were decided; return when the last one came."""
    for tick in range(first, first + ticks):
        held.now = tick_start(tick)
        body = wire.Act(0.1, 0.0, held.now - delay)
        held.server._on_act("", wire.Envelope(ROBOT, 1, tick, body))
    return held.now


@pytest.mark.parametrize(("delay_ms", "late"), [(0, False), (99, False), (101, True), (180, True)])
def test_commands_later_than_the_world_takes_them_are_counted(world, delay_ms, late):
    commanded(world, milliseconds(delay_ms), 20)
    assert world.server._report()["late_commands"] == ([[ROBOT, 20, delay_ms / 1000]] if late else [])


def test_robot_that_brakes_for_late_commands_is_told_once_and_again_after_a_while(world, caplog):
    with caplog.at_level(logging.WARNING, logger="rmr"):
        commanded(world, milliseconds(180), ROW_MIN - 1)
        assert not caplog.records
        commanded(world, milliseconds(180), 30, first=12 + ROW_MIN - 1)
        assert [record.getMessage() for record in caplog.records] == [
            "robot 1 brakes: its wheel commands arrive 180 ms late, and after 100 ms they are dropped; "
            "the bus is delayed or the machine is too slow"
        ]
        commanded(world, milliseconds(180), TELL_EVERY * TICK_HZ // NS_PER_S, first=50)
        assert len(caplog.records) == 2


def test_single_late_commands_are_no_reason_to_warn(world, caplog):
    with caplog.at_level(logging.WARNING, logger="rmr"):
        for tick in range(12, 100, 2):
            commanded(world, milliseconds(180), 1, first=tick)
            commanded(world, 0, 1, first=tick + 1)
    assert not caplog.records


def test_late_commands_stand_among_the_warnings_of_a_run():
    few, many = [1, ROW_MIN - 1, 0.2], [3, 40, 0.18]
    assert run_warnings({"robots": {}, "bus": {"lost": 0, "late_commands": [few, many]}}) == [
        "robot 3 braked although it drove: 40 of its wheel commands arrived too late, the latest 0.180 s "
        "after it was decided; the bus is delayed or the machine is too slow"
    ]


def test_late_samples_stand_among_the_warnings_of_a_run():
    robots = {"1": {"late_samples": ROW_MIN - 1}, "2": {"late_samples": 90}}
    assert run_warnings({"robots": robots}) == [
        "robot 2 stood although it was to drive: 90 of its samples arrived too late; "
        "the bus is delayed or the machine is too slow"
    ]

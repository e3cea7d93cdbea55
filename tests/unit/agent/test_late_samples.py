"""Samples that a delayed bus brings too late: the robot counts them, and says why it stands."""

import asyncio
import logging

import pytest
from test_robot_life import live, sample

from rmr.base.time import NEVER, TICK_HZ, milliseconds, seconds, tick_start
from rmr.bus.late_messages import ROW_MIN, TELL_EVERY, LateSamples


def heard(late, delay_ms, ticks, first=0):
    for tick in range(first, first + ticks):
        late.note(tick_start(tick), tick_start(tick) + milliseconds(delay_ms))


@pytest.mark.parametrize(("delay_ms", "count"), [(0, 0), (99, 0), (101, 20), (180, 20)])
def test_samples_older_than_a_robot_drives_on_are_counted(delay_ms, count):
    late = LateSamples(3)
    heard(late, delay_ms, 20)
    assert late.count == count
    assert late.worst == (milliseconds(delay_ms) if count else 0)


def test_robot_that_stands_for_late_samples_says_so_once_and_again_after_a_while(caplog):
    late = LateSamples(3)
    with caplog.at_level(logging.WARNING, logger="rmr"):
        heard(late, 180, ROW_MIN - 1)
        assert not caplog.records
        heard(late, 180, 30, first=ROW_MIN - 1)
        assert [record.getMessage() for record in caplog.records] == [
            "robot 3 stands: its samples arrive 180 ms late, and it drives on none older than 100 ms; "
            "the bus is delayed or the machine is too slow"
        ]
        heard(late, 180, TELL_EVERY * TICK_HZ // seconds(1), first=40)
        assert len(caplog.records) == 2


def test_stamps_that_no_body_of_this_run_gives_say_nothing_of_how_late_samples_are(caplog):
    late = LateSamples(3)
    with caplog.at_level(logging.WARNING, logger="rmr"):
        for tick in range(20):
            for stamp in (-NEVER, -1, tick_start(tick), tick_start(tick) - seconds(3), NEVER):
                late.note(stamp, tick_start(tick) + milliseconds(1))
        heard(late, 180, 20, first=20)
    assert (late.count, late.worst) == (20, milliseconds(180))
    assert len(caplog.records) == 1


def test_samples_of_a_robot_that_runs_are_looked_at(monkeypatch):
    async def scene(life, clock, node, failures):
        life.sense(sample())
        clock.sample("running", 0, 0, 0, 0)
        async with asyncio.timeout(5):
            while not life.started:
                await asyncio.sleep(0.001)
        before = life.late_samples.count
        life.sense(sample(life.now() - seconds(1)))
        assert life.late_samples.count == before + 1

    live(monkeypatch, scene)

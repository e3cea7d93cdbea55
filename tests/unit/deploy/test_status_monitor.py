"""Whom a launcher believes: the session that was heard first, unless it is over."""

from types import SimpleNamespace

import pytest

from rmr.base.time import seconds
from rmr.bus import wire
from rmr.bus.keys import Keys
from rmr_deploy import status_monitor
from rmr_deploy.status_monitor import JUDGE_S, RETURN_S, SESSIONS_MAX, SILENT_S, StatusMonitor
from rmr_world.quorum import DIED, NEVER_CAME, STOPPED

KEYS = Keys("dash")


class Launcher:
    """A launcher's view of robot 1, and the bus on which it is."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        self.connected = True
        self.due = []
        """Calls that are to be made later: (instant, call)."""
        monkeypatch.setattr(status_monitor, "time", SimpleNamespace(monotonic=lambda: self.now))
        monkeypatch.setattr(status_monitor, "asyncio", SimpleNamespace(get_running_loop=lambda: self))
        self.handlers = {}
        self.tokens = {}
        self.monitor = StatusMonitor(self, "dash")
        self.number = 0
        self.token(there=True)

    def subscribe(self, key, handler, *, whole=False):
        self.handlers[key] = handler

    def watch_alive(self, key, handler):
        self.tokens[key] = handler

    def call_later(self, delay_s, call, *args):
        self.due.append((self.now + delay_s, lambda: call(*args)))

    def wait(self, wait_s):
        """Let time pass, and make the calls that come due."""
        end = self.now + wait_s
        while self.due and min(at for at, _ in self.due) <= end:
            first = min(self.due, key=lambda due: due[0])
            self.due.remove(first)
            self.now = first[0]
            first[1]()
        self.now = end

    def token(self, *, there):
        self.tokens[KEYS.alive("robot", "*")](KEYS.alive("robot", 1), there)

    def says(self, run, sender=1, state="running", *, final=False):
        """Let a session say something; return whether it is believed."""
        self.number += 1
        said = wire.Status(state, f"{run}, {self.number}", False, final, seconds(1), {})
        self.handlers[KEYS.statuses](KEYS.status(sender), wire.Envelope(sender, run, self.number, said))
        held = self.monitor.world if sender < 0 else self.monitor.robots.get(sender)
        return held is not None and held.progress == said.progress


def test_a_forged_status_is_dropped_as_long_as_the_robots_own_session_speaks(monkeypatch):
    launcher = Launcher(monkeypatch)
    for sender in (1, wire.WORLD_ID):
        assert launcher.says(7, sender)
        for forged in range(100, 130):
            assert not launcher.says(forged, sender, "failed")
        assert launcher.says(7, sender)


def test_a_successor_is_believed_when_the_token_has_vanished_and_the_predecessor_if_it_comes_back(monkeypatch):
    launcher = Launcher(monkeypatch)
    assert launcher.says(7)
    launcher.token(there=False)
    launcher.token(there=True)
    assert launcher.says(8)
    assert launcher.says(7), "it had lost its connection"
    assert not launcher.says(8)


def test_a_robot_that_was_restarted_by_its_launcher_is_believed_at_once(monkeypatch):
    launcher = Launcher(monkeypatch)
    assert launcher.says(7)
    launcher.monitor.retire(1, DIED)
    launcher.token(there=True)
    assert launcher.says(8)
    assert not launcher.says(7)


def test_a_session_that_has_fallen_silent_gives_way_until_it_speaks_again(monkeypatch):
    launcher = Launcher(monkeypatch)
    assert launcher.says(7)
    launcher.now = SILENT_S - 0.1
    assert not launcher.says(8)
    launcher.now = SILENT_S
    assert launcher.says(8)
    assert launcher.says(7)
    assert not launcher.says(8)


def test_sessions_without_number_are_bounded_and_the_first_goes_on(monkeypatch):
    launcher = Launcher(monkeypatch)
    assert launcher.says(7)
    for forged in range(100, 100 + 2 * SESSIONS_MAX):
        assert not launcher.says(forged)
    assert len(launcher.monitor._speakers[1]._heard) == SESSIONS_MAX
    assert launcher.says(7)


def test_the_time_is_told_by_those_who_are_there(monkeypatch):
    launcher = Launcher(monkeypatch)
    launcher.says(7)
    launcher.says(8, sender=9)
    launcher.monitor.robots[9] = launcher.monitor.robots[9]._replace(stamp=1 << 60)
    assert launcher.monitor.now == seconds(1)


def test_a_robot_that_has_left_was_stopped_if_it_said_so_and_has_died_otherwise(monkeypatch):
    for state, final, fate in (("running", False, DIED), ("failed", True, DIED), ("stopped", True, STOPPED)):
        launcher = Launcher(monkeypatch)
        assert launcher.says(7, state=state, final=final)
        launcher.token(there=False)
        assert launcher.monitor.fate(1) == fate


def test_a_robot_that_nobody_has_seen_never_came(monkeypatch):
    launcher = Launcher(monkeypatch)
    assert launcher.monitor.fate(2) == NEVER_CAME
    launcher.token(there=False)
    assert launcher.monitor.fate(1) == DIED, "its process was there, and ended before it said anything"
    assert launcher.says(7, sender=2)
    assert launcher.monitor.fate(2) == DIED


def test_a_robot_is_absent_once_its_token_has_vanished_and_the_connection_has_not(monkeypatch):
    launcher = Launcher(monkeypatch)
    launcher.token(there=False)
    launcher.wait(JUDGE_S)
    assert launcher.monitor.present == set()
    launcher.token(there=True)
    launcher.wait(10.0)
    assert launcher.monitor.present == {1}


@pytest.mark.parametrize("returns", [True, False])
def test_of_a_robot_whose_token_has_vanished_with_the_connection_nothing_is_known_until_that_is_back(
    monkeypatch, returns
):
    launcher = Launcher(monkeypatch)
    launcher.token(there=False)
    launcher.connected = False
    launcher.wait(60.0)
    assert launcher.monitor.present == {1}
    launcher.connected = True
    launcher.wait(RETURN_S - 0.1)
    if returns:
        launcher.token(there=True)
    launcher.wait(2 * RETURN_S)
    assert launcher.monitor.present == ({1} if returns else set())


def test_silence_of_the_world_lasts_from_its_last_message(monkeypatch):
    launcher = Launcher(monkeypatch)
    launcher.wait(5.0)
    launcher.says(7, wire.WORLD_ID)
    launcher.wait(4.0)
    launcher.says(7)
    assert launcher.monitor.world_silent_s == 4.0

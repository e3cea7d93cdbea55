"""The world server's bookkeeping, with a bus that keeps what it is given."""

import pytest
from world_labs import LABS

from rmr.base.time import tick_start
from rmr.bus.process import Ending
from rmr.bus.wire import Losses
from rmr_world import server
from rmr_world.lab import load_lab
from rmr_world.server import BEHIND_MAX, CATCH_UP_MAX, WorldServer


class StubBus:
    """Keeps what is published."""

    def __init__(self) -> None:
        self.losses = Losses()
        self.published: list[tuple[str, object]] = []

    def publish(self, key: str, body: object) -> None:
        self.published.append((key, body))


class Held:
    """A world that has been held up until some tick."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0
        monkeypatch.setattr(server.time, "monotonic_ns", lambda: self.now)
        self.server = WorldServer(load_lab(LABS / "testbed" / "lab.yaml"), 1, StubBus(), Ending(), when_ready=False)
        self.server._time.start(0, 0)

    def catch_up(self, tick: int, calls: int) -> dict[str, int]:
        self.now = tick_start(tick)
        for _ in range(calls):
            self.server._catch_up()
        return self.server._report()


def test_a_tick_that_is_made_up_for_is_counted_once(monkeypatch):
    held = Held(monkeypatch)
    assert held.catch_up(1, 1)["ticks_late"] == 0
    behind = 3 * CATCH_UP_MAX
    assert held.catch_up(1 + behind, 3)["ticks_late"] == behind - 1


def test_a_world_that_is_too_far_behind_sets_lab_time_back_and_makes_up_for_nothing(monkeypatch):
    report = Held(monkeypatch).catch_up(BEHIND_MAX + 10, 1)
    assert (report["ticks_late"], report["set_back"]) == (0, 1)

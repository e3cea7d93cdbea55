"""A simulated run that is paced: pause, step, speed, and orders between two ticks."""

import threading
import time

import pytest

from rmr_view.run_pacer import RunPacer


class Ticking:
    """A run that does nothing but tick, in a thread."""

    def __init__(self, speed):
        self.pacer = RunPacer(speed)
        self.count = 0
        self.over = False
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self):
        while not self.over:
            self.pacer.tick()
            self.count += 1

    def settled(self):
        """Wait until the count stands, and return it."""
        before = -1
        while before != self.count:
            before = self.count
            time.sleep(0.1)
        return before

    def end(self):
        self.over = True
        self.pacer.stop()
        self.thread.join(5)
        assert not self.thread.is_alive()


@pytest.fixture
def ticking():
    ticking = Ticking(100.0)
    yield ticking
    ticking.end()


def reaches(ticking, count):
    end = time.monotonic() + 100
    while ticking.count < count:
        assert time.monotonic() < end
        time.sleep(0.005)


def test_pause_holds_the_run_step_advances_it_by_one_tick_and_resume_lets_it_go_on(ticking):
    reaches(ticking, 5)
    ticking.pacer.pause()
    count = ticking.settled()
    assert not ticking.pacer.running
    for _ in range(3):
        ticking.pacer.step()
    reaches(ticking, count + 3)
    assert ticking.settled() == count + 3
    ticking.pacer.resume()
    assert ticking.pacer.running
    reaches(ticking, count + 20)


def test_run_keeps_no_more_than_its_speed(ticking):
    ticking.pacer.set_speed(0.1)  # six ticks a second
    began = time.monotonic()
    count = ticking.count
    time.sleep(0.6)
    assert ticking.count - count <= 2 + 6 * (time.monotonic() - began)
    assert ticking.pacer.speed == 0.1


def test_order_is_carried_out_between_two_ticks_also_while_the_run_is_paused(ticking):
    ticking.pacer.pause()
    ticking.settled()
    assert ticking.pacer.call(lambda: threading.current_thread() is ticking.thread).result(5)
    with pytest.raises(ValueError, match="robot 3 lives"):
        ticking.pacer.call(lambda: (_ for _ in ()).throw(ValueError("robot 3 lives"))).result(5)


def test_run_that_is_over_takes_no_orders():
    pacer = RunPacer(1.0)
    waiting = pacer.call(lambda: 1)
    pacer.stop()
    for future in (waiting, pacer.call(lambda: 1)):
        with pytest.raises(LookupError, match="the run is over"):
            future.result(5)
    pacer.tick()  # returns at once

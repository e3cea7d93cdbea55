"""Paces a simulated run: lab time follows wall time at a chosen speed, pauses, and advances by single ticks.

The simulation calls `tick` at the end of each tick, in its own thread, which waits here. Orders from other threads are
carried out at that place, between two ticks, so nothing else in the simulation needs a lock.
"""

import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from threading import Condition
from typing import Any

from rmr.base.time import TICK_S

WAIT_S_MAX = 0.2
"""Greatest time of one wait: Ctrl-C is noticed in between."""


class RunPacer:
    """The speed of one run."""

    def __init__(self, speed: float) -> None:
        self._condition = Condition()
        self._speed = speed
        self._paused = False
        self._steps = 0
        self._stopped = False
        self._due = time.monotonic()
        self._orders: deque[tuple[Callable[[], Any], Future[Any]]] = deque()

    @property
    def speed(self) -> float:
        """Lab time over wall time."""
        return self._speed

    @property
    def running(self) -> bool:
        """Whether lab time advances by itself."""
        return not (self._paused or self._stopped)

    def tick(self) -> None:
        """Carry out what was ordered, and wait until the next tick may begin."""
        with self._condition:
            # A quarter of a second is caught up with; a run that cannot keep its speed does not race later.
            self._due = max(self._due + TICK_S / self._speed, time.monotonic() - 0.25)
            while True:
                self._carry_out()
                if self._stopped or self._may_go_on():
                    return
                wait = WAIT_S_MAX if self._paused else min(WAIT_S_MAX, self._due - time.monotonic())
                if wait > 0:
                    self._condition.wait(wait)

    def _may_go_on(self) -> bool:
        if self._steps:
            self._steps -= 1
            return True
        return not self._paused and time.monotonic() >= self._due

    def _carry_out(self) -> None:
        while self._orders:
            order, future = self._orders.popleft()
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(order())
            except Exception as error:  # the order's mistake, for the one who gave it
                future.set_exception(error)

    def call(self, order: Callable[[], Any]) -> Future[Any]:
        """Have `order` carried out between two ticks; the future has its result."""
        future: Future[Any] = Future()
        with self._condition:
            if self._stopped:
                future.set_exception(LookupError("the run is over"))
            else:
                self._orders.append((order, future))
            self._condition.notify()
        return future

    def pause(self) -> None:
        """Stop lab time after the present tick."""
        with self._condition:
            self._paused = True

    def resume(self) -> None:
        """Let lab time go on."""
        with self._condition:
            self._paused = False
            self._due = time.monotonic()
            self._condition.notify()

    def step(self) -> None:
        """Advance by one tick, and pause."""
        with self._condition:
            self._paused = True
            self._steps += 1
            self._condition.notify()

    def set_speed(self, speed: float) -> None:
        """Choose lab time over wall time."""
        with self._condition:
            self._speed = speed
            self._due = time.monotonic()
            self._condition.notify()

    def stop(self) -> None:
        """Never wait again: the run is over, or is to end. Orders that wait are refused."""
        with self._condition:
            self._stopped = True
            while self._orders:
                self._orders.popleft()[1].set_exception(LookupError("the run is over"))
            self._condition.notify()

"""A robot that takes itself to be somewhere is near there."""

from rmr.base.time import Instant, milliseconds
from rmr.node.motion.localiser import MISTAKEN_M
from rmr_sim.checkers.run_view import RunView

EVERY = milliseconds(100)
"""Period of the check."""


class PositionChecker:
    """Compares each robot's estimate of its position with the truth, ten times a second."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._look_at: Instant = 0
        self._mistaken: set[int] = set()
        """Robots whose estimate was wrong at the last look: that is told once."""

    def __call__(self, now: Instant) -> None:
        """Check all robots that live."""
        if now < self._look_at:
            return
        self._look_at = now + EVERY
        for robot in self._view.robots:
            off_m = self._view.off_m(robot)
            if off_m <= MISTAKEN_M:
                self._mistaken.discard(robot)
            elif robot not in self._mistaken:
                self._mistaken.add(robot)
                self._view.violate(now, "position", (robot,), f"robot {robot} is mistaken: {self._view.mistake(robot)}")

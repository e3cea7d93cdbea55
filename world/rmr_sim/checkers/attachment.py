"""The list of all checkers, and their attachment to a run; here are those that only look at the physics.

No robot touches another one, an obstacle or a wall, and a robot that takes itself to be somewhere is near there.
"""

from rmr.base.time import Instant, milliseconds
from rmr.node.motion.localiser import MISTAKEN_M
from rmr_sim.checkers.coordination_checkers import DeadlineChecker, LeaderChecker, ScheduleChecker
from rmr_sim.checkers.delivery_checker import DeliveryChecker
from rmr_sim.checkers.passage_checker import PassageChecker
from rmr_sim.checkers.progress_checker import ProgressChecker
from rmr_sim.checkers.run_view import RunView
from rmr_sim.simulation import Simulation
from rmr_sim.violation import CONTACT

LOOK_EVERY = milliseconds(100)
"""Period with which positions are checked."""


class ContactChecker:
    """Checks the contacts of the physics."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._contacts = view.simulation.world.contacts
        self._seen = 0

    def __call__(self, _now: Instant) -> None:
        """Check the contacts since the last call."""
        if len(self._contacts) == self._seen:
            return
        for contact in self._contacts[self._seen :]:
            robots = (contact.robot,) if contact.other is None else (contact.robot, contact.other)
            other = "an obstacle or a wall" if contact.other is None else f"robot {contact.other}"
            x = round(contact.x, 2) + 0.0
            y = round(contact.y, 2) + 0.0  # no negative zero
            words = f"robot {contact.robot} touched {other} at ({x:.2f}, {y:.2f})"
            mistakes = [f"robot {robot}: {said}" for robot in robots if (said := self._view.mistake(robot))]
            words = "; ".join([words, *mistakes])
            self._view.violate(contact.at, CONTACT, robots, words)
        self._seen = len(self._contacts)


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
        self._look_at = now + LOOK_EVERY
        for robot in self._view.robots:
            off_m = self._view.off_m(robot)
            if off_m <= MISTAKEN_M:
                self._mistaken.discard(robot)
            elif robot not in self._mistaken:
                self._mistaken.add(robot)
                self._view.violate(now, "position", (robot,), f"robot {robot} is mistaken: {self._view.mistake(robot)}")


CHECKERS = (
    ContactChecker,
    PassageChecker,
    ScheduleChecker,
    LeaderChecker,
    DeadlineChecker,
    DeliveryChecker,
    ProgressChecker,
    PositionChecker,
)


def attach_checkers(simulation: Simulation) -> None:
    """Attach all checkers to `simulation` before it begins; they append to its `violations`."""
    view = RunView(simulation)
    simulation.checkers += [checker(view) for checker in CHECKERS]

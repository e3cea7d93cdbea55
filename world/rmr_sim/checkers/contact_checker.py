"""No robot touches another one, an obstacle or a wall."""

from rmr.base.time import Instant
from rmr_sim.checkers.run_view import RunView
from rmr_sim.violation import CONTACT


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

"""The rules that every simulated run must keep, looked at after each tick.

A checker sees what no robot does: all of them, and the truth of the physics. It only looks, so a run is the same with
and without it, and it keeps little, so that long runs cost no more than short ones.
"""

from rmr.base.time import Instant
from rmr_sim.simulation import Simulation
from rmr_sim.violation import CONTACT, Violation


def watch(simulation: Simulation) -> None:
    """Let all checkers look at `simulation`; what they find stands in its `violations`."""
    simulation.observers += [Contacts(simulation)]


class Contacts:
    """No robot touches another one, an obstacle or a wall."""

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._seen = 0

    def __call__(self, _now: Instant) -> None:
        """Look at the contacts since the last look."""
        contacts = self._simulation.world.contacts
        if len(contacts) == self._seen:
            return
        for contact in contacts[self._seen :]:
            robots = (contact.robot,) if contact.other is None else (contact.robot, contact.other)
            other = "an obstacle or a wall" if contact.other is None else f"robot {contact.other}"
            where = f"at ({contact.x:.2f}, {contact.y:.2f})"
            words = f"robot {contact.robot} touched {other} {where}"
            self._simulation.violations.append(Violation(contact.at, CONTACT, robots, words))
        self._seen = len(contacts)

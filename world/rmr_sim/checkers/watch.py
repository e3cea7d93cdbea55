"""All checkers of a run, in one place."""

from rmr_sim.checkers.contacts import Contacts
from rmr_sim.checkers.deadlines import Deadlines
from rmr_sim.checkers.deliveries import Deliveries
from rmr_sim.checkers.leaders import Leaders
from rmr_sim.checkers.passages import Passages
from rmr_sim.checkers.progress import StandsStill
from rmr_sim.checkers.scene import Scene
from rmr_sim.checkers.schedules import Schedules
from rmr_sim.simulation import Simulation

CHECKERS = (Contacts, Passages, Schedules, Leaders, Deadlines, Deliveries, StandsStill)


def watch(simulation: Simulation) -> None:
    """Let all checkers look at `simulation`, which has not begun; what they find stands in its `violations`."""
    scene = Scene(simulation)
    simulation.checkers += [checker(scene) for checker in CHECKERS]

"""All checkers of a run, in one place."""

from rmr_sim.checkers.contact_checker import Contacts
from rmr_sim.checkers.deadline_checker import Deadlines
from rmr_sim.checkers.delivery_checker import Deliveries
from rmr_sim.checkers.leader_checker import Leaders
from rmr_sim.checkers.passage_checker import Passages
from rmr_sim.checkers.progress_checker import StandsStill
from rmr_sim.checkers.run_view import Scene
from rmr_sim.checkers.schedule_checker import Schedules
from rmr_sim.simulation import Simulation

CHECKERS = (Contacts, Passages, Schedules, Leaders, Deadlines, Deliveries, StandsStill)


def watch(simulation: Simulation) -> None:
    """Let all checkers look at `simulation`, which has not begun; what they find stands in its `violations`."""
    scene = Scene(simulation)
    simulation.checkers += [checker(scene) for checker in CHECKERS]

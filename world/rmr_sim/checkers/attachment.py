"""The list of all checkers, and their attachment to a run."""

from rmr_sim.checkers.contact_checker import ContactChecker
from rmr_sim.checkers.deadline_checker import DeadlineChecker
from rmr_sim.checkers.delivery_checker import DeliveryChecker
from rmr_sim.checkers.leader_checker import LeaderChecker
from rmr_sim.checkers.passage_checker import PassageChecker
from rmr_sim.checkers.position_checker import PositionChecker
from rmr_sim.checkers.progress_checker import ProgressChecker
from rmr_sim.checkers.run_view import RunView
from rmr_sim.checkers.schedule_checker import ScheduleChecker
from rmr_sim.simulation import Simulation

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

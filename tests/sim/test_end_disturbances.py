"""Disturbances that were added to a simulated run can be ended; those of the lab stay."""

from dataclasses import replace

from rmr.base.time import NEVER, seconds
from rmr.radio.links import Disturbance
from rmr_sim.event import Event
from rmr_sim.run_setup import Options, load
from rmr_world.provided_labs import labs_folder


class Clear(Event):
    def callback(self, simulation):
        simulation.end_disturbances()


def received(*, cleared: bool, given: bool) -> int:
    """Return the frames received within 3 s of a lab whose frames are all lost from the start on."""
    lost = Disturbance(0, NEVER, loss=1.0)
    loaded = load(labs_folder() / "corridor", Options(robots=2, duration=seconds(3)))
    if given:
        loaded = replace(loaded, lab=replace(loaded.lab, disturbances=(lost,)))
    simulation = loaded.simulation()
    if not given:
        simulation.disturb(lost)
    if cleared:
        simulation.schedule(Clear(seconds(1)))
    simulation.run()
    return sum(part["frames"]["received"] for part in simulation.robot_parts().values())


def test_added_disturbance_ends_and_that_of_the_lab_stays():
    assert received(cleared=False, given=False) == 0
    assert received(cleared=True, given=False) > 0
    assert received(cleared=True, given=True) == 0

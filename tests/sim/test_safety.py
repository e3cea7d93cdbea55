"""What keeps robots from touching, and gets them home, when radio, minds or bodies fail."""

from pathlib import Path

import pytest
from lab_maker import small_lab

from rmr.base.geometry import distance
from rmr.base.time import milliseconds, seconds
from rmr.radio.links import partition
from rmr_sim.event import Event
from rmr_sim.run_setup import prepare

pytestmark = pytest.mark.medium

LABS = Path(__file__).parents[2] / "deploy" / "labs"
GO = """
type action goto(R: robot, X: float, Y: float) -o there(R).
goal(@1, 1.1, 1.2). goal(@2, 0.2, 1.2).
goal(R, X, Y) -o goto(R, X, Y).
"""
HOME = """
type action moveto(robot, area).
type sensor at(robot, area).
go(R).
go(R) -o moveto(R, exit).
"""


class Push(Event):
    """Somebody moves robot 1 aside."""

    def callback(self, simulation):
        robot = simulation.world._robots[1]
        robot.y -= 0.2
        robot.rolled, robot.free_until_m = True, 0.0


def crossing(folder, *, cut):
    """Return the run of two robots whose ways cross; with `cut` they do not hear each other from the first second."""
    simulation = small_lab(folder, GO, robots=2, finish="there(R)", duration="40s")
    if cut:
        simulation.disturb(partition(((1,), (2,)), seconds(1), seconds(7)))
    return simulation


def test_robots_without_radio_contact_stop_until_it_returns(tmp_path):
    simulation = crossing(tmp_path, cut=True)
    stood = {}
    simulation.observers.append(
        lambda now: stood.update({now: [robot.node.driver.speed == 0 for robot in simulation.robots]})
    )
    assert simulation.run()
    assert simulation.world.collisions == 0
    assert all(all(still) for now, still in stood.items() if milliseconds(5500) < now < seconds(7))


def test_working_radio_lets_robots_cross_without_stopping(tmp_path):
    simulation = crossing(tmp_path, cut=False)
    assert simulation.run()
    assert simulation.time_s < 15
    assert simulation.world.collisions == 0


@pytest.mark.parametrize("seed", [5, 6])
def test_a_corridor_in_two_parts_comes_together_again_without_a_touch(seed):
    simulation = prepare(LABS / "corridor", seed=seed)
    simulation.disturb(partition(((1, 2, 3), (4, 5, 6)), seconds(3), seconds(6)))
    assert simulation.run()
    assert simulation.world.collisions == 0


def test_robots_that_want_each_others_places_make_room_and_swap(tmp_path):
    swap = GO.replace("@1, 1.1, 1.2", "@1, 0.5, 0.2").replace("@2, 0.2, 1.2", "@2, 0.2, 0.2")
    simulation = small_lab(tmp_path, swap, robots=2, finish="there(R)", duration="60s")
    assert simulation.run()
    assert simulation.world.collisions == 0


def test_a_robot_that_is_pushed_out_of_its_place_goes_back(tmp_path):
    lab = (LABS / "testbed" / "lab.yaml").read_text().replace("testbed.rmr", "home.rmr").replace("at(R, exit)", "")
    (tmp_path / "lab.yaml").write_text(
        "\n".join(line for line in lab.split("\n") if "due(" not in line and "facts:" not in line)
    )
    (tmp_path / "home.rmr").write_text(HOME)
    simulation = prepare(tmp_path, seed=1, robots=1, events=[Push(seconds(20))])
    away = []

    def look(now):
        pose, place = simulation.world.pose(1), simulation.robots[0].node.driver.place
        if now >= seconds(20) + milliseconds(500) and place is not None:
            away.append(distance(pose.x, pose.y, *place))

    simulation.observers.append(look)
    simulation.run()
    assert away[0] > 0.08
    assert away[-1] < 0.04


def test_stalled_robot_treats_queued_beacons_as_old(tmp_path):
    simulation = crossing(tmp_path, cut=False)
    ages = []

    class Wake(Event):
        def callback(self, simulation):
            peer = simulation.robots[0].node.peers.known[2]
            ages.append(simulation.now - peer.hello_at)

    class Stall(Event):
        def callback(self, simulation):
            simulation.stall(1, seconds(4))

    simulation.schedule(Stall(seconds(2)))
    simulation.schedule(Wake(seconds(4) + milliseconds(2)))
    assert simulation.run()
    assert ages[0] >= seconds(2)

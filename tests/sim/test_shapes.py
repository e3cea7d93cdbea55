"""Robots that are faster or larger than the reference robot change sides, and touch nothing."""

from random import Random

import pytest
from shape_labs import PROGRAM, shape_lab

from rmr.base.geometry import distance
from rmr.base.time import in_seconds
from rmr_sim.run_setup import prepare

CROSSING = """
lab: fast
program: fast.rmr
duration: 60s
finish: there(R)
arena: {{size: [4.0, 2.0]}}
areas: {{r1: {{at: [3.7, 0.5]}}, r2: {{at: [3.7, 1.5]}}, l1: {{at: [0.3, 0.5]}}, l2: {{at: [0.3, 1.5]}}}}
robots:
  - {{id: 1, pose: [0.3, 0.5, 0deg]}}
  - {{id: 2, pose: [0.3, 1.5, 0deg]}}
  - {{id: 3, pose: [3.7, 0.5, 180deg]}}
  - {{id: 4, pose: [3.7, 1.5, 180deg]}}
facts: ["goes(@1, r2)", "goes(@2, r1)", "goes(@3, l2)", "goes(@4, l1)"]
robot: {{speed: {speed}}}
localisation: {{beacons: [[0, 0], [4.0, 0]]}}
"""
"""Four robots cross in the middle. With a view of 25 cm they touched at 0.4, 0.5 and 0.7 m/s in seeds 1 to 10: 2, 8 and
21 times."""


def run(folder, lab, seed):
    (folder / "fast.rmr").write_text(PROGRAM)
    (folder / "shapes.rmr").write_text(PROGRAM)
    (folder / "lab.yaml").write_text(lab)
    simulation = prepare(folder, seed=seed)
    return simulation.run(), simulation.world.collisions


@pytest.mark.parametrize(("speed", "seed"), [(0.4, 3), (0.4, 4), (0.5, 1), (0.5, 2), (0.7, 1), (0.7, 2)])
def test_faster_robots_see_each_other_early_enough(tmp_path, speed, seed):
    assert run(tmp_path, CROSSING.format(speed=speed), seed) == (True, 0)


@pytest.mark.parametrize(("radius", "speed", "robots"), [(0.05, 0.7, 3), (0.15, 0.4, 4), (0.15, 1.0, 5), (0.3, 0.4, 4)])
def test_robots_of_any_size_and_speed_change_sides_on_open_floor(tmp_path, radius, speed, robots):
    assert run(tmp_path, shape_lab("crossing", radius, speed, robots, Random(1)), 1) == (True, 0)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_fast_robot_that_brakes_in_a_turn_beside_a_wall_does_not_leave_its_arc(tmp_path, seed):
    assert run(tmp_path, shape_lab("crossing", 0.5, 1.0, 2, Random(9)), seed) == (True, 0)


def test_a_fast_robot_says_how_fast_it_drives_while_it_brakes(tmp_path):
    """It is commanded to stand still, and drives on for half a metre: to others it was a body that stands."""
    (tmp_path / "fast.rmr").write_text(PROGRAM)
    (tmp_path / "lab.yaml").write_text(CROSSING.format(speed=1.0))
    simulation = prepare(tmp_path, seed=1)
    places = {}
    told = []

    def look(now):
        for host in simulation.robots:
            x, y, _ = simulation.world.pose(host.robot)
            x0, y0, then = places.get(host.robot, (x, y, now))
            if now > then:
                driven = distance(x, y, x0, y0) / in_seconds(now - then)
                commanded = host.node.driver.speed
                told.append((driven, commanded, host.node.driver.driven(now)))
            places[host.robot] = x, y, now

    simulation.observers.append(look)
    assert simulation.run()
    brakes = [(driven, said) for driven, commanded, said in told if driven > 0.4 and commanded == 0.0]
    assert brakes
    assert all(said > 0.7 * driven for driven, said in brakes)

"""A robot drives only where it knows its position: mirror images, estimates that are wrong, beacons in any order."""

import math
from pathlib import Path

import pytest
from drawn_beacons import drawn

from rmr.base.geometry import STILL
from rmr.base.time import seconds
from rmr_sim.run_setup import Options, load, report_of
from rmr_world.finding import LabError
from rmr_world.run_warnings import run_warnings

PROGRAM = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
start(R).
start(R) -o moveto(R, goal).
"""
LAB = """
lab: mirror
program: mirror.rmr
duration: 40s
finish: at(R, goal)
arena: {{size: [2.0, 2.0]}}
areas: {{goal: {{at: [0.4, 0.5]}}}}
robots: [{{id: 1, pose: [1.6, 0.7, 180deg]}}]
localisation: {{beacons: {beacons}, dropout: {dropout}}}
"""


def loaded(folder: Path, beacons, dropout=0.0):
    (folder / "mirror.rmr").write_text(PROGRAM)
    lab = folder / "lab.yaml"
    lab.write_text(LAB.format(beacons=[list(each) for each in beacons], dropout=dropout))
    return load(lab, Options())


DIAGONAL = [(0, 0), (2, 2)]
CORNERS = [*DIAGONAL, (2, 0), (0, 2)]


@pytest.mark.parametrize("dropout", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(1, 6))
def test_a_robot_among_four_beacons_never_drives_by_its_mirror_image(tmp_path, seed, dropout):
    simulation = loaded(tmp_path, CORNERS, dropout).simulation(seed)
    off_m = []

    def look(_now):
        pose = simulation.robots[0].node.driver.localiser.pose
        if pose is not None:
            off_m.append(math.dist(pose[:2], simulation.world.pose(1)[:2]))

    simulation.observers.append(look)
    assert simulation.run()
    assert simulation.world.collisions == 0
    assert max(off_m) < 0.05


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_robot_says_where_it_is_as_soon_as_it_knows(tmp_path, seed):
    (tmp_path / "mirror.rmr").write_text(PROGRAM.replace("start(R).\n", "", 1))  # no robot sets out
    text = LAB.format(beacons=[list(each) for each in CORNERS], dropout=0.95)
    lab = tmp_path / "lab.yaml"
    text = text.replace("at: [0.4, 0.5]", "box: [0.2, 0.2, 0.9, 0.9]")
    lab.write_text(text.replace("robots: [", "robots: [{id: 2, pose: [0.4, 1.6, 0deg]}, "))
    simulation = load(lab, Options()).simulation(seed)
    located = {}
    heard = {}

    def look(now):
        for robot in simulation.robots:
            if robot.node.driver.localiser.pose is not None:
                located.setdefault(robot.robot, now)
            for peer, known in robot.node.peers.known.items():
                if known.hello is not None:
                    heard.setdefault(peer, now)
        if len(heard) == 2:
            simulation.stop()

    simulation.observers.append(look)
    simulation.run()
    assert max(located.values()) > seconds(0.5), "later than the first hello is due"
    assert all(heard[robot] < located[robot] + seconds(0.1) for robot in (1, 2))


def test_beacons_in_opposite_corners_alone_are_refused_with_two_places_that_look_alike(tmp_path):
    with pytest.raises(LabError, match=r"localisation.beacons: a robot at .* is as far from both beacons as one at"):
        loaded(tmp_path, DIAGONAL)


def test_a_robot_with_a_mirrored_estimate_stands_locates_itself_and_drives_on(tmp_path):
    simulation = loaded(tmp_path, CORNERS).simulation(1)
    driver = simulation.robots[0].node.driver
    stood = []

    def look(now):
        ekf = driver.localiser._ekf
        if now == seconds(2):
            ekf.x, ekf.y = ekf.y, ekf.x  # the image across the first two beacons' line
        if ekf is None and now > seconds(2):
            stood.append((driver.moving, simulation.world._robots[1].target == STILL))

    simulation.observers.append(look)
    assert simulation.run()
    assert driver.localiser.dropped == 1
    assert stood
    assert not any(moving for moving, _ in stood)
    assert all(still for _, still in stood)
    assert simulation.world.collisions == 0
    assert simulation.time_s < 8.0


def test_a_fast_robot_that_is_commanded_to_stand_has_a_sample_of_each_tick_until_it_does(tmp_path):
    setup = loaded(tmp_path, CORNERS)
    lab = tmp_path / "lab.yaml"
    lab.write_text(lab.read_text() + "robot: {radius: 0.08, speed: 1.5}\n")
    simulation = load(lab, setup.options).simulation(1)
    driver = simulation.robots[0].node.driver
    ages = []

    def look(now):
        if not ages and simulation.world.distance_m(1) > 0.4:
            driver.localiser._search()
            simulation.silence(1, now + seconds(2))
        if driver.localiser.pose is None and 1 in simulation.world.awake:
            ages.append(now - driver._sensed_at)

    simulation.observers.append(look)
    assert simulation.run()
    assert len(ages) > 20, "it braked for a third of a second"
    assert set(ages) == {0}


def test_a_drive_fails_when_the_robot_does_not_find_itself_again(tmp_path):
    simulation = loaded(tmp_path, CORNERS).simulation(1)
    localiser = simulation.robots[0].node.driver.localiser

    def look(now):
        if now == seconds(2):
            localiser._search()
            simulation.silence(1, seconds(100))

    simulation.observers.append(look)
    assert not simulation.run()
    failure = simulation.robots[0].report()["first_failure"]
    assert "does not know any more where it is" in failure[-1]
    assert simulation.world.distance_m(1) < 1.0


def test_a_robot_that_is_mistaken_is_named_with_how_far_off_it_is(tmp_path):
    simulation = loaded(tmp_path, CORNERS).simulation(1)
    driver = simulation.robots[0].node.driver

    def look(now):
        ekf = driver.localiser._ekf
        if now == seconds(1):
            simulation.silence(1, seconds(100))  # nothing contradicts the estimate
            ekf.x, ekf.y = ekf.y, ekf.x

    simulation.observers.append(look)
    simulation.run()
    report = report_of(simulation, False)
    told = {each["check"]: each["words"] for each in report["violations"]}
    assert "robot 1 is mistaken: its estimate is (" in told["position"]
    assert "robot 1: its estimate is (" in told["contact"]
    assert report["robots"]["1"]["off_m"] > 0.2
    assert any("was mistaken about its position" in line for line in run_warnings(report))


@pytest.mark.parametrize("seed", range(1, 31))
def test_wherever_beacons_stand_the_estimate_is_near_or_the_lab_is_refused(seed, tmp_path):
    assert drawn(seed, tmp_path).is_right

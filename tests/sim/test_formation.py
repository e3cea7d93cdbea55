"""Formation control (paper V.C, figure 13): each shape stands, by the world's own measure, before the next is begun."""

import math
from itertools import combinations, pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

from rmr.base.time import seconds
from rmr_sim.event import Event
from rmr_sim.run_setup import prepare, report_of
from rmr_sim.simulation import Simulation
from rmr_world.fact_syntax import parse_fact

pytestmark = pytest.mark.medium

FORMATION = Path(__file__).parents[2] / "deploy" / "labs" / "formation"
SHAPES = 4
TOLERANCE_M = 0.03


class Reach(NamedTuple):
    """One straight drive of one robot, as the trace tells of it."""

    robot: int
    ends: str
    """The instant of its end names the round."""
    since_s: float
    until_s: float


def formation(file: str, seed: int = 1, **options) -> Simulation:
    return prepare(FORMATION / file, seed=seed, **options)


def shapes(simulation: Simulation) -> dict[int, list[tuple[float, float]]]:
    stated = [parse_fact(fact) for fact in simulation.lab.facts]
    return {fact.args[0]: fact.args[1] for fact in stated if fact.name == "shape"}


def reaches(simulation: Simulation) -> list[list[Reach]]:
    """Return the drives of all robots, round by round."""
    begun, rounds = {}, {}
    for entry in simulation.trace():
        text = entry.get("action", "")
        if entry["what"] == "action" and text.startswith("reach"):
            begun[entry["robot"]] = entry["t"]
        elif entry["what"] == "action_ended" and text.startswith("reach"):
            assert entry["failure"] is None
            drive = Reach(entry["robot"], text.split(", ")[-1], begun.pop(entry["robot"]), entry["t"])
            rounds.setdefault(drive.ends, []).append(drive)
    assert not begun
    return list(rounds.values())


def watch_orders(simulation: Simulation) -> list[list[tuple[float, float]]]:
    """Return a list that will hold where the robots are, by the world, whenever a round begins, and at the end."""
    poses, orders = [], [0]

    def observe(_now):
        most = max(sum("reach" in text for _, text in robot.node.services.action_log) for robot in simulation.robots)
        if most > orders[0] or all(robot.finished() for robot in simulation.robots):
            orders[0] = most
            poses.append([simulation.world.pose(robot.robot)[:2] for robot in simulation.robots])

    simulation.observers.append(observe)
    return poses


def assert_on_places(poses, places):
    nearest = [min(range(len(places)), key=lambda k, pose=pose: math.dist(pose, places[k])) for pose in poses]
    assert len(set(nearest)) == len(poses), "each on a place of its own"
    assert max(math.dist(pose, places[k]) for pose, k in zip(poses, nearest, strict=True)) < TOLERANCE_M


def assert_apart(before, after):
    """No two could exchange their places and lessen the sum of the squared ways: straight ways keep apart."""
    for (a, b), (p, q) in zip(combinations(before, 2), combinations(after, 2), strict=True):
        assert sum((a[k] - b[k]) * (p[k] - q[k]) for k in range(2)) > -0.02


class Befalls(Event):
    """Something that befalls a robot."""

    def __init__(self, instant, befall, robot):
        super().__init__(instant)
        self.befall, self.robot = befall, robot

    def callback(self, _simulation):
        self.befall(self.robot)


def at(simulation, time_s, befall, robot):
    simulation.schedule(Befalls(seconds(time_s), befall, robot))


@pytest.mark.parametrize(("file", "within_s"), [("lab.yaml", 15.0), ("nine.yaml", 22.0)])
def test_each_shape_stands_before_the_next_is_begun(file, within_s):
    simulation = formation(file)
    poses = watch_orders(simulation)
    assert simulation.run()
    rounds = reaches(simulation)
    assert [len(drives) for drives in rounds] == [len(simulation.robots)] * SHAPES
    for last, following in pairwise(rounds):
        assert max(drive.until_s for drive in last) <= min(drive.since_s for drive in following)
    for index, places in shapes(simulation).items():
        assert_on_places(poses[index], places)
        assert_apart(poses[index - 1], poses[index])
    report = report_of(simulation, True)
    count = SHAPES * len(simulation.robots)
    assert report["deadlines"] == {"met": count, "missed": 0, "best_possible": count}
    assert report["collisions"] == 0
    assert report["time_s"] <= within_s


def test_the_barrier_holds_where_a_fifth_of_all_frames_is_lost():
    simulation = formation("lab.yaml", seed=3, loss=0.2)
    assert simulation.run()
    rounds = reaches(simulation)
    for last, following in pairwise(rounds):
        assert max(drive.until_s for drive in last) <= min(drive.since_s for drive in following)
    assert report_of(simulation, True)["collisions"] == 0


@pytest.mark.parametrize("from_s", [10.629352817, 4.0, 9.0])
def test_shapes_are_formed_after_30_s_without_any_radio(tmp_path, from_s):
    """In the first case an answer to the captain is first sent as the silence begins (seed 8202)."""
    lab = (FORMATION / "lab.yaml").read_text("utf-8").replace("duration: 120s", "duration: 300s")
    faults = f"faults:\n  - {{from: {from_s}s, to: {from_s + 30}s, loss: 1.0}}\n"
    (tmp_path / "lab.yaml").write_text(lab + faults, "utf-8")
    (tmp_path / "formation.rmr").write_text((FORMATION / "formation.rmr").read_text("utf-8"), "utf-8")
    simulation = prepare(tmp_path / "lab.yaml", seed=8202)
    assert simulation.run()
    report = report_of(simulation, True)
    assert report["collisions"] == 0
    assert [robot["undelivered"] for robot in report["robots"].values()] == [0] * 4


def test_three_of_the_robots_form_the_shapes_too():
    simulation = formation("lab.yaml", robots=3)
    assert simulation.run()


@pytest.mark.parametrize("robot", [1, 3])
def test_restarted_robot_receives_its_destination_again(robot):
    """The captain among them: it asks the others where they stand."""
    simulation = formation("lab.yaml")
    at(simulation, 4.0, simulation.kill, robot)
    at(simulation, 6.0, simulation.restart, robot)
    poses = watch_orders(simulation)
    assert simulation.run()
    assert_on_places(poses[-1], shapes(simulation)[SHAPES])
    assert report_of(simulation, True)["collisions"] == 0


def test_barrier_waits_for_a_dead_robot_and_the_shape_is_reported_late():
    simulation = formation("lab.yaml")
    at(simulation, 4.0, simulation.kill, 3)
    at(simulation, 16.0, lambda _: simulation.stop(), 3)
    assert not simulation.run()
    report = report_of(simulation, False)
    for robot in ("1", "2", "4"):
        jobs = report["robots"][robot]["assertions"]
        assert len([job for job in jobs if job["met"] is False]) == 1
        assert f"standing(@{robot}, 4)" not in [job["job"] for job in jobs], "nobody stands in the third shape"

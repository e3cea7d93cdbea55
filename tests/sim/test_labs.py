"""The two labs hold what they promise: everybody through, in the order of deadlines, nobody touched."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from rmr_sim.run_setup import prepare, report_of
from rmr_world.fact_syntax import parse_fact

LABS = Path(__file__).parents[2] / "deploy" / "labs"
BOUND_FACTOR = {"corridor": 2.0, "testbed": 1.7}


def run(lab: str, seed: int, **options: Any) -> dict[str, Any]:
    simulation = prepare(LABS / lab, seed=seed, **options)
    report = report_of(simulation, simulation.run())
    report["due"] = {fact.owner: fact.args[0] for fact in map(parse_fact, simulation.lab.facts)}
    return report


def by_finish(report: dict[str, Any]) -> list[int]:
    return sorted(map(int, report["robots"]), key=lambda robot: report["robots"][str(robot)]["finish_s"])


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("lab", ["corridor", "testbed"])
def test_six_robots_finish_in_the_order_of_their_deadlines_without_contact(lab, seed):
    report = run(lab, seed)
    assert report["finished"]
    assert report["collisions"] == 0
    assert report["deadlines"] == {"met": 6, "missed": 0, "best_possible": 6}
    assert by_finish(report) == sorted(report["due"], key=report["due"].get)
    assert report["time_s"] <= BOUND_FACTOR[lab] * report["bound_s"]
    assert report["violations"] == []


@pytest.mark.parametrize("lab", ["corridor", "testbed"])
def test_both_labs_finish_at_20_percent_frame_loss(lab):
    report = run(lab, 5, loss=0.2)
    assert report["finished"]
    assert report["violations"] == []
    assert report["collisions"] == 0


@pytest.mark.parametrize("robots", [1, 2, 3, 4, 5])
def test_the_test_bed_takes_one_to_six_robots(robots):
    report = run("testbed", 4, robots=robots)
    assert report["finished"]
    assert report["collisions"] == 0
    assert len(report["robots"]) == robots
    assert report["deadlines"]["missed"] == 0


def test_one_leader_makes_one_schedule_in_the_order_of_the_deadlines():
    report = run("corridor", 7)
    (schedule,) = report["schedule"]
    assert schedule["event"] == "crossing"
    assert schedule["leader"] in schedule["order"] or schedule["leader"] in report["due"]
    assert schedule["formed_s"] < report["time_s"]


def test_robots_line_up_in_their_turn_before_they_pass():
    simulation = prepare(LABS / "corridor", seed=7)
    simulation.run()
    for robot in simulation.robots:
        names = [text.split("(")[0] for _, text in robot.node.services.action_log]
        assert names[-1] == "moveto"
        assert set(names[:-1]) == {"lineup"}


@pytest.mark.slow
def test_equal_seeds_give_equal_octets_whatever_the_hash_seed(tmp_path):
    octets = []
    for hash_seed in ("1", "2"):
        folder = tmp_path / hash_seed
        command = [sys.executable, "-m", "rmr_sim.main", str(LABS / "testbed"), "--seed", "7", "--run", str(folder)]
        environment = {**os.environ, "PYTHONHASHSEED": hash_seed}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=100)
        assert done.returncode == 0, done.stderr
        octets.append((folder / "report.json").read_bytes())
    assert octets[0] == octets[1]
    other = run("testbed", 8)
    assert json.loads(octets[0])["robots"] != other["robots"], "another seed is another run"

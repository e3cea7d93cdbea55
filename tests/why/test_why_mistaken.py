"""`rmr why` and the report name localisation where a robot was mistaken about its position."""

import pytest
from command_runner import invoke

from rmr.base.geometry import Point
from rmr_deploy.why_program import why_command
from rmr_sim.main import main as simulate
from rmr_world import physics

pytestmark = pytest.mark.medium

LAB = """
lab: mistaken
program: mistaken.rmr
duration: 12s
finish: at(R, goal)
arena: {size: [3.0, 2.0]}
areas: {goal: {at: [2.5, 0.5]}}
robots: [{id: 1, pose: [0.3, 0.5, 0deg]}]
localisation: {beacons: [[0, 0], [3, 0]]}
"""
PROGRAM = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
start(R).
driven: assert(start(R), at(R, goal), 7, broadcast(R)).
start(R) -o moveto(R, goal).
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A robot that hears beacons which stand half a metre beside where the lab says."""
    folder = tmp_path_factory.mktemp("mistaken")
    (folder / "lab.yaml").write_text(LAB)
    (folder / "mistaken.rmr").write_text(PROGRAM)

    class Misplaced(physics.Sensors):
        def __init__(self, rng, beacons, *settings):
            super().__init__(rng, tuple(Point(x - 0.6, y) for x, y in beacons), *settings)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physics, "Sensors", Misplaced)
        simulate([str(folder / "lab.yaml"), "--run", str(folder / "run")])
    return folder / "run"


def why(*words):
    return invoke(why_command(), [str(word) for word in words], name="rmr why").stdout


def test_the_time_of_a_drive_by_a_wrong_estimate_belongs_to_localisation(run):
    text = why(run, "--missed")
    assert "localisation" in text
    assert "its estimate was 0.6 m off" in why(run, "--missed", "driven@1", "--timeline")


def test_the_answer_why_a_fact_does_not_hold_says_how_far_off_the_estimate_is(run):
    text = why(run, "--not", "at(@1, goal)")
    assert "localisation: robot 1 was mistaken about its position: at the end its estimate was 0.6" in text

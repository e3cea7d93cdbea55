"""The default depth of view, and what `rmr check` says of robots that cannot see each other early enough."""

import pytest
from world_labs import complaints, lab_of

from rmr_world.lab_program import load_lab_program, validated

LAB = """
lab: shapes
program: shapes.rmr
duration: 60s
arena: {{size: [20.0, 20.0]}}
robots:
  - {{id: 1, pose: [2, 2, 0deg]}}
  - {{id: 2, pose: [6, 6, 0deg]}}
robot: {robot}
"""


def warnings(folder, robot):
    (folder / "shapes.rmr").write_text("type !go(robot).\n")
    lab = lab_of(folder, LAB.format(robot=robot))
    return [line for line in validated(lab, load_lab_program(lab)).warnings.splitlines() if "robot." in line]


@pytest.mark.parametrize(
    ("robot", "depth"),
    [("{}", 0.25), ("{speed: 0.5}", 0.703), ("{radius: 0.15, speed: 0.5}", 0.783), ("{speed: 2.0}", 6.341)],
)
def test_the_depth_of_view_follows_from_radius_and_speed(tmp_path, robot, depth):
    assert lab_of(tmp_path, LAB.format(robot=robot)).arena.shape.view_depth == pytest.approx(depth, abs=0.001)


def test_a_depth_that_is_given_is_kept(tmp_path):
    assert lab_of(tmp_path, LAB.format(robot="{speed: 0.5, view: {depth: 0.9}}")).arena.shape.view_depth == 0.9


def test_robots_that_cannot_stop_within_their_view_are_an_error(tmp_path):
    (found,) = complaints(tmp_path, LAB.format(robot="{speed: 0.5, view: {depth: 0.25}}"))
    assert "robot.view.depth: at 0.5 m/s a robot needs 0.21 m to stand" in found
    assert "0.54 m are the least, 0.70 m the default" in found


def test_robots_that_see_each_other_late_are_warned_of(tmp_path):
    (found,) = warnings(tmp_path, "{speed: 0.5, view: {depth: 0.6}}")
    assert "need 0.70 m to notice each other and stop: leave the key out" in found


@pytest.mark.parametrize(("robot", "words"), [("{radius: 0.6}", "up to 0.5 m;"), ("{speed: 1.5}", "up to 1 m/s;")])
def test_robots_outside_of_the_envelope_are_warned_of(tmp_path, robot, words):
    (found,) = warnings(tmp_path, robot)
    assert words in found


@pytest.mark.parametrize("robot", ["{}", "{radius: 0.05, speed: 0.05}", "{radius: 0.5, speed: 1.0}"])
def test_robots_inside_of_the_envelope_are_not(tmp_path, robot):
    assert warnings(tmp_path, robot) == []


STATION = "areas: {dock: {at: [19, 19]}}\nstations: [dock]\n"


@pytest.mark.parametrize(
    ("more", "warned"),
    [
        (STATION, True),
        (STATION + "radio: {tx_power_dbm: 12}\n", False),
        (STATION.replace("stations: [dock]\n", ""), False),
    ],
)
def test_turns_on_a_floor_wider_than_the_radio_reaches_are_warned_of(tmp_path, more, warned):
    (tmp_path / "shapes.rmr").write_text("type action moveto(robot, area).\nstart(R) -o moveto(R, dock).\n")
    lab = lab_of(tmp_path, LAB.format(robot="{}") + more)
    found = [line for line in validated(lab, load_lab_program(lab)).warnings.splitlines() if "radio" in line]
    assert bool(found) is warned
    if warned:
        assert "radio: warning: this floor is 28 m across, and the radio reaches 19 m" in found[0]
        assert "`tx_power_dbm: 12` surely reaches over the whole floor" in found[0]

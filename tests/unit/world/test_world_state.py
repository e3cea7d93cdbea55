"""The folder of a durable world: what it holds, and what it refuses."""

import json
from pathlib import Path

import pytest

from rmr.base.geometry import Twist
from rmr.base.time import seconds, tick_start
from rmr_world.incarnation_claims import IncarnationClaims
from rmr_world.lab_file import load_lab
from rmr_world.lab_time import LabTime
from rmr_world.physics import World
from rmr_world.world_messages import map_of
from rmr_world.world_state import STATE, WorldFolder, WorldStateError

LAB = load_lab(Path(__file__).parents[3] / "deploy" / "labs" / "testbed" / "lab.yaml")
KNOWN = map_of(LAB, 1)


def written(path, physics):
    """Write the state of a world with these bodies, and return what a later one reads."""
    rest = {"run": 7, "runs": True, "tick": 60, "here": [1], "lives": [], "added": [], "late": 2, "set_back": 0}
    folder = WorldFolder(path, KNOWN)
    folder.write(rest | physics.kept())
    folder.close()
    return json.loads((path / STATE).read_text())


def driven():
    physics = World(LAB, 1)
    for tick in range(60):
        physics.act(1, Twist(0.1, 0.3), tick_start(tick), tick_start(tick))
        physics.step(tick_start(tick + 1))
    return physics


def test_bodies_and_encoders_are_where_they_were_and_stand(tmp_path):
    before = driven()
    written(tmp_path / "a", before)
    held = WorldFolder(tmp_path / "b", KNOWN)
    assert held.held is None, "a new folder holds nothing"
    (tmp_path / "b" / STATE).write_bytes((tmp_path / "a" / STATE).read_bytes())
    after = World(LAB, 1)
    after.bring_back(66, held._read())
    for robot in LAB.roster:
        assert after.pose(robot) == before.pose(robot)
        assert after.distance_m(robot) == before.distance_m(robot)
        now, old = after.sense(robot, tick_start(66)), before.sense(robot, tick_start(60))
        assert (now.left_m, now.right_m, now.truth) == (old.left_m, old.right_m, old.truth)
    assert after.min_gap_m == before.min_gap_m
    after.step(tick_start(67))
    assert after.pose(1) == before.pose(1)


def test_a_robot_keeps_its_lives_and_a_new_one_knows_when_the_last_had_ended():
    before = IncarnationClaims()
    for token in (5, 6):
        before.claim(1, token, 0.0, alive=False)
        before.release(1)
    after = IncarnationClaims()
    after.bring_back(json.loads(json.dumps(before.kept())), seconds(3))
    assert after.claim(1, 6, 0.0, alive=False)
    assert after.life(1, 6) == before.life(1, 6)
    after.release(1)
    assert after.claim(1, 7, 0.0, alive=False)
    assert after.life(1, 7) == (2, seconds(3.5))


def test_lab_time_stands_until_it_goes_on():
    lab_time = LabTime()
    lab_time.stand(seconds(5))
    assert (lab_time.state, lab_time.at(seconds(100))) == ("running", seconds(5))
    lab_time.go_on(seconds(100))
    assert lab_time.at(seconds(101)) == seconds(6)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda _: b"\xff{", "no state of a world (not JSON)"),
        (lambda _: b"[]", "no state of a world (expected a record)"),
        (lambda held: json.dumps({**held, "tick": -1}).encode(), "no state of a world (expected a count)"),
        (lambda held: json.dumps({**held, "version": 2}).encode(), "of another version of rmr"),
    ],
)
def test_what_is_no_state_is_refused_with_the_way_out(tmp_path, change, why):
    held = written(tmp_path, World(LAB, 1))
    (tmp_path / STATE).write_bytes(change(held))
    with pytest.raises(WorldStateError) as caught:
        WorldFolder(tmp_path, KNOWN)
    assert f"{tmp_path / STATE}: {why}" in str(caught.value)
    assert str(caught.value).endswith("begin anew with an empty folder")


@pytest.mark.parametrize("other", [map_of(LAB, 2), map_of(LAB.with_robots(2), 1)])
def test_state_of_another_lab_or_seed_is_refused(tmp_path, other):
    written(tmp_path, World(LAB, 1))
    with pytest.raises(WorldStateError, match="of another lab, seed or number of robots than this world's"):
        WorldFolder(tmp_path, other)

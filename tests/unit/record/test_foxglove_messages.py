"""Messages are valid under Foxglove's schemas, which are those of their package."""

import base64
import hashlib
import json
import math
import re
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

import rmr.record
from rmr.base.arena import Area, Arena, Disc, Polygon
from rmr.base.geometry import Point
from rmr.record.channels import CHANNELS, schema_of
from rmr.record.foxglove_messages import grid, heading_of, log_message, scene, transforms_json

FOLDER = Path(rmr.record.__file__).with_name("foxglove")
FLOOR = Arena(
    1.0,
    0.5,
    0.1,
    obstacles=(
        Disc(Point(0.85, 0.25), 0.04),
        Polygon((Point(0.2, 0.0), Point(0.4, 0.0), Point(0.4, 0.3), Point(0.2, 0.3))),
    ),
    areas=(
        Area("exit", (Point(0.9, 0.1),), slotted=True),
        Area("door", (Point(0.5, 0.4),), box=(0.4, 0.3, 0.6, 0.5), queue=(Point(0.5, 0.4), Point(0.6, 0.4))),
    ),
    beacons=(Point(0.0, 0.0),),
)


def valid(topic: str, message: object) -> None:
    _, schema = schema_of(topic)
    Draft7Validator(json.loads(schema)).validate(json.loads(json.dumps(message)))


@pytest.mark.parametrize("name", ["FrameTransforms", "Grid", "Log", "SceneUpdate"])
def test_a_schema_is_the_one_of_the_package(name):
    readme = (FOLDER / "README.md").read_text()
    found = re.search(rf"{name}\.json \| ([0-9a-f]{{64}})", readme)
    assert found is not None
    assert hashlib.sha256((FOLDER / f"{name}.json").read_bytes()).hexdigest() == found[1]


def test_the_licence_of_the_schemas_comes_with_them():
    assert "MIT License" in (FOLDER / "LICENSE").read_text()


def test_a_scene_is_valid_and_has_every_part_of_the_arena():
    update = scene(FLOOR, (1, 2))
    valid("/scene", update)
    assert [entity["id"] for entity in update["entities"]] == ["arena", "area/exit", "area/door", "robot/1", "robot/2"]
    assert [entity["frame_id"] for entity in update["entities"][3:]] == ["robot/1", "robot/2"]


def test_a_grid_marks_the_cells_of_obstacles():
    found = grid(FLOOR)
    valid("/floor", found)
    cells = base64.b64decode(found["data"])
    rows = ["".join(map(str, cells[at : at + 10])) for at in range(0, 50, 10)]
    assert rows == ["0011000000", "0011000000", "0011000010", "0000000000", "0000000000"]


def test_transforms_are_valid_and_give_the_pose_back():
    message = json.loads(transforms_json(1_500_000_000, [("robot/3", 1.25, -0.5, 2.0)]))
    valid("/tf", message)
    [transform] = message["transforms"]
    assert transform["timestamp"] == {"sec": 1, "nsec": 500_000_000}
    assert transform["child_frame_id"] == "robot/3"
    assert transform["translation"] == {"x": 1.25, "y": -0.5, "z": 0}
    assert math.isclose(heading_of(transform["rotation"]), 2.0, abs_tol=4e-4)


def test_a_log_line_is_valid_at_every_level():
    for level in ("debug", "info", "warning", "error", "critical", "unknown"):
        valid("/log", log_message(-1, level, "world", "lab time runs"))


def test_every_channel_in_json_has_a_schema():
    assert {
        channel.topic for channel in CHANNELS if channel.encoding == "json" and not schema_of(channel.topic)[1]
    } == set()

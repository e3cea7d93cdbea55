"""A floor from an image or the map of a ROS map server: dark is blocked, and what is wrong is told with its place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image
from world_labs import ROOM, complaints, lab_of

from rmr_world.floor_map import FloorMap, MapError, boxes, read_map

ROS = """\
image: floor.pgm
resolution: 0.05
origin: [-1.5, 0.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


def draw(path, blocked, dark=0, light=255):
    """Write a floor (row 0 at its lower edge) as an image."""
    pixels = np.where(np.asarray(blocked, dtype=bool)[::-1], dark, light).astype(np.uint8)
    Image.fromarray(pixels).save(path)


def walled(door=slice(12, 18)):
    """Return a floor of 3.0 m x 1.5 m with a wall across it and a door in that."""
    blocked = np.zeros((30, 60), dtype=bool)
    blocked[:, 30:32] = True
    blocked[door, 30:32] = False
    return blocked


def covered(found, shape, width_m, height_m):
    """Return the cells whose centres lie in boxes."""
    rows, columns = shape
    x = (np.arange(columns) + 0.5) * width_m / columns
    y = (np.arange(rows) + 0.5) * height_m / rows
    inside = np.zeros(shape, dtype=bool)
    for x0, y0, x1, y1 in found:
        inside |= np.outer((y0 < y) & (y < y1), (x0 < x) & (x < x1))
    return inside


@given(arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_boxes_cover_what_is_blocked_and_nothing_else(blocked):
    rows, columns = blocked.shape
    if blocked.all():
        with pytest.raises(MapError, match="has no free floor"):
            boxes(FloorMap(blocked, None), columns * 0.1, rows * 0.1)
        return
    found = boxes(FloorMap(blocked, None), columns * 0.1, rows * 0.1)
    assert (covered(found, blocked.shape, columns * 0.1, rows * 0.1) == blocked).all()


def test_walls_of_a_building_are_few_boxes():
    blocked = np.zeros((400, 600), dtype=bool)
    for k in range(0, 600, 60):
        blocked[:, k : k + 3] = True
        blocked[100:120, k : k + 3] = False
    blocked[[0, 1, 398, 399], :] = True
    assert len(boxes(FloorMap(blocked, 0.05), 30.0, 20.0)) <= 22


@pytest.mark.parametrize("name", ["floor.png", "floor.pgm"])
def test_dark_pixels_of_an_image_are_obstacles_and_its_lower_edge_is_that_of_the_arena(tmp_path, name):
    blocked = walled()
    blocked[0:4, 0:4] = True
    draw(tmp_path / name, blocked)
    arena = lab_of(tmp_path, f"{ROOM}map: {name}\nobstacles: [{{circle: [2.5, 1.0, 0.1]}}]\n").arena
    assert arena.clearance(0.1, 0.1) == 0.0
    assert arena.clearance(0.1, 1.4) > 0.0
    assert arena.clearance(1.55, 0.3) == 0.0
    assert arena.clearance(1.55, 0.75) == pytest.approx(0.15)
    assert arena.clearance(2.5, 1.0) == 0.0, "obstacles stand on the map's floor"


def test_map_of_a_ros_map_server_is_read_with_its_thresholds_and_unknown_cells_are_blocked(tmp_path):
    pixels = np.full((30, 60), 254, dtype=np.uint8)
    pixels[:, 30] = 205  # unknown, in what map savers write
    pixels[:, 40] = 0
    Image.fromarray(pixels).save(tmp_path / "floor.pgm")
    (tmp_path / "map.yaml").write_text(ROS)
    arena = lab_of(tmp_path, f"{ROOM}map: map.yaml\n").arena
    assert len(arena.obstacles) == 2
    assert [arena.clearance(x, 0.75) > 0.0 for x in (1.4, 1.525, 1.8, 2.025)] == [True, False, True, False]
    (tmp_path / "map.yaml").write_text(ROS.replace("negate: 0", "negate: 1"))
    assert read_map(tmp_path / "map.yaml").blocked[:, 0].all()


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("image: floor.pgm", "image: none.pgm", "none.pgm cannot be read: No such file or directory"),
        ("image: floor.pgm", "image: map.yaml", "map.yaml is no image that can be read (PNG, PGM, BMP, TIFF, JPEG)"),
        ("image: floor.pgm", "image: 7", "map.yaml: image should be a file name"),
        ("image: floor.pgm\n", "", "map.yaml is no map file of ROS: it should have the keys image and resolution"),
        ("resolution: 0.05", "resolution: fine", "map.yaml: resolution should be a number from 0.0001 to 10, not"),
        ("0.196", "0.7", "map.yaml: free_thresh should be at most occupied_thresh"),
        ("negate: 0", "negate: 2", "map.yaml: negate should be 0 or 1, not 2"),
        ("0.0, 0.0]", "0.0, 0.5]", "map.yaml: a yaw of 0.5 rad is not supported: turn the image"),
        ("[-1.5, 0.0, 0.0]", "here", "map.yaml: origin should be [x, y, yaw], not 'here'"),
        ("negate: 0", "mode: raw", "map.yaml: mode should be trinary or scale, not 'raw'"),
        ("negate: 0", "negated: 0", "map.yaml has the unknown key negated; known are image, resolution, origin"),
        ("negate: 0", "negate: [", "map.yaml is no YAML: while parsing"),
    ],
)
def test_mistake_in_a_map_is_told_at_the_key_that_names_it(tmp_path, old, new, why):
    draw(tmp_path / "floor.pgm", walled())
    assert old in ROS
    (tmp_path / "map.yaml").write_text(ROS.replace(old, new))
    (complaint,) = complaints(tmp_path, f"{ROOM}map: map.yaml\n")
    assert complaint.startswith(f"6:6: map: {why}")


def test_arena_of_another_size_is_told_the_size_of_the_map(tmp_path):
    draw(tmp_path / "floor.pgm", walled())
    (tmp_path / "map.yaml").write_text(ROS.replace("0.05", "0.04"))
    (complaint,) = complaints(tmp_path, f"{ROOM}map: map.yaml\n")
    assert complaint == "3:15: arena.size: should be [2.4, 1.2], the size of map.yaml"


def test_image_that_does_not_fit_or_is_too_fine_is_told(tmp_path):
    draw(tmp_path / "a.png", np.eye(50))
    (complaint,) = complaints(tmp_path, f"{ROOM}map: a.png\n")
    assert complaint.startswith("6:6: map: has 50 x 50 pixels, which do not fit an arena of 3 m x 1.5 m: a pixel")
    draw(tmp_path / "a.png", np.indices((120, 240)).sum(axis=0) % 2)
    (complaint,) = complaints(tmp_path, f"{ROOM}map: a.png\n")
    assert complaint.startswith("6:6: map: needs more than 3000 boxes: take an image with larger pixels")
    draw(tmp_path / "a.png", np.ones((10, 20)))
    (complaint,) = complaints(tmp_path, f"{ROOM}map: a.png\n")
    assert complaint == "6:6: map: has no free floor: light pixels are free, dark ones blocked"


def test_robot_that_starts_in_a_wall_of_the_map_is_told(tmp_path):
    blocked = walled()
    blocked[:, 8:12] = True
    draw(tmp_path / "floor.png", blocked)
    (complaint,) = complaints(tmp_path, f"{ROOM}map: floor.png\n")
    assert complaint == "5:5: robots.0: robot 1 starts inside an obstacle"

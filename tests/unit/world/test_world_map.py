"""A floor from an image or the map of a ROS map server: dark is blocked, and what is wrong is told with its place."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image
from world_labs import ROOM, complaints, lab_of

from rmr.bytecode.program import Program
from rmr_world.floor_map import FloorMap, MapError, boxes, read_map
from rmr_world.validate.lab_lint import unknown_floor

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


def palette(pixels, path, **options):
    """Write an image of indices whose palette runs the other way: index 0 is white."""
    image = Image.fromarray(255 - pixels, "L").convert("P")
    image.putpalette([255 - k // 3 for k in range(768)])
    image.putdata((255 - pixels).ravel().tolist())
    image.save(path, **options)


def colours(pixels, path):
    Image.fromarray(np.dstack([pixels] * 3)).save(path)


def wide(pixels, path):
    """Write 16 bits a pixel, each the middle of its grey or up to half a grey off."""
    off = np.resize(np.array([0, 128, -128, 77]), pixels.shape)
    Image.fromarray(np.clip(pixels.astype(int) * 257 + off, 0, 65535).astype(np.uint16)).save(path)


def shares(pixels, path):
    Image.fromarray(pixels.astype(np.float32) / 255.0).save(path)


FORMATS = {
    "grey.png": lambda pixels, path: Image.fromarray(pixels).save(path),
    "grey.pgm": lambda pixels, path: Image.fromarray(pixels).save(path),
    "grey.bmp": lambda pixels, path: Image.fromarray(pixels).save(path),
    "grey.tiff": lambda pixels, path: Image.fromarray(pixels).save(path),
    "colours.png": colours,
    "palette.png": palette,
    "wide.png": wide,
    "wide.tiff": wide,
    "wide.pgm": wide,
    "shares.tiff": shares,
}
"""How a file is written, by its name."""
SEEN_THROUGH = {
    "alpha.png": lambda pixels, alpha, path: Image.fromarray(np.dstack([pixels, alpha])).save(path),
    "alpha-colours.png": lambda pixels, alpha, path: Image.fromarray(np.dstack([*[pixels] * 3, alpha])).save(path),
    "alpha.tiff": lambda pixels, alpha, path: Image.fromarray(np.dstack([*[pixels] * 3, alpha])).save(path),
}
"""The same for images with opacity."""


def is_blocked(grey, alpha, negate, free):
    """Return what the map server of nav2 (map_io.cpp, trinary) and the rule "unknown is blocked" make of a pixel."""
    light = np.float32(grey) / np.float32(255)
    occupied = light if negate else np.float32(1) - light
    return alpha < 255 or not occupied <= np.float32(free)


@st.composite
def thresholds(draw):
    """Return a threshold at the darkness of a grey, or at a neighbour of that, and one of a map that knows it all."""
    exact = np.float32(1) - np.float32(draw(st.integers(0, 255))) / np.float32(255)
    toward = draw(st.sampled_from([None, 0.0, 1.0]))
    return float(exact if toward is None else np.nextafter(exact, np.float32(toward)))


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from([*FORMATS, *SEEN_THROUGH]),
    arrays(np.uint8, (4, 8)),
    arrays(np.uint8, (4, 8), elements=st.sampled_from([0, 1, 128, 254, 255])),
    st.sampled_from(["0", "1", "true", "False", "no", "yes"]),
    thresholds(),
    st.booleans(),
)
def test_map_of_any_format_is_read_as_the_map_server_reads_it(name, pixels, alpha, negate, free, at_a_pixel):
    if at_a_pixel:
        free = float(np.float32(1) - np.float32(pixels[0, 0]) / np.float32(255))
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        if name in SEEN_THROUGH:
            SEEN_THROUGH[name](pixels, alpha, path)
        else:
            FORMATS[name](pixels, path)
            alpha = np.full_like(pixels, 255)
        about = f"image: {name}\nresolution: 5e-2\nnegate: {negate}\noccupied_thresh: 1.0\nfree_thresh: {free!r}\n"
        (Path(folder) / "map.yaml").write_text(about)
        floor = read_map(Path(folder) / "map.yaml")
    turned = negate in ("1", "true", "yes")
    expected = [
        [is_blocked(*cell, turned, free) for cell in zip(*row, strict=True)] for row in zip(pixels, alpha, strict=True)
    ]
    assert floor.blocked[::-1].tolist() == expected
    assert floor.resolution_m == 0.05
    assert floor.unknown_free == np.count_nonzero((pixels == 205) & ~np.array(expected))


@pytest.mark.parametrize("negate", [0, 1])
def test_threshold_at_the_darkness_of_each_grey_leaves_it_free(tmp_path, negate):
    greys = np.arange(256, dtype=np.uint8)
    Image.fromarray(np.tile(greys, (2, 1))).save(tmp_path / "all.png")
    for grey in range(256):
        light = np.float32(grey) / np.float32(255)
        free = float(light if negate else np.float32(1) - light)
        about = f"image: all.png\nresolution: 1\nnegate: {negate}\noccupied_thresh: 1\nfree_thresh: {free!r}\n"
        (tmp_path / "map.yaml").write_text(about)
        blocked = read_map(tmp_path / "map.yaml").blocked[0]
        assert (blocked == (greys > grey if negate else greys < grey)).all(), grey


@given(arrays(bool, (4, 8)), st.sampled_from(["floor.png", "floor.pbm", "floor.tiff", "floor.bmp"]))
def test_image_of_one_bit_is_read(light, name):
    with TemporaryDirectory() as folder:
        Image.fromarray(light).save(Path(folder) / name)
        assert (read_map(Path(folder) / name).blocked[::-1] == ~light).all()


@pytest.mark.parametrize(("bits", "saved"), [(2, np.uint8), (4, np.uint8)])
def test_few_bits_a_pixel_are_scaled(tmp_path, bits, saved):
    most = 2**bits - 1
    greys = np.arange(most + 1, dtype=saved)[None, :]
    (tmp_path / "few.pgm").write_bytes(b"P5 %d 1 %d\n" % (most + 1, most) + greys.tobytes())
    assert read_map(tmp_path / "few.pgm").blocked[0].tolist() == [k / most < 0.5 for k in range(most + 1)]


def test_transparent_pixel_of_an_image_is_blocked_whatever_its_kind(tmp_path):
    light = np.array([[255, 200, 255, 200]], dtype=np.uint8)
    Image.fromarray(light).save(tmp_path / "grey.png", transparency=200)
    palette(light, tmp_path / "palette.png", transparency=255 - 200)
    Image.fromarray(light.astype(np.uint16) * 257).save(tmp_path / "wide.png", transparency=200 * 257)
    for name in ("grey.png", "palette.png", "wide.png"):
        assert read_map(tmp_path / name).blocked.tolist() == [[False, True, False, True]], name


@pytest.mark.parametrize("value", [1.5, -0.25, float("nan")])
def test_shares_of_white_beyond_their_range_are_told(tmp_path, value):
    Image.fromarray(np.full((2, 4), value, dtype=np.float32)).save(tmp_path / "f.tiff")
    with pytest.raises(MapError, match=r"^f\.tiff has pixels outside of 0 to 1: save it with 8 bits for each pixel"):
        read_map(tmp_path / "f.tiff")


def test_cells_that_a_threshold_frees_although_the_map_does_not_know_them_are_told(tmp_path):
    pixels = np.full((30, 60), 254, dtype=np.uint8)
    pixels[:, 30:32] = 205
    Image.fromarray(pixels).save(tmp_path / "floor.pgm")
    for free, count in (("0.196", 0), ("0.25", 60)):
        (tmp_path / "map.yaml").write_text(ROS.replace("0.196", free))
        lab = lab_of(tmp_path, f"{ROOM}map: map.yaml\n")
        found = [str(each) for each in unknown_floor(lab, Program(()))]
        told = (
            f"{lab.path}:6:6: map: warning: 60 cells of grey 205, which map savers write for unknown, are free by the "
            "map's free_thresh: robots will drive there; with free_thresh: 0.196 they are blocked"
        )
        assert found == ([told] if count else []), free


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
        ("negate: 0", "negate: 0\nimage: other.pgm", "map.yaml:5:1: image: repeated key; it stands in line 1 already"),
        ("negate: 0", "negate: *here", "map.yaml:4:9: negate: aliases (*here) are not allowed here"),
        ("negate: 0", "negate: [", "map.yaml:6:12: not YAML: while parsing"),
    ],
)
def test_mistake_in_a_map_is_told_at_the_key_that_names_it(tmp_path, old, new, why):
    draw(tmp_path / "floor.pgm", walled())
    assert old in ROS
    (tmp_path / "map.yaml").write_text(ROS.replace(old, new))
    (complaint,) = complaints(tmp_path, f"{ROOM}map: map.yaml\n")
    assert complaint.startswith(f"6:6: map: {why}")


def test_an_image_without_a_library_that_reads_it_is_told_at_the_key_that_names_it(tmp_path, monkeypatch):
    draw(tmp_path / "floor.png", walled())
    monkeypatch.setitem(sys.modules, "PIL", None)
    (complaint,) = complaints(tmp_path, f"{ROOM}map: floor.png\n")
    what = "map: floor.png is an image: Pillow is not installed; pip install 'rmr-robots[maps]' brings it"
    assert complaint.startswith(f"6:6: {what}")


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
    assert complaint == "6:6: map: has no free floor: light pixels are free, dark and transparent ones blocked"


def test_robot_that_starts_in_a_wall_of_the_map_is_told(tmp_path):
    blocked = walled()
    blocked[:, 8:12] = True
    draw(tmp_path / "floor.png", blocked)
    (complaint,) = complaints(tmp_path, f"{ROOM}map: floor.png\n")
    assert complaint == "5:5: robots.0: robot 1 starts inside an obstacle"

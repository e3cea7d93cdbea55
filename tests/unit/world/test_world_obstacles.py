"""Obstacles of a lab file: concave outlines become convex parts, and many obstacles are as exact as few."""

import math
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world_labs import ROOM, complaints, lab_of

from rmr.base.arena import Polygon
from rmr.base.geometry import Point, point_segment_distance
from rmr.node.motion.grid import OccupancyGrid
from rmr_world.free_flow import OBSTACLES_MAX, FreeFlow
from rmr_world.lab_geometry import convex_parts

ELL = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.2), (0.2, 0.2), (0.2, 1.0), (0.0, 1.0)]
COMB = [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]


def points(corners):
    return [Point(float(x), float(y)) for x, y in corners]


def area(corners):
    return sum(a.x * b.y - b.x * a.y for a, b in zip(corners, corners[1:] + corners[:1], strict=True)) / 2.0


def turns(corners):
    threes = zip(corners, corners[1:] + corners[:1], corners[2:] + corners[:2], strict=True)
    return [(b.x - a.x) * (c.y - b.y) - (b.y - a.y) * (c.x - b.x) for a, b, c in threes]


def inside(corners, x, y):
    """Return whether (x, y) lies inside of an outline: a ray to the right crosses it an odd number of times."""
    odd = False
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        if (a.y > y) != (b.y > y) and x < a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x):
            odd = not odd
    return odd


def check(corners):
    parts = convex_parts(corners)
    assert all(turn > 0.0 for part in parts for turn in turns(part))
    assert sum(map(area, parts)) == pytest.approx(abs(area(corners)), abs=1e-9)
    left, right = min(p.x for p in corners), max(p.x for p in corners)
    bottom, top = min(p.y for p in corners), max(p.y for p in corners)
    for i in range(20):
        for j in range(20):
            x, y = left + (i + 0.513) / 20 * (right - left), bottom + (j + 0.487) / 20 * (top - bottom)
            edges = zip(corners, corners[1:] + corners[:1], strict=True)
            if min(point_segment_distance(x, y, *a, *b) for a, b in edges) > 1e-6:
                # A seam between two parts belongs to both but for rounding.
                assert inside(corners, x, y) == any(Polygon(part).distance(x, y) < 1e-9 for part in parts), (x, y)
    return parts


@pytest.mark.parametrize(("corners", "count"), [(ELL, 2), (COMB, 4), ([(0, 0), (2, 0), (2, 1), (0, 1)], 1)])
def test_outline_becomes_few_convex_parts_in_either_direction(corners, count):
    for given_corners in (points(corners), points(corners[::-1]), points(corners[3:] + corners[:3])):
        assert count <= len(check(given_corners)) <= count + 1


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(0.05, 1.0), min_size=3, max_size=24))
def test_parts_of_any_star_shaped_outline_cover_it(radii):
    step = math.tau / len(radii)
    corners = points((r * math.cos(k * step), r * math.sin(k * step)) for k, r in enumerate(radii))
    check(corners)


def test_corners_on_a_straight_edge_are_left_out():
    assert convex_parts(points([(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)])) == [
        tuple(points([(0, 0), (2, 0), (2, 1), (0, 1)]))
    ]


@pytest.mark.parametrize(
    ("corners", "why"),
    [
        (
            "[[0,0],[1,1],[1,0],[0,1]]",
            "crosses or touches itself: the edge from [0, 0] to [1, 1] and the edge from [1, 0] to [0, 1]",
        ),
        (
            "[[0,0],[2,0],[2,1],[1,0],[0,1]]",
            "crosses or touches itself: the edge from [0, 0] to [2, 0] and the edge from [2, 1] to [1, 0]",
        ),
        ("[[0,0],[1,0],[1,1],[0,0]]", "should name each corner once; the last one need not repeat the first"),
        ("[[0,0],[1,0],[2,0]]", "should have an inside: its corners lie on a line"),
    ],
)
def test_outline_that_is_no_polygon_is_an_error_with_its_place(tmp_path, corners, why):
    (complaint,) = complaints(tmp_path, f"{ROOM}obstacles: [{{polygon: {corners}}}]")
    assert complaint == f"6:13: obstacles.0: polygon {why}"


def test_concave_obstacle_is_an_obstacle_in_all_its_parts_and_its_bay_is_free(tmp_path):
    corners = "[[1, 0.3], [2, 0.3], [2, 1.2], [1.8, 1.2], [1.8, 0.5], [1.2, 0.5], [1.2, 1.2], [1, 1.2]]"
    arena = lab_of(tmp_path, f"{ROOM}obstacles: [{{polygon: {corners}}}]").arena
    assert len(arena.obstacles) == 3
    assert all(arena.clearance(x, y) == 0.0 for x, y in [(1.1, 1.1), (1.9, 1.1), (1.5, 0.4), (1.1, 0.4)])
    assert arena.clearance(1.5, 0.9) == pytest.approx(0.3)


def scattered(count, size_m):
    """Return a lab with small boxes all over its floor, but for a strip at each side."""
    chance = random.Random(count)
    spots = [(chance.uniform(1.0, size_m - 1.1), chance.uniform(0.0, size_m - 0.1)) for _ in range(count)]
    boxes = "".join(f"  - {{box: [{x:.3f}, {y:.3f}, {x + 0.05:.3f}, {y + 0.05:.3f}]}}\n" for x, y in spots)
    room = ROOM.replace("[3.0, 1.5]", f"[{size_m}, {size_m}]").replace("[0.5, 0.75, 0deg]", f"[0.5, {size_m / 2}, 0]")
    return f"{room}obstacles:\n{boxes}"


def test_clearance_of_each_cell_is_that_of_all_obstacles(tmp_path):
    arena = lab_of(tmp_path, scattered(60, 4.0)).arena
    grid = OccupancyGrid(arena)
    for row in range(grid.rows):
        for column in range(grid.columns):
            cell = grid.index_at(column, row)
            assert grid.clear[cell] == arena.clearance((column + 0.5) * grid.cell, (row + 0.5) * grid.cell)


def test_free_flow_leads_around_many_obstacles_and_is_straight_past_more(tmp_path):
    start, goal = Point(0.5, 2.0), Point(3.5, 2.0)
    around, straight = (
        FreeFlow(lab_of(tmp_path, scattered(count, 4.0)).arena).lengths(start, [goal])[0]
        for count in (60, OBSTACLES_MAX + 1)
    )
    assert 3.0 < around < 3.5
    assert straight == pytest.approx(3.0), "still a lower bound"

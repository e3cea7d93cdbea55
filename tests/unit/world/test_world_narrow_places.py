"""Narrow passages found from the floor: drawn floors with known corridors, the provided labs, many obstacles."""

from pathlib import Path
from random import Random

import numpy as np
import pytest

from rmr.base.arena import Arena, Disc, Polygon
from rmr.base.geometry import Point, distance
from rmr_world.clearance_grid import ClearanceGrid, components
from rmr_world.lab_file import load_lab
from rmr_world.narrow_places import narrow_places, side_by_side_m

LABS = Path(__file__).parents[3] / "deploy" / "labs"
RADIUS = 0.07


def box(x0, y0, x1, y1):
    return Polygon((Point(x0, y0), Point(x1, y0), Point(x1, y1), Point(x0, y1)))


def floor(*obstacles, size=(4.0, 3.0)):
    return Arena(*size, 0.05, tuple(obstacles))


def wall(x, thickness, doors, height=3.0):
    """Return the boxes of a wall at `x` with a door of each (centre, width)."""
    edges = [0.0, *(y + side * width / 2 for y, width in sorted(doors) for side in (-1, 1)), height]
    return [box(x, low, x + thickness, high) for low, high in zip(edges[::2], edges[1::2], strict=True)]


@pytest.mark.parametrize("seed", range(12))
def test_the_narrow_doors_of_a_drawn_wall_are_found_and_no_wide_one(seed):
    rng = Random(f"{seed}/doors")
    thickness = rng.choice([0.05, 0.1, 0.3, 0.8])
    widths = [rng.choice([rng.uniform(0.2, 0.35), rng.uniform(0.39, 0.5), 0.12]) for _ in range(3)]
    doors = list(zip((0.5, 1.5, 2.5), widths, strict=True))
    found = narrow_places(floor(*wall(1.7, thickness, doors))).passages
    expected = [door for door in doors if 0.2 <= door[1] <= 0.35]
    assert len(found) == len(expected)
    for passage, (y, width) in zip(found, expected, strict=True):
        west, east = passage.ends
        assert west.x < 1.7 < 1.7 + thickness < east.x
        assert max(abs(west.y - y), abs(east.y - y)) < 0.03
        assert passage.width == pytest.approx(width, abs=0.01)
        assert thickness < passage.length < thickness + side_by_side_m(RADIUS)


def test_a_passage_beside_an_open_way_between_the_same_rooms_is_found():
    (passage,) = narrow_places(floor(*wall(2.0, 0.1, [(0.6, 0.3), (2.0, 1.0)]))).passages
    assert passage.ends[0].y == pytest.approx(0.6, abs=0.02)


def test_a_crossing_of_narrow_corridors_is_a_zone_with_a_passage_in_each_arm():
    corners = [(x, y) for x in (1.0, 3.15) for y in (1.0, 2.65)]
    yards = floor(*(box(x, y, x + 1.85, y + 1.35) for x, y in corners), size=(6.0, 5.0))
    found = narrow_places(yards)
    arms = [p for p in found.passages if p.width < 0.31]
    assert len(arms) == 4
    (zone,) = found.zones
    assert distance(*zone.centre, 3.0, 2.5) < 0.06


def test_dead_ends_and_corners_of_rooms_are_no_passages():
    niche = wall(2.0, 1.0, [(1.5, 0.3)])
    assert not narrow_places(floor(*niche, box(2.9, 0.0, 4.0, 3.0))).passages
    wedge = Polygon((Point(0.0, 0.0), Point(4.0, 0.0), Point(0.0, 0.8)))
    assert narrow_places(floor(wedge, box(1.0, 1.2, 1.5, 1.7))).passages == ()


def test_the_bend_of_a_corridor_divides_no_passage():
    width = 0.34
    bend = floor(
        box(1.0, 0.0, 4.0, 2.0),
        box(1.0 - width, 2.0 + width, 3.0, 3.0),
        box(0.4, 1.0, 1.0 - width, 3.0),
        size=(4.0, 4.0),
    )
    lengths = [p.length for p in narrow_places(bend).passages]
    assert max(lengths) > 2.5


@pytest.mark.parametrize("path", sorted(LABS.glob("*/*.yaml")), ids=lambda path: path.stem)
def test_the_passages_of_each_provided_lab_are_those_that_are_found(path):
    arena = load_lab(path).arena
    found = narrow_places(arena).passages
    assert len(found) == len(arena.passages)
    for mouth in [mouth for passage in arena.passages for mouth in passage.mouths]:
        assert min(each.away(mouth) for each in found) < 0.02


def test_names_do_not_depend_on_the_order_of_the_obstacles():
    obstacles = [*wall(1.0, 0.2, [(1.0, 0.3), (2.2, 0.3)]), *wall(2.6, 0.2, [(0.6, 0.3)]), Disc(Point(3.5, 0.3), 0.1)]
    shuffled = Random("order").sample(obstacles, len(obstacles))
    one = narrow_places(floor(*obstacles)).passages
    assert [each.name for each in one] == [f"passage_{k}" for k in range(1, len(one) + 1)]
    assert one == narrow_places(floor(*shuffled)).passages


@pytest.mark.medium
def test_the_work_for_a_thousand_obstacles_does_not_grow_with_their_product(monkeypatch):
    measured = []
    exact = Arena.clearance_of

    def counted(arena, obstacles, x, y):
        measured.append(len(obstacles))
        return exact(arena, obstacles, x, y)

    monkeypatch.setattr(Arena, "clearance_of", counted)
    rng = Random("many")
    corners = [(rng.uniform(0.0, 11.8), rng.uniform(0.0, 11.8)) for _ in range(1000)]
    found = narrow_places(floor(*(box(x, y, x + 0.15, y + 0.2) for x, y in corners), size=(12.0, 12.0)))
    assert len(found.passages) > 100
    # Exact distances are measured around the narrowest point of each passage: one to all obstacles, 289 to a few.
    assert len(measured) <= 290 * len(found.passages)
    assert sum(measured) < 20 * len(measured)


def test_components_are_those_of_a_flood_fill():
    mask = np.random.default_rng(3).random((40, 50)) < 0.35
    labels = components(mask)
    assert ((labels > 0) == mask).all()
    for r, c in np.argwhere(mask):
        around = labels[max(0, r - 1) : r + 2, max(0, c - 1) : c + 2]
        assert set(around[around > 0].tolist()) == {labels[r, c]}
    seen = set()
    for number in range(1, labels.max() + 1):
        cells = {(int(r), int(c)) for r, c in np.argwhere(labels == number)}
        stack = [min(cells)]
        reached = set(stack)
        while stack:
            r, c = stack.pop()
            near = {(r + dr, c + dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1)} & cells - reached
            reached |= near
            stack += near
        assert reached == cells
        seen |= cells
    assert len(seen) == mask.sum()


def test_clearance_of_the_grid_is_that_of_the_arena():
    arena = floor(
        box(1.0, 1.0, 1.6, 1.3), Disc(Point(2.5, 1.5), 0.3), Polygon((Point(3, 2), Point(3.6, 2.2), Point(3, 2.7)))
    )
    grid = ClearanceGrid(arena, 0.3)
    for row in range(0, grid.clear.shape[0], 7):
        for column in range(0, grid.clear.shape[1], 7):
            exact = arena.clearance(*grid.centre((row, column)))
            assert min(0.3, grid.clear[row, column]) == pytest.approx(min(0.3, exact), abs=1e-9)

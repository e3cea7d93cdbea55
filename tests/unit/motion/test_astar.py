"""Grid, A* and the reduction of its paths."""

import heapq
import math
from itertools import pairwise
from random import Random

import bench
import pytest

from rmr.base.arena import Arena, Disc, RobotShape
from rmr.base.geometry import Point, point_segment_distance
from rmr.base.grid_path import STEPS
from rmr.node.motion.astar import plan, search
from rmr.node.motion.grid import (
    APART_M,
    PATH_MARGIN_M,
    OccupancyGrid,
    blocked_cells,
    cell_for,
    discs_around,
    grid_of,
    segment_clearance,
)

ROOM = Arena(1.5, 1.5, 0.05)


def dijkstra(grid: OccupancyGrid, blocked: bytearray, start: int, goal: int) -> float:
    """Return the least cost by plain uniform-cost search over cell coordinates."""
    cost = {start: 0.0}
    queue = [(0.0, start)]
    while queue:
        so_far, here = heapq.heappop(queue)
        if here == goal:
            return so_far
        if so_far > cost[here]:
            continue
        column, row = grid.cell_at(here)
        for dc, dr in STEPS:
            there = grid.index_at(column + dc, row + dr)
            corner = blocked[grid.index_at(column + dc, row)] or blocked[grid.index_at(column, row + dr)]
            if blocked[there] or (dc and dr and corner):
                continue
            way = so_far + math.hypot(dc, dr)
            if way < cost.get(there, math.inf):
                cost[there] = way
                heapq.heappush(queue, (way, there))
    return math.inf


def path_cost(grid: OccupancyGrid, cells: list[int]) -> float:
    spots = [grid.cell_at(c) for c in cells]
    return sum(math.dist(a, b) for a, b in pairwise(spots))


def test_a_path_costs_what_uniform_cost_search_finds_on_random_floors():
    rng = Random("1/floors")
    grid = OccupancyGrid(ROOM)
    found = 0
    for _ in range(40):
        blocked = bytearray(1 if c < 0 or rng.random() < 0.3 else 0 for c in grid.clear)
        free = [i for i, b in enumerate(blocked) if not b]
        start, goal = rng.choice(free), rng.choice(free)
        cells, expansions = search(grid.stride, blocked, start, goal)
        best = dijkstra(grid, blocked, start, goal)
        assert (cells is None) == math.isinf(best)
        assert expansions <= len(free)
        if cells is not None:
            found += 1
            assert (cells[0], cells[-1]) == (start, goal)
            assert math.isclose(path_cost(grid, cells), best)
    assert found > 20


def test_no_step_cuts_a_blocked_corner():
    rng = Random("2/floors")
    grid = OccupancyGrid(ROOM)
    for _ in range(20):
        blocked = bytearray(1 if c < 0 or rng.random() < 0.3 else 0 for c in grid.clear)
        free = [i for i, b in enumerate(blocked) if not b]
        cells, _ = search(grid.stride, blocked, rng.choice(free), rng.choice(free))
        for a, b in zip(cells or (), (cells or ())[1:], strict=False):
            (ac, ar), (bc, br) = grid.cell_at(a), grid.cell_at(b)
            assert not blocked[grid.index_at(ac, br)]
            assert not blocked[grid.index_at(bc, ar)]


def test_the_same_floor_gives_the_same_plan():
    arena = bench.testbed()
    plans = [plan(arena, Point(0.1, 0.15), Point(1.38, 1.14), (Point(0.1, 0.37),)) for _ in range(2)]
    assert plans[0] == plans[1]


def test_a_reduced_path_keeps_the_clearance_except_near_start_and_goal():
    for arena, starts in ((bench.testbed(), bench.TESTBED_STARTS), (bench.corridor(), bench.CORRIDOR_STARTS)):
        exits = arena.area("exit")
        assert exits is not None
        for start in starts:
            for goal in exits.places:
                found = plan(arena, Point(start.x, start.y), goal)
                assert found is not None
                for a, b in zip(found.points[1:-1], found.points[2:-1], strict=False):
                    assert segment_clearance(arena, a, b) >= 0.10 - 1e-9
                for a, b in zip(found.points, found.points[1:], strict=False):
                    assert segment_clearance(arena, a, b) >= 0.075 - 1e-9


def test_a_plan_is_hardly_longer_than_the_straight_way_where_that_is_free():
    found = plan(ROOM, Point(0.2, 0.2), Point(1.3, 0.8))
    assert found is not None
    assert found.points == (Point(0.2, 0.2), Point(1.3, 0.8))


def test_a_plan_keeps_off_parked_robots():
    parked = (Point(0.7, 0.75), Point(0.7, 0.5))
    found = plan(ROOM, Point(0.2, 0.7), Point(1.3, 0.7), parked)
    assert found is not None
    for a, b in zip(found.points, found.points[1:], strict=False):
        for p in parked:
            assert point_segment_distance(*p, *a, *b) >= 0.17 - 1e-6


def test_a_goal_that_is_taken_has_no_plan():
    assert plan(ROOM, Point(0.2, 0.2), Point(1.0, 1.0), (Point(1.05, 1.0),)) is None


def test_a_wall_of_parked_robots_has_no_plan_and_is_never_ignored():
    wall = [Point(0.75, 0.05 + 0.2 * i) for i in range(8)]
    assert plan(ROOM, Point(0.2, 0.7), Point(1.3, 0.7), wall) is None


def test_a_robot_that_stands_close_to_a_parked_one_can_leave():
    found = plan(ROOM, Point(0.3, 0.7), Point(1.3, 0.7), (Point(0.445, 0.7),))
    assert found is not None
    assert len(found.points) > 2


def test_starts_and_goals_may_lie_nearer_to_a_wall_than_the_way_between():
    found = plan(ROOM, Point(0.08, 0.08), Point(1.42, 1.42))
    assert found is not None


def test_a_door_too_narrow_for_the_usual_margin_is_still_used():
    arena = Arena(1.5, 1.5, 0.05, (bench.box(0.7, 0.0, 0.8, 0.63), bench.box(0.7, 0.815, 0.8, 1.5)))
    assert plan(arena, Point(0.2, 0.7), Point(1.3, 0.7)) is not None


def test_a_slit_narrower_than_the_robot_is_not_used():
    arena = Arena(1.5, 1.5, 0.05, (bench.box(0.7, 0.0, 0.8, 0.68), bench.box(0.7, 0.8, 0.8, 1.5)))
    assert plan(arena, Point(0.2, 0.7), Point(1.3, 0.7)) is None


@pytest.mark.parametrize("low", [0.66 + 0.005 * k for k in range(11)])
@pytest.mark.parametrize(("start_y", "goal_y"), [(0.3, 0.3), (0.08, 0.3), (0.08, 0.08)])  # 0.08: beside the wall
def test_a_way_leads_through_a_door_wherever_its_middle_lies_among_the_cells(low, start_y, goal_y):
    arena = Arena(1.5, 1.5, 0.05, (bench.box(0.5, 0.0, 1.0, low), bench.box(0.5, low + 0.185, 1.0, 1.5)))
    found = plan(arena, Point(0.2, start_y), Point(1.3, goal_y))
    assert found is not None
    assert min(segment_clearance(arena, a, b) for a, b in pairwise(found.points)) >= min(0.085, start_y, goal_y)


def test_the_clearance_of_a_segment_is_that_of_its_worst_point():
    arena = Arena(1.5, 1.5, 0.05, (bench.box(0.6, 0.0, 0.9, 0.6), Disc(Point(0.3, 1.2), 0.1)))
    rng = Random("3/segments")
    for _ in range(50):
        a, b = (Point(rng.uniform(0.05, 1.45), rng.uniform(0.05, 1.45)) for _ in range(2))
        sampled = min(arena.clearance(a.x + (b.x - a.x) * i / 400, a.y + (b.y - a.y) * i / 400) for i in range(401))
        assert abs(segment_clearance(arena, a, b) - sampled) < 0.004


def test_cells_near_the_start_are_relaxed_but_never_below_the_radius():
    grid = grid_of(ROOM)
    start, goal = Point(0.08, 0.7), Point(1.3, 0.7)
    blocked = blocked_cells(grid, start, goal, discs_around((), 0.07, start, goal), 0.03)
    assert not blocked[grid.index(0.08, 0.7)]
    assert blocked[grid.index(0.08, 1.2)]
    assert blocked[grid.index(0.02, 0.7)]


@pytest.mark.parametrize(("radius", "cell"), [(0.07, 0.05), (0.308, 0.22), (0.5, 0.35), (0.05, 0.1), (0.07, 0.02)])
def test_from_wherever_a_robot_can_stand_a_way_begins(radius, cell):
    arena = Arena(
        11.0, 7.0, cell, (bench.box(3.0, 0.0, 4.0, 4.0), Disc(Point(8.0, 5.0), 0.4)), shape=RobotShape(radius)
    )
    grid = grid_of(arena)
    rng = Random(f"2/stands/{radius}")
    tried = 0
    while tried < 100:
        place = Point(rng.uniform(0.0, 11.0), rng.uniform(0.0, 7.0))
        if arena.clearance(*place) < radius + 0.005 + 1.5 * cell:
            continue
        tried += 1
        assert cell_for(grid, blocked_cells(grid, place, place, (), 0.03), place) is not None
    assert plan(arena, Point(1.0, 1.0), Point(10.0, 1.0)) is not None


def test_no_way_begins_on_the_other_side_of_a_thin_wall():
    # A slot between two walls, with no cell that a robot could enter.
    slot = (bench.box(0.625, 0.0, 0.635, 1.5), bench.box(0.745, 0.0, 0.755, 1.5))
    arena = Arena(1.5, 1.5, 0.13, slot, shape=RobotShape(0.05))
    assert plan(arena, Point(0.69, 0.7), Point(1.2, 0.7)) is None


def test_a_plan_keeps_farther_off_robots_that_stand_where_there_is_room():
    arena = Arena(2.0, 1.5, 0.05, (), ())
    radius = arena.shape.radius
    room = plan(arena, Point(0.3, 0.775), Point(1.7, 0.775), [Point(1.0, 0.775)])
    # A row of robots from wall to wall, with a gap for one that keeps 4 cm off them on both sides.
    gap = 2.0 * (2.0 * radius + PATH_MARGIN_M) + 0.02
    wall = [Point(1.0, 0.775 + sign * (gap / 2.0 + k * 0.16)) for sign in (-1, 1) for k in range(4)]
    narrow = plan(arena, Point(0.3, 0.775), Point(1.7, 0.775), wall)
    assert room is not None
    assert narrow is not None

    def nearest(points, others):
        return min(point_segment_distance(*p, *a, *b) for p in others for a, b in pairwise(points)) - 2.0 * radius

    assert nearest(room.points, [Point(1.0, 0.775)]) >= APART_M - 1e-6
    assert PATH_MARGIN_M <= nearest(narrow.points, wall) < APART_M

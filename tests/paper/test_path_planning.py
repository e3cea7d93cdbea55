"""Claims of section IV.D of the paper: path planning for the leader and the followers."""

import math
import sys
from itertools import pairwise
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "unit" / "motion"))

import bench

from rmr.base.geometry import Point
from rmr.node.motion.astar import plan, search
from rmr.node.motion.grid import blocked_cells, grid_of
from rmr.node.motion.leader_path import follower_route, shared_part
from rmr.node.motion.route import leader_route

ARENA = bench.testbed()
GRID = grid_of(ARENA)
START, GOAL = Point(0.1, 0.15), Point(1.38, 1.38)


def test_iv_d_2_the_test_bed_is_900_grids_of_5_by_5_cm():
    assert GRID.columns * GRID.rows == 900
    assert GRID.cell == 0.05


def test_iv_d_2_obstacles_are_grids_that_no_path_enters():
    blocked = blocked_cells(GRID, START, GOAL, (), -GRID.arena.shape.radius)
    inside = [GRID.index(0.625 + 0.05 * i, 0.05 * j + 0.025) for i in range(5) for j in range(12)]
    free = [GRID.index(0.3, 0.7), GRID.index(0.75, 0.75)]
    assert not any(blocked[index] for index in free)
    found = plan(ARENA, START, GOAL)
    assert found is not None
    cells = [GRID.index_at(*cell) for cell in found.path.cells()]
    assert not any(index in inside for index in cells)


def test_iv_d_3_grids_are_connected_when_they_differ_by_at_most_one_in_x_and_y():
    found = plan(ARENA, START, GOAL)
    assert found is not None
    cells = found.path.cells()
    for (ac, ar), (bc, br) in pairwise(cells):
        assert max(abs(ac - bc), abs(ar - br)) == 1


def test_iv_d_3_an_edge_costs_1_and_a_diagonal_root_2_and_the_path_is_of_least_cost():
    blocked = bytearray(clear < 0.0 for clear in GRID.clear)
    cells, _ = search(GRID.stride, blocked, GRID.index_at(3, 2), GRID.index_at(13, 6))
    assert cells is not None
    spots = [GRID.cell_at(c) for c in cells]
    cost = sum(math.dist(a, b) for a, b in pairwise(spots))
    assert math.isclose(cost, 6 + 4 * math.sqrt(2))


def test_iv_d_3_the_euclidean_heuristic_never_overestimates():
    blocked = bytearray(clear < 0.1 for clear in GRID.clear)
    goal = GRID.index(1.2, 0.75)
    for index in range(0, len(blocked), 7):
        if blocked[index]:
            continue
        cells, _ = search(GRID.stride, blocked, index, goal)
        if cells is None:
            continue
        spots = [GRID.cell_at(c) for c in cells]
        cost = sum(math.dist(a, b) for a, b in pairwise(spots))
        assert math.dist(spots[0], spots[-1]) <= cost + 1e-9


def test_iv_d_3_the_search_is_best_first_and_expands_fewer_grids_than_there_are():
    blocked = bytearray(clear < 0.1 for clear in GRID.clear)
    _, expansions = search(GRID.stride, blocked, GRID.index(0.2, 0.75), GRID.index(1.2, 0.75))
    assert expansions < sum(1 for b in blocked if not b) / 4


def test_iv_d_1_the_leader_goes_from_its_start_by_the_reduced_grid_path_to_its_target():
    route = leader_route(ARENA, START, GOAL, (), through_gate=True)
    assert route is not None
    assert route.points[0] == START
    assert route.points[-1] == GOAL
    found = plan(ARENA, START, GOAL)
    assert found is not None
    assert len(found.points) < len(found.path.cells()) / 2


def test_iv_d_1_a_follower_goes_by_the_leaders_path_and_only_its_ends_are_its_own():
    leader = leader_route(ARENA, START, GOAL, (), through_gate=True)
    assert leader is not None
    shared = shared_part(ARENA, leader)
    assert shared is not None
    middle = [GRID.centre(GRID.index_at(*cell)) for cell in shared.cells()]
    for k, start in enumerate(bench.TESTBED_STARTS[1:], 1):
        target = ARENA.area("exit").places[k]
        route = follower_route(ARENA, Point(start.x, start.y), target, (), shared)
        assert route is not None
        assert route.points[0] == Point(start.x, start.y)
        assert route.points[-1] == target
        for spot in middle:
            s = route.project(*spot, 0.0, route.length_m)
            assert math.dist(route.point(s), spot) < 0.05


def test_iv_d_1_a_follower_saves_the_search():
    leader = leader_route(ARENA, START, GOAL, (), through_gate=True)
    assert leader is not None
    shared = shared_part(ARENA, leader)
    assert shared is not None
    route = follower_route(ARENA, Point(0.1, 0.59), Point(1.38, 0.9), (), shared)
    assert route is not None
    assert len(route.points) == 4  # S_k, S1', T1', T_k: both legs straight, no grid searched

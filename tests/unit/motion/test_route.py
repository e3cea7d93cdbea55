"""Routes of leader and followers, their gates, and path following."""

import math

import bench
import pytest

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, Pose, point_segment_distance
from rmr.node.motion.follow import Follower
from rmr.node.motion.grid import grid_of
from rmr.node.motion.leader_path import follower_route, shared_part
from rmr.node.motion.route import gated_again, leader_route, make_route, queue_before, way_of

TESTBED = bench.testbed()
EXITS = TESTBED.area("exit").places
STARTS = [Point(p.x, p.y) for p in bench.TESTBED_STARTS]


def leader(start: Point = STARTS[0], goal: Point = EXITS[0], parked=()):
    route = leader_route(TESTBED, start, goal, parked, through_gate=True)
    assert route is not None
    return route


def test_arc_lengths_points_and_headings_of_a_polyline():
    route = make_route(TESTBED, [Point(0.1, 0.1), Point(0.4, 0.1), Point(0.4, 0.5)], through_gate=False)
    assert route.length_m == pytest.approx(0.7)
    assert route.point(0.5) == pytest.approx((0.4, 0.3))
    assert route.point(9.0) == pytest.approx((0.4, 0.5))
    assert route.heading(0.2) == 0.0
    assert route.heading(0.6) == pytest.approx(math.pi / 2)
    assert route.project(0.38, 0.3, 0.0, 0.7) == pytest.approx(0.5)


def test_projection_stays_in_its_window_on_a_route_that_comes_back():
    route = make_route(TESTBED, [Point(0.1, 0.1), Point(0.5, 0.1), Point(0.1, 0.1001)], through_gate=False)
    assert route.project(0.2, 0.1, 0.0, 0.25) == pytest.approx(0.1)
    assert route.project(0.2, 0.1, 0.5, 0.8) == pytest.approx(0.7)


def test_a_route_through_the_corridor_has_its_gate_at_the_bottlenecks_point():
    for start in STARTS:
        for goal in EXITS:
            route = leader(start, goal)
            assert route.gate_m is not None
            assert math.dist(route.point(route.gate_m), (0.5, 0.75)) < 1e-6
            assert route.way == 0


def test_the_hull_is_clear_a_radius_beyond_the_corridors_end():
    route = leader()
    end = route.point(route.clear_m)
    assert 0.9 + 0.07 - 0.03 <= end.x <= 0.9 + 0.07 + 0.05


def test_a_route_that_does_not_pass_the_bottleneck_has_no_gate():
    route = leader_route(TESTBED, Point(0.1, 0.15), Point(0.1, 1.3), (), through_gate=True)
    assert route is not None
    assert route.gate_m is None


def test_a_route_that_is_not_meant_to_pass_has_no_gate():
    route = leader_route(TESTBED, STARTS[0], EXITS[0], (), through_gate=False)
    assert route is not None
    assert route.gate_m is None


def test_the_way_back_through_the_corridor_has_the_other_direction():
    back = leader_route(TESTBED, EXITS[0], STARTS[0], (), through_gate=True)
    assert back is not None
    assert back.way == 1


@pytest.mark.parametrize(
    ("degrees", "way"), [(0, 0), (80, 0), (-80, 0), (90, 0), (100, 1), (180, 1), (-100, 1), (-90, 1)]
)
def test_the_way_goes_by_the_heading_at_the_gate(degrees, way):
    assert way_of(math.radians(degrees)) == way


def test_the_shared_path_reaches_from_the_gate_to_the_end_of_the_narrow_section():
    route = leader()
    path = shared_part(TESTBED, route)
    assert path is not None
    cells = path.cells()
    grid = grid_of(TESTBED)
    assert math.dist(grid.centre(grid.index_at(*cells[0])), (0.5, 0.75)) < 0.06
    assert cells[-1][0] * 0.05 >= 0.9
    assert len(path.steps) * 3 < 100 * 8  # fits one frame with room


def test_a_follower_takes_the_leaders_path_between_its_own_legs():
    shared = shared_part(TESTBED, leader())
    assert shared is not None
    for start in STARTS[1:]:
        route = follower_route(TESTBED, start, EXITS[3], (), shared)
        assert route is not None
        assert route.gate_m is not None
        assert route.points[0] == start
        assert route.points[-1] == EXITS[3]
        last = grid_of(TESTBED).centre(grid_of(TESTBED).index_at(*shared.cells()[-1]))
        assert any(math.dist(p, last) < 1e-9 for p in route.points)


def test_a_followers_leg_goes_around_what_stands_in_it():
    shared = shared_part(TESTBED, leader())
    assert shared is not None
    parked = (STARTS[1],)
    route = follower_route(TESTBED, STARTS[0], EXITS[3], parked, shared)
    assert route is not None
    assert len(route.points) > 4
    for a, b in zip(route.points, route.points[1:], strict=False):
        assert point_segment_distance(*parked[0], *a, *b) >= 0.17 - 1e-6


def test_a_shared_path_that_lies_outside_the_arena_is_not_followed():
    from rmr.base.grid_path import GridPath

    route = follower_route(TESTBED, STARTS[0], EXITS[0], (), GridPath((500, 500), (0, 0)))
    assert route is not None
    assert route.gate_m is not None


def test_a_follower_that_waits_at_the_entry_does_not_drive_back():
    corridor = bench.corridor()
    own = leader_route(corridor, Point(0.2, 0.18), Point(2.6, 1.35), (), through_gate=True)
    assert own is not None
    shared = shared_part(corridor, own)
    assert shared is not None
    route = follower_route(corridor, Point(1.1, 0.75), Point(2.6, 0.15), (), shared)
    assert route is not None
    assert all(b.x >= a.x - 1e-9 for a, b in zip(route.points, route.points[1:], strict=False))


def test_a_route_made_anew_inside_the_corridor_still_knows_where_it_ends():
    route = leader_route(TESTBED, Point(0.7, 0.75), EXITS[0], (), through_gate=False)
    assert route is not None
    again = gated_again(TESTBED, TESTBED.passages[0], route)
    assert again.gate_m == 0.0
    assert 0.9 <= again.point(again.clear_m).x < 1.05


def test_places_of_the_queue_before_a_robot_are_those_nearer_to_the_gate():
    corridor = bench.corridor()
    spots = queue_before(corridor, Point(0.7, 0.75))
    assert [round(p.x, 2) for p in spots] == [1.1, 1.1, 0.9]
    assert queue_before(Arena(1.0, 1.0, 0.05, areas=(Area("a", (Point(0.5, 0.5),)),)), Point(0.1, 0.1)) == []


def follow(route, pose: Pose, seconds: float = 30.0, limit: float = 1.0):
    """Drive ideal wheels along `route`; return the poses."""
    follower = Follower(route, TESTBED.shape)
    x, y, theta = pose
    poses = [pose]
    for _ in range(round(seconds * 60)):
        follower.locate(poses[-1])
        v, w = follower.steer(poses[-1], limit)
        if follower.arrived:
            break
        assert abs(v) <= TESTBED.shape.speed + 1e-9
        assert abs(w) <= TESTBED.shape.turn + 1e-9
        theta += w / 60
        x, y = x + v / 60 * math.cos(theta), y + v / 60 * math.sin(theta)
        poses.append(Pose(x, y, theta))
    assert follower.arrived
    return poses


def test_a_follower_ends_within_a_centimetre_and_stays_near_its_path():
    for start in bench.TESTBED_STARTS:
        route = leader(Point(start.x, start.y), EXITS[1])
        poses = follow(route, start)
        assert math.dist(poses[-1][:2], EXITS[1]) < 0.01
        for pose in poses:
            s = route.project(pose.x, pose.y, 0.0, route.length_m)
            assert math.dist(pose[:2], route.point(s)) < 0.035


def test_a_follower_that_looks_the_wrong_way_turns_in_place_first():
    route = make_route(TESTBED, [Point(0.2, 0.3), Point(0.2, 1.2)], through_gate=False)
    follower = Follower(route, TESTBED.shape)
    follower.locate(Pose(0.2, 0.3, -math.pi / 2))
    v, w = follower.steer(Pose(0.2, 0.3, -math.pi / 2), 1.0)
    assert v == 0.0
    assert abs(w) > 1.0


def test_full_speed_is_held_on_a_straight_way():
    route = make_route(TESTBED, [Point(0.2, 0.3), Point(0.2, 1.2)], through_gate=False)
    poses = follow(route, Pose(0.2, 0.3, math.pi / 2))
    assert len(poses) / 60 < 0.9 / 0.2 + 0.6

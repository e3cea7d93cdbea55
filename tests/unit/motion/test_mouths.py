"""A bottleneck with two mouths: gates, ways, room before them, and robots that begin inside."""

import math

import bench
import pytest

from rmr.base.arena import Area, Arena
from rmr.base.geometry import Point, Pose
from rmr.base.grid_path import GridPath
from rmr.base.time import seconds
from rmr.node.crossing.approach import Approach, departures
from rmr.node.motion.gate import PUT_OFF_S, EntryGate
from rmr.node.motion.leader_path import follower_route
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.replanning import ordered_route
from rmr.node.motion.route import DriveOrder, leader_route
from rmr.node.motion.standoff.refuge import clearing_spot

MOUTHS = (Point(1.2, 0.75), Point(1.8, 0.75))
LEFT, RIGHT = Point(0.45, 0.15), Point(2.55, 1.35)
WEST, EAST = Area("west", MOUTHS[:1]), Area("east", MOUTHS[1:])
TWOWAY = Arena(
    3.0,
    1.5,
    0.05,
    (bench.box(1.2, 0.0, 1.8, 0.6), bench.box(1.2, 0.9, 1.8, 1.5)),
    (
        WEST,
        EAST,
        Area("right", (Point(2.85, 0.15), Point(1.95, 0.15)), slotted=True),
    ),
    passages=bench.bottleneck(WEST, EAST),
)
RADIUS = TWOWAY.shape.radius


def through(start, goal):
    route = leader_route(TWOWAY, start, goal, (), through_gate=True)
    assert route is not None
    return route


@pytest.mark.parametrize(("start", "goal", "way"), [(LEFT, RIGHT, 0), (RIGHT, LEFT, 1)])
def test_the_gate_is_the_mouth_by_which_a_route_enters(start, goal, way):
    route = through(start, goal)
    assert route.gate_m is not None
    assert math.dist(route.point(route.gate_m), MOUTHS[way]) < 1e-6
    assert route.way == way
    assert not route.within


def test_a_robot_is_clear_when_its_hull_is_out_of_the_other_mouth():
    out = through(LEFT, RIGHT)
    assert out.point(out.clear_m).x >= MOUTHS[1].x + 0.7 * RADIUS
    assert out.clear_m - out.gate_m == pytest.approx(0.6 + RADIUS, abs=0.05)


def test_who_waits_leaves_room_for_who_comes_out():
    route = through(LEFT, RIGHT)
    gate = EntryGate(TWOWAY.shape, holding=False)
    assert math.dist(route.point(gate.hold_line_m(route)), MOUTHS[0]) > 3.0 * RADIUS


def test_who_stands_where_others_come_out_is_in_their_way_until_it_may_enter():
    for start, blocks in ((Point(1.81, 0.76), True), (Point(2.3, 0.9), False)):
        route = through(start, LEFT)
        gate = EntryGate(TWOWAY.shape, holding=True)
        assert not gate.blocks(0, route, 0.0)  # it may be just about to drive on
        assert gate.blocks(seconds(3), route, 0.0) is blocks
        gate.opened = True
        assert not gate.blocks(seconds(6), route, 0.0)


@pytest.mark.parametrize(("opened", "passes"), [(False, False), (True, True)])
def test_a_step_to_and_fro_in_the_room_before_the_mouth_is_no_entry_without_a_turn(opened: bool, passes: bool):
    route = through(Point(1.93, 0.97), LEFT)  # a robot that stepped aside, nearer to the mouth than where it may wait
    gate = EntryGate(TWOWAY.shape, holding=False)
    gate.opened = opened
    gate.locate(route, 0.03, arrived=False)
    assert gate.passed is passes
    assert gate.limit(0, route, 0.03) == (TWOWAY.shape.speed if passes else 0.0)


def test_who_is_in_the_bottleneck_without_a_turn_drives_out():
    route = through(Point(1.93, 0.97), LEFT)
    gate = EntryGate(TWOWAY.shape, holding=False)
    assert route.gate_m is not None
    gate.locate(route, route.gate_m + RADIUS + 0.03, arrived=False)
    assert gate.passed


def test_who_waits_right_before_one_that_stands_in_the_mouth_is_in_its_way():
    route = through(Point(2.07, 0.69), LEFT)
    for stands, blocks in (
        (Point(1.91, 0.69), True),  # it has come out and has no room to turn
        (Point(1.83, 0.90), False),  # it passes aside
        (Point(2.20, 0.80), False),  # it waits, too
    ):
        gate = EntryGate(TWOWAY.shape, holding=False)
        assert not gate.blocks(0, route, 0.0, [stands])  # that one may be just about to drive on
        assert gate.blocks(seconds(3), route, 0.0, [stands]) is blocks


def test_out_of_the_mouth_there_is_room_aside_even_next_to_one_that_waits():
    mouth, other = MOUTHS[1], Point(1.97, 0.99)
    spot = clearing_spot(TWOWAY, Point(1.81, 0.76), LEFT, [other], Pose(*mouth, math.pi), 0.27)
    assert spot is not None
    assert spot.x > mouth.x
    assert math.dist(spot, mouth) > 0.27
    assert math.dist(spot, other) > 2.0 * RADIUS


def test_a_way_within_one_room_has_no_gate_even_past_its_mouth():
    route = leader_route(TWOWAY, Point(1.05, 0.15), Point(1.05, 1.35), (), through_gate=True)
    assert route is not None
    assert route.gate_m is None


@pytest.mark.parametrize(("x", "goal", "way"), [(1.3, RIGHT, 0), (1.6, RIGHT, 0), (1.4, LEFT, 1), (1.7, LEFT, 1)])
def test_a_route_that_begins_inside_has_its_gate_there_and_goes_out_by_its_own_way(x, goal, way):
    route = through(Point(x, 0.75), goal)
    assert route.within
    assert (route.gate_m, route.way) == (0.0, way)
    assert route.clear_m == pytest.approx(abs(MOUTHS[1 - way].x - x) + RADIUS, abs=0.06)


def test_a_route_that_begins_inside_a_bottleneck_with_one_mouth_has_its_gate_there_too():
    arena, goal = bench.corridor(), Point(2.6, 0.87)
    inside = leader_route(arena, Point(1.5, 0.75), goal, (), through_gate=True)
    assert inside is not None
    assert inside.within
    for start in (Point(0.9, 0.75), Point(0.2, 0.18), Point(2.1, 0.75)):
        route = leader_route(arena, start, goal, (), through_gate=True)
        assert route is not None
        assert not route.within


def test_a_corner_that_is_narrow_is_no_bottleneck():
    arena = bench.testbed()
    route = leader_route(arena, Point(0.1, 0.15), Point(1.38, 1.38), (), through_gate=True)
    assert route is not None
    assert not route.within


def test_a_leader_shares_a_path_for_each_way():
    approach = Approach(Navigator(TWOWAY, 1))
    paths = approach.shared(Pose(*LEFT, 0.0), RIGHT, TWOWAY.passages[0], 0)
    assert sorted(paths) == [0, 1]
    for way, (start, goal) in enumerate([(LEFT, RIGHT), (RIGHT, LEFT)]):
        path = paths[way]
        assert isinstance(path, GridPath)
        route = follower_route(TWOWAY, start, goal, (), path)
        assert route is not None
        assert route.way == way


def test_who_turns_round_inside_follows_no_path_that_leads_back():
    paths = Approach(Navigator(TWOWAY, 1)).shared(Pose(*LEFT, 0.0), RIGHT, TWOWAY.passages[0], 0)
    inside = Point(1.35, 0.75)
    routes = [
        ordered_route(TWOWAY, inside, DriveOrder(LEFT, shared, True), ()) for shared in (None, paths[0], paths[1])
    ]
    assert None not in routes
    assert routes[0] == routes[1]
    assert routes[2].length_m < routes[0].length_m + 2.0 * TWOWAY.cell


def test_departures_are_measured_from_the_mouth_of_the_way():
    eastward, westward = (departures(TWOWAY, TWOWAY.passages[0].entrance(way), "right") for way in (0, 1))
    assert eastward[0] > eastward[1]
    assert eastward[1] - westward[1] == pytest.approx(0.6, abs=0.05)


def test_who_is_put_off_on_its_way_stands_and_leaves_when_it_is_just_in_time():
    route = through(Point(2.6, 0.9), LEFT)
    gate = EntryGate(TWOWAY.shape, holding=False)
    drive = seconds(gate.commit_line_m(route) / TWOWAY.shape.speed)
    gate.opens_at = drive + seconds(PUT_OFF_S - 0.1)
    assert gate.limit(0, route, 0.0) > 0.0
    gate.opens_at = drive + seconds(PUT_OFF_S + 0.1)
    assert gate.limit(0, route, 0.0) == 0.0
    assert gate.limit(seconds(1), route, 0.0) == 0.0  # and does not creep on
    assert gate.limit(gate.opens_at - drive, route, 0.0) == TWOWAY.shape.speed

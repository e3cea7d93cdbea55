"""Several passages: which gate a route has, which one a turn opens, and what follows behind it."""

import math
from itertools import pairwise, permutations

import bench
import pytest

from rmr.base.arena import Area, Arena, FloorPassage, RobotShape
from rmr.base.direction import direction_of, ends_of
from rmr.base.geometry import Point, Pose, distance
from rmr.base.time import seconds, tick_start
from rmr.node.crossing import resource
from rmr.node.motion.astar import plan
from rmr.node.motion.gate import EntryGate
from rmr.node.motion.keep_right import gated_route
from rmr.node.motion.leader_path import shared_part
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.priority import Heard
from rmr.node.motion.replanning import ordered_route
from rmr.node.motion.route import DriveOrder, leader_route, make_route, still_behind
from rmr.node.ports import SeenBody


def area(name, x, y):
    return Area(name, (Point(x, y),))


ENDS = {
    name: (area(f"{name}_w", x, 0.75), area(f"{name}_e", x + 0.4, 0.75)) for name, x in (("one", 1.0), ("two", 2.4))
}
ROW = Arena(
    3.8,
    1.5,
    0.05,
    tuple(bench.box(x, low, x + 0.4, high) for x in (1.0, 2.4) for low, high in ((0.0, 0.6), (0.9, 1.5))),
    tuple(each for pair in ENDS.values() for each in pair),
    passages=tuple(FloorPassage(name, pair) for name, pair in ENDS.items()),
)
WEST, EAST = Point(0.3, 0.75), Point(3.5, 0.75)


def test_the_gate_of_a_route_is_that_of_the_first_passage_on_it():
    there = leader_route(ROW, WEST, EAST, (), through_gate=True)
    back = leader_route(ROW, EAST, WEST, (), through_gate=True)
    assert there is not None
    assert back is not None
    assert (there.passage, there.way, there.gate_m) == ("one", 0, pytest.approx(0.7, abs=0.05))
    assert (back.passage, back.way, back.gate_m) == ("two", 1, pytest.approx(0.7, abs=0.05))


def test_a_passage_behind_the_robot_has_no_gate():
    route = leader_route(ROW, WEST, EAST, (), through_gate=True, behind=frozenset(["one"]))
    assert route is not None
    assert (route.passage, route.gate_m) == ("two", pytest.approx(2.1, abs=0.05))
    route = leader_route(ROW, WEST, EAST, (), through_gate=True, behind=frozenset(["one", "two"]))
    assert route is not None
    assert (route.passage, route.gate_m) == (None, None)


def test_a_robot_with_a_turn_at_one_passage_whose_goal_is_on_this_side_now_does_not_drive_through_and_back():
    route = gated_route(ROW, Point(1.9, 0.75), WEST, (), via="two")
    assert route is not None
    assert (route.passage, route.length_m) == ("one", pytest.approx(1.6, abs=0.05))


def test_a_turn_opens_the_gate_of_its_passage_only():
    route = leader_route(ROW, WEST, EAST, (), through_gate=True)
    assert route is not None
    gate = EntryGate(ROW.shape, holding=False)
    gate.opened = True
    for passage, opens in (("one", True), ("two", False), (None, True)):
        gate.passage = passage
        assert gate.open_to(route) is opens
        assert (gate.limit(0, route, gate.hold_line_m(route)) > 0.0) is opens


def test_a_drive_stops_at_the_second_gate_that_has_not_been_opened():
    nav = Navigator(ROW, 1)
    pose = Pose(*WEST, 0.0)
    assert nav.go(0, pose, EAST, through_gate=True)
    nav.gate(None, True, "one")
    now = 0
    while now < seconds(60):
        now += seconds(1 / 60)
        twist = nav.step(now, pose, (), bumped=False)
        pose = Pose(pose.x + twist.v / 60, pose.y, 0.0)
    assert nav.behind == {"one"}
    assert nav.route is not None
    assert nav.route.passage == "two"
    assert 1.6 < pose.x < 2.4 - 0.19 - ROW.shape.radius
    nav.gate(None, True, "two")
    while now < seconds(90) and nav.status == "moving":
        now += seconds(1 / 60)
        twist = nav.step(now, pose, (), bumped=False)
        pose = Pose(pose.x + twist.v / 60, pose.y, 0.0)
    assert nav.status == "arrived"


def test_a_robot_that_has_asked_at_a_passage_goes_there():
    ends = {
        name: (area(f"{name}_w", 1.0, y), area(f"{name}_e", 1.4, y)) for name, y in (("south", 0.45), ("north", 1.05))
    }
    walls = ((0.0, 0.3), (0.6, 0.9), (1.2, 1.5))
    arena = Arena(
        2.4,
        1.5,
        0.05,
        tuple(bench.box(1.0, low, 1.4, high) for low, high in walls),
        tuple(each for pair in ends.values() for each in pair),
        passages=tuple(FloorPassage(name, pair) for name, pair in ends.items()),
    )
    start, goal = Point(0.3, 0.9), Point(2.1, 0.9)
    found = {via: gated_route(arena, start, goal, (), via=via) for via in (None, "south", "north")}
    assert {via: route.passage for via, route in found.items() if route} == {
        None: "south", "south": "south", "north": "north",
    }  # fmt: skip
    blocked = gated_route(arena, start, goal, [Point(1.2, 1.05)], via="north")
    assert blocked is not None
    assert blocked.passage == "south"


def test_a_way_between_the_mouths_of_a_passage_may_lead_through_another_one():
    """Where another way leaves more room to the walls, none is planned through the tight one."""
    ends = {name: (area("w", 1.0, y), area("e", 1.4, y)) for name, y in (("south", 0.45), ("tight", 1.05))}
    arena = Arena(
        2.4,
        1.5,
        0.05,
        tuple(bench.box(1.0, low, 1.4, high) for low, high in ((0.0, 0.3), (0.6, 0.96), (1.14, 1.5))),
        passages=tuple(FloorPassage(name, pair) for name, pair in ends.items()),
    )
    start, goal = Point(2.1, 0.9), Point(0.3, 0.9)
    tight = arena.passages[1].mouths
    points = [point for leg in pairwise((start, *tight[::-1], goal)) for point in plan(arena, *leg).points[1:]]
    for behind in (frozenset(), {"tight"}):
        assert make_route(arena, [start, *points], through_gate=True, behind=frozenset(behind)).passage == "south"
    assert make_route(arena, [start, *points], through_gate=True, behind=frozenset({"south"})).passage is None
    for via in (None, "tight"):
        found = gated_route(arena, start, goal, (), via=via)
        assert found is not None
        assert found.passage == "south"
        assert found.length_m < 2.2


def test_a_route_along_the_side_of_a_wide_passage_passes_its_gate():
    """Its mouth is a point in the middle: a route that cuts the corner is 0.4 m away from it."""
    mouths = area("wide_w", 1.0, 1.0), area("wide_e", 1.4, 1.0)
    walls = bench.box(1.0, 0.0, 1.4, 0.4), bench.box(1.0, 1.6, 1.4, 4.0)
    arena = Arena(2.4, 4.0, 0.05, walls, mouths, passages=(FloorPassage("wide", mouths),))
    route = leader_route(arena, Point(0.5, 3.5), Point(1.9, 3.5), (), through_gate=True)
    assert route is not None
    assert min(abs(y - 1.0) for _, y in route.points) > 0.2
    assert route.passage == "wide"


def test_a_plan_made_anew_inside_the_passage_leads_on():
    for start, goal in ((Point(1.2, 0.75), EAST), (Point(1.2, 0.75), WEST)):
        route = gated_route(ROW, start, goal, (), via="one")
        assert route is not None
        assert route.within
        turn = 1.0 if goal is EAST else -1.0
        assert all(turn * (b.x - a.x) >= 0.0 for a, b in pairwise(route.points)), route.points


def test_a_robot_that_has_asked_at_a_passage_does_not_go_through_it_to_a_place_before_it():
    route = gated_route(ROW, WEST, Point(0.5, 0.3), (), via="one")
    assert route is not None
    assert (route.passage, route.gate_m) == (None, None)


def test_a_robot_that_has_entered_a_passage_goes_through_none_back_to_another_place():
    def under_way(start: Point, goal: Point, heading: float) -> Navigator:
        nav = Navigator(ROW, 1)
        assert nav.go(0, Pose(*start, heading), goal, through_gate=True)
        nav.gate(None, True, "one")
        nav.step(seconds(1 / 60), Pose(*start, heading), (), bumped=False)
        return nav

    west, middle = Point(0.3, 0.4), Point(2.0, 0.4)
    before = under_way(WEST, middle, 0.0)
    assert not before.leads_back(Point(2.0, 1.1))
    assert not before.leads_back(west)
    inside = under_way(Point(1.2, 0.75), middle, 0.0)
    assert not inside.leads_back(Point(2.0, 1.1))
    assert inside.leads_back(west)
    beyond = under_way(Point(1.2, 0.75), middle, 0.0)
    for step in range(2, 40):
        beyond.step(step * seconds(1 / 60), Pose(1.2 + step / 60, 0.75, 0.0), (), bumped=False)
    assert not beyond.leads_back(Point(2.0, 1.1))
    assert beyond.leads_back(west)
    assert beyond.leads_back(EAST)
    has_passed_none = under_way(Point(1.8, 0.75), middle, -1.0)
    assert not has_passed_none.leads_back(Point(2.0, 1.1))
    assert not has_passed_none.leads_back(west)


def test_a_way_around_a_passage_is_not_taken_for_one_through_it():
    """The mouths of large robots reach far; where cells are as large, no centre of one is free in the upper aisle."""
    upper = FloorPassage("upper", (area("w", 2.7, 4.96), area("e", 7.3, 4.96)))
    arena = Arena(
        10.0,
        6.2,
        0.31,
        (bench.box(3.0, 0.0, 7.0, 0.6), bench.box(3.0, 2.6, 7.0, 4.38), bench.box(3.0, 5.54, 7.0, 6.2)),
        shape=RobotShape(radius=0.438),
        passages=(upper,),
    )
    start, goal = Point(2.0, 4.9), Point(8.0, 3.6)
    around = leader_route(arena, start, goal, (), through_gate=True)
    assert around is not None
    assert min(point.y for point in around.points) < 2.6
    assert around.passage is None
    through = make_route(arena, [start, *upper.mouths, goal], through_gate=True)
    assert (through.passage, through.way) == ("upper", 0)
    assert shared_part(arena, through) is None


def test_a_robot_does_not_follow_its_leader_through_a_passage_to_a_place_before_it():
    leader = leader_route(ROW, WEST, EAST, (), through_gate=True)
    assert leader is not None
    shared = shared_part(ROW, leader)
    for goal, passage in ((EAST, "one"), (Point(0.5, 0.3), None)):
        route = ordered_route(ROW, WEST, DriveOrder(goal, shared, through_gate=True), ())
        assert route is not None
        assert route.passage == passage


def test_a_robot_in_a_crowd_before_an_open_door_does_not_queue_for_the_passage_beside_it():
    walls = tuple(bench.box(1.0, low, 1.3, high) for low, high in ((0.0, 0.4), (1.0, 1.5), (1.74, 2.4)))
    ends = (area("w", 0.9, 1.62), area("e", 1.4, 1.62))
    arena = Arena(2.4, 2.4, 0.05, walls, ends, passages=(FloorPassage("narrow", ends),))
    navigator = Navigator(arena, 1)
    at = Pose(0.85, 0.7, 0.0)
    assert navigator.go(0, at, Point(2.0, 0.7), through_gate=True)
    assert navigator.route is not None
    assert navigator.route.gate_m is None
    crowd = [SeenBody(0.16, y, 0.0, 0.0) for y in (-0.15, 0.0, 0.15)]
    tried = set()
    for tick in range(480):
        navigator.step(tick_start(tick), at, crowd, bumped=False)
        tried.add(navigator.policy.chosen)
        assert navigator.route.gate_m is None
    assert "reverse" in tried


def test_a_robot_that_backs_out_of_a_passage_has_it_before_it_again():
    """In the entrance it finds the passage barred, and drives to another one: the barred one is not behind it."""
    ends = {
        name: (area(f"{name}_w", 1.0, y), area(f"{name}_e", 1.4, y)) for name, y in (("south", 0.45), ("north", 1.05))
    }
    arena = Arena(
        2.4,
        1.5,
        0.05,
        tuple(bench.box(1.0, low, 1.4, high) for low, high in ((0.0, 0.3), (0.6, 0.9), (1.2, 1.5))),
        tuple(each for pair in ends.values() for each in pair),
        passages=tuple(FloorPassage(name, pair) for name, pair in ends.items()),
    )
    nav = Navigator(arena, 1)
    pose = Pose(0.7, 1.05, 0.0)
    assert nav.go(0, pose, Point(2.1, 1.05), through_gate=True)
    nav.gate(None, True, "north")
    nav.relocate(0, pose)
    behind = set()
    for tick in range(1, 900):
        if nav.passed_gate:
            nav.update_parked([Point(1.2, 1.05)])
        twist = nav.step(tick_start(tick), pose, (), bumped=False)
        theta = pose.theta + twist.w / 60
        pose = Pose(pose.x + twist.v * math.cos(theta) / 60, pose.y + twist.v * math.sin(theta) / 60, theta)
        behind |= nav.behind
    assert behind == set()
    assert nav.route is not None
    assert nav.route.passage == "south"
    assert pose.x < 1.0  # it has no turn there


def test_a_way_back_through_a_passage_that_is_behind_passes_its_gate():
    """A robot has come through one passage, finds the next one barred, and drives back: it needs its turn again."""
    near, away = Point(1.6, 0.75), Point(1.95, 0.75)
    assert still_behind(ROW, frozenset({"one"}), near) == {"one"}
    assert still_behind(ROW, frozenset({"one"}), away) == frozenset()
    nav = Navigator(ROW, 1)
    assert nav.go(0, Pose(*WEST, 0.0), EAST, through_gate=True)
    nav.gate(None, True, "one")
    pose = Pose(*WEST, 0.0)
    now = 0
    while pose.x < away.x and now < seconds(60):
        now += seconds(1 / 60)
        twist = nav.step(now, pose, (), bumped=False)
        pose = Pose(pose.x + twist.v / 60, pose.y, 0.0)
        if nav.behind:
            nav.gate(None, True, "two")
    assert nav.behind == {"one"}
    nav.relocate(now, pose)
    assert nav.behind == frozenset()


def test_a_robot_that_comes_back_from_a_retreat_drives_through_the_passage_again():
    """Though another robot stands somewhere, which is not in its way: it retreated again, and again."""
    nav = Navigator(ROW, 1)
    pose = Pose(0.6, 0.75, 0.0)
    assert nav.go(0, pose, EAST, through_gate=True)
    nav.gate(None, True, "one")
    nav.relocate(0, pose)
    aside = False
    for tick in range(1, 60 * 60):
        now = tick_start(tick)
        if tick % 12 == 1:
            nav.update_moving(now, 1, [Heard(7, Pose(0.2, 1.3, 0.0), Point(0.2, 0.2), 0, now)])
        jam = [] if aside else [SeenBody(0.15, y, 0.0, 0.0) for y in (-0.14, 0.0, 0.14)]
        twist = nav.step(now, pose, jam, bumped=False)
        theta = pose.theta + twist.w / 60
        pose = Pose(pose.x + twist.v * math.cos(theta) / 60, pose.y + twist.v * math.sin(theta) / 60, theta)
        aside = aside or nav.policy.chosen == "retreat"
        if aside and not nav.aside and nav.route is not None and nav.route.passage == "one":
            return
    raise AssertionError((aside, pose, nav.policy.chosen))


ARMS = [("south", 2.0, 0.6), ("west", 1.1, 2.0), ("east", 2.9, 2.0)]
MEETING = Arena(
    4.0,
    3.0,
    0.05,
    (
        bench.box(1.2, 0.7, 1.85, 1.85),
        bench.box(2.15, 0.7, 2.8, 1.85),
        bench.box(1.2, 2.15, 2.8, 3.0),
        bench.box(1.15, 0.0, 1.2, 1.85),
        bench.box(2.8, 0.0, 2.85, 1.85),
    ),
    tuple(area(*arm) for arm in ARMS),
    passages=(FloorPassage("meeting", tuple(area(*arm) for arm in ARMS)),),
)
"""Three corridors that meet."""
YARDS = [Point(2.0, 0.3), Point(0.5, 2.0), Point(3.5, 2.0)]
INSIDE = [Point(2.0, 1.3), Point(1.5, 2.0), Point(2.5, 2.0)]
"""In the middle of each arm."""
TRIPS = list(permutations(range(3), 2))


@pytest.mark.parametrize(("one", "other"), TRIPS)
def test_where_corridors_meet_a_way_has_the_direction_from_its_entrance_to_its_end(one, other):
    route = leader_route(MEETING, YARDS[one], YARDS[other], (), through_gate=True)
    assert route is not None
    assert (route.passage, route.within) == ("meeting", False)
    assert ends_of(route.way) == (one, other)
    assert distance(*route.point(route.gate_m or 0.0), *ARMS[one][1:]) < 0.1
    assert distance(*route.point(route.clear_m), *ARMS[other][1:]) < 0.2


@pytest.mark.parametrize(("one", "other"), TRIPS)
def test_one_that_begins_in_an_arm_has_its_gate_behind_it_and_the_direction_from_that_arm(one, other):
    route = leader_route(MEETING, INSIDE[one], YARDS[other], (), through_gate=True)
    assert route is not None
    assert (route.passage, route.within, route.gate_m) == ("meeting", True, 0.0)
    assert ends_of(route.way) == (one, other)


@pytest.mark.parametrize(("one", "other"), TRIPS)
def test_in_every_arm_on_its_way_a_robot_is_within_and_only_at_the_end_beyond(one, other):
    goal = Area("goal", (YARDS[other],), slotted=True)
    passage = MEETING.passages[0]
    assert resource.stands_within(MEETING, passage, goal, Pose(*INSIDE[one], 0.0))
    assert not resource.stands_within(MEETING, passage, goal, Pose(*YARDS[one], 0.0))
    assert not resource.is_beyond(MEETING, passage, goal, Pose(*YARDS[one], 0.0))
    assert resource.is_beyond(MEETING, passage, goal, Pose(*YARDS[other], 0.0))


def test_a_robot_without_a_turn_backs_out_by_the_entrance_by_which_it_came():
    passage = MEETING.passages[0]
    gate = EntryGate(MEETING.shape, holding=False)
    gate.way = direction_of(2, 0, 3)
    assert gate.backed_out(passage, Pose(*YARDS[2], 0.0))
    assert not gate.backed_out(passage, Pose(*YARDS[0], 0.0))

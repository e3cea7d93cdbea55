"""The last resort: who can get out of a jam by nothing else walks away to free floor, and comes back."""

import math
from itertools import combinations

import bench
import pytest

from rmr.base.arena import BOTTLENECK, Area, Arena, RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.time import seconds
from rmr.base.values import Robot
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.observer import inside
from rmr.node.crossing.phases import Inside
from rmr.node.crossing.situation import CrossingPlan, Withdraw
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.priority import Heard
from rmr.node.motion.standoff.detector import ENDURED, DeadlockDetector
from rmr.node.motion.standoff.escapes import retreat_until
from rmr.node.motion.standoff.refuge import Side, paths_of, retreat_route, side_of
from rmr.node.ports import SeenBody
from rmr.vm.job import TimedJob

WEST, EAST = Area("west", (Point(1.2, 0.75),)), Area("east", (Point(1.8, 0.75),))
ARENA = Arena(
    3.0,
    1.5,
    0.05,
    (bench.box(1.2, 0.0, 1.8, 0.6), bench.box(1.2, 0.9, 1.8, 1.5)),
    (WEST, EAST),
    passages=bench.bottleneck(WEST, EAST),
)
RADIUS = ARENA.shape.radius
START, GOAL, OTHER = Point(1.04, 0.73), Point(2.55, 0.15), Point(0.985, 0.578)


def test_a_retreat_ends_on_free_floor_before_the_bottleneck():
    ends = []
    for tries in range(1, 9):
        route = retreat_route(ARENA, START, GOAL, [OTHER], 1, tries)
        assert route is not None
        end = route.points[-1]
        assert side_of(ARENA, end, GOAL) is Side.BEFORE
        assert math.dist(end, OTHER) > 2.0 * RADIUS
        ends.append(end)
    assert max(math.dist(START, end) for end in ends) > 0.5 > min(math.dist(START, end) for end in ends)


def test_each_robot_and_each_try_has_a_way_and_a_time_of_its_own():
    ways = {
        (robot, tries): retreat_route(ARENA, Point(0.6, 0.75), GOAL, [], robot, tries)
        for robot in (1, 2)
        for tries in (1, 2)
    }
    assert all(a.points[-1] != b.points[-1] for a, b in combinations(ways.values(), 2))
    assert len({retreat_until(0, robot, tries) for robot, tries in ways}) == 4


def test_a_robot_that_is_walled_in_finds_no_way():
    around = [Point(0.6 + 0.16 * math.cos(a), 0.75 + 0.16 * math.sin(a)) for a in (0.0, 1.05, 2.1, 3.14, 4.2, 5.25)]
    assert retreat_route(ARENA, Point(0.6, 0.75), GOAL, around, 1, 1) is None


def test_a_stand_off_endures_where_the_robot_stays_or_is_driven_back():
    here, there, back, goal = Pose(0.5, 0.5, 0.0), Pose(0.7, 0.5, 0.0), Pose(0.3, 0.5, 0.0), Point(1.2, 0.5)
    stays, moves, yields = (DeadlockDetector(1, RobotShape()) for _ in range(3))
    assert not stays.endures(0, here, goal, walks=False)
    assert stays.endures(ENDURED, here, goal, walks=False)
    assert stays.endures(ENDURED + seconds(1), there, goal, walks=True)
    assert not moves.endures(0, here, goal, walks=False)
    assert not moves.endures(ENDURED, there, goal, walks=False)
    assert not yields.endures(0, here, goal, walks=False)
    assert yields.endures(ENDURED, back, goal, walks=False)


@pytest.mark.parametrize(("at", "walks"), [(Pose(*START, 0.13), True), (Pose(1.5, 0.75, 0.0), False)])
def test_before_the_mouth_a_robot_gives_up_its_passage_and_leaves_but_not_within(at: Pose, walks: bool):
    navigator, now = Navigator(ARENA, 1), 0
    navigator.go(now, Pose(1.0, at.y, 0.0), GOAL, through_gate=True)
    navigator.gate(None, opened=True)
    passed = False
    while now < 2 * ENDURED and not navigator.aside:
        now += seconds(1 / 60)
        navigator.update_moving(now, 1, [Heard(8, Pose(at.x + 0.16, at.y - 0.05, 2.0), Point(0.15, 1.35), 2, now)])
        navigator.step(now, at, [SeenBody(0.15, -0.05, 0.0, 0.0)], bumped=False)
        passed = passed or navigator.passed_gate
    assert passed
    assert navigator.aside is walks
    assert navigator.passed_gate is not walks
    job = TimedJob(1, 0, "crossing", "crossing()", "across(@1)", 0, seconds(60), (), Robot(1))
    plan = CrossingPlan(gated=True, passage=BOTTLENECK)
    crossing = Crossing(job, b"group.", b"group.", 0, None, Inside(now, None), plan, entered_at=now)
    gives_up = Withdraw() in crossing.step(now, inside(navigator, crossing, at, None))
    assert gives_up is walks, "others wait for an entry that is not used"


@pytest.mark.parametrize("seen", [Pose(1.91, 0.69, -1.3), Pose(1.86, 0.86, -2.1)])
def test_who_waits_for_its_turn_makes_room_for_one_that_is_stuck_between_it_and_the_mouth(seen: Pose):
    at, now = Pose(2.01, 0.79, 2.8), 0
    waits = Navigator(ARENA, 8)
    waits.go(now, at, Point(0.15, 1.35), through_gate=True)
    waits.gate(seconds(60), opened=False)
    while now < seconds(4) and not waits.aside:
        now += seconds(1 / 60)
        waits.update_moving(now, 7, [Heard(4, seen, GOAL, 2, now)])
        waits.step(now, at, [], bumped=False)
    assert waits.aside
    assert not waits.passed_gate
    assert waits.route is not None
    assert math.dist(waits.route.points[-1], seen[:2]) > 3.0 * RADIUS


def test_who_is_inside_with_its_turn_waits_for_nobody_that_stands_in_the_mouth_behind_it():
    at, now = Pose(1.698, 0.744, -2.99), 0
    inside = Navigator(ARENA, 6)
    inside.go(now, at, Point(1.05, 1.35), parked=[Point(1.861, 0.799)], through_gate=True)
    inside.gate(None, opened=True)
    speed = 0.0
    while now < seconds(1):
        now += seconds(1 / 60)
        speed = inside.step(now, at, [], bumped=False).v
    assert speed > 0.1


def test_a_retreat_ends_off_the_ways_of_others_where_it_can():
    floor = Arena(3.0, 1.5, 0.05, (), ())
    here, wide = Point(1.5, 0.75), 2.0 * floor.shape.radius
    other = Heard(2, Pose(1.2, 0.2, 0.0), Point(1.2, 1.3), 0, 0)
    ways = paths_of(floor, here, [other], ())
    assert [way.points[-1] for way in ways] == [other.goal]
    runs = [(robot, tries) for robot in range(1, 9) for tries in (1, 2)]
    for one, hinders in (((), True), (ways, False)):
        ends = [retreat_route(floor, here, Point(2.8, 0.75), (), robot, tries, one) for robot, tries in runs]
        assert any(end is not None and abs(end.points[-1].x - 1.2) < wide for end in ends) is hinders
    turns = [math.radians(degrees) for degrees in range(-120, 121, 15)]
    walled = [Point(here.x + 0.28 * math.cos(turn), here.y + 0.28 * math.sin(turn)) for turn in turns]
    farther = retreat_route(floor, here, Point(2.8, 0.75), walled, 1, 1, ways)
    assert farther is not None
    assert math.dist(farther.points[-1], here) > 0.3
    assert abs(farther.points[-1].x - 1.2) >= wide


def test_a_retreat_ends_on_a_way_of_others_where_there_is_nothing_else():
    lane, here = Arena(3.0, 0.3, 0.05, (), ()), Point(1.5, 0.15)
    ways = paths_of(lane, here, [Heard(2, Pose(0.9, 0.15, 0.0), Point(2.9, 0.15), 0, 0)], ())
    away = retreat_route(lane, here, Point(0.2, 0.15), (), 1, 1, ways)
    assert ways
    assert away is not None
    assert math.dist(away.points[-1], here) > 0.2


def test_only_those_near_that_say_where_they_go_have_ways():
    floor, here = Arena(3.0, 1.5, 0.05, (), ()), Point(0.5, 0.75)
    far = Heard(2, Pose(2.5, 0.2, 0.0), Point(1.2, 1.3), 0, 0)
    silent = Heard(3, Pose(0.8, 0.2, 0.0), None, 0, 0)
    assert paths_of(floor, here, [far, silent], ()) == []


def test_of_a_crowd_the_ways_of_the_nearest_count():
    floor, here = Arena(3.0, 1.5, 0.05, (), ()), Point(0.5, 0.75)
    crowd = [Heard(robot, Pose(1.4 - 0.05 * robot, 0.75, 0.0), Point(2.8, 0.75), 0, 0) for robot in range(1, 13)]
    ways = paths_of(floor, here, crowd, ())
    assert [way.points[0].x for way in ways] == [pytest.approx(1.4 - 0.05 * robot) for robot in range(12, 4, -1)]


@pytest.mark.parametrize("seed", range(4))
def test_large_robots_that_meet_pass_each_other_once_one_has_made_room(seed: int):
    # It backs up by 20 cm, the other one follows, and the way around is another one from there.
    arena = Arena(9.3, 4.0, 0.3, (), (), shape=RobotShape(0.43, 0.4))
    world = bench.Bench(arena, [Pose(0.8, 2.0, 0.0), Pose(8.5, 2.0, math.pi)], seed)
    goals = Point(8.5, 2.0), Point(0.8, 2.0)
    for body, goal in zip(world.bodies, goals, strict=True):
        body.nav.go(0, body.estimate, goal)

    def have_passed() -> bool:
        if world.tick % bench.SAID_TICKS == 0:
            world.say()
        return all(body.nav.status == "arrived" for body in world.bodies)

    assert world.run(have_passed, 45.0), world.time
    assert not world.contacts

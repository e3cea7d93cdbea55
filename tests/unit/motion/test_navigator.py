"""The navigator: one robot's drives, its gate, parked robots, stand-offs, and what others ask of it."""

import math

import bench
import pytest

from rmr.base.arena import Arena
from rmr.base.geometry import STILL, Point, Pose, Twist
from rmr.base.time import Instant, in_seconds, seconds, tick_start
from rmr.node.motion import forecast
from rmr.node.motion.hearing import ReportedState
from rmr.node.motion.navigator import Navigator
from rmr.node.motion.priority import Heard
from rmr.node.motion.standoff.detector import ENDURED
from rmr.node.motion.standoff.escapes import RETREAT_S, RETREAT_SPREAD_S
from rmr.node.ports import SeenBody

ROOM = Arena(1.5, 1.5, 0.05)
EXIT = Point(1.38, 1.14)


def alone(start: Pose = bench.TESTBED_STARTS[0], arena: Arena | None = None, noise: float = 0.0):
    world = bench.Bench(arena or bench.testbed(), [start], 1, noise)
    return world, world.bodies[0], world.bodies[0].nav


def test_a_new_navigator_is_idle_and_stands():
    nav = Navigator(ROOM, 1)
    assert nav.status == "idle"
    assert nav.step(0, Pose(0.5, 0.5, 0.0), (), False) == STILL
    assert nav.remaining_m == 0.0


def test_a_drive_arrives_within_a_centimetre_and_faces_as_ordered():
    world, body, nav = alone(Pose(0.3, 0.3, 2.0), ROOM)
    assert nav.go(0, body.estimate, Point(1.2, 0.9), final_heading=-1.0)
    assert world.run(lambda: nav.status == "arrived", 20)
    assert math.dist((body.x, body.y), (1.2, 0.9)) < 0.01
    assert abs(body.theta + 1.0) < 0.05
    assert not world.contacts


def test_a_drive_to_where_the_robot_stands_arrives_at_once():
    world, body, nav = alone(Pose(0.3, 0.3, 2.0), ROOM)
    assert nav.go(0, body.estimate, Point(0.3, 0.3))
    assert world.run(lambda: nav.status == "arrived", 2)


def test_noisy_poses_still_arrive():
    for seed in range(5):
        world = bench.Bench(bench.testbed(), [bench.TESTBED_STARTS[seed]], seed)
        body = world.bodies[0]
        body.nav.go(0, body.estimate, EXIT, through_gate=True)
        body.nav.gate(None, True)
        assert world.run(lambda nav=body.nav: nav.status == "arrived", 15)
        assert math.dist((body.x, body.y), EXIT) < 0.03
        assert not world.contacts


def test_a_closed_gate_stops_the_hull_before_the_entry():
    world, body, nav = alone()
    nav.go(0, body.estimate, EXIT, through_gate=True)
    nav.gate(None, False)
    world.run(lambda: False, 8)
    assert nav.status == "moving"
    assert not nav.passed_gate
    front = nav.route.gate_m - nav.route.project(body.x, body.y, 0.0, 3.0) - 0.07
    assert 0.0 <= front < 0.03
    assert body.v == 0.0


def test_an_opened_gate_lets_the_robot_pass_and_tells_when_it_is_clear():
    world, body, nav = alone()
    nav.go(0, body.estimate, EXIT, through_gate=True)
    nav.gate(None, True)
    assert world.run(lambda: nav.passed_gate, 10)
    assert not nav.cleared
    assert in_seconds(nav.eta_clear()) == pytest.approx(3.1, abs=0.5)
    assert world.run(lambda: nav.cleared, 10)
    assert body.x > 0.9 + 0.04
    assert nav.eta_clear() == 0


@pytest.mark.parametrize("wait_s", [4.0, 6.0, 12.0])
def test_a_robot_crosses_the_gates_line_as_its_slot_opens_and_leaves_just_in_time(wait_s):
    world, body, nav = alone()
    nav.go(0, body.estimate, EXIT, through_gate=True)
    opens = seconds(wait_s)
    nav.gate(opens, False)
    assert in_seconds(nav.eta_gate()) < wait_s
    assert world.run(lambda: nav.eta_gate() == 0, 20)
    assert world.time == pytest.approx(wait_s, abs=0.12)
    nav.gate(opens, True)
    before = body.distance
    world.run(lambda: False, world.time + 1.0)
    assert body.distance - before > 0.17  # it went on without stopping


def test_a_robot_that_waits_for_its_time_is_parked_and_one_that_has_left_is_not():
    world, body, nav = alone()
    nav.go(0, body.estimate, EXIT, through_gate=True)
    nav.gate(seconds(10), False)
    world.run(lambda: False, 3)
    assert nav.parked
    assert body.distance < 0.001
    world.run(lambda: False, 8)
    assert not nav.parked


@pytest.mark.parametrize("start", bench.TESTBED_STARTS)
def test_what_is_left_of_the_way_to_the_gate_falls_as_time_goes(start):
    world, body, nav = alone(start)
    estimate = forecast.estimate(nav.arena, body.estimate, EXIT)
    assert estimate is not None
    due = in_seconds(estimate.approach)
    nav.go(0, body.estimate, EXIT, through_gate=True)
    nav.gate(None, True)
    told = []
    world.run(lambda: told.append(world.time + in_seconds(nav.eta_gate())) or nav.passed_gate, 1.0)
    assert told[-1] == pytest.approx(due, abs=0.15)  # a quarter of a second more, and the slot would be moved
    world.run(lambda: nav.eta_gate() == 0, 10)
    assert world.time == pytest.approx(due, abs=0.15)


def test_the_estimate_is_what_the_drive_then_takes():
    for start in bench.TESTBED_STARTS:
        world, body, nav = alone(start)
        estimate = forecast.estimate(nav.arena, body.estimate, EXIT)
        assert estimate is not None
        nav.go(0, body.estimate, EXIT, through_gate=True)
        nav.gate(None, True)
        world.run(lambda nav=nav, world=world: nav.eta_gate() == 0, 10)
        assert world.time == pytest.approx(in_seconds(estimate.approach), abs=0.45)
        crossed = world.time
        world.run(lambda nav=nav: nav.cleared, 10)
        assert world.time - crossed == pytest.approx(in_seconds(estimate.inside), abs=0.45)
        assert estimate.way == 0


def test_the_estimate_of_a_drive_without_gate_is_its_length():
    estimate = forecast.estimate(ROOM, Pose(0.3, 0.3, 0.0), Point(1.3, 0.3))
    assert estimate is not None
    assert in_seconds(estimate.approach) == pytest.approx(5.15, abs=0.1)
    assert estimate.inside == 0


def test_without_a_way_the_robot_is_blocked_and_goes_when_the_others_have_left():
    world, body, nav = alone(Pose(0.2, 0.7, 0.0), ROOM)
    wall = [Point(0.75, 0.05 + 0.2 * i) for i in range(8)]
    assert not nav.go(0, body.estimate, Point(1.3, 0.7), parked=wall)
    assert nav.status == "blocked"
    world.run(lambda: False, 1)
    assert nav.status == "blocked"
    assert body.distance == 0.0
    nav.update_parked(wall[:2])
    assert world.run(lambda: nav.status == "arrived", 12)


def test_a_robot_that_parks_in_the_way_is_driven_around():
    world, body, nav = alone(Pose(0.2, 0.7, 0.0), ROOM)
    nav.go(0, body.estimate, Point(1.3, 0.7))
    world.run(lambda: False, 1)
    nav.update_parked([Point(0.8, 0.7)])
    least = math.inf
    while world.time < 12 and nav.status != "arrived":
        world.step()
        least = min(least, math.dist((body.x, body.y), (0.8, 0.7)))
    assert nav.status == "arrived"
    assert least > 0.15


def test_noise_of_parked_robots_is_no_reason_to_plan_again():
    world, body, nav = alone(Pose(0.2, 0.7, 0.0), ROOM)
    nav.go(0, body.estimate, Point(1.3, 0.7), parked=[Point(0.8, 0.3)])
    for i in range(10):
        nav.update_parked([Point(0.8 + 0.001 * i, 0.3)])
        world.step()
    assert nav.replans == 1


def test_stop_forgets_everything():
    world, body, nav = alone(Pose(0.2, 0.7, 0.0), ROOM)
    nav.go(0, body.estimate, Point(1.3, 0.7))
    world.run(lambda: False, 1)
    nav.stop()
    assert nav.status == "idle"
    assert nav.route is None
    assert nav.step(world.now, body.estimate, (), False) == STILL


def test_face_turns_in_place():
    world, body, nav = alone(Pose(0.5, 0.7, 0.0), ROOM)
    nav.face(2.5)
    assert world.run(lambda: nav.status == "arrived", 3)
    assert abs(body.theta - 2.5) < 0.05
    assert body.distance == 0.0


def test_driving_by_hand_still_stops_if_dangerous():
    nav = Navigator(ROOM, 1)
    nav.drive(0.15, 0.0)
    assert nav.step(0, Pose(0.5, 0.5, 0.0), (), False) == Twist(0.15, 0.0)
    assert nav.step(0, Pose(0.5, 0.5, 0.0), (SeenBody(0.142, 0.0, 0.0, 0.0),), False).v == 0.0


@pytest.mark.parametrize(("w", "slowed"), [(2.2, True), (0.0, False), (-2.2, False)], ids=["left", "straight", "right"])
def test_a_robot_that_turns_slows_for_one_abeam_on_its_left_that_it_hears_but_does_not_see(w: float, slowed: bool):
    nav, pose = Navigator(ROOM, 1), Pose(0.5, 0.5, 0.0)
    nav.hearing.update(pose, [ReportedState(2, 0.495, 0.668, 0.04, -0.045, 0, parked=False, silent=False)])
    nav.drive(0.2, w)
    assert (nav.step(0, pose, (), False).v < 0.06) is slowed


def test_a_robot_late_in_the_order_gives_way_to_one_it_cannot_see():
    pose = Pose(0.75, 0.3, math.pi / 2)
    yielding, first = Navigator(ROOM, 3), Navigator(ROOM, 3)
    for nav, rank in ((yielding, 2), (first, 0)):
        nav.go(0, pose, Point(0.75, 1.3))
        other = Heard(7, Pose(0.4, 0.65, 0.0), Point(1.3, 0.65), 1 if nav is yielding else 0, 0)
        nav.update_moving(0, rank, [other])
    assert yielding.step(0, pose, (), False).v < 0.15
    assert first.step(0, pose, (), False).v == pytest.approx(0.2)


def test_two_robots_face_to_face_that_hear_each_other_pass():
    starts = [Pose(0.3, 0.75, 0.0), Pose(1.2, 0.75, math.pi)]
    for seed in range(20):
        world = bench.Bench(ROOM, starts, seed)
        a, b = world.bodies
        a.nav.go(0, a.estimate, Point(1.2, 0.75))
        b.nav.go(0, b.estimate, Point(0.3, 0.75))

        def both_there(world=world, a=a, b=b):
            if world.tick % bench.SAID_TICKS == 0:
                world.say()
            return a.nav.status == b.nav.status == "arrived"

        assert world.run(both_there, 30), seed
        assert not world.contacts, seed


@pytest.mark.parametrize("gated", [True, False])
def test_a_robot_whose_goal_is_taken_leaves_the_way_to_it_only_to_retreat(gated: bool):
    navigator = Navigator(bench.testbed(), 1)
    start, goal = Pose(0.25, 0.75, 0.0), Point(1.38, 0.36)
    navigator.go(0, start, goal, through_gate=gated)
    navigator.gate(0, opened=True)

    def gates(since: Instant, until: Instant) -> set[tuple[bool, bool]]:
        found = set()
        for tick in range(round(in_seconds(since) * 60), round(in_seconds(until) * 60)):
            now = tick_start(tick)
            if tick % 12 == 0:
                navigator.update_moving(now, 1, [Heard(2, Pose(*goal, 3.0), Point(0.25, 0.75), 2, now)])
            navigator.step(now, start, [SeenBody(0.165, 0.0, 0.0, 0.0)], bumped=False)
            found.add((navigator.route.points[-1] == goal, navigator.route.gate_m is not None))
        return found

    assert gates(0, ENDURED) == {(True, gated)}
    assert navigator.replans > 3, "it never was in a deadlock"
    assert (False, False) in gates(ENDURED, 2 * ENDURED), "it seeks for ever a way out where there is none"
    assert not navigator.passed_gate


def test_a_robot_that_has_retreated_and_finds_no_way_back_retreats_elsewhere():
    navigator = Navigator(bench.testbed(), 1)
    start, goal = Pose(0.25, 0.75, 0.0), Point(1.38, 0.36)
    barred = [Point(0.55, 0.7), Point(0.55, 0.82)]  # by others that stand aside as well, and wait

    def ends(since_s: float, until_s: float) -> set[Point]:
        found = set()
        for tick in range(round(since_s * 60), round(until_s * 60)):
            now = tick_start(tick)
            if tick % 12 == 0:
                navigator.update_moving(now, 1, [Heard(2, Pose(*goal, 3.0), Point(0.25, 0.75), 2, now)])
            navigator.step(now, start, [SeenBody(0.165, 0.0, 0.0, 0.0)], bumped=False)
            found.add(navigator.route.points[-1])
        return found

    navigator.go(0, start, goal)
    jammed_s = in_seconds(ENDURED) + 2.5
    (spot,) = ends(0, jammed_s) - {goal}
    navigator.update_parked(barred)
    longest_s = RETREAT_S + RETREAT_SPREAD_S
    assert ends(jammed_s, jammed_s + longest_s + 2) - {spot, goal}, "it has not retreated again"


def test_a_robot_that_is_given_another_place_ends_its_excursion_first():
    navigator = Navigator(bench.testbed(), 1)
    start, goal, other = Pose(0.25, 0.75, 0.0), Point(1.38, 0.36), Point(1.38, 0.5)
    navigator.go(0, start, goal)
    now = 0
    while not navigator.aside:
        now += seconds(1 / 60)
        assert now < 3 * ENDURED, "it has not retreated"
        navigator.update_moving(now, 1, [Heard(2, Pose(*goal, 3.0), Point(0.25, 0.75), 2, now)])
        navigator.step(now, start, [SeenBody(0.165, 0.0, 0.0, 0.0)], bumped=False)
    spot = navigator.route.points[-1]
    assert navigator.go(now, start, other)
    assert navigator.aside
    assert navigator.route.points[-1] == spot
    assert navigator.goal == other
    navigator.step(now + seconds(RETREAT_S + RETREAT_SPREAD_S), start, [], bumped=False)
    assert not navigator.aside
    assert navigator.route.points[-1] == other


def test_another_driver_heads_for_the_hold_line_then_for_the_goal_and_the_drive_ends_when_it_is_there():
    _, body, nav = alone()
    nav.outside = True
    nav.go(0, body.estimate, EXIT, through_gate=True)
    assert nav.step(0, body.estimate, (), False) == STILL
    line = nav.heads_for()
    assert nav.route is not None
    assert math.dist((line.x, line.y), nav.route.point(nav.route.gate_m or 0.0)) == pytest.approx(0.08, abs=0.02)
    nav.reached(line)
    assert nav.status == "moving"
    at_line = Pose(line.x, line.y, line.theta)
    nav.relocate(0, at_line)
    nav.step(0, at_line, (), False)
    assert nav.heads_for() is None, "it stands until its turn"
    nav.gate(None, True)
    goal = nav.heads_for()
    assert math.dist((goal.x, goal.y), EXIT) < 1e-9
    nav.reached(goal)
    assert nav.step(0, at_line, (), False) == STILL
    assert nav.status == "arrived"
    nav.stop()
    assert not nav.outside


def test_another_driver_stands_while_it_is_too_early_to_leave():
    _, body, nav = alone()
    nav.outside = True
    nav.go(0, body.estimate, EXIT, through_gate=True)
    nav.gate(seconds(60), False)
    nav.step(0, body.estimate, (), False)
    nav.step(tick_start(1), body.estimate, (), False)
    assert nav.heads_for() is None
    nav.gate(seconds(60), True)
    nav.step(tick_start(2), body.estimate, (), False)
    assert nav.heads_for() is not None

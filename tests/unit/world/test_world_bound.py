"""The physical bound, free-flow ways and the deadlines that could be met."""

import math
from itertools import permutations
from random import Random

import pytest
from world_labs import LABS, ROOM, lab_of

from rmr.base.arena import Arena, Disc, Polygon, RobotShape
from rmr.base.geometry import Point
from rmr_world.bound import bound_s, destinations, free_times
from rmr_world.free_flow import FreeFlow
from rmr_world.lab_file import load_lab
from rmr_world.run_report import _through_bottleneck, best_possible

R = 0.07


def box(x0, y0, x1, y1):
    return Polygon((Point(x0, y0), Point(x1, y0), Point(x1, y1), Point(x0, y1)))


def flow_of(*obstacles):
    return FreeFlow(Arena(3.0, 1.5, 0.05, tuple(obstacles), shape=RobotShape()))


def way(flow, a, b):
    return flow.lengths(Point(*a), [Point(*b)])[0]


# Free-flow ways


def test_an_unhindered_way_is_straight():
    assert way(flow_of(), (0.5, 0.5), (2.5, 1.2)) == pytest.approx(math.hypot(2.0, 0.7))


def test_a_way_round_a_disc_is_two_tangents_and_an_arc():
    grown = 0.2 + R
    tangent = math.sqrt(0.6**2 - grown**2)
    arc = math.pi - 2 * math.acos(grown / 0.6)
    exact = 2 * tangent + grown * arc
    found = way(flow_of(Disc(Point(1.5, 0.75), 0.2)), (0.9, 0.75), (2.1, 0.75))
    assert 0.997 * exact < found <= exact


def test_a_way_round_a_box_bends_around_its_corner_at_the_robot_s_radius():
    flow = flow_of(box(1.0, 0.0, 1.2, 1.0))
    a, corner = Point(0.5, 0.5), Point(1.0, 1.0)
    d = math.dist(a, corner)
    tangent = math.sqrt(d * d - R * R)
    turned = math.atan2(0.5, 0.5) + math.asin(R / d)  # from the tangent to level, at the left corner
    exact = 2 * (tangent + R * turned) + 0.2
    assert way(flow, (0.5, 0.5), (1.7, 0.5)) == pytest.approx(exact, rel=1e-3)
    assert way(flow, (0.5, 0.5), (1.7, 0.5)) <= exact


def test_a_gap_narrower_than_the_robot_is_no_way():
    narrow = flow_of(box(1.0, 0.0, 1.2, 0.69), box(1.0, 0.82, 1.2, 1.5))
    wide = flow_of(box(1.0, 0.0, 1.2, 0.67), box(1.0, 0.83, 1.2, 1.5))
    assert way(narrow, (0.5, 0.75), (2.0, 0.75)) == math.inf
    assert way(wide, (0.5, 0.75), (2.0, 0.75)) == pytest.approx(1.5)


def test_no_way_is_shorter_than_the_straight_line_and_both_directions_are_equal():
    rng = Random("ways")
    flow = flow_of(box(0.6, 0.4, 0.9, 1.1), Disc(Point(1.6, 0.7), 0.3), box(2.2, 0.0, 2.4, 0.9))
    free = []
    while len(free) < 12:
        point = Point(rng.uniform(R, 3 - R), rng.uniform(R, 1.5 - R))
        if flow.free(point):
            free.append(point)
    table = [flow.lengths(point, free) for point in free]
    for i, a in enumerate(free):
        for j, b in enumerate(free):
            assert table[i][j] >= math.dist(a, b) - 1e-9
            assert table[i][j] == pytest.approx(table[j][i])
            assert all(table[i][j] <= table[i][k] + table[k][j] + 1e-9 for k in range(len(free)))


# The bound


def test_a_lone_robot_s_bound_is_its_trip(tmp_path):
    lab = lab_of(tmp_path, ROOM + "areas: {goal: {at: [2.5, 0.75]}}\nfinish: at(R, goal)\n")
    assert bound_s(lab) == pytest.approx(2.0 / 0.2)


def test_slots_are_shared_out_so_that_the_longest_trip_is_least(tmp_path):
    text = ROOM.replace("[0.5, 0.75, 0deg]", "[0.5, 0.2, 0]") + (
        "  - {id: 2, pose: [1.5, 0.2, 0]}\nareas: {goal: {slots: [[1.3, 0.2], [2.5, 0.2]]}}\nfinish: at(R, goal)\n"
    )
    assert bound_s(lab_of(tmp_path, text)) == pytest.approx(1.0 / 0.2)  # not 2.0 m for robot 1


def test_the_bottleneck_assignment_is_the_best_of_all():
    from rmr_world.bound import _longest_trip

    rng = Random("assignment")
    for _ in range(50):
        trips = [[rng.uniform(1, 9) for _ in range(5)] for _ in range(4)]
        best = min(max(trips[i][slot] for i, slot in enumerate(order)) for order in permutations(range(5), 4))
        assert _longest_trip(trips, shared=False) == best


def test_robots_pass_a_bottleneck_one_behind_the_other():
    lab = load_lab(LABS / "corridor")
    times = free_times(lab)
    (stream,) = times.streams
    assert times.spacing == pytest.approx(0.7)
    assert min(stream.approaches) == pytest.approx(3.02, abs=0.01)
    assert min(stream.departures) == pytest.approx(math.hypot(1.5, 0.12) / 0.2, abs=0.01)
    assert bound_s(lab) == pytest.approx(min(stream.approaches) + 5 * 0.7 + min(stream.departures))
    assert bound_s(lab) == pytest.approx(14.04, abs=0.01)


def test_the_testbed_s_bound_is_about_ten_seconds():
    assert bound_s(load_lab(LABS / "testbed")) == pytest.approx(10.12, abs=0.01)


def test_robots_from_both_sides_change_direction_at_least_once():
    lab = load_lab(LABS / "twoway")
    times = free_times(lab)
    west, east = times.entrances[0], times.entrances[1]
    assert (west.count, east.count) == (4, 4)
    assert times.turnaround == pytest.approx(times.spacing + 0.6 / 0.2)
    assert west.approach == pytest.approx(east.approach)  # the rooms are point-symmetric
    assert bound_s(lab) == pytest.approx(west.approach + 6 * times.spacing + times.turnaround + east.departure)
    assert bound_s(lab) > bound_s(lab.with_robots(4)) + 3.0


def test_a_robot_that_need_not_pass_the_bottleneck_is_not_counted_at_it(tmp_path):
    text = (LABS / "twoway" / "lab.yaml").read_text().replace("goes(@1, right)", "goes(@1, left)")
    entrances = free_times(lab_of(tmp_path, text)).entrances
    assert (entrances[0].count, entrances[1].count) == (3, 4)


def test_robots_of_several_destinations_share_out_the_slots_of_each(tmp_path):
    text = ROOM.replace("[0.5, 0.75, 0deg]", "[0.5, 0.2, 0]") + (
        "  - {id: 2, pose: [1.5, 0.2, 0]}\n"
        "areas: {a: {slots: [[0.7, 0.2], [1.0, 0.2]]}, b: {slots: [[2.5, 0.2], [1.7, 0.2]]}}\n"
        "finish: done(R)\nfacts: ['goes(@1, a)', 'goes(@2, b)']\n"
    )
    lab = lab_of(tmp_path, text)
    assert {robot: area.name for robot, area in destinations(lab).items()} == {1: "a", 2: "b"}
    assert bound_s(lab) == pytest.approx(1.0)  # 0.2 m, both


def test_a_box_is_reached_at_its_edge(tmp_path):
    lab = lab_of(tmp_path, ROOM + "areas: {goal: {box: [1.5, 0.5, 2.5, 1.0]}}\nfinish: at(R, goal)\n")
    assert bound_s(lab) == pytest.approx(1.0 / 0.2)


def test_an_unreachable_destination_has_an_infinite_bound(tmp_path):
    wall = "obstacles: [{box: [1, 0, 1.2, 1.5]}]\n"
    lab = lab_of(tmp_path, ROOM + wall + "areas: {goal: {at: [2.5, 0.75]}}\nfinish: at(R, goal)\n")
    assert bound_s(lab) == math.inf


def test_a_lab_without_a_destination_has_no_trip(tmp_path):
    lab = lab_of(tmp_path, ROOM + "finish: done(R)\n")
    assert destinations(lab) == {}
    assert bound_s(lab) == 0


# Deadlines


def jobs(lab, deadlines, met=None):
    def job(robot, deadline):
        return {"job": f"at(@{robot}, exit)", "start_s": 0.0, "finish_s": None, "deadline_s": deadline, "met": met}

    return {robot: {"assertions": [job(robot, d)]} for robot, d in zip(lab.roster, deadlines, strict=True)}


def test_all_deadlines_of_both_labs_can_be_met():
    for name in ("corridor", "testbed"):
        lab = load_lab(LABS / name)
        deadlines = [float(fact.args[0]) for fact in lab.initial_facts]
        assert best_possible(lab, jobs(lab, deadlines)) == 6


def test_deadline_before_the_free_flow_trip_cannot_be_met():
    lab = load_lab(LABS / "corridor")
    assert best_possible(lab, jobs(lab, [30, 30, 30, 30, 30, 5])) == 5


def test_robots_that_are_all_due_at_once_pass_the_bottleneck_in_turn():
    lab = load_lab(LABS / "corridor")
    (first,) = free_times(lab).streams
    earliest = min(first.approaches) + min(first.departures)
    together = [max(earliest + 2.5 * 0.7, 13.5)] * 6
    assert best_possible(lab, jobs(lab, together)) == 1 + int((together[0] - earliest) / 0.7)


def best_of_all_orders(times, deadlines):
    """Return the most jobs that any order of any of them meets; job i enters by mouth i % 2."""
    best = 0
    for order in (order for n in range(len(deadlines) + 1) for order in permutations(range(len(deadlines)), n)):
        at, last, met = 0.0, None, 0
        for job in order:
            family = times.entrances[job % 2]
            gap = 0.0 if last is None else times.spacing if last == job % 2 else times.turnaround
            at, last = max(family.approach, at + gap), job % 2
            met += at + family.departure <= deadlines[job]
        best = max(best, met)
    return best


def test_as_many_deadlines_count_as_possible_as_the_best_of_all_orders_meets():
    times = free_times(load_lab(LABS / "twoway"))
    rng = Random("orders")
    seen = set()
    for _ in range(25):
        deadlines = [rng.uniform(8.0, 15.0) for _ in range(5)]
        in_time = [sorted(deadlines[family::2]) for family in (0, 1)]
        found = _through_bottleneck(times, in_time)
        assert found == best_of_all_orders(times, deadlines)
        seen.add(found)
    assert len(seen) > 2


def test_best_possible_counts_every_deadline_that_was_met():
    lab = load_lab(LABS / "corridor")
    assert best_possible(lab, jobs(lab, [1.0] * 6, met=True)) == 6


def test_best_possible_is_not_known_where_no_job_is_a_trip_and_one_was_missed(tmp_path):
    lab = lab_of(tmp_path, ROOM)
    missed = {"job": "seen(@1)", "deadline_s": 0.1, "met": False}
    assert best_possible(lab, {1: {"assertions": [missed]}}) is None
    assert best_possible(lab, {1: {"assertions": [{**missed, "met": True}]}}) == 1
    assert best_possible(lab, {1: {"assertions": []}}) == 0


def test_other_jobs_count_as_possible_beside_trips():
    lab = load_lab(LABS / "corridor")
    robots = jobs(lab, [30, 30, 30, 30, 30, 5])
    robots[min(robots)]["assertions"].append({"job": "seen(@1)", "deadline_s": 0.1, "met": False})
    assert best_possible(lab, robots) == 6

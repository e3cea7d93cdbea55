"""Passages that all robots share: who drives through takes turns, whatever the event, and several in a row."""

from pathlib import Path

import pytest
from lab_maker import traced

from rmr.base.geometry import Point, Pose
from rmr.base.time import TICK_HZ, in_seconds, seconds
from rmr.node.crossing import approach
from rmr.node.crossing.approach import side_of
from rmr.node.motion.keep_right import gated_route
from rmr.node.motion.route import leader_route
from rmr_sim.run_setup import prepare
from rmr_sim.simulation_api import simulate

LABS = Path(__file__).parents[2] / "deploy" / "labs"

PROGRAM = """
type action moveto(R: robot, A: area) -o at(R, A) else stuck(R, A).
type sensor at(robot, area).
type !goes(robot, area).
type !due(robot, float).
start(R).
{assertion}
start(R), goes(R, A), due(R, D) -o want(R, A, D).
want(R, A, D) -o moveto(R, A) then there(R).
"""
WATCHED = 'trip: watch(want(R, A, D), there(R), D, say(R, "late")).'

LAB = """
lab: aisles
program: aisles.rmr
seed: 1
duration: 90s
finish: there(R)
arena: {{size: [{width}, 2.4], cell: 0.05}}
obstacles:
{walls}
areas:
  left: {{slots: [[0.2, 0.3], [0.2, 0.8], [0.2, 1.6], [0.2, 2.1]]}}
  right: {{slots: [[{right}, 0.3], [{right}, 0.8], [{right}, 1.6], [{right}, 2.1]]}}
{areas}
passages:
{passages}
robots:
{robots}
facts: [{facts}]
localisation: {{sigma: 0.005}}
{faults}
"""
ONE = {"a": (1.0, (1.2,))}
"""Passages of one wall: its left edge, and the middle of each gap, metres."""


def aisles(folder, walls, ways, *, due=None, program=WATCHED, faults=""):
    """Return a started simulation of walls 0.6 m thick with gaps, and robots that go "right" or "left"."""
    width = 2.0 + max(x for x, _ in walls.values())
    boxes, areas, passages = [], [], []
    for name, (x, gaps) in walls.items():
        edges = [0.0, *(edge for gap in gaps for edge in (gap - 0.15, gap + 0.15)), 2.4]
        boxes += [f"  - {{box: [{x}, {a}, {x + 0.6}, {b}]}}" for a, b in zip(edges[::2], edges[1::2], strict=True)]
        for number, gap in enumerate(gaps):
            here = f"{name}{number}"
            areas += [f"  {here}w: {{at: [{x}, {gap}]}}", f"  {here}e: {{at: [{x + 0.6}, {gap}]}}"]
            passages.append(f"  {here}: {{mouths: [{here}w, {here}e]}}")
    rows = {"right": [0.2, 0], "left": [width - 0.2, 0]}
    robots = []
    for robot, way in enumerate(ways, 1):
        x, taken = rows[way]
        rows[way][1] += 1
        robots.append(
            f"  - {{id: {robot}, pose: [{x}, {[0.3, 0.8, 1.6, 2.1][taken]}, {'0deg' if x < 1 else '180deg'}]}}"
        )
    facts = [f'"goes(@{robot}, {way})"' for robot, way in enumerate(ways, 1)]
    facts += [f'"due(@{robot}, {(due or {}).get(robot, 80)})"' for robot in range(1, len(ways) + 1)]
    text = LAB.format(
        width=width, right=width - 0.2, walls="\n".join(boxes), areas="\n".join(areas), passages="\n".join(passages),
        robots="\n".join(robots), facts=", ".join(facts), faults=faults,
    )  # fmt: skip
    (folder / "aisles.rmr").write_text(PROGRAM.format(assertion=program))
    (folder / "lab.yaml").write_text(text)
    return prepare(folder, seed=1)


def spans(simulation):
    """Return who was in each passage from when to when, in order of entry: passage, robot, from and to in seconds."""
    found = []
    for entry in simulation.trace():
        if entry["what"] in ("entered", "left"):
            for span in found:  # one that entered, was restarted there and entered again was inside all the time
                if span[:2] == [entry["event"], entry["robot"]]:
                    span[3] = min(span[3], entry["t"])
        if entry["what"] == "asks":  # it met another one in the mouth, and has given its turn back
            for span in found:
                if span[1] == entry["robot"]:
                    span[3] = min(span[3], entry["t"])
        if entry["what"] == "entered":
            found.append([entry["event"], entry["robot"], entry["t"], 1e9])
    return found


def opposed(simulation, ways):
    """Return the pairs that were in one passage in opposite directions at one time."""
    entries = spans(simulation)
    pairs = [(a, b) for k, a in enumerate(entries) for b in entries[:k] if a[0] == b[0]]
    return [(a, b) for a, b in pairs if ways[a[1] - 1] != ways[b[1] - 1] and a[2] < b[3] and b[2] < a[3]]


@pytest.mark.parametrize("program", ["", WATCHED])
def test_drives_take_turns_with_and_without_a_job(tmp_path, program):
    ways = ["right", "left", "right", "left"]
    simulation = aisles(tmp_path, ONE, ways, program=program)
    assert simulation.run()
    assert sorted({(span[0], span[1]) for span in spans(simulation)}) == [("a0", robot) for robot in (1, 2, 3, 4)]
    assert opposed(simulation, ways) == []


def test_the_job_that_is_due_first_goes_first(tmp_path):
    simulation = aisles(tmp_path, ONE, ["right", "left"], due={1: 60, 2: 18})
    assert simulation.run()
    assert next(span[1] for span in spans(simulation)) == 2


def test_jobs_of_different_events_exclude_each_other(tmp_path):
    ways = ["right", "left", "right", "left"]
    program = 'trip: assert(want(R, A, D), at(R, A), D, say(R, "late")).'  # one event for each side
    simulation = aisles(tmp_path, ONE, ways, program=program)
    assert simulation.run()
    assert len(spans(simulation)) == 4
    assert opposed(simulation, ways) == []


def test_a_drive_through_two_passages_takes_a_turn_at_each(tmp_path):
    ways = ["right", "left", "right"]
    simulation = aisles(tmp_path, {"a": (1.0, (1.2,)), "b": (2.8, (1.2,))}, ways)
    assert simulation.run()
    for robot, order in ((1, ["a0", "b0"]), (2, ["b0", "a0"]), (3, ["a0", "b0"])):
        own = [span for span in spans(simulation) if span[1] == robot]
        assert list(dict.fromkeys(span[0] for span in own)) == order
        left = max(span[3] for span in own if span[0] == order[0])
        entered = min(span[2] for span in own if span[0] == order[1])
        assert left <= entered, "it asks at the second as it comes out of the first"
    assert opposed(simulation, ways) == []


def test_robots_of_opposite_directions_take_different_aisles(tmp_path):
    ways = ["right", "left", "right", "left"]
    simulation = aisles(tmp_path, {"a": (1.0, (1.0, 1.4))}, ways)
    assert simulation.run()
    assert {(span[0], ways[span[1] - 1]) for span in spans(simulation)} == {("a0", "right"), ("a1", "left")}


def test_a_robot_does_not_drive_farther_than_a_passage_is_long_to_keep_right(tmp_path):
    arena = aisles(tmp_path, {"a": (1.0, (0.4, 2.0))}, ["right"]).lab.arena
    for start, goal, passage in (
        (Point(0.2, 2.1), Point(2.8, 2.1), "a1"),
        (Point(0.2, 1.3), Point(2.8, 1.3), "a0"),
        (Point(2.8, 1.1), Point(0.2, 1.1), "a1"),
    ):
        route = gated_route(arena, start, goal, ())
        assert route is not None
        assert route.passage == passage


def test_a_robot_restarted_in_a_passage_is_inside_at_once(tmp_path):
    ways = ["right", "left"]
    simulation = aisles(
        tmp_path, ONE, ways, due={1: 20, 2: 60}, faults="faults: [{kill: 1, at: 7s}, {restart: 1, at: 8s}]"
    )
    assert simulation.run()
    assert [
        entry["t"] > 8.0 and entry["cautious"] for entry in traced(simulation, "entered") if entry["robot"] == 1
    ] == [
        False,
        True,
    ]
    assert opposed(simulation, ways) == []


def test_next_turn_is_asked_for_as_a_robot_comes_out(tmp_path):
    simulation = aisles(tmp_path, {"a": (1.0, (1.2,)), "b": (2.8, (1.2,))}, ["right"])
    assert simulation.run()
    first, second = spans(simulation)
    assert second[2] - first[3] < 10.0
    assert in_seconds(simulation.now) < 40.0
    assert simulation.now > seconds(10)


@pytest.mark.slow
def test_the_warehouse_finishes_without_contact():
    """Two robots that stood 2 cm apart in the open touched when one of them set out."""
    run = simulate(LABS / "warehouse", seed=18)
    assert run.finished
    assert run.report["violations"] == []


DIVIDED = ("[2.8, 0.3], [0.6, 0.8], [2.8, 1.6], [0.6, 2.1]", "[0.6, 0.3], [0.6, 0.8], [2.8, 1.6], [2.8, 2.1]")
"""Slots of which two lie on the robots' side of the passage."""


def divided(folder, slots, robots, due=None):
    """Return the lab file of robots to the left of a passage whose goal has `slots` on both sides."""
    aisles(folder, ONE, ["right"] * robots, due=due)
    lab = folder / "lab.yaml"
    text = lab.read_text()
    right = next(line for line in text.splitlines() if line.startswith("  right:"))
    lab.write_text(text.replace(right, f"  right: {{slots: [{slots}]}}"))
    return folder


@pytest.mark.parametrize("slots", DIVIDED)
@pytest.mark.parametrize("due", [{1: 80, 2: 70, 3: 60, 4: 50}, {1: 50, 2: 60, 3: 70, 4: 80}])
def test_slots_on_both_sides_of_a_passage_are_all_taken(tmp_path, slots, due):
    for seed in (1, 2):
        simulation = prepare(divided(tmp_path, slots, 4, due), seed=seed)
        assert simulation.run()
        assert simulation.now < seconds(60)


@pytest.mark.parametrize("slots", DIVIDED)
def test_nobody_goes_through_a_passage_while_a_slot_on_its_own_side_is_free(tmp_path, slots):
    simulation = prepare(divided(tmp_path, slots, 2), seed=1)
    assert simulation.run()
    assert spans(simulation) == []


def test_on_which_side_of_a_passage_a_robot_is_takes_one_plan_a_cell(tmp_path, monkeypatch):
    arena = prepare(divided(tmp_path, DIVIDED[0], 1), seed=1).lab.arena
    area = arena.area("right")
    plans = []

    def counted(*args, **options):
        plans.append(args)
        return leader_route(*args, **options)

    monkeypatch.setattr(approach, "leader_route", counted)
    assert side_of(arena, area, Pose(0.41, 1.21, 0.0)) == area.places[1::2]
    assert side_of(arena, area, Pose(2.41, 1.21, 0.0)) == area.places[::2]
    before = len(plans)
    assert before > 0
    for heading in range(3):
        assert side_of(arena, area, Pose(0.42, 1.22, float(heading))) == area.places[1::2]
    assert len(plans) == before


@pytest.mark.parametrize("slots", DIVIDED)
@pytest.mark.parametrize("due", [{1: 80, 2: 70, 3: 60, 4: 50}, {1: 50, 2: 60, 3: 70, 4: 80}])
def test_a_robot_with_a_slot_on_its_own_side_lines_up_for_no_passage(tmp_path, slots, due):
    simulation = prepare(divided(tmp_path, slots, 4, due), seed=1)
    arena = simulation.lab.arena
    for_nothing = dict.fromkeys(range(1, 5), 0)
    most = 0

    def look(_now):
        nonlocal most
        for robot, simulated in enumerate(simulation.robots, 1):
            node = simulated.node
            crossing = node.crossings.current
            waits = crossing is not None and crossing.rank > 0 and crossing.waits
            near = waits and node.driver.place in side_of(arena, arena.area("right"), node.driver.localiser.pose)
            for_nothing[robot] = for_nothing[robot] + 1 if near else 0
            most = max(most, for_nothing[robot])

    simulation.observers.append(look)
    assert simulation.run()
    assert most < TICK_HZ
    assert len(spans(simulation)) == 2  # nobody goes there and back

"""What actions leave behind: effects that handlers name, failures that are broadcast, places that are taken."""

from pathlib import Path

import pytest
from lab_maker import small_lab, traced

from rmr.base.geometry import Point
from rmr.base.time import seconds
from rmr_sim.run_setup import prepare

TESTBED = Path(__file__).parents[2] / "deploy" / "labs" / "testbed"
WALL = [Point(0.3, 0.07 + 0.1 * k) for k in range(15)]
"""As if robots stood side by side from one end of the entry to the other."""
EFFECT = 'from rmr import action\n\n@action("act", effect="{}")\nasync def act(robot, *args): pass\n'


@pytest.mark.parametrize(
    ("effect", "failure"),
    [
        ("done", None),
        ("unheard_of", None),
        ("pair", "its effect does not fit: pair has 1 arguments without its owner, not 0"),
        ("act", "its effect does not fit: act is an action, not a fact"),
    ],
)
def test_an_effect_that_a_handler_names_holds_or_fails_its_action(tmp_path, effect, failure):
    simulation = small_lab(
        tmp_path,
        "type action act(robot).\ntype pair(robot, int).\ngo(R).\ngo(R) -o act(R).\ndone(R) -o seen(R).\n",
        actions=EFFECT.format(effect),
        duration="1s",
    )
    simulation.run()
    (ended,) = traced(simulation, "action_ended")
    assert ended["failure"] == failure
    assert simulation.robots[0].node.machine.facts() == (["seen(@1)"] if effect == "done" else [])


def test_a_handlers_effect_on_a_sensed_fact_is_left_to_the_senses(tmp_path):
    simulation = small_lab(
        tmp_path,
        "type action act(robot, area).\ngo(R).\ngo(R) -o act(R, box).\nat(R, box) -o there(R).\n",
        actions=EFFECT.format("at"),
        duration="1s",
    )
    simulation.run()
    assert simulation.robots[0].node.machine.facts() == []


def test_every_copy_of_a_failure_broadcast_names_the_deadline_that_derived_it(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action wait(R: robot, T: float) -o waited(R).
        type action broadcast(robot).
        first: watch(begun(R), ended(R), 1, broadcast(R)).
        second: watch(begun(R), stopped(R), 1.05, broadcast(R)).
        begun(@1).
        begun(R), ended(R), stopped(R) -o 1.
        begun(R), waited(R) -o broadcast(R).
        go(@1).
        go(R) -o wait(R, 2).
        failed(R, B, E) -o knows(R, B, E).
        """,
        robots=2,
        duration="3s",
    )
    node, told = simulation.robots[0].node, []
    send = node.services.broadcast_failure
    node.services.broadcast_failure = lambda assertion: (told.append(assertion), send(assertion))
    simulation.run()
    assert told == [0, 1, 0, 1, 0, 1, None, None, None]
    names = ("broadcast", "first", "second")
    assert simulation.robots[1].node.machine.facts() == [f"knows(@2, @1, {name})" for name in names]


def test_a_heading_of_any_size_is_reached(tmp_path):
    simulation = small_lab(
        tmp_path,
        "type action face(R: robot, D: float) -o turned(R).\ngo(R).\ngo(R) -o face(R, 1e300).\n",
        finish="turned(R)",
        duration="8s",
    )
    assert simulation.run()


SLOTTED = """
lab: two
program: two.rmr
arena: {size: [1.5, 1.5], cell: 0.05}
areas:
  west: {slots: [[0.3, 1.2], [0.3, 0.9]]}
  east: {slots: [[1.2, 1.2], [1.2, 0.9]]}
robots: [{id: 1, pose: [0.3, 0.3, 0deg]}]
duration: 30s
"""


def two_areas(folder, program, *, lab=""):
    (folder / "lab.yaml").write_text(SLOTTED + lab)
    (folder / "two.rmr").write_text(program)
    return prepare(folder, seed=1)


def test_a_robot_on_its_slot_of_one_area_stands_in_no_other(tmp_path):
    program = "type action moveto(robot, area).\ngo(R).\ngo(R) -o moveto(R, west).\n"
    simulation = two_areas(tmp_path, program + "at(R, west) -o home(R).\nat(R, east) -o lost(R).\n")
    simulation.run()
    assert simulation.robots[0].node.machine.facts() == ["home(@1)"]


def test_a_robot_that_drives_away_gives_up_its_slot(tmp_path):
    simulation = two_areas(
        tmp_path,
        """
        type action moveto(robot, area).
        type action goto(R: robot, X: float, Y: float) -o away(R).
        go(R).
        go(R) -o moveto(R, west).
        at(R, west) -o goto(R, 0.9, 0.3).
        """,
        lab="finish: away(R)\n",
    )
    assert simulation.run()
    assert simulation.robots[0].node.crossings.destinations.current() is None


def test_a_drive_of_a_robot_that_never_finds_itself_fails(tmp_path):
    simulation = two_areas(
        tmp_path,
        "type action goto(R: robot, X: float, Y: float) -o there(R) else lost(R).\ngo(R).\ngo(R) -o goto(R, 1, 1).\n",
        lab="finish: lost(R)\nlocalisation: {beacons: []}\n",
    )
    assert simulation.run()
    (ended,) = traced(simulation, "action_ended")
    assert ended["failure"] == "the robot does not know where it is"


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ("5, 5", "(5, 5) is outside the arena"),
        ("-1, 0.5", "(-1, 0.5) is outside the arena"),
        ("0.01, 0.5", "the wall leaves no room for a robot at (0.01, 0.5)"),
    ],
)
def test_a_drive_to_where_nobody_can_stand_fails_in_its_time_and_touches_nothing(tmp_path, goal, why):
    simulation = small_lab(
        tmp_path,
        f"type action goto(R: robot, X: float, Y: float) -o yes(R) else no(R).\ngo(R).\ngo(R) -o goto(R, {goal}).\n",
        finish="no(R)",
        duration="25s",
    )
    assert simulation.run()
    (ended,) = traced(simulation, "action_ended")
    assert ended["failure"] == f"no way there: {why}"
    assert simulation.world.collisions == 0


@pytest.mark.medium
@pytest.mark.parametrize(("barred_s", "fails"), [(30, False), (45, True)])
def test_waiting_robot_has_a_longer_timeout_for_a_blocked_path(monkeypatch, barred_s, fails):
    simulation = prepare(TESTBED, robots=2, seed=1)
    heard = simulation.robots[0].node.peers
    monkeypatch.setattr(heard, "parked", lambda now: WALL if now < seconds(barred_s) else ())
    assert simulation.run() is not fails
    ended = [(entry["action"], entry["failure"]) for entry in traced(simulation, "action_ended") if entry["robot"] == 1]
    assert [(action, failure.split(":")[0]) for action, failure in ended if failure] == (
        [("moveto(@1, exit)", "no way there")] if fails else []
    )
    assert fails or simulation.time_s > barred_s


COUNTS = """
from rmr import action

count = 0

@action("act")
async def act(robot):
    global count
    count += 1
    robot.state["count"] = robot.state.get("count", 0) + 1
    robot.insert("counted", count, robot.state["count"])
    await robot.sleep(1.0)
"""


def test_globals_and_state_of_handlers_are_one_robots_until_it_starts_anew(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action act(R: robot) -o acted(R).
        type counted(robot, int, int).
        go(R).
        go(R) -o act(R) then act(R).
        """,
        robots=2,
        actions=COUNTS,
        duration="6s",
        faults="[{at: 3s, kill: 2}, {at: 4s, restart: 2}]",
    )
    simulation.run()
    first, second = (robot.node.machine.facts() for robot in simulation.robots)
    assert first == ["acted(@1)", "acted(@1)", "counted(@1, 1, 1)", "counted(@1, 2, 2)"]
    assert second == [fact.replace("@1", "@2") for fact in first]


STEPS = """
from rmr import ActionFailed, RobotHandle, action

@action("fetch", wheels=True)
async def fetch(robot: RobotHandle) -> None:
    await robot.moveto("box")
    await robot.face(180.0)
    await robot.wait(0.5)
    try:
        await robot.moveto("nowhere")
    except ActionFailed as failure:
        robot.say(str(failure))
    await robot.goto(0.3, 0.3)

@action("peek")
async def peek(robot: RobotHandle) -> None:
    await robot.moveto("box")
"""


def test_a_handler_drives_by_the_provided_actions_step_by_step(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action fetch(R: robot) -o fetched(R).
        type action peek(R: robot) -o peeked(R) else no(R).
        go(@1).
        go(R) -o fetch(R), peek(R).
        at(R, box) -o was(R, box).
        """,
        robots=2,
        actions=STEPS,
        finish="",
        duration="25s",
    )
    simulation.run()
    node = simulation.robots[0].node
    assert node.machine.facts() == ["fetched(@1)", "no(@1)", "was(@1, box)"]
    assert [entry["text"] for entry in traced(simulation, "said")] == ["no area is called nowhere"]
    (peek, fetch) = traced(simulation, "action_ended")
    assert peek["failure"] == 'robot.moveto drives: declare the handler with @action("peek", wheels=True)'
    assert fetch["failure"] is None
    assert node.services.percept().pose.x == pytest.approx(0.3, abs=0.05)
    assert node.crossings.destinations.current() is None, "it has given up the place in the box"


def test_a_robot_that_stands_in_its_place_while_an_action_turns_it_still_claims_the_place(tmp_path):
    simulation = small_lab(
        tmp_path,
        """
        type action moveto(R: robot, A: area) -o came(R).
        type action face(R: robot, D: float).
        go(R).
        go(R) -o moveto(R, box).
        came(R) -o face(R, 180.0).
        """,
        duration="20s",
    )
    node, claims = simulation.robots[0].node, set()

    def look(_now):
        driving = node.actions.driving
        if driving is not None and driving.name == "face":
            claims.add(node.crossings.destinations.current())

    simulation.checkers.append(look)
    simulation.run()
    assert claims == {node.driver.place}
    assert node.driver.place is not None


@pytest.mark.parametrize(("stand_in", "facts"), [("", ["done(@1, 3)"]), ("raise ValueError", ["jammed(@1)"])])
def test_an_action_of_ros_2_ends_at_once_unless_a_file_has_a_handler_for_it(tmp_path, stand_in, facts):
    program = "type action act(R: robot, N: int) -o done(R, N) else jammed(R).\ngo(R).\ngo(R) -o act(R, 3).\n"
    entry = "\nactions: [{action: 'act(R, data)', service: act, type: std_srvs/SetBool}]\n"
    small_lab(tmp_path, program, duration="1s", actions=EFFECT.format("done").replace("pass", stand_in or "pass"))
    lab = tmp_path / "lab.yaml"
    lab.write_text(lab.read_text() + entry)
    simulation = prepare(tmp_path, seed=1, actions=tmp_path / "actions.py" if stand_in else None)
    simulation.run()
    assert simulation.robots[0].node.machine.facts() == facts


def test_a_body_without_nav2_navigates_as_it_moves(tmp_path):
    program = "type action navigate(R: robot, A: area) -o there(R).\ngo(R).\ngo(R) -o navigate(R, spot).\n"
    simulation = small_lab(tmp_path, program, finish="there(R)")
    assert simulation.run()
    pose = simulation.world.pose(1)
    assert abs(pose.x - 1.0) < 0.03
    assert abs(pose.y - 0.5) < 0.03

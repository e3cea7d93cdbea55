"""Handlers of users in a replay: what they did is done again, and nothing of them is executed."""

import sys
from pathlib import Path

import pytest
from mind_runs import MindRun

from rmr.node.trace import TraceLevel

sys.path.append(str(Path(__file__).parents[2] / "integration"))
from failing_handlers import failing_lab

pytestmark = pytest.mark.medium

LAB = """
lab: doors
program: doors.rmr
duration: 20s
finish: over(R)
arena: {size: [2.0, 1.0], cell: 0.05}
areas:
  far: {at: [1.6, 0.5]}
robots: [{id: 1, pose: [0.3, 0.5, 0deg]}]
"""


def lab_of(folder, program, actions):
    (folder / "lab.yaml").write_text(LAB)
    (folder / "doors.rmr").write_text(program)
    (folder / "doors.py").write_text(actions)
    return MindRun(folder, 1, actions=folder / "doors.py")


def equal(run, **options):
    """Return the replay of robot 1, which is equal."""
    replay = run.replay(1, **options)
    assert replay.difference is None
    assert replay.ended
    return replay


def test_handlers_that_fail_in_every_way_have_equal_traces_in_a_replay(tmp_path):
    lab, seed, _, actions = failing_lab(tmp_path)
    run = MindRun(Path(lab), seed, actions=Path(actions))
    replay = equal(run, trace=TraceLevel.FACTS)
    notes = [entry for entry in replay.node.trace_log if entry["what"] not in ("inserted", "removed")]
    assert notes == run.simulation.trace()
    assert len([entry for entry in notes if entry["what"] == "action_ended"]) > 20
    assert len([entry for entry in notes if entry["what"] == "raised"]) > 5


OUTSIDE = """
from pathlib import Path
from rmr import action

FILE = Path(__file__).with_name("count")

@action("ask", wheels=True)
async def ask(robot):
    count = int(FILE.read_text()) + 1 if FILE.exists() else 1
    FILE.write_text(str(count))
    robot.insert("count", count)
    robot.say(f"asked {count} times")
    await robot.until(lambda: FILE.exists() and robot.now() > 0.5)
    robot.drive(0.05 * count, 0.0)
    await robot.sleep(1.0)
    robot.stop()
    await robot.moveto("far")
    robot.state["count"] = count
    if count > 5:
        robot.insert("never", 1)
"""


def test_a_handler_that_reads_and_writes_a_file_is_not_executed_by_a_replay(tmp_path):
    program = """
    type action ask(R: robot) -o asked(R) else asked(R).
    type count(R: robot, N: int).
    start(R).
    start(R) -o ask(R).
    asked(R), count(R, N) -o over(R), total(R, N).
    """
    run = lab_of(tmp_path, program, OUTSIDE)
    assert run.finished
    (tmp_path / "count").write_text("77")
    (tmp_path / "doors.py").unlink()
    for _ in range(2):
        twin = equal(run).node
        assert twin.machine.facts() == run.simulation.robots[0].node.machine.facts()
        assert "total(@1, 1)" in twin.machine.facts()
        assert twin.services.state == {}
    assert (tmp_path / "count").read_text() == "77"


RACE = """
from rmr import ActionFailed, action

class First:
    def __init__(self, *awaited):
        self.awaited = [each.__await__() for each in awaited]

    def __await__(self):
        while True:
            pauses = []
            for each in self.awaited:
                try:
                    pauses.append(next(each))
                except StopIteration:
                    for other in self.awaited:
                        other.close()
                    return
            until = min(pause.until for pause in pauses)
            yield type(pauses[0])(until, lambda: any(pause.over(int(NOW() * 1e9)) for pause in pauses))

NOW = None

@action("race", wheels=True)
async def race(robot):
    global NOW
    NOW = robot.now
    await First(robot.moveto("far"), robot.sleep(1.5))
    robot.say("too slow")
    pending = robot.moveto("far").__await__()
    next(pending)
    await robot.sleep(0.3)
    try:
        pending.throw(ActionFailed("enough"))
    except ActionFailed as failure:
        robot.say(str(failure))
    dropped = robot.face(90.0).__await__()
    next(dropped)
    await robot.sleep(0.2)
    del dropped
    robot.say("dropped")
    await robot.sleep(0.2)
    for wrong in ([1], None, 2.5, "text", object()):
        try:
            robot.insert("count", wrong)
        except (ValueError, TypeError):
            robot.say(f"refused {type(wrong).__name__}")
    robot.insert("count", 3)
    await robot.goto(1.0, 0.5)
"""


def test_a_handler_that_races_provided_actions_is_replayed_step_by_step(tmp_path):
    program = """
    type action race(R: robot) -o asked(R) else asked(R).
    type count(R: robot, N: int).
    start(R).
    start(R) -o race(R).
    asked(R), count(R, N) -o over(R), total(R, N).
    """
    run = lab_of(tmp_path, program, RACE)
    said = [entry["text"] for entry in run.simulation.trace() if entry["what"] == "said"]
    assert said[:3] == ["too slow", "enough", "dropped"]
    assert len(said) == 8
    assert run.finished
    equal(run)


CONDITION = """
from rmr import action

@action("observe")
async def observe(robot):
    seen = []

    def often_enough():
        seen.append(robot.now())
        if len(seen) == 5:
            robot.say("five times")
        return len(seen) >= 9

    await robot.until(often_enough)
    robot.insert("count", len(seen))
"""


def test_a_condition_that_acts_on_the_robot_is_replayed_where_it_did(tmp_path):
    program = """
    type action observe(R: robot) -o asked(R) else asked(R).
    type count(R: robot, N: int).
    start(R).
    start(R) -o observe(R).
    asked(R), count(R, N) -o over(R), total(R, N).
    """
    run = lab_of(tmp_path, program, CONDITION)
    assert run.finished
    assert "total(@1, 9)" in equal(run).node.machine.facts()


CAMERA = """
from rmr import action

@action("film")
async def film(robot):
    robot.insert("seen", 3)
    await robot.sleep(0.5)
    robot.withdraw("seen", 3)
    robot.withdraw("seen", 3)
    for wrong in (("nothing", 1), ("seen", "three"), ("kept", 1), ("at", "far")):
        try:
            robot.withdraw(*wrong)
        except ValueError as error:
            robot.say(str(error))
    await robot.sleep(0.5)
"""


def test_a_handler_withdraws_what_it_has_sensed_and_a_replay_does_so_too(tmp_path):
    program = """
    type action film(R: robot) -o over(R).
    type sensor seen(robot, int).
    type sensor at(robot, area).
    type begin(robot).
    type kept(robot, int).
    type over(robot).
    type noted(robot, int).
    type quiet(robot).
    begin(R).
    begin(R) -o film(R).
    seen(R, N), not noted(R, N) -o noted(R, N).
    noted(R, N), not seen(R, N) -o quiet(R).
    """
    run = lab_of(tmp_path, program, CAMERA)
    replay = equal(run, trace=TraceLevel.FACTS)
    entries = replay.node.trace_log
    [inserted] = [each["t"] for each in entries if each["what"] == "inserted" and each["fact"] == "seen(@1, 3)"]
    [removed] = [each["t"] for each in entries if each["what"] == "removed" and each["fact"] == "seen(@1, 3)"]
    assert 0.5 <= removed - inserted < 0.6
    assert [each["text"] for each in entries if each["what"] == "said"] == [
        "the program knows no predicate nothing",
        "argument 2 of seen is 'three', which is no int",
        "kept is not sensed: its facts cannot be withdrawn",
        "at is withdrawn by the robot itself, as what it senses changes",
    ]
    assert "quiet(@1)" in replay.node.machine.facts()

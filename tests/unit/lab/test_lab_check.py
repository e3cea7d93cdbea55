"""`rmr check LAB`: all that is judged before a run, as text, as JSON and as a picture."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from command_runner import invoke

from rmr_lab import lab_check
from rmr_lab.main import check as command
from rmr_lab.main import command as lab
from rmr_lab.picture import draw
from rmr_world.bound import destinations
from rmr_world.lab_file import load_lab

KEYS = ["code", "column", "end_column", "end_line", "file", "fix", "hint", "line", "message", "severity"]
LABS = Path(__file__).parents[3] / "deploy" / "labs"
PROGRAM = """\
type action moveto(R: robot, A: area) -o at(R, A).
type action pack(R: robot) -o packed(R).
type sensor at(robot, area).
start(R).
start(R) -o moveto(R, yard), pack(R).
"""
LAB = """\
lab: room
program: room.rmr
finish: packed(R)
actions: actions.py
arena: {size: [3.0, 1.5]}
areas: {yard: {slots: [[2.5, 0.3], [2.5, 0.8]]}}
robots:
  - {id: 1, pose: [0.5, 0.3, 0deg]}
  - {id: 2, pose: [0.8, 0.3, 90deg]}
"""
ACTIONS = 'from rmr import action\n\n\n@action("pack")\nasync def pack(robot):\n    await robot.sleep(1.0)\n'


def room(folder, *, lab=LAB, program=PROGRAM, actions=ACTIONS):
    (folder / "lab.yaml").write_text(lab)
    (folder / "room.rmr").write_text(program)
    (folder / "actions.py").write_text(actions)
    return folder


def check(*words):
    result = invoke(command, [*map(str, words)])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result


def listed(folder):
    result = invoke(command, ["--json", str(folder)])
    found = json.loads(result.stdout)["diagnostics"]
    assert all(sorted(each) == KEYS for each in found)
    return [(Path(each["file"]).name, each["line"], each["severity"], each["message"]) for each in found], result


@pytest.mark.parametrize("name", ["corridor", "dock", "formation", "hall", "testbed", "twoway", "warehouse"])
def test_provided_lab_is_found_by_its_name_and_has_no_findings(name):
    result = check("--json", name)
    assert (result.exit_code, json.loads(result.stdout)["diagnostics"]) == (0, [])


def test_lab_with_actions_has_no_findings(tmp_path):
    found, result = listed(room(tmp_path))
    assert (found, result.exit_code) == ([], 0)


def test_mistakes_of_lab_and_program_are_reported_together(tmp_path):
    lab, program = LAB.replace("arena:", "seeed: 1\narena:"), PROGRAM.replace("start(R) -o", "start(R) -o nobody(X),")
    found, result = listed(room(tmp_path, lab=lab, program=program))
    assert ("lab.yaml", 5, "error", "seeed: unknown key") in found
    assert any(file == "room.rmr" and severity == "error" for file, _, severity, _ in found)
    assert result.exit_code == 3


def test_hint_stands_apart_from_the_message(tmp_path):
    room(tmp_path, lab=LAB.replace("finish: packed(R)", "finish: paked(R)"))
    [found] = json.loads(check("--json", tmp_path).stdout)["diagnostics"]
    assert found["hint"] == "did you mean 'packed'?"
    assert found["message"] == "finish: the program knows no fact 'paked'"


def test_warning_of_the_lab_has_its_severity_and_exit_code_0(tmp_path):
    found, result = listed(room(tmp_path, lab=LAB + "duration: 1s\nfaults:\n  - {at: 5s, kill: 1}\n"))
    message = "faults: {at: 5.0, kill: 1} begins when the duration of 1 s is over"
    assert found == [("lab.yaml", 12, "warning", message)]
    assert result.exit_code == 0


def test_action_without_handler_is_reported_at_its_declaration(tmp_path):
    found, result = listed(room(tmp_path, lab=LAB.replace("actions: actions.py\n", "")))
    [(file, line, severity, message)] = found
    assert (file, line, severity) == ("room.rmr", 2, "error")
    assert message.startswith("no handler for action pack: ")
    assert result.exit_code == 3


@pytest.mark.parametrize(
    ("actions", "line", "message"),
    [
        ("from rmr import action\nx = 1 / 0\n", 2, "ZeroDivisionError"),
        ("from rmr import action\ndef f(:\n", 1, "SyntaxError"),
        ("x = 1\n", 1, "registers no action"),
        ("print('loaded')\n" + ACTIONS, None, ""),
    ],
)
def test_mistake_in_the_actions_file_is_reported_with_its_line(tmp_path, actions, line, message):
    found, _ = listed(room(tmp_path, actions=actions))
    if line is None:
        assert found == []
        return
    [(_, where, severity, words)] = [each for each in found if each[0] == "actions.py"]
    assert (where, severity) == (line, "error")
    assert message in words


def test_python_files_are_executed_only_after_that_is_said_and_not_at_all_with_no_code(tmp_path):
    folder = room(tmp_path, lab=LAB + "events: what.py\n", actions="print('runs')\n" + ACTIONS)
    (folder / "what.py").write_text("print('runs, too')\ndef events(lab, seed):\n    return []\n")
    said = check(folder).stderr.splitlines()
    assert said[:3] == [
        f"{folder}: actions.py and what.py: executed, as by a run (not with --no-code)",
        "runs",
        "runs, too",
    ]
    spared = check("--no-code", folder)
    assert spared.exit_code == 0
    assert spared.stderr.splitlines()[0] == f"{folder}: actions.py and what.py: not executed, and so not checked"
    assert "runs" not in spared.stderr + spared.stdout


def test_a_lab_without_python_files_is_checked_as_ever_with_no_code(tmp_path):
    folder = room(tmp_path, lab=LAB.replace("actions: actions.py\n", ""))
    for words in ((), ("--no-code",)):
        answer = check(*words, folder)
        assert answer.exit_code == 3
        assert "no handler for action pack: " in answer.stderr
        assert "executed" not in answer.stderr


def test_mistake_in_the_events_file_is_reported_with_its_line(tmp_path):
    folder = room(tmp_path, lab=LAB + "events: what.py\n")
    (folder / "what.py").write_text("def events(lab, seed):\n    return lab.nothing\n")
    [(file, line, _, message)], _ = listed(folder)
    assert (file, line) == ("what.py", 2)
    assert "nothing" in message


def test_lab_file_names_its_actions_for_the_simulator_and_an_option_goes_before(tmp_path):
    from rmr_sim.run_setup import prepare

    folder = room(tmp_path)
    assert prepare(folder).run()
    (folder / "other.py").write_text(ACTIONS.replace("pack", "wrap"))
    with pytest.raises(Exception, match="no handler for action pack"):
        prepare(folder, actions=folder / "other.py")


def test_missing_lab_is_wrong_usage_with_the_nearest_name():
    result = check("coridor")
    assert result.exit_code == 2
    assert "there is no coridor; did you mean 'corridor'?" in result.output


@pytest.mark.medium
def test_rmr_check_of_a_lab_checks_the_lab(tmp_path):
    words = [sys.executable, "-m", "rmr.cli", "check", "--json", str(room(tmp_path))]
    code = "import sys; from rmr.cli import main; main()"
    result = subprocess.run([sys.executable, "-c", code, *words[3:]], capture_output=True, text=True, check=False)
    assert (result.returncode, json.loads(result.stdout)) == (0, {"version": 1, "diagnostics": []}), result.stderr


# -- the picture -------------------------------------------------------------------------------------------------------


def shapes(text):
    counts: dict[str, int] = {}
    for element in ET.fromstring(text).iter():
        name = element.get("class")
        if name:
            counts[name] = counts.get(name, 0) + 1
    return counts


def test_picture_has_robots_slots_queue_obstacles_beacons_gate_and_ways():
    lab = load_lab(Path("corridor"))
    found = shapes(draw(lab, destinations(lab)))
    wanted = {"robot": 6, "heading": 6, "way": 6, "obstacle": 2, "beacon": 2, "mouth": 1, "queue": 6, "slot": 7}
    assert {name: found[name] for name in wanted} == wanted


def test_picture_shows_heading_and_goal_where_they_are(tmp_path):
    lab = load_lab(room(tmp_path))
    root = ET.fromstring(draw(lab, dict.fromkeys([1, 2], lab.arena.area("yard"))))
    headings = [element for element in root.iter() if element.get("class") == "heading"]
    x1, y1, x2, y2 = (float(headings[1].get(key)) for key in ("x1", "y1", "x2", "y2"))
    assert x1 == pytest.approx(x2, abs=0.2)
    assert y2 < y1, "90 degrees points up"
    ends = [element.get("points").split()[-1] for element in root.iter() if element.get("class") == "way"]
    slots = [f"{e.get('cx')},{e.get('cy')}" for e in root.iter() if e.get("class") == "slot"]
    assert ends == slots


def test_picture_is_written_beside_the_findings(tmp_path):
    result = check("corridor", "--svg", tmp_path / "floor.svg")
    assert result.exit_code == 0
    assert shapes((tmp_path / "floor.svg").read_text())["way"] == 6


def test_picture_of_a_wrong_lab_is_not_drawn(tmp_path):
    result = check(room(tmp_path, lab=LAB.replace("lab: room", "lab: Room")), "--svg", tmp_path / "floor.svg")
    assert result.exit_code == 3
    assert "is not drawn: the lab file has errors" in result.output
    assert not (tmp_path / "floor.svg").exists()


def test_findings_hold_lab_and_program_where_they_are_valid(tmp_path):
    found = lab_check.check(room(tmp_path))
    assert found.lab is not None
    assert found.program is not None


def test_picture_or_schema_that_cannot_be_written_is_wrong_usage(tmp_path):
    place = tmp_path / "nothing" / "file"
    result = check("corridor", "--svg", place)
    assert result.exit_code == 2
    assert f"{place}: No such file or directory" in result.output
    result = invoke(lab, ["schema", "-o", str(place)])
    assert (result.exit_code, result.output) == (2, f"{place}: No such file or directory\n")


BROKEN = "type !broken(robot).\n" + PROGRAM.replace("start(R) -o", "start(R), !broken(R) -o").replace(", pack(R)", "")
"""`!broken(R)` is meant as `not broken(R)`."""


@pytest.mark.parametrize(
    ("more", "warned"),
    [
        ("", True),
        ('facts: ["broken(@1)"]\n', False),
        ("actions: actions.py\n", False),  # a handler may insert it
        ("events: actions.py\n", False),
        ("loads: [{at: 5.0, program: room.rmr}]\n", False),  # what the other program derives is carried over
    ],
)
def test_a_declared_fact_that_nothing_can_bring_is_told_for_a_lab_that_is_given_no_more(tmp_path, more, warned):
    lab = LAB.replace("actions: actions.py\n", more).replace("packed(R)", "at(R, yard)")
    program = "\n".join(line for line in BROKEN.splitlines() if "pack" not in line) + "\n"
    python = ACTIONS + "\n\ndef events(lab, seed):\n    return []\n"
    found, _ = listed(room(tmp_path, lab=lab, program=program, actions=python))
    missing = [(name, line) for name, line, _, message in found if "nothing states or derives `broken`" in message]
    assert missing == ([("room.rmr", 5)] if warned else [])
    assert not [message for *_, severity, message in found if severity == "error"]

"""Warnings of passages and turns that do not exclude robots from each other, before a run."""

from pathlib import Path

import pytest

from rmr_world.lab_file import load_lab
from rmr_world.lab_program import load_lab_program
from rmr_world.narrow_places import narrow_places
from rmr_world.passage_use import passage_uses
from rmr_world.validate.exclusion import CHECKS

ROOT = Path(__file__).parents[3]
EXAMPLES = [*ROOT.glob("deploy/labs/*/*.yaml"), *ROOT.glob("docs/examples/labs/*/*.yaml")]
HEAD = """\
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type !goes(robot, area).
start(R).
"""
THROUGH = "start(R), goes(R, A) -o crossing(R, A), moveto(R, A).\nat(R, A), goes(R, A) -o across(R, A).\n"
BY_GOAL = f"{HEAD}{THROUGH}by_goal: assert(crossing(R, A), across(R, A), 60, broadcast(R)).\n"
BY_ALL = BY_GOAL.replace("across(R, A)", "across(R)")
DOCK = """\
type action charge(R: robot, P: area) -o full(R, P).
docking: assert(books(R), served(R), 60, broadcast(R)).
start(R) -o books(R).
books(R) -o moveto(R, right), charge(R, right).
at(R, right), full(R, right) -o served(R).
"""
LAB = """\
lab: rooms
program: rooms.rmr
arena: {size: [4.0, 1.5]}
obstacles:
  - {box: [1.0, 0.0, 1.3, 0.6]}
  - {box: [1.0, 0.9, 1.3, 1.5]}
areas:
  left: {slots: [[0.2, 0.2], [0.2, 1.3]]}
  right: {slots: [[3.8, 0.2], [3.8, 1.3]]}
  west: {at: [1.0, 0.75]}
  east: {at: [1.3, 0.75]}
robots:
  - {id: 1, pose: [0.5, 0.4, 0deg]}
  - {id: 2, pose: [3.4, 0.4, 180deg]}
facts: ["goes(@1, right)", "goes(@2, left)"]
"""
SECOND_WALL = "areas:\n", "  - {box: [2.0, 0.0, 2.3, 0.6]}\n  - {box: [2.0, 0.9, 2.3, 1.5]}\nareas:\n"
NAMED = "robots:\n", "bottleneck: {mouths: [west, east]}\nrobots:\n"


def findings(folder, program, *changes):
    text = LAB
    for old, new in changes:
        text = text.replace(old, new)
    (folder / "lab.yaml").write_text(text)
    (folder / "rooms.rmr").write_text(program)
    (folder / "actions.py").write_text("")
    lab = load_lab(folder)
    loaded = load_lab_program(lab).program
    return [(each.path, each.message) for check in CHECKS for each in check(lab, loaded)]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_no_provided_lab_and_no_example_is_warned_of(path):
    lab = load_lab(path)
    program = load_lab_program(lab).program
    assert [finding for check in CHECKS for finding in check(lab, program)] == []


def test_one_event_excludes_whole_drives_through_a_passage_without_a_name(tmp_path):
    assert findings(tmp_path, BY_ALL) == []


@pytest.mark.parametrize("named", [False, True])
def test_jobs_of_two_events_that_contend_for_one_passage_are_warned_of(tmp_path, named):
    ((path, message),) = findings(tmp_path, BY_GOAL, *([NAMED] if named else []))
    assert path == ("bottleneck" if named else "arena")
    assert "robot 1 (by_goal(right)) and robot 2 (by_goal(left)) pass it" in message
    where = "the passage 'bottleneck'" if named else "the narrow passage between [0.91, 0.75] and [1.40, 0.75], 0.30 m"
    assert message.startswith(where)


def test_a_narrow_passage_beside_the_bottleneck_that_turns_cover_is_warned_of(tmp_path):
    ((path, message),) = findings(tmp_path, BY_ALL, SECOND_WALL, NAMED)
    assert path == "arena"
    assert "[1.90, 0.75]" in message
    assert "the turns of robots 1, 2 (by_goal) cover 'bottleneck' only" in message


def test_mouths_at_the_outer_ends_cover_both_passages(tmp_path):
    outer = "east: {at: [1.3, 0.75]}", "east: {at: [2.3, 0.75]}"
    assert findings(tmp_path, BY_ALL, SECOND_WALL, NAMED, outer) == []


def test_a_bottleneck_that_cuts_a_turn_short_is_warned_of(tmp_path):
    away = "program: rooms.rmr", "program: rooms.rmr\nactions: actions.py"
    ((path, message),) = findings(tmp_path, HEAD + DOCK, away, NAMED)
    assert path == "bottleneck"
    assert "the drive of robot 1 to 'right' passes it: charge" in message
    assert findings(tmp_path, HEAD + DOCK, away) == []


def test_a_passage_that_was_found_and_cuts_a_turn_short_is_warned_of(tmp_path):
    away = "program: rooms.rmr", "program: rooms.rmr\nactions: actions.py"
    unnamed = "  west: {at: [1.0, 0.75]}\n  east: {at: [1.3, 0.75]}\n", ""
    ((path, message),) = findings(tmp_path, HEAD + DOCK, away, unnamed)
    assert path == "arena"
    assert "a passage of 'passage_1' and ends behind it" in message
    assert "write passages: {} for none, or make charge an event of its own" in message


def test_drives_are_found_on_the_passages_that_they_lead_through(tmp_path):
    findings(tmp_path, BY_ALL, SECOND_WALL, NAMED)
    lab = load_lab(tmp_path)
    named, second = passage_uses(lab, load_lab_program(lab).program)
    assert named.narrow == narrow_places(lab.arena).passages[:1]
    assert [drive.robot for drive in named.drives] == [drive.robot for drive in second.drives] == [1, 2]

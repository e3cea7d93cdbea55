"""A lab and its program before they run: ways that are not there, deadlines that nothing can meet."""

from pathlib import Path

import pytest
from world_labs import LABS, ROOM, lab_of

from rmr_deploy.preparation import RunRefusedError, read_program
from rmr_sim.main import main
from rmr_world.finding import LabError
from rmr_world.lab_file import load_lab
from rmr_world.lab_program import load_lab_program, validated

WALL = "{box: [1.45, 0.0, 1.55, 1.5]}"
LAB = """\
lab: room
program: room.rmr
duration: 20s
finish: at(R, yard)
arena: {{size: [3.0, 1.5], cell: 0.05}}
obstacles: [{obstacles}]
areas: {{yard: {yard}, entry: {{at: [0.5, 1.2], queue: {{path: [[0.5, 1.2], [{queue}, 1.2]], spacing: 0.2}}}}}}
robots:
  - {{id: 1, pose: [0.5, 0.3, 0deg]}}
  - {{id: 2, pose: [0.8, 0.3, 0deg]}}
facts: ["due(@1, {due})", "due(@2, 60)"]
"""
PROGRAM = """\
type action moveto(R: robot, A: area) -o at(R, A).
type action lineup(robot, area, int).
type action say(robot, string).
type sensor at(robot, area).
type !due(robot, float).
type queue(robot).
type started(robot).
start(R).
start(R), due(R, D) -o crossing(R, D).
crossing: assert(crossing(R, D), at(R, yard), D, say(R, "too late")).
crossing(R, _) -o moveto(R, yard).
queue(R) -o lineup(R, entry, 1).
"""
HOME = "type !home(robot, area).\nat(R, A), home(R, A) -o there(R).\n"


def room(
    folder: Path,
    *,
    obstacles: str = "",
    yard: str = "{slots: [[2.5, 0.3], [2.5, 0.8]]}",
    queue: float = 0.9,
    due: str = "60",
    program: str = PROGRAM,
) -> Path:
    (folder / "room.rmr").write_text(program)
    (folder / "lab.yaml").write_text(LAB.format(obstacles=obstacles, yard=yard, queue=queue, due=due))
    return folder


def told(folder: Path) -> tuple[list[str], list[str]]:
    """Return the problems and the warnings of the lab in `folder`, without the folder."""
    lab = load_lab(folder)
    try:
        warnings = validated(lab, load_lab_program(lab)).warnings.splitlines()
    except LabError as error:
        return [str(problem).replace(f"{folder}/", "") for problem in error.problems], []
    return [], [warning.replace(f"{folder}/", "") for warning in warnings if "lab.yaml" in warning]


@pytest.mark.parametrize("name", ["corridor", "testbed", "hall", "twoway", "formation", "dock", "warehouse"])
def test_the_labs_of_this_repository_are_fine(name):
    lab = load_lab(LABS / name)
    assert validated(lab, load_lab_program(lab)).warnings == ""


@pytest.mark.parametrize(("y", "beacons", "warned"), [(1.4, 2, True), (1.2, 2, False), (1.4, 3, False)])
def test_a_place_where_robots_know_their_position_too_badly_is_a_warning(tmp_path, y, beacons, warned):
    folder = room(tmp_path, yard=f"{{slots: [[2.5, 0.3], [2.9, {y}]]}}")
    at = [[0, 1.5], [0.5, 1.5], [0, 0]][:beacons]
    with (folder / "lab.yaml").open("a") as lab:
        lab.write(f"localisation: {{beacons: {at}}}\n")
    problems, warnings = told(folder)
    assert problems == []
    words = "a robot at (2.9, 1.4), near the line through the beacons, knows its position to"
    assert any(f"areas.yard.slots.1: warning: {words}" in warning for warning in warnings) == warned


def test_a_room_without_walls_is_fine(tmp_path):
    assert told(room(tmp_path)) == ([], [])


def test_robots_that_a_wall_parts_from_their_destination_are_named_with_the_place(tmp_path):
    words = "robots 1, 2 find no way to area 'yard'; a robot of radius 0.07 m must fit through"
    assert told(room(tmp_path, obstacles=WALL)) == ([f"lab.yaml:7:15: areas.yard: {words}"], [])


@pytest.mark.parametrize(("gap_m", "fits"), [(0.13, False), (0.16, False), (0.25, True)])
def test_a_door_must_be_wider_than_a_robot_by_what_its_planner_keeps(tmp_path, gap_m, fits):
    door = f"{{box: [1.45, 0.0, 1.55, 0.7]}}, {{box: [1.45, {0.7 + gap_m}, 1.55, 1.5]}}"
    problems, _ = told(room(tmp_path, obstacles=door))
    assert (problems == []) is fits


def test_only_the_enclosed_robot_is_named(tmp_path):
    cage = "{box: [0.64, 0.0, 0.68, 0.6]}, {box: [0.64, 0.56, 1.0, 0.6]}, {box: [0.96, 0.0, 1.0, 0.6]}"
    problems, _ = told(room(tmp_path, obstacles=cage))
    assert len(problems) == 1
    assert "robot 2 finds no way to area 'yard'" in problems[0]


def test_unreachable_slot_is_named_individually(tmp_path):
    closet = "{box: [2.3, 0.6, 2.34, 1.5]}, {box: [2.3, 0.6, 3.0, 0.64]}"
    problems, _ = told(room(tmp_path, obstacles=closet, yard="{slots: [[2.5, 0.3], [2.6, 1.0]]}"))
    assert problems == ["lab.yaml:7:36: areas.yard.slots.1: no robot finds a way to place 1 of area 'yard'"]


def test_an_area_and_a_queue_that_the_program_uses_must_have_a_way_from_some_robot(tmp_path):
    program = PROGRAM.replace("at(R, yard), D", "done(R), D").replace("moveto(R, yard)", "moveto(R, entry)")
    folder = room(tmp_path, obstacles=WALL, queue=2.9, program=program)
    lab = (folder / "lab.yaml").read_text().replace("finish: at(R, yard)\n", "")
    (folder / "lab.yaml").write_text(lab.replace("spacing: 0.2", "spacing: 2.0"))
    problems, _ = told(folder)
    assert problems == [
        "lab.yaml:6:81: areas.entry.queue: no robot finds a way to place 1 of the queue of area 'entry'"
    ]
    away = lab.replace("at: [0.5, 1.2]", "at: [2.5, 1.2]")
    (folder / "lab.yaml").write_text(away.replace("[[0.5, 1.2], [2.9, 1.2]]", "[[0.5, 1.2], [0.9, 1.2]]"))
    problems, _ = told(folder)
    assert problems == ["lab.yaml:6:57: areas.entry: no robot finds a way to area 'entry', which the program uses"]


def test_a_deadline_shorter_than_the_way_is_a_warning_where_the_lab_states_it(tmp_path):
    words = "warning: robot 1 cannot be at yard within 9 s (crossing): the way alone takes 10.00 s"
    assert told(room(tmp_path, due="9")) == ([], [f"lab.yaml:11:9: facts.0: {words}"])


@pytest.mark.parametrize(("facts", "within"), [("due(R, 9)", "9 s"), ("due(@1, -4)", "0 s")])
def test_a_deadline_is_found_also_where_all_robots_have_it_and_where_it_is_negative(tmp_path, facts, within):
    folder = room(tmp_path, due="9")
    file = folder / "lab.yaml"
    file.write_text(file.read_text().replace("due(@1, 9)", facts))
    _, warnings = told(folder)
    assert warnings[0].startswith(f"lab.yaml:11:9: facts.0: warning: robot 1 cannot be at yard within {within}")


def test_of_a_deadline_that_each_run_draws_the_latest_counts(tmp_path):
    assert told(room(tmp_path, due="1..30")) == ([], [])
    _, (warning,) = told(room(tmp_path, due="1..9"))
    assert "lab.yaml:11:9: facts.0: warning: robot 1 cannot be at yard within 9 s" in warning


def test_deadline_stated_in_the_program_is_reported_with_its_place_in_the_program(tmp_path):
    program = PROGRAM.replace("at(R, yard), D", "at(R, yard), 3s").replace("crossing: assert", "crossing: watch")
    problems, warnings = told(room(tmp_path, program=program))
    assert problems == []
    assert len(warnings) == 2
    assert warnings[0].startswith("lab.yaml:2:10: program: warning: robot 1 cannot be at yard within 3 s")


def test_jobs_that_start_later_or_finish_elsewhere_get_no_deadline_warning(tmp_path):
    later = PROGRAM.replace("start(R), due(R, D) -o", "started(R), due(R, D) -o")
    assert told(room(tmp_path, due="1", program=later)) == ([], [])
    elsewhere = PROGRAM.replace("at(R, yard), D", "done(R), D")
    assert told(room(tmp_path, due="1", program=elsewhere)) == ([], [])


def test_a_deadline_of_the_labs_own_finish_fact_is_judged_by_where_its_facts_lead(tmp_path):
    folder = room(tmp_path, due="9", program=PROGRAM.replace("at(R, yard), D", "there(R), D") + HOME)
    file = folder / "lab.yaml"
    file.write_text(file.read_text().replace("at(R, yard)", "there(R)").replace('"due(@2', '"home(R, yard)", "due(@2'))
    words = "warning: robot 1 cannot be at yard within 9 s (crossing): the way alone takes 10.00 s"
    assert told(folder) == ([], [f"lab.yaml:11:9: facts.0: {words}"])


@pytest.mark.parametrize(
    ("written", "instead", "said"),
    [
        (
            "duration: 20s",
            "duration: 9s",
            "3:11: duration: warning: nothing can finish within 9 s: no schedule takes less than 10.00 s",
        ),
        (
            "facts:",
            "faults: [{at: 21s, kill: 2}, {at: 20s, kill: 1}]\nfacts:",
            "11:9: faults: warning: {at: 21.0, kill: 2} begins when the duration of 20 s is over",
        ),
        (
            "facts:",
            "faults: [{from: 25s, to: 30s, loss: 0.5}]\nfacts:",
            "11:9: faults: warning: {from: 25.0, to: 30.0, loss: 0.5} begins",
        ),
        (
            "facts:",
            "localisation: {beacons: [[0, 0]]}\nfacts:",
            "11:25: localisation.beacons: warning: no robot will know where it is, and moveto will never",
        ),
        (
            "facts:",
            "localisation: {beacons: [[1, 0], [1, 0]]}\nfacts:",
            "11:25: localisation.beacons: warning: no robot will know",
        ),
        (
            "facts:",
            "localisation: {dropout: 1.0}\nfacts:",
            "11:25: localisation.dropout: warning: no robot will know where it is, and moveto will never begin: all",
        ),
    ],
)
def test_implausible_lab_settings_are_warnings(tmp_path, written, instead, said):
    file = room(tmp_path) / "lab.yaml"
    file.write_text(file.read_text().replace(written, instead))
    problems, warnings = told(tmp_path)
    assert problems == []
    assert len(warnings) == 1
    assert warnings[0].startswith(f"lab.yaml:{said}")


def test_a_program_that_does_not_drive_needs_no_beacons(tmp_path):
    file = room(tmp_path, program="type !due(robot, float).\nat(R, yard) -o queue(R).\n") / "lab.yaml"
    file.write_text(file.read_text().replace("facts:", "localisation: {beacons: []}\nfacts:"))
    assert told(tmp_path) == ([], [])


def test_rmr_sim_runs_with_an_impossible_deadline_and_fails_by_exit_code(tmp_path, capsys):
    folder = room(tmp_path, due="9")
    assert main([str(folder), "--robots", "1", "--run", str(tmp_path / "a"), "--trace", str(tmp_path / "trace")]) == 0
    assert "the way alone takes 10.00 s" in capsys.readouterr().err
    assert '"text": "too late"' in (tmp_path / "trace").read_text()
    assert main([str(folder), "--robots", "1", "--run", str(tmp_path / "b"), "--strict"]) == 4


def test_rmr_sim_and_rmr_up_refuse_an_unreachable_destination(tmp_path, capsys):
    folder = room(tmp_path, obstacles=WALL)
    assert main([str(folder), "--run", str(tmp_path / "run")]) == 3
    assert "lab.yaml:7:15: areas.yard: robots 1, 2 find no way" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
    with pytest.raises(RunRefusedError, match="find no way to area 'yard'") as refusal:
        read_program(load_lab(folder), color=False)
    assert refusal.value.exit_code == 3


@pytest.mark.parametrize(
    ("area", "said"),
    [
        ("{slots: [[0.5, 0.5], [0.64, 0.5]]}", "places 0 and 1 are closer than two robots of radius 0.07 m and 10 mm"),
        ("{line: {from: [0.5, 0.5], to: [0.8, 0.5], count: 3}}", None),
        (
            "{slots: [[0.07, 0.5], [0.5, 0.5]]}",
            "a robot of radius 0.07 m does not fit at (0.07, 0.5) with 5 mm to spare",
        ),
        ("{at: [0.5, 0.5], queue: {path: [[0.5, 0.5], [0.9, 0.5]], spacing: 0.145}}", "places 0 and 1 are closer"),
    ],
)
def test_places_need_room_for_robots_that_know_their_place_to_a_centimetre(tmp_path, area, said):
    try:
        lab_of(tmp_path, f"{ROOM}areas: {{yard: {area}}}\n")
        found = None
    except LabError as error:
        found = str(error)
    assert (found is None) is (said is None)
    assert said is None or said in (found or "")


# -- what a lab promises of turns and room -----------------------------------------------------------------------------

ALL_TO_A_BOX = """\
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type !due(robot, float).
start(R).
start(R) -o moveto(R, yard).
"""


def bare(folder: Path, text: str) -> Path:
    (folder / "lab.yaml").write_text(text)
    return folder


def test_box_too_small_for_its_robots_is_a_warning(tmp_path):
    folder = room(tmp_path, yard="{box: [2.3, 0.3, 2.5, 0.5]}")
    message = "warning: area 'yard' has room for 1 robot of radius 0.07 m at a time, and 2 go there"
    assert told(folder) == ([], [f"lab.yaml:7:21: areas.yard.box: {message}"])
    assert told(room(tmp_path, yard="{box: [2.2, 0.3, 2.6, 0.5]}")) == ([], [])


def test_box_too_small_for_robots_that_move_there_first_is_a_warning_without_a_finish(tmp_path):
    folder = room(tmp_path, yard="{box: [2.3, 0.3, 2.5, 0.5]}", program=ALL_TO_A_BOX)
    bare(folder, (folder / "lab.yaml").read_text().replace("finish: at(R, yard)\n", ""))
    _, warnings = told(folder)
    assert warnings == [
        "lab.yaml:6:21: areas.yard.box: warning: area 'yard' has room for 1 robot of radius 0.07 m at a time, "
        "and 2 go there"
    ]


CARRY_IN_TURNS = """\
type action carry(R: robot, A: area) -o dropped(R, A).
type !due(robot, float).
fetch(R, yard, 60.0).
fetching: assert(fetch(R, A, D), dropped(R, A), D, broadcast(R)).
fetch(R, A, _) -o carry(R, A).
"""


def test_area_with_room_for_one_is_no_warning_where_a_handler_drives_there_by_turns(tmp_path):
    folder = room(tmp_path, yard="{at: [2.4, 0.4]}", program=CARRY_IN_TURNS)
    bare(folder, (folder / "lab.yaml").read_text().replace("finish: at(R, yard)", "finish: dropped(R, yard)"))
    assert told(folder) == ([], [])


DOOR = "{box: [1.45, 0.0, 1.55, 0.6]}, {box: [1.45, 0.9, 1.55, 1.5]}"


def test_bottleneck_off_every_route_is_a_warning(tmp_path):
    folder = room(tmp_path, obstacles=DOOR)
    text = (folder / "lab.yaml").read_text()
    door = text.replace("robots:", "bottleneck: door\nrobots:").replace("yard:", "door: {at: [1.4, 0.75]}, yard:")
    assert told(bare(folder, door))[1] == []
    _, warnings = told(bare(folder, door.replace("at: [1.4, 0.75]", "at: [0.2, 1.3]")))
    assert warnings == [
        "lab.yaml:8:13: bottleneck: warning: nobody passes the bottleneck: no way of a robot to an area leads through "
        "'door'; nothing is passed in turns there"
    ]


def test_bottleneck_without_an_assertion_that_a_drive_serves_is_a_warning(tmp_path):
    folder = room(tmp_path, obstacles=DOOR, program=ALL_TO_A_BOX)
    text = (folder / "lab.yaml").read_text()
    door = text.replace("robots:", "bottleneck: door\nrobots:").replace("yard:", "door: {at: [1.4, 0.75]}, yard:")
    _, warnings = told(bare(folder, door))
    assert warnings == [
        "lab.yaml:8:13: bottleneck: warning: the bottleneck is of no use: no moveto serves a time assertion of the "
        "program, so robots pass it without turns"
    ]


def all_warnings(folder: Path) -> list[str]:
    lab = load_lab(folder)
    return validated(lab, load_lab_program(lab)).warnings.replace(f"{folder}/", "").splitlines()


def test_time_assertion_that_never_starts_in_this_lab_names_the_fact_that_is_missing(tmp_path):
    folder = room(tmp_path)
    bare(folder, "\n".join(line for line in (folder / "lab.yaml").read_text().splitlines() if "due" not in line))
    warnings = [line for line in all_warnings(folder) if "warning" in line]
    assert warnings == [
        "room.rmr:9:11: warning[W102]: nothing states or derives `due`, the rule cannot fire",
        "room.rmr:10:1: warning: the time assertion crossing never starts: nothing makes a fact 'due', so there is no "
        "'crossing'; state it under facts",
    ]


def test_time_assertion_that_no_action_serves_is_a_warning(tmp_path):
    program = PROGRAM.replace("at(R, yard), D,", "tidy(R), D,") + "$queue(R) -o tidy(R).\n"
    warnings = all_warnings(room(tmp_path, program=program))
    assert any(
        "the event of the time assertion crossing is never scheduled: no action leads to its finish" in w
        for w in warnings
    )


@pytest.mark.parametrize(("gap_m", "hint"), [(0.13, False), (0.172, True)])
def test_a_door_between_the_centres_of_large_cells_is_told_with_the_cell_that_finds_it(tmp_path, gap_m, hint):
    door = f"{{box: [1.45, 0.0, 1.55, 0.71]}}, {{box: [1.45, {0.71 + gap_m}, 1.55, 1.5]}}"
    problems, _ = told(room(tmp_path, obstacles=door))
    assert len(problems) == 1
    assert ("it does, but not on a grid of 0.05 m; set arena.cell to 0.025 or less" in problems[0]) is hint

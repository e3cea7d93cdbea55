"""A lab and its program judged against each other."""

import pytest
from world_labs import LABS, ROOM, lab_of

from rmr.bytecode.codec import decode, encode
from rmr.lang.compiler import compile_file, compile_source
from rmr_world.finding import LabError
from rmr_world.lab_file import load_lab
from rmr_world.validate.program_fit import CHECKS

AREAS = "areas: {gate: {at: [2.0, 0.75]}, yard: {at: [1.0, 1.2], queue: {path: [[1, 1.2], [2, 1.2]], spacing: 0.2}}}\n"
HEADER = """\
type action moveto(R: robot, A: area) -o at(R, A).
type action lineup(robot, area, int).
type action shout(robot).
type sensor at(robot, area).
type !due(robot, float).
type place(robot, area). type spot(robot, area, int). type round(robot, list area).
start(R).
"""


def check_program(lab, program):
    return sorted({finding for check in CHECKS for finding in check(lab, program)})


def program_of(source, *, debug=True):
    """Return the program of HEADER and `source`."""
    compilation = compile_source(HEADER + source, "room.rmr")
    assert compilation.program is not None, compilation.diagnostics
    return compilation.program if debug else decode(encode(compilation.program, debug=False))


def judged(folder, source="", extra="", *, debug=True):
    """Return the complaints about a room with the areas gate and yard, without the folder."""
    lab = lab_of(folder, ROOM + AREAS + extra)
    return [str(p).replace(f"{folder}/", "") for p in check_program(lab, program_of(source, debug=debug))]


@pytest.mark.parametrize("name", ["corridor", "testbed"])
def test_the_labs_fit_their_programs(name):
    lab = load_lab(LABS / name)
    assert check_program(lab, compile_file(lab.program).program) == []


@pytest.mark.parametrize(
    ("source", "where"),
    [
        ("start(R) -o moveto(R, gat).", "in rule 1"),
        ("start(R), place(R, gat) -o 1.", "in rule 1"),
        ("start(R), not at(R, gat) -o shout(R).", "in rule 1"),
        ("start(R), place(R, A), A = gat -o shout(R).", "in rule 1"),
        ("start(R), place(R, A), gat != A -o shout(R).", "in rule 1"),
        ("start(R) -o {A | place(R, A) | place(R, gat)}.", "in rule 1"),
        ("start(R) -o [count => N | place(R, gat) | seen(R, N)].", "in rule 1"),
        ("start(R) -o [max D => N | spot(R, A, D), A = gat | seen(R, N)].", "in rule 1"),
        ("start(R) -o [collect A => L | place(R, A) | moveto(R, gat)].", "in rule 1"),
        ("start(R) -o moveto(R, gate) then place(R, gat).", "in rule 1"),
        ("start(R) -o shout(R) then ?place(R, gat).", "in a goal in rule 1"),
        ("start(R) -o ?place(R, gat).", "in a goal in rule 1"),
        ("assert(place(R, gat), at(R, gate), 10, shout(R)).", "in the time assertion at"),
        ("assert(start(R), at(R, gat), 10, shout(R)).", "in the time assertion at"),
        ("assert(start(R), at(R, gate), 10, moveto(R, gat)).", "in the time assertion at"),
    ],
)
def test_an_undefined_area_is_named_where_the_program_uses_it(tmp_path, source, where):
    (complaint,) = judged(tmp_path, source)
    assert complaint.startswith("room.rmr:8:")
    assert complaint.endswith(f"area 'gat', used {where}, is not defined in lab.yaml; did you mean 'gate'?")


@pytest.mark.parametrize(
    ("source", "where"),
    [
        ("place(R, gat).", "in a fact"),
        ("round(R, [gate, gat]).", "in a fact"),
        ("?at(R, gat).", "in a goal"),
        ("type action hop(R: robot) -o place(R, gat).", "in an effect of hop"),
    ],
)
def test_a_use_without_a_place_in_the_source_points_at_the_lab_s_program(tmp_path, source, where):
    assert judged(tmp_path, source) == [
        f"lab.yaml:2:10: program: area 'gat', used {where}, is not defined; did you mean 'gate'?"
    ]


def test_byte_code_without_debug_information_is_judged_too(tmp_path):
    assert judged(tmp_path, "start(R) -o moveto(R, gat).", debug=False) == [
        "lab.yaml:2:10: program: area 'gat', used in rule 1, is not defined; did you mean 'gate'?"
    ]


def test_defined_areas_and_symbols_of_other_types_are_fine(tmp_path):
    source = "type line(robot, line).\nstart(R), line(R, L), L = north, place(R, A), A = yard -o moveto(R, gate)."
    assert judged(tmp_path, source) == []


def test_a_line_up_needs_an_area_with_a_queue(tmp_path):
    assert judged(tmp_path, "start(R) -o lineup(R, yard, 1).") == []
    (complaint,) = judged(tmp_path, "start(R) -o lineup(R, gate, 1).")
    assert "area 'gate' has no queue in lab.yaml, which lineup in rule 1 needs" in complaint


@pytest.mark.parametrize(
    ("fact", "complaint"),
    [
        ("duw(@1, 5)", "the program knows no fact 'duw'; did you mean 'due'?"),
        ("shout(@1)", "'shout' is an action, not a fact"),
        ("due(@1)", "'due' has 2 arguments in the program, here 1"),
        ("due(@1, soon)", "argument 2 of 'due' should be float"),
        ("place(@1, 3..4)", "argument 2 of 'place' should be area"),
        ("place(@1, 3)", "argument 2 of 'place' should be area"),
    ],
)
def test_a_fact_of_the_lab_that_the_program_cannot_hold_is_named(tmp_path, fact, complaint):
    source = "start(R), due(R, D), place(R, A) -o shout(R)."
    found = judged(tmp_path, source, f"facts:\n  - 'due(@1, 25)'\n  - '{fact}'\n")
    assert found == [f"lab.yaml:9:5: facts.1: {complaint}"]


@pytest.mark.parametrize(
    ("fact", "complaint"),
    [
        ("chrge(R, v)", "the program knows no fact 'chrge'; did you mean 'charge'?"),
        ("charge(R)", "holds nothing of the message"),
        ("charge(R, v, w)", "'charge' has 2 arguments in the program, here 3"),
        ("due(R, v)", "a fact from a topic is a sensed one: declare 'type sensor due(robot, ...)'"),
        ("at(R, v)", "the robot senses 'at' itself: declare another one"),
        ("charge(R, v)", ""),
        ("battery(R, v)", ""),
    ],
)
def test_a_fact_from_a_topic_is_a_sensed_one_of_the_program(tmp_path, fact, complaint):
    source = (
        "type sensor charge(robot, float).\nstart(R), due(R, D), charge(R, C), battery(R, B), at(R, yard) -o shout(R)."
    )
    try:
        found = judged(tmp_path, source, f"facts:\n  - 'due(@1, 25)'\n  - {{topic: t, type: a/B, fact: '{fact}'}}\n")
    except LabError as error:
        found = str(error).splitlines()
    assert len(found) == bool(complaint)
    assert not found or f"facts.1.fact: {complaint}" in found[0]


def test_an_undefined_area_in_a_fact_of_the_lab_is_named(tmp_path):
    found = judged(tmp_path, "start(R), place(R, A) -o shout(R).", "facts: ['place(@1, gat)']\n")
    assert found == ["lab.yaml:7:9: facts.0: area 'gat' is not defined; did you mean 'gate'?"]


def test_facts_keep_their_lines_when_only_some_robots_take_part(tmp_path):
    robots = "  - {id: 2, pose: [1.5, 0.75, 0]}\n"
    text = ROOM.replace("robots:\n", "robots:\n" + robots) + "facts: ['due(@1, 5)', 'duw(@2, 5)']\n"
    (problem,) = check_program(lab_of(tmp_path, text).with_robots(1), program_of("start(R), due(R, D) -o shout(R)."))
    assert (problem.path, problem.line, problem.column) == ("facts.1", 7, 23)


@pytest.mark.parametrize(
    ("finish", "complaint"),
    [
        ("donee(R)", "the program knows no fact 'donee'; did you mean 'done'?"),
        ("done(R, 3)", "'done' has 1 argument in the program, here 2"),
        ("shout(R)", "the program knows no fact 'shout'"),
    ],
)
def test_a_finish_that_the_program_cannot_reach_is_named(tmp_path, finish, complaint):
    found = judged(tmp_path, "start(R) -o done(R).", f"finish: {finish}\n")
    assert len(found) == 1
    assert found[0].startswith(f"lab.yaml:7:9: finish: {complaint}")


def test_a_finish_may_be_what_every_robot_senses(tmp_path):
    assert judged(tmp_path, "start(R) -o shout(R).", "finish: at(R, gate)\n") == []

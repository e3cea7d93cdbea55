"""Mistakes in the passages of a lab file, with place and remedy, and warnings of those that nobody uses."""

from pathlib import Path

import pytest

from rmr_world.finding import LabError
from rmr_world.lab_file import load_lab
from rmr_world.lab_program import load_lab_program, validated

LABS = Path(__file__).parents[3] / "deploy" / "labs"


def warehouse(folder, changes):
    """Return the errors and warnings of the provided lab with replacements in its file."""
    text = (LABS / "warehouse" / "lab.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "lab.yaml").write_text(text)
    (folder / "warehouse.rmr").write_text((LABS / "warehouse" / "warehouse.rmr").read_text())
    try:
        loaded = load_lab(folder)
        return str(validated(loaded, load_lab_program(loaded)).warnings)
    except LabError as error:
        return "\n".join(map(str, error.problems))


def test_the_passages_of_the_file_are_those_of_the_arena():
    arena = load_lab(LABS / "warehouse").arena
    found = {passage.name: [area.name for area in passage.entrances] for passage in arena.passages}
    assert found == {"north": ["north_west", "north_east"], "south": ["south_west", "south_east"]}
    assert not any(passage.by_event for passage in arena.passages)


SOUTH = "south: {mouths: [south_west, south_east]}"
MISTAKES = [
    (SOUTH, "south: {mouths: [south_wet, south_east]}", "south: area 'south_wet' is not defined; did you mean"),
    (SOUTH, "south: {mouths: [south_west]}", "south: mouths should name two areas; for one entry write its name alone"),
    (
        SOUTH,
        "south: 3",
        "south: should be a mapping with the keys mouths, not 3; name an area, or {mouths: [west, east]}",
    ),
    (SOUTH, "South: south_west", "passages.South"),
    (SOUTH, "bottleneck: south_west", "bottleneck: a lab has a bottleneck or passages"),
    ("passages:\n", "bottleneck: south_west\npassages:\n", "passages.north: a lab has a bottleneck or passages"),
    ("[2.6, 0.9]", "[1.6, 1.0]", "passages.south: two of its mouths are closer than a robot is wide"),
    ("  south_east: {at: [2.6, 0.9]}", "  south_east: {at: [2.6, 1.9]}", "'south_east' is 0.20 m from 'north_east'"),
]


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES)
def test_a_mistake_in_the_passages_is_told_with_its_place(tmp_path, old, new, words):
    assert words in warehouse(tmp_path, [(old, new)])


def test_a_station_beside_passages_is_taken_and_one_in_a_passage_is_an_error(tmp_path):
    assert warehouse(tmp_path, [("passages:\n", "stations: [west_home]\npassages:\n")]) == ""
    inside = [("[4.05, 0.45], ", "[2.1, 0.9], "), ("passages:\n", "stations: [east_store]\npassages:\n")]
    assert "lies in passage 'south': a robot that stays there would close it" in warehouse(tmp_path, inside)


def test_passages_in_a_row_need_room_to_wait_between_them(tmp_path):
    wall = "  - {box: [3.1, 0.0, 3.5, 0.75]}\n  - {box: [3.1, 1.05, 3.5, 3.0]}\nareas:\n  far: {at: [3.5, 0.9]}\n"
    wall += "  near: {at: [3.1, 0.9]}\n"
    found = warehouse(tmp_path, [("areas:\n", wall), ("passages:\n", "passages:\n  last: {mouths: [near, far]}\n")])
    assert "robots that wait there need 0.66 m: make one of them, with mouths at the outer ends" in found


def test_a_passage_that_nobody_passes_is_warned_of(tmp_path):
    areas = "areas:\n  here: {at: [0.9, 0.3]}\n  there: {at: [0.9, 1.5]}\n"
    found = warehouse(tmp_path, [("areas:\n", areas), ("passages:\n", "passages:\n  idle: {mouths: [here, there]}\n")])
    assert "passages.idle: warning: nobody passes it: no way of a robot to an area leads through 'here' and" in found
    assert "passages.north" not in found


def test_a_passage_whose_robots_drive_through_another_one_for_room_is_warned_of(tmp_path):
    tight = [("[1.6, 1.05, 2.6, 1.95]", "[1.6, 1.05, 2.6, 2.01]"), ("[1.6, 2.25, 2.6, 3.0]", "[1.6, 2.19, 2.6, 3.0]")]
    found = warehouse(tmp_path, tight)
    words = "between 'north_west' and 'north_east' robots of 0.07 m drive through 'south', which leaves them more room"
    assert f"passages.north: warning: nobody passes it: {words}" in found
    assert "passages.south" not in found


def test_a_narrow_passage_without_a_name_beside_those_with_names_is_warned_of(tmp_path):
    found = warehouse(tmp_path, [("  south: {mouths: [south_west, south_east]}\n", "")])
    assert "is not exclusive: drives go through it without turns; name its ends under passages" in found


ACROSS = """
lab: across
program: across.rmr
duration: 60s
finish: there(R)
arena: {size: [4.0, 3.0], cell: 0.05}
areas:
  west: {at: [0.2, 0.3]}
  east: {at: [3.8, 0.3]}
robots:
  - {id: 1, pose: [0.6, 2.5, 0deg]}
  - {id: 2, pose: [3.4, 2.5, 180deg]}
facts:
  - goes(@1, east)
  - goes(@2, west)
localisation: {beacons: [[0, 0], [4, 0]]}
obstacles:
"""
"""Two robots that change sides, and what lies between them."""
GOES = """
type action moveto(R: robot, A: area) -o there(R).
type !goes(robot, area).
start(R).
start(R), goes(R, A) -o moveto(R, A).
"""


@pytest.mark.parametrize(("x", "named", "warnings"), [(2.2, "", 2), (2.2, "passages: {}\n", 0), (2.8, "", 0)])
def test_doors_that_face_each_other_without_room_to_wait_are_warned_of(tmp_path, x, named, warnings):
    walls = [(left, low, left + 0.3, high) for left in (1.3, x) for low, high in ((0.0, 0.55), (0.85, 3.0))]
    boxes = "".join(f"  - {{box: {list(wall)}}}\n" for wall in walls)
    (tmp_path / "lab.yaml").write_text(f"{ACROSS}{boxes}{named}")
    (tmp_path / "across.rmr").write_text(GOES)
    loaded = load_lab(tmp_path)
    found = str(validated(loaded, load_lab_program(loaded)).warnings)
    assert found.count("has no turns, so robots meet in it: it ends 0.") == warnings


TOUR = """
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type tour(robot, list area).
start(R).
start(R), tour(R, [A | Rest]) -o tour(R, Rest), moveto(R, A).
at(R, _), tour(R, []) -o there(R).
"""


def test_a_first_drive_that_has_no_way_is_warned_of(tmp_path):
    lab = ACROSS.replace("goes(@1, east)", "tour(@1, [east])").replace("goes(@2, west)", "tour(@2, [west])")
    (tmp_path / "lab.yaml").write_text(lab + "  - {box: [1.9, 0.0, 2.1, 3.0]}\n")
    (tmp_path / "across.rmr").write_text(TOUR)
    loaded = load_lab(tmp_path)
    found = str(validated(loaded, load_lab_program(loaded)).warnings)
    assert (
        "areas.east: warning: robot 1 finds no way to area 'east'; a robot of radius 0.07 m must fit through; the"
        in found
    )
    assert "areas.west: warning: robot 2 finds no way to area 'west'" in found

"""The stations of a lab file: their capacities, and every mistake, told before the run."""

import pytest
from world_labs import LABS, ROOM, complaints, lab_of

from rmr_world.finding import LabError
from rmr_world.lab_file import load_lab
from rmr_world.lab_program import load_lab_program, validated

AREAS = """\
areas:
  pair: {slots: [[2.0, 0.4], [2.0, 0.8]]}
  box: {box: [0.9, 0.1, 1.3, 0.5]}
  spot: {at: [2.5, 1.2], queue: {path: [[2.0, 0.5], [1.0, 1.2]], spacing: 0.25}}
"""
ALONE = AREAS.replace(", queue: {path: [[2.0, 0.5], [1.0, 1.2]], spacing: 0.25}", "")


@pytest.mark.parametrize(
    ("stations", "capacities"),
    [
        ("[pair]", (("pair", 2),)),
        ("[spot, pair]", (("spot", 1), ("pair", 2))),
        ("{pair: {capacity: 1}, spot: {}}", (("pair", 1), ("spot", 1))),
        ("[box]", (("box", 4),)),
        ("[]", ()),
    ],
)
def test_a_station_has_the_capacity_that_the_file_names_or_as_many_as_there_are_places(tmp_path, stations, capacities):
    assert lab_of(tmp_path, ROOM + ALONE + f"stations: {stations}\n").arena.stations == capacities


MISTAKES = [
    (ALONE, "pair", "10:11: stations: should be a list of areas: [pair], not 'pair'"),
    (ALONE, "[pair, pair]", "10:11: stations: names 'pair' twice"),
    (ALONE, "[pear]", "10:12: stations.0: area 'pear' is not defined; did you mean 'pair'?"),
    (ALONE, "{pair: {capacity: 0}}", "stations.pair.capacity: should be greater than or equal to 1, not 0"),
    (ALONE, "{pair: {capacity: two}}", "stations.pair.capacity: should be a valid integer, not 'two'"),
    (ALONE, "{pair: {capacty: 2}}", "stations.pair.capacty: unknown key; did you mean 'capacity'?"),
    (
        ALONE,
        "{pair: {capacity: 3}}",
        "stations.pair.capacity: is 3, but area 'pair' has 2 places: name at most that many, or add places",
    ),
    (AREAS, "[pair]", "a place of the queue of area 'spot' is nearer to station 'pair' than a robot is wide"),
    (
        ALONE.replace("[2.5, 1.2]", "[2.05, 0.9]"),
        "[pair, spot]",
        "stations.1: lies nearer to station 'pair' than a robot is wide",
    ),
    (ALONE, "[pair]\nbottleneck: spot", "stations: a lab with a bottleneck has no stations"),
]


@pytest.mark.parametrize(("areas", "stations", "words"), MISTAKES)
def test_a_mistake_in_the_stations_is_told_with_its_place(tmp_path, areas, stations, words):
    (found,) = complaints(tmp_path, ROOM + areas + f"stations: {stations}\n")
    assert words in found


def dock(folder, changes):
    """Return the errors and warnings of the provided lab with replacements in its file."""
    text = (LABS / "dock" / "lab.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "lab.yaml").write_text(text)
    (folder / "dock.rmr").write_text((LABS / "dock" / "dock.rmr").read_text())
    loaded = load_lab(folder)
    try:
        return validated(loaded, load_lab_program(loaded)).warnings
    except LabError as error:
        return "\n".join(map(str, error.problems))


def test_a_station_to_which_nothing_drives_is_an_error(tmp_path):
    found = dock(tmp_path, [("  bay1:", "  spare: {at: [2.2, 0.2]}\n  bay1:"), ("[charger]", "[charger, spare]")])
    assert "nothing drives to station 'spare': neither the program nor a fact of the lab names it" in found


def test_no_warning_where_a_station_limits_the_robots_that_go_to_an_area(tmp_path):
    program = "type action moveto(R: robot, A: area) -o at(R, A). type sensor at(robot, area). start(R).\n"
    (tmp_path / "room.rmr").write_text(program + "start(R) -o moveto(R, yard).\n")
    text = ROOM + "  - {id: 2, pose: [1, 1, 0]}\nareas: {yard: {slots: [[2, 0.75]]}}\n"
    for station, warned in (("", True), ("stations: [yard]\n", False)):
        loaded = lab_of(tmp_path, text + station)
        assert ("has room for 1 robot" in validated(loaded, load_lab_program(loaded)).warnings) is warned


DEAD_END = [
    ("[[2.2, 0.7], [2.2, 1.1]]", "[[2.28, 0.9], [2.05, 0.9]]"),
    ("areas:\n", "obstacles:\n  - {box: [1.9, 0.0, 2.4, 0.78]}\n  - {box: [1.9, 1.02, 2.4, 1.8]}\nareas:\n"),
]


def test_a_station_that_a_robot_cannot_leave_while_others_stand_there_is_an_error(tmp_path):
    found = dock(tmp_path, DEAD_END)
    assert "a robot on place 0 of station 'charger' has no way out while robots stand on the others" in found
    assert dock(tmp_path, [*DEAD_END, ("[charger]", "{charger: {capacity: 1}}")]) == ""

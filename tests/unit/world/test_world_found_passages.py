"""Passages of a lab that names none: which are found, and as what they reach robots."""

from collections.abc import Iterable

import pytest
from world_labs import lab_of

from rmr.base.arena import Arena, from_data, to_data
from rmr_world.bound import bound_s

FLOOR = """\
lab: rooms
program: room.rmr
arena: {size: [4.0, 1.5]}
obstacles:
  - {box: [1.2, 0.0, 1.8, 0.6]}
  - {box: [1.2, 0.9, 1.8, 1.5]}
robots:
  - {id: 1, pose: [0.5, 0.75, 0deg]}
"""
TOO_CLOSE = """\
  - {box: [2.25, 0.0, 2.65, 0.6]}
  - {box: [2.25, 0.9, 2.65, 1.5]}
"""
"""A second wall 45 cm behind the first one: room for robots to pass, and not to wait."""


def arena_of(folder, *more: str, floor: str = FLOOR) -> Arena:
    return lab_of(folder, floor + "".join(more)).arena


def names(arena: Arena) -> Iterable[str]:
    return [passage.name for passage in arena.passages]


def test_the_door_between_two_rooms_is_a_passage_for_all_robots(tmp_path):
    (door,) = arena_of(tmp_path).passages
    assert (door.name, door.found, door.by_event, door.two_ended) == ("passage_1", True, False, True)
    (west_x, west_y), (east_x, east_y) = door.mouths
    assert (west_x, east_x) == (pytest.approx(1.1, abs=0.05), pytest.approx(1.9, abs=0.05))
    assert west_y == east_y == pytest.approx(0.75, abs=0.01)


@pytest.mark.parametrize(
    "more",
    [
        "areas: {here: {at: [1.5, 0.75]}}\n",
        "areas: {rest: {at: [1.5, 0.75]}}\nstations: [rest]\n",
        "areas: {rest: {box: [1.3, 0.65, 1.7, 0.85]}}\nstations: [rest]\n",
        "passages: {}\n",
        "areas: {door: {at: [1.1, 0.75]}}\nbottleneck: door\n",
        "areas: {door: {at: [1.1, 0.75]}}\npassages: {in: door}\n",
    ],
)
def test_none_is_found_where_somebody_stays_in_it_or_the_lab_says_what_is_shared(tmp_path, more):
    assert "passage_1" not in names(arena_of(tmp_path, more))


def test_one_is_found_in_a_lab_with_stations(tmp_path):
    assert names(arena_of(tmp_path, "areas: {rest: {at: [0.3, 0.3]}}\nstations: [rest]\n")) == ["passage_1"]


def test_a_robot_that_starts_in_it_holds_it(tmp_path):
    inside = FLOOR + "  - {id: 2, pose: [1.5, 0.75, 0deg]}\n"
    assert names(arena_of(tmp_path, floor=inside)) == []


def test_passages_without_room_to_wait_between_them_are_left_out(tmp_path):
    floor = FLOOR.replace("robots:\n", TOO_CLOSE + "robots:\n")
    assert names(arena_of(tmp_path, floor=floor)) == []


def test_robots_are_told_of_it_with_the_floor(tmp_path):
    arena = arena_of(tmp_path)
    assert from_data(to_data(arena)) == arena


def test_the_bound_of_a_run_does_not_take_a_passage_that_was_found_for_the_only_way(tmp_path):
    """Around the door there is a way 45 cm wide, and two robots may take one each."""
    floor = FLOOR.replace("[1.2, 0.9, 1.8, 1.5]", "[1.2, 0.9, 1.8, 1.05]").replace(
        "lab: rooms\n", "lab: rooms\nfinish: at(R, east)\n"
    )
    robots = "  - {id: 2, pose: [0.5, 0.4, 0deg]}\nareas: {east: {slots: [[3.0, 0.75], [3.0, 0.4]]}}\n"
    lab = lab_of(tmp_path, floor + robots)
    assert names(lab.arena) == ["passage_1"]
    without = lab_of(tmp_path, floor + robots + "passages: {}\n")
    assert bound_s(lab) == bound_s(without)


BESIDE = """\
  - {box: [2.9, 0.0, 3.3, 0.6]}
  - {box: [2.9, 0.9, 3.3, 1.5]}
"""
"""A second wall, with room for robots that wait."""
ENDS = "areas: {west: {at: [1.05, 0.75]}, east: {at: [1.95, 0.75]}}\n"


@pytest.mark.parametrize(
    ("named", "found"),
    [
        ("passages: {door: {mouths: [west, east]}}\n", ["door", "passage_2"]),
        ("passages: {passage_2: {mouths: [west, east]}}\n", ["passage_2", "passage_2_found"]),
        ("passages: {}\n", []),
    ],
)
def test_those_that_the_lab_does_not_name_are_found_beside_those_that_it_names(tmp_path, named, found):
    floor = FLOOR.replace("[4.0, 1.5]", "[5.0, 1.5]").replace("robots:\n", BESIDE + "robots:\n")
    arena = arena_of(tmp_path, ENDS, named, floor=floor)
    assert names(arena) == found
    assert [passage.found for passage in arena.passages] == [False, True][: len(found)]

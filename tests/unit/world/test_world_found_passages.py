"""Passages of a lab that names none: which are found, and as what they reach robots."""

import math
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
    assert (door.name, door.found, door.by_event, door.one_way) == ("passage_1", True, False, False)
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


CORRIDORS = """\
lab: corridors
program: none.rmr
arena: {size: [4.0, 3.0], cell: 0.05}
obstacles:
  - {box: [1.2, 0.7, 1.85, 1.35]}
  - {box: [2.15, 0.7, 2.8, 1.35]}
  - {box: [1.2, 1.65, 1.85, 2.3]}
  - {box: [2.15, 1.65, 2.8, 2.3]}
robots:
  - {id: 1, pose: [0.5, 0.75, 0deg]}
"""
MIDDLE = "  - {box: [1.2, 1.65, 2.8, 2.3]}\n"
"""Instead of the upper blocks: three corridors meet."""


def three(floor: str = CORRIDORS) -> str:
    lines = floor.splitlines(keepends=True)
    return "".join([*lines[:6], MIDDLE, *lines[8:]])


def test_corridors_that_meet_are_one_passage_with_an_end_for_each(tmp_path):
    (four,) = arena_of(tmp_path, floor=CORRIDORS).passages
    assert (four.name, four.found, len(four.mouths)) == ("junction_1", True, 4)
    outer = [(2.0, 0.6), (1.1, 1.5), (2.9, 1.5), (2.0, 2.4)]
    assert sorted(four.mouths) == [pytest.approx(end, abs=0.06) for end in sorted(outer)]
    (one,) = arena_of(tmp_path, floor=three()).passages
    assert sorted(one.mouths) == [pytest.approx(end, abs=0.06) for end in sorted(outer[:3])]


def test_a_robot_that_starts_in_one_arm_holds_them_all(tmp_path):
    assert names(arena_of(tmp_path, floor=CORRIDORS.replace("0.5, 0.75, 0deg", "1.5, 1.5, 0deg"))) == []


def test_where_five_corridors_meet_none_of_them_has_turns(tmp_path):
    blocks = "".join(
        f"  - {{polygon: [{', '.join(corners)}]}}\n"
        for corners in (
            [
                f"[{2.0 + r * math.cos(a):.3f}, {2.0 + r * math.sin(a):.3f}]"
                for r, a in ((0.3, m), (1.2, m - w), (1.2, m + w))
            ]
            for m, w in ((math.radians(72 * k + 36), math.radians(28)) for k in range(5))
        )
    )
    head, robots = CORRIDORS.split("obstacles:\n", maxsplit=1)[0], CORRIDORS[CORRIDORS.index("robots:") :]
    floor = head.replace("[4.0, 3.0]", "[4.0, 4.0]") + "obstacles:\n" + blocks + robots.replace("0.5, 0.75", "0.3, 0.3")
    assert names(arena_of(tmp_path, floor=floor)) == []


def test_a_lab_may_name_the_ends_of_corridors_that_meet(tmp_path):
    ends = "areas: {s: {at: [2.0, 0.6]}, w: {at: [1.1, 1.5]}, e: {at: [2.9, 1.5]}, n: {at: [2.0, 2.4]}}\n"
    (named,) = arena_of(tmp_path, ends, "passages: {meeting: {mouths: [s, w, e, n]}}\n", floor=CORRIDORS).passages
    assert (named.name, named.found, len(named.mouths)) == ("meeting", False, 4)


def test_robots_are_told_of_it_with_the_floor(tmp_path):
    arena = arena_of(tmp_path)
    assert from_data(to_data(arena)) == arena
    meeting = arena_of(tmp_path, floor=CORRIDORS)
    assert from_data(to_data(meeting)) == meeting


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

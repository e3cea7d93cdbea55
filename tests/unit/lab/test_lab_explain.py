"""`rmr check LAB --explain`: passages, who needs them, what turns cover."""

import json
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.base.arena import Arena, Disc
from rmr.base.geometry import Point
from rmr_lab.main import check as command
from rmr_lab.picture import COLUMNS_MAX, ROWS_MAX, text_map

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs" / "examples" / "labs"


def check(*words):
    return invoke(command, [*map(str, words)])


def explained(lab):
    result = check("--explain", "--json", lab)
    found = json.loads(result.stdout)
    assert list(found) == ["version", "diagnostics", "explanation"]
    (only,) = found["explanation"]["labs"]
    return only


def test_a_corridor_is_listed_with_its_ends_width_and_robots():
    lab = explained("corridor")
    (passage,) = lab["passages"]
    assert (passage["name"], passage["key"], passage["areas"]) == ("bottleneck", "bottleneck", ["entry"])
    assert passage["ends"] == [[pytest.approx(x, abs=0.02), pytest.approx(0.75, abs=0.01)] for x in (1.1, 1.9)]
    assert passage["width_m"] == pytest.approx(0.3, abs=0.005)
    assert {(drive["robot"], drive["due_s"]) for drive in passage["drives"]} >= {(1, 32.0), (6, 24.0)}
    assert all(drive["scheduled"] == "in turns" and drive["enters_by"] == 1 for drive in passage["drives"])
    (turn,) = lab["turns"]
    assert (turn["held"], turn["events"]) == (["moveto"], ["crossing(exit)"])
    assert turn["over"].startswith("the bottleneck")


def test_an_aisle_without_a_name_is_passed_by_whole_drives_in_both_directions():
    north, south = explained(EXAMPLES / "aisles" / "through.yaml")["passages"]
    assert [drive["robot"] for drive in north["drives"]] == [1, 2, 3, 4]
    assert south["key"] is None
    assert {(d["robot"], d["enters_by"], d["scheduled"]) for d in south["drives"]} == {
        (5, 1, "whole drive"), (6, 1, "whole drive"), (7, 2, "whole drive"), (8, 2, "whole drive")
    }  # fmt: skip


def test_corridors_that_meet_are_listed_as_one_with_lines_to_paste():
    text = check("--explain", EXAMPLES / "junction" / "lab.yaml").stdout
    assert "a  junction_1  [2.00, 0.61], [1.09, 2.01], [2.91, 2.01], 0.28 m wide" in text
    assert "one robot abreast: those that enter or leave by one end, one robot behind the other" in text
    assert "junction_1: {mouths: [junction_1_a, junction_1_b, junction_1_c]}" in text


def test_a_floor_without_narrow_places_and_an_assertion_that_is_only_watched():
    result = check("--explain", "formation")
    assert "none: two robots can pass each other everywhere" in result.stdout
    assert "nothing: it is only watched" in result.stdout


def test_a_floor_that_is_too_large_to_be_searched_is_told(tmp_path):
    (tmp_path / "p.rmr").write_text("start(R).\n")
    (tmp_path / "lab.yaml").write_text(
        "lab: large\nprogram: p.rmr\narena: {size: [90, 90], cell: 0.2}\nrobots: [{id: 1, pose: [1, 1, 0deg]}]\n"
    )
    assert "the floor is not searched" in check("--explain", tmp_path).stdout


def test_the_key_that_names_a_passage_is_told_where_the_lab_names_none(tmp_path):
    for file in (ROOT / "deploy" / "labs" / "twoway").glob("*.*"):
        text = file.read_text()
        (tmp_path / file.name).write_text("".join(x for x in text.splitlines(True) if not x.startswith("bottleneck")))
    assert "named under bottleneck.mouths" in check("--explain", tmp_path).stdout
    assert "bottleneck.mouths" not in check("--explain", "twoway").stdout


def test_stations_are_listed_with_their_capacities():
    assert explained("dock")["stations"] == [{"name": "charger", "capacity": 2, "robots": []}]
    shown = check("--explain", "dock").stdout
    assert "STATIONS" in shown
    assert "charger\n     capacity   2 at a time" in shown
    assert "STATIONS" not in check("--explain", "corridor").stdout


def test_the_text_has_a_map_of_at_most_100_columns():
    text = check("--explain", EXAMPLES / "aisles" / "through.yaml").stdout
    assert max(map(len, text.splitlines())) <= 120
    drawn = [line for line in text.splitlines() if line.startswith("|")]
    assert {len(line) for line in drawn} == {COLUMNS_MAX + 2}
    assert any("bbbb" in line for line in drawn)


def test_the_drawing_shows_the_passages_that_were_found(tmp_path):
    svg = tmp_path / "floor.svg"
    assert check("--explain", "--svg", svg, EXAMPLES / "aisles" / "lab.yaml").exit_code == 0
    assert svg.read_text().count('class="narrow"') == 2


def test_a_lab_with_errors_is_not_explained(tmp_path):
    (tmp_path / "lab.yaml").write_text("lab: Room\n")
    result = check("--explain", "--json", tmp_path)
    assert result.exit_code != 0
    assert json.loads(result.stdout)["explanation"] == {"labs": []}


def test_programs_and_labs_are_not_explained_together(tmp_path):
    (tmp_path / "p.rmr").write_text("start(R).\n")
    assert "name one kind at a time" in check("--explain", "corridor", tmp_path / "p.rmr").stderr


@pytest.mark.parametrize(("width", "height"), [(1.0, 50.0), (50.0, 1.0), (3.0, 3.0)])
def test_a_map_is_small_whatever_the_shape_of_the_floor(width, height):
    arena = Arena(width, height, 0.05, (Disc(Point(0.5, 0.5), 0.4),))
    lines = text_map(arena, {}, {"o": [Point(width, height), Point(0.0, 0.0)]}).splitlines()
    assert len(lines) <= ROWS_MAX + 2
    assert max(map(len, lines)) <= COLUMNS_MAX + 2
    assert "".join(lines).count("o") == 2
    assert lines[-2][1] == "o"

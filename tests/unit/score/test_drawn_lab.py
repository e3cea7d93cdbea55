"""Drawn labs: one seed, one lab; every kind is drawn; `rmr check` takes nearly all; places keep a way free."""

import subprocess
import sys
from itertools import combinations
from pathlib import Path

import drawn_lab
import pytest
import yaml
from drawn_floor import FLOORS, Shape, draw_floor, pixels, places
from drawn_lab import BEACONS, CORRIDORS_FROM, NAMINGS, RADII_M, ROBOTS, SPEEDS_MPS, draw_lab
from drawn_program import PROGRAMS

from rmr.base.geometry import Point, distance
from rmr.base.streams import stream
from rmr_sim.run_setup import Options, load
from rmr_world.finding import LabError

pytestmark = pytest.mark.medium

DRAWN = [draw_lab(seed) for seed in range(120)]


def files(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_a_seed_draws_the_same_lab_in_every_process():
    code = "from drawn_lab import draw_lab; print(*(draw_lab(seed).digest for seed in range(40)))"
    environment = {"PYTHONHASHSEED": "5", "PYTHONPATH": str(Path(drawn_lab.__file__).parent)}
    script = [sys.executable, "-c", code]
    there = subprocess.run(script, check=True, capture_output=True, text=True, env=environment).stdout.split()
    assert there == [drawn.digest for drawn in DRAWN[:40]]


def test_the_script_writes_the_files_of_a_seed(tmp_path, monkeypatch, capsys):
    seed = next(drawn.seed for drawn in DRAWN if drawn.image is not None)
    monkeypatch.setattr(sys, "argv", ["drawn_lab.py", str(seed), str(tmp_path / "there")])
    assert drawn_lab.main() == 0
    assert files(tmp_path / "there") == files(draw_lab(seed).write(tmp_path / "here"))
    assert set(files(tmp_path / "there")) == {"lab.yaml", "drawn.rmr", "floor.pgm"}
    assert f"Drawn lab {seed};" in capsys.readouterr().out


def test_two_seeds_draw_two_labs():
    assert len({yaml.safe_dump(drawn.lab) for drawn in DRAWN}) == len(DRAWN)


@pytest.mark.parametrize(
    ("part", "kinds"),
    [("floor", FLOORS), ("program", PROGRAMS), ("naming", NAMINGS), ("image", ("yes", "no"))],
)
def test_every_kind_is_drawn(part, kinds):
    newer = [draw_lab(seed) for seed in range(CORRIDORS_FROM, CORRIDORS_FROM + 20)]
    assert {drawn.kinds[part] for drawn in [*DRAWN, *newer]} == set(kinds)
    assert "corridors" not in {drawn.kinds["floor"] for drawn in DRAWN}


def test_beacons_are_drawn_by_default_on_one_wall_on_all_and_anywhere():
    found = {drawn.kinds["beacons"].split()[-1] for drawn in DRAWN}
    assert found == {"default", "wall", "around", "anywhere"}
    counts = {len(drawn.lab["localisation"].get("beacons", "two")) for drawn in DRAWN}
    assert {BEACONS[0], BEACONS[1]} <= counts


def test_robots_are_mostly_near_the_default_and_some_far_from_it_and_all_within_the_limits():
    radii = sorted(drawn.lab["robot"]["radius"] for drawn in DRAWN)
    speeds = sorted(drawn.lab["robot"]["speed"] for drawn in DRAWN)
    counts = sorted(len(drawn.lab["robots"]) for drawn in DRAWN)
    assert RADII_M[0] <= radii[0] < 0.06
    assert 0.35 < radii[-1] <= RADII_M[1]
    assert SPEEDS_MPS[0] <= speeds[0] < 0.15
    assert 1.2 < speeds[-1] <= SPEEDS_MPS[1]
    assert sum(0.05 <= radius <= 0.1 for radius in radii) > 0.6 * len(radii)
    assert counts[0] == ROBOTS[0]
    assert 25 < counts[-1] <= ROBOTS[1]


def test_deadlines_are_between_loose_and_tight_watched_and_asserted():
    assert {drawn.kinds["deadlines"] for drawn in DRAWN} == {
        f"{tightness} ({word})" for tightness in ("loose", "fair", "tight") for word in ("watch", "assert")
    }


def test_most_drawn_labs_are_valid_and_refused_are_those_with_ambiguous_beacons_or_no_way(tmp_path):
    refused = {}
    for drawn in DRAWN[:30]:
        try:
            load(drawn.write(tmp_path / str(drawn.seed)), Options())
        except LabError as error:
            refused[drawn.seed] = str(error)
    ambiguous = {seed for seed, words in refused.items() if "cannot tell where it is" in words}
    assert len(ambiguous) <= 8, refused
    without_way = [words for seed, words in refused.items() if seed not in ambiguous]
    assert len(without_way) <= 3, refused
    assert all("finds no way" in words for words in without_way), refused


@pytest.mark.parametrize("kind", FLOORS)
def test_whatever_stands_at_the_places_another_robot_fits_between_them_and_past_obstacles(kind):
    shape = Shape(0.1, 0.3)
    floor = draw_floor(stream(f"test/{kind}"), kind, shape, 12, 0.01)
    found = places(stream("test/places"), floor, shape.radius, 12)
    assert len(found) > 1
    assert all(distance(*a, *b) >= 4 * shape.radius + 0.06 for a, b in combinations(found, 2))
    assert all(floor.clearance(place) >= 3 * shape.radius + 0.06 for place in found)


def test_an_image_of_a_floor_is_dark_where_its_obstacles_are():
    floor = draw_floor(stream("test/image"), "doors", Shape(0.07, 0.2), 6, 0.05)
    head, _, dark = pixels(floor, 0.05).partition(b"\n255\n")
    columns, rows = map(int, head.split()[1:])
    assert (columns, rows) == (round(floor.width / 0.05), round(floor.height / 0.05))
    for row in range(rows):
        for column in range(columns):
            middle = Point((column + 0.5) * 0.05, floor.height - (row + 0.5) * 0.05)
            assert (dark[row * columns + column] == 0) == (floor.clearance(middle) == 0.0)

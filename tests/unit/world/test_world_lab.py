"""The lab file: what a good one means."""

import math

import pytest
from world_labs import LABS, ROOM, lab_of

from rmr.base.arena import Disc, Polygon
from rmr.base.geometry import Point, Pose
from rmr.base.time import NS_PER_MS, NS_PER_S
from rmr.radio.links import Disturbance
from rmr.radio.phy import Bursts, RadioConfig
from rmr_world.finding import LabError
from rmr_world.lab import Kill, Restart, RobotStart, Stall
from rmr_world.lab_file import load_lab
from rmr_world.schema import json_schema

# What a good file means


def test_the_corridor_lab_is_that_of_the_paper_s_figure_1():
    lab = load_lab(LABS / "corridor")
    assert (lab.name, lab.seed, lab.duration, lab.finish) == ("corridor", 7, 120 * NS_PER_S, "at(R, exit)")
    assert lab.program == LABS / "corridor" / "corridor.rmr"
    assert lab.roster == (1, 2, 3, 4, 5, 6)
    assert [place.x for place in lab.arena.area("entry").queue] == [1.1, 0.9, 0.7, 0.5, 0.3, 0.1]
    assert len(lab.arena.area("exit").places) == 6
    assert [[area.name for area in passage.entrances] for passage in lab.arena.passages] == [["entry"]]


def test_the_testbed_lab_has_thirty_by_thirty_cells():
    lab = load_lab(LABS / "testbed" / "lab.yaml")
    assert lab.arena.width / lab.arena.cell == pytest.approx(30)
    assert lab.arena.height / lab.arena.cell == pytest.approx(30)
    assert [robot.pose.y for robot in lab.robots] == [0.15, 0.37, 0.59, 0.91, 1.13, 1.35]


def test_the_deadlines_of_both_labs_differ_and_do_not_follow_the_ids():
    for name in ("corridor", "testbed"):
        deadlines = [fact.args[0] for fact in load_lab(LABS / name).initial_facts]
        assert len(dict.fromkeys(deadlines)) == 6
        assert deadlines != sorted(deadlines)


def test_everything_but_lab_program_robots_and_arena_has_a_default(tmp_path):
    lab = lab_of(tmp_path, ROOM)
    assert (lab.seed, lab.finish, lab.facts, lab.faults) == (0, "", (), ())
    assert lab.arena.cell == 0.05
    assert lab.arena.shape.radius == 0.07
    assert lab.arena.shape.view_angle == pytest.approx(math.radians(60))
    assert lab.arena.beacons == (Point(0, 0), Point(3.0, 0))
    assert lab.radio.config.interference == "capture_3db"
    assert lab.localisation.rate == 10


def test_a_grid_places_robots_row_by_row(tmp_path):
    text = ROOM + "  - {ids: '2-4,9', grid: {from: [0.2, 0.2], step: [0.3, 1.0], columns: 3, facing: 90deg}}\n"
    assert lab_of(tmp_path, text).robots[1:] == (
        RobotStart(2, Pose(0.2, 0.2, math.pi / 2)),
        RobotStart(3, Pose(0.5, 0.2, math.pi / 2)),
        RobotStart(4, Pose(0.8, 0.2, math.pi / 2)),
        RobotStart(9, Pose(0.2, 1.2, math.pi / 2)),
    )


def test_ids_may_be_written_without_quotes(tmp_path):
    text = ROOM + "  - {ids: 2-3, grid: {from: [0.2, 0.2], step: [0.3, 0], columns: 2}}\n"
    assert lab_of(tmp_path, text).roster == (1, 2, 3)


@pytest.mark.parametrize(
    ("written", "seconds"), [("120s", 120), ("500ms", 0.5), ("1.5min", 90), ("20", 20), ("0.25", 0.25)]
)
def test_durations_are_seconds_or_bear_a_unit(tmp_path, written, seconds):
    assert lab_of(tmp_path, ROOM + f"duration: {written}\n").duration == seconds * NS_PER_S


@pytest.mark.parametrize(("written", "radians"), [("180deg", math.pi), ("1.57", 1.57), ("-90deg", -math.pi / 2)])
def test_angles_are_radians_or_bear_a_unit(tmp_path, written, radians):
    text = ROOM.replace("0deg", written)
    assert lab_of(tmp_path, text).robots[0].pose.theta == pytest.approx(radians)


def test_a_line_spaces_its_places_evenly_ends_included(tmp_path):
    lab = lab_of(tmp_path, ROOM + "areas: {row: {line: {from: [0.2, 0.2], to: [0.8, 0.2], count: 4}}}\n")
    area = lab.arena.area("row")
    assert area.places == (Point(0.2, 0.2), Point(0.4, 0.2), Point(0.6, 0.2), Point(0.8, 0.2))
    assert area.slotted


def test_a_box_area_is_its_box_around_its_centre(tmp_path):
    area = lab_of(tmp_path, ROOM + "areas: {pen: {box: [1.0, 0.2, 2.0, 0.6]}}\n").arena.area("pen")
    assert area.box == (1.0, 0.2, 2.0, 0.6)
    assert area.places == (Point(1.5, 0.4),)


def test_a_queue_goes_round_corners(tmp_path):
    text = ROOM + "areas: {gate: {at: [2, 0.7], queue: {path: [[2, 0.7], [1.6, 0.7], [1.6, 1.3]], spacing: 0.25}}}\n"
    queue = lab_of(tmp_path, text).arena.area("gate").queue
    assert queue == (Point(2, 0.7), Point(1.75, 0.7), Point(1.6, 0.8), Point(1.6, 1.05), Point(1.6, 1.3))


def test_obstacles_are_boxes_circles_and_polygons_either_way_round(tmp_path):
    text = ROOM + (
        "obstacles: [{box: [1, 0, 2, 0.5]}, {circle: [2.5, 1.0, 0.1]}, {polygon: [[0, 0], [0, 0.1], [0.1, 0]]}]\n"
    )
    box, disc, triangle = lab_of(tmp_path, text).arena.obstacles
    assert isinstance(box, Polygon)
    assert box.contains(1.5, 0.25)
    assert disc == Disc(Point(2.5, 1.0), 0.1)
    assert isinstance(triangle, Polygon)
    assert triangle.contains(0.02, 0.02)


TWO = ROOM.replace("  - {id: 1", "  - {id: 2, pose: [1, 1, 0]}\n  - {id: 1")
THREE = TWO + "  - {id: 3, pose: [2, 1, 0]}\n"
S = NS_PER_S


def test_faults_of_processes_are_kept_as_values(tmp_path):
    text = TWO + "faults: [{at: 5s, kill: 1}, {at: 8s, restart: 1}, {from: 2s, to: 3s, stall: 2}]\n"
    lab = lab_of(tmp_path, text)
    assert lab.faults == (Kill(5 * S, 1), Restart(8 * S, 1), Stall(2 * S, 3 * S, 2))
    assert lab.disturbances == ()
    assert lab.with_robots(1).faults == (Stall(2 * S, 3 * S, 2),)


def test_faults_of_the_radio_are_disturbances_from_one_instant_to_another(tmp_path):
    text = THREE + (
        "faults:\n"
        "  - {from: 3s, to: 6s, loss: 0.5}\n  - {from: 4s, to: 9s, partition: [[1], 2-3]}\n  - {at: 5s, kill: 1}\n"
        "  - {from: 1s, to: 2s, link: [1, 2], loss: 1}\n"
        "  - {from: 1s, to: 2s, link: [2, 1], one_way: true, cut: true}\n"
        "  - {from: 1s, to: 2s, attenuation_db: 20}\n"
    )
    lab = lab_of(tmp_path, text)
    assert lab.disturbances == (
        Disturbance(3 * S, 6 * S, loss=0.5),
        Disturbance(4 * S, 9 * S, ((1,), (2, 3)), attenuation_db=math.inf),
        Disturbance(1 * S, 2 * S, ((1,), (2,)), loss=1.0),
        Disturbance(1 * S, 2 * S, ((2,), (1,)), one_way=True, attenuation_db=math.inf),
        Disturbance(1 * S, 2 * S, attenuation_db=20.0),
    )
    assert lab.faults == (Kill(5 * S, 1),)
    assert [each.check() for each in lab.disturbances] == list(lab.disturbances)


def test_links_and_a_partition_of_the_radio_hold_for_the_whole_run(tmp_path):
    text = THREE + (
        "radio:\n  links: [{link: [1, 2], loss: 0.3}, {link: [3, 1], one_way: true, attenuation_db: 20}]\n"
        "  partition: [[1], [2]]\n"
    )
    assert lab_of(tmp_path, text).disturbances == (
        Disturbance(groups=((1,), (2,)), loss=0.3),
        Disturbance(groups=((3,), (1,)), one_way=True, attenuation_db=20.0),
        Disturbance(groups=((1,), (2,)), attenuation_db=math.inf),
    )


def test_with_robots_keeps_of_a_disturbance_what_concerns_the_first_ones(tmp_path):
    text = THREE + (
        "radio: {links: [{link: [1, 2], loss: 0.3}, {link: [1, 3], loss: 0.2}], partition: [[1, 3], [2]]}\n"
        "faults: [{from: 3s, to: 6s, loss: 0.5}]\n"
    )
    assert lab_of(tmp_path, text).with_robots(2).disturbances == (  # robots 2 and 1
        Disturbance(groups=((1,), (2,)), loss=0.3),
        Disturbance(groups=((1,), (2,)), attenuation_db=math.inf),
        Disturbance(3 * S, 6 * S, loss=0.5),
    )


def test_the_radio_s_settings_are_those_of_its_model(tmp_path):
    bursts = "{good: 2s, bad: 200ms}"
    text = f"radio: {{shadowing_db: 4, bursts: {bursts}, loss: 0.1, exponent: 2, interference: awgn, seed: 3}}\n"
    lab = lab_of(tmp_path, ROOM + text)
    assert lab.radio.config == RadioConfig(
        shadowing_db=4.0, bursts=Bursts(2 * S, 200 * NS_PER_MS, 1.0), loss=0.1, exponent=2.0, interference="awgn"
    )
    assert lab.radio.seed == 3
    assert lab_of(tmp_path, ROOM).radio.config == RadioConfig()


def test_with_robots_keeps_the_first_ones_and_their_facts():
    lab = load_lab(LABS / "corridor").with_robots(3)
    assert lab.roster == (1, 2, 3)
    assert lab.facts == ("due(@1, 32)", "due(@2, 26)", "due(@3, 30)")


@pytest.mark.parametrize("count", [0, -1, 7])
def test_with_robots_refuses_more_than_there_are(count):
    with pytest.raises(LabError, match="there are 6 robots"):
        load_lab(LABS / "corridor").with_robots(count)


def test_the_json_schema_describes_every_key():
    schema = json_schema()
    assert {"lab", "program", "arena", "robots"} == set(schema["required"])
    assert schema["additionalProperties"] is False
    assert "from" in schema["$defs"]["FaultSpec"]["properties"]

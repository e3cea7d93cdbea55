"""`rmr plot RUN`: pictures and animation of a recorded run, and what is said of runs that cannot be drawn."""

import json
import math
import re
import shutil
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import pytest

from rmr.base.arena import to_data
from rmr.record.record_writer import RecordWriter
from rmr.record.recording import Message
from rmr.record.run_about import about_run
from rmr_sim.main import main as sim_main
from rmr_view.animation import HOLD_S, OCTETS_MAX, Keyframes, animation
from rmr_view.plot import main
from rmr_view.run_data import POSES_MAX, RunData, Track, read_run
from rmr_view.run_pictures import JOBS_MAX, PICTURES, lateness, radio, trajectories, turns
from rmr_world.lab_file import load_lab

pytestmark = pytest.mark.medium

ROOT = Path(__file__).parents[3]
SVG = "{http://www.w3.org/2000/svg}"
NAMES = ["trajectories.svg", "turns.svg", "lateness.svg", "radio.svg"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a simulated run of the corridor."""
    folder = tmp_path_factory.mktemp("runs") / "corridor"
    assert sim_main([str(ROOT / "deploy/labs/corridor"), "--run", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def floor():
    return to_data(load_lab(ROOT / "deploy/labs/corridor").arena)


def texts(svg):
    return ["".join(each.itertext()) for each in ElementTree.fromstring(svg).iter(f"{SVG}text")]


def pose(robot, x, y):
    turned = {"x": 0, "y": 0, "z": 0.0, "w": 1.0}
    return {"child_frame_id": f"robot/{robot}", "translation": {"x": x, "y": y, "z": 0}, "rotation": turned}


def moved(t, robot, x, y):
    return Message("/tf", round(t * 1e9), {"transforms": [pose(robot, x, y)]})


def traced(t, robot, what, **fields):
    return Message("/trace", round(t * 1e9), {"t": t, "robot": robot, "what": what, **fields})


def frame(t, kind, attempt=0, outcome="ok", octets_s=0.002):
    times = {"asked_s": t, "start_s": t, "end_s": t + octets_s}
    content = {"source": 1, "destination": 2, "kind": kind, "octets": 50, "handle": 1, "attempt": attempt}
    return Message("/frames", round(t * 1e9), {**content, **times, "outcome": outcome})


def drawn(floor, *messages):
    return read_run(RunData("a < b & c", "simulated", 7, floor), messages)


MISSED = (
    moved(0.0, 3, 0.2, 0.2),
    traced(0.0, 3, "job_started", job="at(@3, exit)", deadline_s=4.0),
    traced(1.0, 3, "asks", approach_s=1.0, inside_s=1.0, after_s=1.0, way=0),
    moved(4.0, 3, 0.6, 0.2),
    traced(4.0, 3, "deadline_missed", job="at(@3, exit)"),
    traced(6.0, 3, "job_finished", job="at(@3, exit)"),
    moved(8.0, 3, 1.0, 0.75),
)


# ---- the command


def test_pictures_of_a_run_are_written_into_its_folder_and_named(run, capsys):
    assert main([str(run)]) == 0
    assert capsys.readouterr().out.splitlines() == [str(run / name) for name in NAMES]
    for name in NAMES:
        shown = texts((run / name).read_text())
        assert shown[0].startswith("corridor: 6 robots, simulated, seed 7: ")


def test_pictures_are_the_same_octets_from_folder_and_file(run, tmp_path):
    assert main([str(run), "-o", str(tmp_path / "one")]) == 0
    assert main([str(run / "run.mcap"), "-o", str(tmp_path / "two")]) == 0
    for name in NAMES:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_animation_in_the_readme_is_what_the_command_makes_today(run, tmp_path):
    """To make it anew: rmr sim corridor --run RUN; rmr plot RUN --animate docs/pictures/corridor.svg."""
    assert main([str(run), "--animate", str(tmp_path / "corridor.svg")]) == 0
    made = (tmp_path / "corridor.svg").read_text()
    assert made == (ROOT / "docs/pictures/corridor.svg").read_text()
    assert len(made) < OCTETS_MAX


def test_animation_takes_a_speed(run, tmp_path):
    for speed in ("1", "4"):
        assert main([str(run), "--animate", str(tmp_path / f"{speed}.svg"), "--speed", speed]) == 0
    assert "4 x real time" in texts((tmp_path / "4.svg").read_text())
    assert not [text for text in texts((tmp_path / "1.svg").read_text()) if "real time" in text]


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["nowhere/run"], 2, "nowhere/run: no such file or folder"),
        (["lost.mcap"], 2, "lost.mcap: no such file or folder"),
        (["{empty}"], 3, "no recording of a run"),
        (["{broken}"], 3, "broken.mcap"),
        (["{run}", "--animate", "x.png"], 2, "name a file that ends in .svg"),
        (["{run}", "{empty}"], 2, "name one RUN"),
        (["{run}", "figure14"], 2, "name one RUN"),
        (["figure14", "--animate", "x.svg"], 2, "name one RUN"),
        (["--animate", "x.svg"], 2, "name one RUN"),
        (["{run}", "--animate", "x.svg", "--speed", "0"], 2, "--speed"),
        (["{run}", "-o", "{broken}/deeper"], 2, "broken.mcap"),
    ],
)
def test_wrong_run_is_told_in_one_sentence(run, tmp_path, capsys, words, code, told):
    empty = tmp_path / "empty"
    empty.mkdir()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"no recording at all" * 100)
    assert main([word.format(run=run, empty=empty, broken=broken) for word in words]) == code
    message = capsys.readouterr().err
    assert told in message
    assert "Traceback" not in message


def test_figure_goes_before_a_folder_of_the_same_name(tmp_path, monkeypatch, capsys):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "seeds.json").write_text("{}")
    (tmp_path / "seeds").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(["seeds", "--data", "data"]) == 3
    assert "its key `figure` is missing" in capsys.readouterr().err


def test_recording_cut_short_is_drawn_and_its_problem_told(run, tmp_path, capsys):
    octets = (run / "run.mcap").read_bytes()
    short = tmp_path / "short.mcap"
    short.write_bytes(octets[: len(octets) * 2 // 3])
    assert main([str(short)]) == 0
    assert "cut short" in capsys.readouterr().err
    assert (tmp_path / "turns.svg").exists()


# ---- the pictures


def test_missed_deadline_is_red_and_a_cross_in_every_picture(floor):
    data = drawn(floor, *MISSED)
    for picture in (turns, lateness, animation):
        root = ElementTree.fromstring(picture(data))
        assert [each for each in root.iter(f"{SVG}path") if "miss" in each.get("class", "").split()]
    assert "+2.00 s" in texts(lateness(data))
    assert {"missed", "2.0 s late"} <= set(texts(animation(data)))


def test_names_are_escaped_and_colours_have_a_dark_form(floor):
    data = drawn(floor, *MISSED)
    for picture in (*PICTURES.values(), animation):
        text = picture(data)
        assert ElementTree.fromstring(text).find(f"{SVG}title").text.startswith("a < b & c: 1 robots")
        assert "prefers-color-scheme: dark" in text
        assert "<script" not in text
        assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


@pytest.mark.parametrize("picture", [*PICTURES.values(), animation])
def test_run_without_jobs_turns_or_frames_is_drawn(floor, picture):
    assert picture(drawn(floor))
    assert picture(drawn(floor, moved(0.0, 1, 0.2, 0.2)))


def test_animation_moves_robots_at_the_instants_of_the_run(floor):
    data = drawn(floor, *MISSED)
    assert data.end_s == 8.0
    text = animation(data, 1.0)
    length = float(re.search(r"animation: ([\d.]+)s", text)[1])
    assert length == pytest.approx(8.0 + 2.5)
    assert "{38.1%{transform:translate(192px,".replace("{", "}", 1) in text  # at 4 s of 10.5 s it is at x = 0.6 m


def test_animation_of_a_crowd_is_thinned_until_it_is_small(floor):
    wild = [
        moved(t / 10, robot, 1.5 + (t * robot * 37 % 100) / 100, t * robot % 71 / 71)
        for t in range(500)
        for robot in range(1, 13)
    ]
    text = animation(drawn(floor, *wild))
    assert len(text) < 4 * OCTETS_MAX
    assert ElementTree.fromstring(text) is not None


def test_lateness_shows_the_latest_jobs_of_many_and_says_so(floor):
    jobs = [traced(0.0, 1, "job_started", job=f"j{k}", deadline_s=float(k + 1)) for k in range(JOBS_MAX + 10)]
    shown = texts(lateness(drawn(floor, *jobs, moved(5.0, 1, 1.0, 1.0))))
    assert shown[0].endswith(f"(the latest {JOBS_MAX} of {JOBS_MAX + 10} jobs)")
    assert "1: j0" in shown
    assert f"1: j{JOBS_MAX + 9}" not in shown


def test_radio_counts_airtime_repeats_and_losses(floor):
    frames = [frame(0.1, "hello"), frame(0.2, "fact", 1), frame(0.3, "fact", 3, "no_ack"), frame(0.3, "ack", 1)]
    data = drawn(floor, *frames)
    assert data.radio.frames == 4
    assert data.radio.counts["repeats"] == {0: 2}
    assert data.radio.airtime["fact"] == {0: pytest.approx(0.004)}
    shown = texts(radio(data))
    assert {"repeats (2)", "no ack (1)", "access failure (0)", "hello", "fact"} <= set(shown)


def test_radio_of_a_long_run_has_a_bounded_number_of_bins(floor):
    data = drawn(floor, *(frame(float(10 * k), "hello", octets_s=0.5) for k in range(1000)))
    assert data.radio.bins <= 240
    assert sum(data.radio.airtime["hello"].values()) == pytest.approx(500.0)


def test_track_of_a_long_run_keeps_a_bounded_number_of_poses():
    track = Track()
    for k in range(5 * POSES_MAX):
        track.add(float(k), 0.0, 0.0, 0.0)
    assert POSES_MAX / 2 <= len(track) <= POSES_MAX
    assert len({after - before for before, after in pairwise(track.t)}) == 1


def test_trajectories_end_where_the_robots_ended(floor):
    root = ElementTree.fromstring(trajectories(drawn(floor, *MISSED)))
    [line] = root.iter(f"{SVG}polyline")
    assert line.get("points").split()[-1] == f"{20 + 860 / 3:.2f},{44 + 430 - 0.75 * 860 / 3:g}"


def test_pictures_of_a_folder_whose_recording_is_not_joined_yet(run, tmp_path):
    parts = tmp_path / "record"
    parts.mkdir()
    shutil.copy(run / "run.mcap", parts / "world.mcap")
    assert main([str(tmp_path)]) == 0
    assert json.loads((run / "report.json").read_text())["lab"] in (tmp_path / "turns.svg").read_text()


@pytest.mark.parametrize(
    ("spans", "body"),
    [
        ([(2.0, 4.0)], "20%{opacity:1}0%,40%,100%{opacity:0}"),
        ([(0.0, 4.0)], "0%{opacity:1}40%,100%{opacity:0}"),
        ([(0.0001, 4.0)], "0%{opacity:1}40%,100%{opacity:0}"),
        ([(2.0, math.inf)], "20%,100%{opacity:1}0%{opacity:0}"),
        ([(0.0, math.inf)], "0%,100%{opacity:1}"),
        ([(2.0, 4.0), (4.0, 5.0)], "20%,40%{opacity:1}0%,50%,100%{opacity:0}"),
        ([(2.0, 2.0001)], "0%,100%{opacity:0}"),
    ],
)
def test_keyframes_show_an_element_in_its_spans_of_time(spans, body):
    frames = Keyframes(10.0 - HOLD_S, 1.0)
    assert ('opacity="0"' in frames.shown(spans)) == (spans[-1][1] < math.inf)
    step = ";animation-timing-function:step-end"
    assert f"{{{body}}}" in frames.style().replace(step, "")


def write_run(path, floor, *messages):
    writer = RecordWriter(path, about_run("lab", "simulated", 7, (1,), "sim"))
    if floor is not None:
        writer.attach("floor.json", floor)
    for topic, data in messages:
        writer.write(topic, 0, data)
    writer.close()
    return path


@pytest.mark.parametrize("floor", [None, b"{", b"[]", b"{}", b'{"width": 1}', b"[" * 100_000])
def test_recording_without_a_readable_floor_is_told(tmp_path, capsys, floor):
    assert main([str(write_run(tmp_path / "x.mcap", floor))]) == 3
    assert "floor.json" in capsys.readouterr().err


def test_damaged_messages_are_left_out_and_counted(tmp_path, capsys, floor):
    damaged = [
        ("/trace", {}),
        ("/trace", {"what": "slotted", "t": "x", "robot": 1, "start_s": 1}),
        ("/trace", {"what": "job_started", "t": 1.0, "robot": 1}),
        ("/trace", {"what": ["asks"], "t": 1.0, "robot": 1}),
        ("/tf", {"transforms": 7}),
        ("/tf", {"transforms": [pose(1, float("nan"), 0.0)]}),
        ("/frames", {"start_s": 0.0}),
        ("/frames", {"start_s": "now", "kind": "hello", "attempt": 0, "outcome": None, "end_s": None}),
        ("/faults", {"fault": {"at": "soon", "kill": 1}}),
        ("/faults", {}),
    ]
    path = write_run(
        tmp_path / "x.mcap", json.dumps(floor).encode(), *damaged, ("/tf", {"transforms": [pose(1, 1.0, 1.0)]})
    )
    assert main([str(path)]) == 0
    assert capsys.readouterr().err.splitlines() == [
        f"rmr plot: {count} messages of {topic} are damaged and left out"
        for topic, count in (("/trace", 4), ("/tf", 2), ("/frames", 2), ("/faults", 2))
    ]

"""`rmr.simulate`: report, trajectories and trace of a lab as plain data, and the pytest fixture `rmr_sim`."""

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import rmr
from rmr_sim.arguments import parse
from rmr_sim.event import Event
from rmr_sim.sim_command import perform
from rmr_world.run_report import COLUMNS, summary, table_rows

pytestmark = pytest.mark.medium

ROOT = Path(__file__).parents[2]
LAB = """
lab: walk
program: walk.rmr
seed: 3
duration: 30s
finish: at(R, there)
arena: {size: [2.0, 1.0], cell: 0.05}
areas: {there: {box: [1.2, 0.2, 1.8, 0.8]}}
robots: [{id: 1, pose: [0.3, 0.3, 0deg]}, {id: 2, pose: [0.3, 0.7, 0deg]}]
"""
PROGRAM = "type action moveto(robot, area).\nstart(R).\nstart(R) -o moveto(R, there).\n"


@pytest.fixture
def lab(tmp_path):
    """A folder with a lab of two robots that drive to an area."""
    folder = tmp_path / "walk"
    folder.mkdir()
    (folder / "lab.yaml").write_text(LAB)
    (folder / "walk.rmr").write_text(PROGRAM)
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One run of it."""
    folder = tmp_path_factory.mktemp("walk")
    (folder / "lab.yaml").write_text(LAB)
    (folder / "walk.rmr").write_text(PROGRAM)
    return rmr.simulate(folder, seed=5)


def test_report_and_trace_are_those_of_the_command(lab, tmp_path, capsys):
    run = rmr.simulate(lab, seed=9, loss=0.1, chaos=True)
    words = ["--seed", "9", "--loss", "0.1", "--chaos", "--json", "--trace", str(tmp_path / "t.jsonl")]
    perform(parse([str(lab), *words, "--run", str(tmp_path / "run")]))
    assert run.report == json.loads(capsys.readouterr().out)
    assert run.trace == [json.loads(line) for line in (tmp_path / "t.jsonl").read_text().splitlines()]


def test_a_run_says_how_it_ended(run):
    assert (run.lab, run.seed, run.finished) == ("walk", 5, True)
    assert run.time_s == run.report["time_s"] > 4.0
    assert run.warnings == []


def test_a_notebook_shows_the_table_of_the_command_and_where_each_robot_went(run):
    shown = ElementTree.fromstring(run._repr_html_())
    assert shown.findtext("p") == summary(run.report)
    cells = [[cell.text for cell in row] for row in shown.iter("tr")]
    assert cells == [list(COLUMNS), *map(list, table_rows(run.report))]
    svg = "{http://www.w3.org/2000/svg}"
    ways = [line.get("points").split() for line in shown.iter(f"{svg}polyline")]
    assert [len(way) for way in ways] == [len(rows) for rows in run.trajectories.values()]
    for way, rows in zip(ways, run.trajectories.values(), strict=True):
        assert [float(each) for each in way[-1].split(",")] == pytest.approx([rows[-1, 1], -rows[-1, 2]], abs=1e-3)
    assert [each.text for each in shown.iter(f"{svg}title")] == [f"@{robot}" for robot in run.trajectories]


def test_a_notebook_shows_a_run_without_a_pose_and_names_that_look_like_tags(run):
    shown = dataclasses.replace(run, report={**run.report, "lab": "<b>"}, trajectories={})._repr_html_()
    assert "&lt;b&gt;: finished" in shown
    assert "svg" not in shown


def test_trajectories_hold_the_true_poses_at_the_stated_rate(run):
    assert list(run.trajectories) == [1, 2]
    for robot, y in ((1, 0.3), (2, 0.7)):
        way = run.trajectories[robot]
        assert way.dtype == np.float64
        assert way.shape == (1 + int(run.time_s * 10.0), 4)
        assert np.allclose(way[0], [0.0, 0.3, y, 0.0])
        assert np.all(np.abs(way[:, 0] - np.arange(len(way)) / 10.0) < 1 / 60)
        assert np.all(np.diff(way[:, 0]) > 0)
        assert np.all(np.abs(way[:, 3]) <= np.pi)
        walked = np.hypot(*np.diff(way[:, 1:3], axis=0).T).sum()
        assert walked == pytest.approx(run.report["robots"][str(robot)]["distance_m"], abs=0.02)
        assert 1.1 < way[-1, 1] < 1.9


@pytest.mark.parametrize(("rate", "samples"), [(60.0, 61), (1.0, 2), (0.3, 1), (7.0, 8)])
def test_the_rate_says_how_many_samples_there_are(lab, rate, samples):
    assert len(rmr.simulate(lab, duration=1.0, rate=rate).trajectories[1]) == samples


def test_robots_duration_actions_and_events_are_passed_on(lab):
    (lab / "walk.rmr").write_text(PROGRAM + "type action blink(R: robot) -o blinked(R).\nstart2(R) -o blink(R).\n")
    (lab / "blink.py").write_text("from rmr import action\n@action('blink')\nasync def blink(robot):\n    pass\n")

    class Poke(Event):
        def callback(self, simulation):
            simulation.insert(1, "start2")

    run = rmr.simulate(lab, robots=1, duration=2.0, actions=lab / "blink.py", events=[Poke(10**9)])
    assert (list(run.trajectories), run.finished, run.time_s) == ([1], False, 2.0)
    assert "blinked(@1)" in run.report["robots"]["1"]["facts"]
    (lab / "events.py").write_text("def events(lab, seed):\n    return []\n")
    run = rmr.simulate(lab, duration=2.0, actions=str(lab / "blink.py"), events=str(lab / "events.py"))
    assert "blinked(@1)" not in run.report["robots"]["1"]["facts"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed: a whole number from 0, not -1"),
        ({"seed": 1.5}, "seed: a whole number from 0, not 1.5"),
        ({"robots": 0}, "robots: a whole number from 1, not 0"),
        ({"loss": 1.0}, "loss: a share from 0 up to 1, not 1.0"),
        ({"order": "lifo"}, "order: 'lifo' is none of ours, edf, fcfs, none"),
        ({"duration": 0}, "duration: a number of seconds above 0, not 0"),
        ({"duration": float("nan")}, "duration: a number of seconds above 0, not nan"),
        ({"rate": 61}, "rate: samples per second, above 0 and 60 at most, not 61"),
        ({"rate": None}, "rate: samples per second, above 0 and 60 at most, not None"),
        ({"duration": "5s"}, "duration: a number of seconds above 0, not '5s'"),
        ({"loss": "x"}, "loss: a share from 0 up to 1, not 'x'"),
        ({"actions": 3}, "actions: the path of a file of handlers, not 3"),
        ({"events": 3}, r"events: the path of a file of events, or a list of `rmr_sim\.event\.Event`, not 3"),
        ({"events": [3]}, r"events: the path of a file of events, or a list of `rmr_sim\.event\.Event`, not 3"),
        ({"facts": "due(@1, 3)"}, "facts should be a list; each item is a fact in program syntax"),
        ({"faults": ["{at: 5s, kill: 1}"]}, r"faults: '{at: 5s, kill: 1}' should be a mapping, such as"),
        ({"order": None}, "order: None is none of ours, edf, fcfs, none"),
    ],
)
def test_an_argument_that_cannot_be_used_is_a_usage_error(lab, options, message):
    with pytest.raises(rmr.UsageError, match=message):
        rmr.simulate(lab, **options)


def test_facts_faults_and_durable_robots_are_those_of_the_lab_file_and_of_the_command(lab):
    faults = [{"at": "0.2s", "kill": 1}, {"at": 0.4, "restart": 1}]
    (lab / "walk.rmr").write_text(f"type !told(robot).\n{PROGRAM}")
    run = rmr.simulate(lab, facts=["told(@1)"], faults=faults, durable=True)
    assert run.report["faults"] == [{"at": 0.2, "kill": 1}, {"at": 0.4, "restart": 1}]
    forgetful = rmr.simulate(lab, facts=["told(@1)"], faults=faults)
    lost = [one.report["robots"]["1"].get("lost_in_restart") for one in (run, forgetful)]
    assert lost == [0, 1], "its disk holds all"
    assert "!told(@1)" in run.report["robots"]["1"]["facts"]
    with pytest.raises(rmr.LabError, match=r"faults\.0.*robot 99"):
        rmr.simulate(lab, faults=[{"at": 0.2, "kill": 99}])


def test_provided_lab_is_simulated_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert rmr.simulate("corridor", duration=0.5).lab == "corridor"
    with pytest.raises(rmr.UsageError, match="there is no coridor; did you mean 'corridor'"):
        rmr.simulate("coridor")
    with pytest.raises(rmr.UsageError, match="lab: a path, or the name of a provided lab, not 3"):
        rmr.simulate(3)


def test_invalid_lab_program_or_file_raises_the_message_of_the_command(lab, tmp_path, capsys):
    with pytest.raises(rmr.UsageError, match=r"there is no .*nowhere"):
        rmr.simulate(tmp_path / "nowhere")
    with pytest.raises(rmr.LabError, match="there are 2 robots in this lab, so not 9"):
        rmr.simulate(lab, robots=9)
    with pytest.raises(rmr.ProgramError, match=r"nothing\.py: no such Python file"):
        rmr.simulate(lab, actions="nothing.py")
    with pytest.raises(TypeError, match="'sede'"):
        rmr.simulate(lab, sede=1)
    (lab / "walk.rmr").write_text("start(R) -o moveto(R, X).")
    with pytest.raises(rmr.CompileError) as caught:
        rmr.simulate(lab)
    assert perform(parse([str(lab), "--run", str(tmp_path / "run")])) == 3
    assert str(caught.value).strip() == capsys.readouterr().err.strip()
    assert caught.value.diagnostics[0]["file"].endswith("walk.rmr")
    (lab / "lab.yaml").write_text(LAB + "colour: red\n")
    with pytest.raises(rmr.LabError, match=r"lab\.yaml:\d+:1: colour: unknown key"):
        rmr.simulate(lab)


def test_an_event_that_fails_is_an_event_error(lab):
    class Wrong(Event):
        def callback(self, simulation):
            raise RuntimeError("no")

    with pytest.raises(rmr.EventError, match="no"):
        rmr.simulate(lab, events=[Wrong(0)])


# -- the pytest fixture


def pytest_in(folder, *words):
    """Run pytest with the plugin in a folder, in a process of its own."""
    plugin = ["-p", "rmr_sim.pytest_plugin", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_ADDOPTS": ""}
    command = [sys.executable, "-m", "pytest", "-q", *plugin, *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


def test_fixture_finds_a_lab_beside_the_test_and_reports_a_missing_one(lab):
    (lab.parent / "test_walk.py").write_text(
        "import pytest\n\n"
        "def test_lab(rmr_sim):\n"
        "    run = rmr_sim('walk', seed=7, rate=5.0)\n"
        "    assert run.finished and run.seed == 7\n\n"
        "def test_none(rmr_sim):\n"
        "    import rmr\n"
        "    with pytest.raises(rmr.UsageError, match='there is no wlak'):\n"
        "        rmr_sim('wlak')\n"
    )
    result = pytest_in(lab.parent.parent, str(lab.parent))
    assert result.returncode == 0, result.stdout + result.stderr
    assert "2 passed" in result.stdout


def test_tests_that_use_no_lab_load_no_simulator(tmp_path):
    (tmp_path / "test_other.py").write_text(
        "import sys\n\n"
        "def test_other():\n"
        "    heavy = ('lark', 'pydantic', 'pymunk', 'numpy', 'click', 'rmr.lang', 'rmr.node', 'rmr_world')\n"
        "    assert [name for name in sys.modules if name.startswith(heavy)] == []\n"
    )
    result = pytest_in(tmp_path)
    assert result.returncode == 0, result.stdout + result.stderr


def test_the_plugin_is_registered_with_pytest():
    text = (ROOT / "pyproject.toml").read_text()
    assert '[project.entry-points.pytest11]\nrmr = "rmr_sim.pytest_plugin"\n' in text


# -- the notebook


def test_the_example_notebook_runs_as_a_script(lab, tmp_path):
    words = [sys.executable, str(ROOT / "docs" / "examples" / "notebook.py"), str(lab), str(tmp_path / "ways.png")]
    environment = {**os.environ, "MPLBACKEND": "agg", "MPLCONFIGDIR": str(tmp_path)}
    result = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "walk: finished True" in result.stdout
    assert "\nwith 10 % loss: " in result.stdout
    assert (tmp_path / "ways.png").exists() or "matplotlib is not installed" in result.stdout

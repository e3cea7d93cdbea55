"""The compiled form gives what the sources give: reports, traces and final poses, to the bit."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from failing_handlers import NAMES, failing_lab

from rmr.compiled import build, modules_in
from rmr.record.recording import open_recording

sys.path.append(str(Path(__file__).parents[1] / "bench"))
from crowds import flood

pytestmark = pytest.mark.slow

RUNS = """
import copy, hashlib, json, pickle, sys
from pathlib import Path
from rmr.base import geometry
from rmr.node.ports import SeenBody
from rmr_sim.run_setup import Options, load, report_of

def run(lab, seed, chaos, actions=None):
    simulation = load(Path(lab), Options(chaos=chaos, actions=actions and Path(actions))).simulation(seed)
    report = report_of(simulation, simulation.run())
    poses = [repr(simulation.world.pose(robot.robot)) for robot in simulation.robots]
    whole = json.dumps([report, simulation.trace(), poses], sort_keys=True, default=str)
    failures = [each["failure"] for each in simulation.trace() if each["what"] == "action_ended"]
    result = {"lab": lab, "seed": seed, "time_s": report["time_s"], "failures": failures}
    return result | {"all": hashlib.sha256(whole.encode()).hexdigest()}

for value in geometry.Pose(1.0, 2.0, 0.5), geometry.STILL, SeenBody(0.3, 0.1, 0.0, 0.2):
    assert copy.deepcopy(value) == pickle.loads(pickle.dumps(value)) == value
print(json.dumps({"file": geometry.__file__, "runs": [run(*each) for each in json.loads(sys.argv[1])]}))
"""
LABS = [
    ("deploy/labs/testbed", 1, False),
    ("deploy/labs/corridor", 2, False),
    ("deploy/labs/twoway", 1, False),
    ("deploy/labs/formation", 1, False),
    ("deploy/labs/testbed", 100, True),  # they walk away from a jam
    ("deploy/labs/formation/sixteen.yaml", 50015, True),  # `reach` fails again and again
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The modules, compiled into a folder of their own."""
    os.chdir(build.ROOT)
    build.look_for_a_compiler()
    folder = tmp_path_factory.mktemp("fast") / "compiled"
    build.compile_into(folder)
    return folder


@pytest.fixture(scope="module")
def labs(tmp_path_factory):
    """Few robots that drive, with and without faults, and a hundred that talk."""
    failing = failing_lab(tmp_path_factory.mktemp("failing"))
    return [*LABS, (str(flood(tmp_path_factory.mktemp("flood"), 100)), 1, False), failing]


def runs(folder, labs):
    answer = subprocess.run(
        [sys.executable, "-c", RUNS, json.dumps(labs)],
        env={**os.environ, "RMR_COMPILED": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(answer.stdout)


@pytest.mark.timeout(550)
def test_compiled_and_interpreted_runs_are_the_same_to_the_bit(folder, labs):
    assert len(modules_in(folder)) == len(build.hot()) + 1
    compiled, interpreted = runs(folder, labs), runs("", labs)
    assert compiled["file"].startswith(str(folder))
    assert interpreted["file"].endswith("geometry.py")
    assert compiled["runs"] == interpreted["runs"]
    told = interpreted["runs"][-1]["failures"]
    whys = (
        "at once",
        "ZeroDivisionError",
        "unheard_of",
        "stopped",
        "on the way out",
        "ignored GeneratorExit",
        "taken over",
        "no `async def`",
    )
    assert [why for why in whys if not any(failure and why in failure for failure in told)] == []
    well = ("keeps", "catches")
    assert sum(failure is not None for failure in told) == len(NAMES) - len(well) + 1  # one lineup is taken over


@pytest.mark.timeout(550)
def test_minds_recorded_in_one_form_are_replayed_equally_in_the_other(folder, labs, tmp_path):
    failing, seed, _, actions = labs[-1]
    words = {"corridor": ["deploy/labs/corridor", "--chaos"], "failing": [failing, "--actions", actions]}
    for name, lab in words.items():
        for recorded, replayed in ((str(folder), ""), ("", str(folder))):
            run = str(tmp_path / f"{name}-{bool(recorded)}")
            rmr(recorded, "sim", *lab, "--seed", str(seed), "--run", run)
            answer = rmr(replayed, "replay", run, "--json")
            assert answer.returncode == 0, answer.stdout + answer.stderr
            found = json.loads(answer.stdout)
            assert found["equal"]
            assert found["compiled"] is bool(replayed)
            assert {each["compiled"] for each in found["minds"]} == {bool(recorded)}


@pytest.mark.timeout(550)
def test_compiled_robots_may_be_durable(folder, tmp_path):
    answer = rmr(str(folder), "sim", "deploy/labs/testbed", "--durable", "--no-record", "--run", str(tmp_path / "run"))
    assert answer.returncode == 0, answer.stdout + answer.stderr
    assert "deadlines met 6 of 6" in answer.stdout


def rmr(compiled, *words):
    """Run `rmr`, with the modules in the folder `compiled`, or interpreted if it is empty."""
    return subprocess.run(
        [sys.executable, "-c", "from rmr.cli import main; main()", *words],
        env={**os.environ, "RMR_COMPILED": compiled},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.timeout(550)
def test_compiled_values_go_from_process_to_process(folder):
    command = ["contention", "--senders", "3", "--seconds", "2", "--seeds", "4", "--json"]
    outputs = {
        subprocess.run(
            [sys.executable, "-c", "from rmr.cli import main; main()", "radio", *command, "--jobs", jobs],
            env={**os.environ, "RMR_COMPILED": str(folder)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for jobs in ("1", "2")
    }
    assert len(outputs) == 1


@pytest.mark.timeout(550)
def test_recordings_of_compiled_and_interpreted_runs_differ_in_one_field(folder, tmp_path):
    recorded = [recording_of(folder, tmp_path / "compiled"), recording_of("", tmp_path / "interpreted")]
    abouts = [recording.about for recording in recorded]
    assert [about.compiled for about in abouts] == [True, False]
    assert replace(abouts[0], compiled=False) == abouts[1]
    pairs = list(zip(recorded[0].raw_messages(), recorded[1].raw_messages(), strict=True))
    unlike = [(one, other) for one, other in pairs if one != other]
    assert len(unlike) == abouts[0].roster[-1]  # the header of each mind has the field, too, and a check sum
    for one, other in unlike:
        assert (one.topic, one.at) == (other.topic, other.at) == ("/mind", 0)
        assert one.octets.split(b"compiled")[0] == other.octets.split(b"compiled")[0]
        assert len(one.octets) == len(other.octets)
    for name in recorded[0].attachments:
        assert recorded[0].attachment(name) == recorded[1].attachment(name)


def recording_of(compiled, folder):
    """Return the recording of a run with faults."""
    words = ["deploy/labs/corridor", "--seed", "2", "--chaos", "--run", str(folder)]
    env = {**os.environ, "RMR_COMPILED": str(compiled)}
    answer = subprocess.run([sys.executable, "-m", "rmr_sim.main", *words], env=env, capture_output=True, check=False)
    assert answer.returncode in (0, 1)
    return open_recording(folder)


TASKS = """
import json, pickle, sys
from pathlib import Path
from rmr_sim.lab_task import LabTask
from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import run_seed

file = Path(sys.argv[1])
if not file.exists():
    task = LabTask(load(Path("deploy/labs/corridor"), Options(robots=3, chaos=True)), run_seed)
    file.write_bytes(pickle.dumps(task))
print(json.dumps(pickle.loads(file.read_bytes())(1).row, sort_keys=True))
"""


@pytest.mark.timeout(550)
@pytest.mark.parametrize("first", ["compiled", "interpreted"])
def test_a_lab_goes_from_process_to_process_in_both_forms(folder, tmp_path, first):
    forms = [str(folder), ""] if first == "compiled" else ["", str(folder)]
    rows = {
        subprocess.run(
            [sys.executable, "-c", TASKS, str(tmp_path / "task")],
            env={**os.environ, "RMR_COMPILED": form},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for form in forms
    }
    assert len(rows) == 1
    assert json.loads(rows.pop())["finished"]

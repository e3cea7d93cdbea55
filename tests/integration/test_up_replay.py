"""Minds of real processes are replayed to equal outputs: under load, with faults, stopped, killed and started again."""

import json
import os
import signal
import subprocess
import sys

import pytest
from command_runner import invoke
from launched import CORRIDOR, LABS, eventually

from rmr.commands.replay_command import command
from rmr.mind.recorded_minds import minds
from rmr.record.recording import open_recording

BURN = "while True: pass"


@pytest.fixture
def started():
    """Processes that are ended with the test."""
    processes = []
    yield processes
    for process in processes:
        process.kill()
        process.wait()


def replayed(folder):
    answer = invoke(command, [str(folder), "--json"], name="rmr replay")
    assert answer.exit_code in (0, 1), answer.stderr
    return json.loads(answer.stdout)


def minds_of(folder):
    """Return how many minds the parts of a run have so far."""
    if not list(folder.glob("record/*.mcap")):
        return 0
    with open_recording(folder) as recording:
        return len(minds(recording))


@pytest.mark.slow
def test_minds_of_processes_are_equal_while_they_run_and_afterwards(up):
    run = up(LABS / "dash").running()
    eventually(lambda: minds_of(run.folder) == 3)
    found = replayed(run.folder)
    assert found["equal"], found
    assert run.wait() == 0, run.out + run.err
    found = replayed(run.folder)
    assert found["equal"], found
    assert [(each["robot"], each["epoch"], each["ended"]) for each in found["minds"]] == [
        (robot, 0, True) for robot in (1, 2, 3)
    ]
    assert all(each["inputs"] > 100 and each["outputs"] > 10 for each in found["minds"])


@pytest.mark.slow
def test_minds_of_loaded_stopped_and_killed_processes_are_equal(up, started):
    started += [subprocess.Popen([sys.executable, "-c", BURN]) for _ in range(3)]
    run = up(CORRIDOR, "--keep-going").running()
    eventually(lambda: minds_of(run.folder) == 6, 60)
    secret = ["--connect", run.endpoint, "--secret", str(run.folder / "secret")]
    fault = [sys.executable, "-P", "-m", "rmr_deploy.fault", "radio", "--loss", "0.4", "--for", "4s", *secret]
    subprocess.run(fault, check=True, capture_output=True)
    os.kill(run.pids["robot-3"], signal.SIGSTOP)
    os.kill(run.pids["robot-5"], signal.SIGKILL)
    eventually(lambda: "robot 5  died" in run.out, 60)
    os.kill(run.pids["robot-3"], signal.SIGCONT)
    again = [sys.executable, "-P", "-m", "rmr_agent.main", "--id", "5", *secret]
    again += ["--record", str(run.folder / "record" / "robots-5.mcap"), str(run.folder / "corridor.rbc")]
    started.append(subprocess.Popen(again, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
    run.wait(240)
    found = replayed(run.folder)
    assert found["equal"], found
    assert [(each["robot"], each["epoch"]) for each in found["minds"]] == [
        *((robot, 0) for robot in range(1, 6)),
        (5, 1),
        (6, 0),
    ]
    assert [each["ended"] for each in found["minds"]] == [True, True, True, True, False, True, True]

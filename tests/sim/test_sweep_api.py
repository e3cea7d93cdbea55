"""`rmr.sweep`: rows as of `rmr sim --seeds`, whoever runs the seeds; and a lab that travels to other processes."""

import gc
import json
import pickle
import shutil
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from threading import Event

import pytest
from test_command import LAB, tiny
from test_sweep import DONE, NEVER, swept

import rmr
from rmr.entry.workers import interrupted_later
from rmr_sim.lab_task import LabTask
from rmr_sim.run_setup import Options, load
from rmr_sim.seed_run import run_seed

pytestmark = [pytest.mark.medium, pytest.mark.real]

ACTING = """
type action wave(R: robot) -o done(R).
go(R).
go(R) -o wave(R).
"""
WAVE = """
from rmr import action

@action("wave")
async def wave(robot):
    await robot.sleep(0.25)
"""
EVENTS = """
from rmr_sim.event import Event

class Wrong(Event):
    def callback(self, simulation):
        raise ValueError("wrong")

def events(lab, seed):
    return [Wrong(0)] if seed == 2 else []
"""


def rows_of(run):
    return json.loads((run / "sweep.json").read_text())["rows"]


def backwards(run, seeds):
    return [run(seed) for seed in reversed(seeds)]


def travelling(run, seeds):
    """Return what comes of the seeds where nothing but the function has come to."""
    return map(pickle.loads(pickle.dumps(run)), seeds)


def in_processes(run, seeds):
    with interrupted_later(), get_context("spawn").Pool(2) as pool:
        return list(pool.imap_unordered(run, seeds))


def in_an_executor(run, seeds):
    with interrupted_later(), ProcessPoolExecutor(1, get_context("spawn")) as executor:
        return list(executor.map(run, seeds))


def in_threads(run, seeds):
    with ThreadPoolExecutor(3) as executor:
        return list(executor.map(run, seeds))


@pytest.mark.parametrize("share", [map, backwards, travelling, in_processes, in_an_executor, in_threads])
def test_rows_are_those_of_the_command_octet_for_octet(tmp_path, share):
    (tmp_path / "wave.py").write_text(WAVE)
    lab = LAB.replace("program: tiny.rmr", "program: tiny.rmr\nactions: wave.py").replace("2s", "9s")
    code, run = swept(tmp_path, ACTING, "--seeds", "1-4", "--jobs", "1", "--chaos", lab=lab)
    assert code == 0
    result = rmr.sweep(tmp_path, range(1, 5), map=share, chaos=True)
    assert json.dumps(result.rows, sort_keys=True) == json.dumps(rows_of(run), sort_keys=True)
    assert result.summary == json.loads((run / "sweep.json").read_text())["summary"]
    assert (result.lab, result.failing, result.warnings) == ("tiny", [], [])


def test_seeds_that_fail_are_named_and_seeds_may_come_in_any_order(tmp_path):
    result = rmr.sweep(tiny(tmp_path, NEVER), [7, 3])
    assert [row["seed"] for row in result.rows] == result.failing == [3, 7]


def test_threads_take_turns(tmp_path):
    busy = []

    def perform(loaded, seed):
        assert not busy
        busy.append(seed)
        Event().wait(0.01)
        busy.clear()
        return seed

    assert in_threads(LabTask(load(tiny(tmp_path, DONE), Options()), perform), range(9)) == list(range(9))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"seeds": []}, "seeds should be a list or range of different whole numbers from 0: there is none"),
        ({"seeds": [1, 1]}, "one is there twice"),
        ({"seeds": [1, -1]}, "-1 is none"),
        ({"seeds": [1, "2"]}, "'2' is none"),
        ({"seeds": [True]}, "True is none"),
        ({"seeds": "1-5"}, "whole numbers from 0, not '1-5'"),
        ({"seeds": 5}, "whole numbers from 0, not 5"),
        ({"map": 3}, "map should be a function such as the built-in map, or pool.imap_unordered, not 3"),
        ({"map": lambda run, seeds: None}, "map should return the rows that come of the seeds, not None"),
        ({"map": lambda run, seeds: [None]}, "map should return the rows that come of the seeds; None is none"),
        ({"map": lambda run, seeds: [run(9)]}, "map should return the rows that come of the seeds; {'seed': 9"),
        ({"map": lambda run, seeds: [run(seeds[0])] * 2}, "map returned two rows of seed 1"),
        ({"map": lambda run, seeds: map(run, seeds[1:])}, "map returned no row of 1 of 2 seeds, such as 1"),
        ({"actions": "nowhere.py"}, "nowhere.py"),
        ({"loss": 2}, "loss: a share from 0 up to 1"),
    ],
)
def test_an_argument_that_cannot_be_used_is_said(tmp_path, given, said):
    with pytest.raises(rmr.Error) as error:
        rmr.sweep(tiny(tmp_path, DONE), **({"seeds": [1, 2]} | given))
    assert said in str(error.value)


def test_what_goes_wrong_in_map_is_not_taken_for_a_file_of_the_lab(tmp_path):
    def share(run, seeds):
        raise ConnectionRefusedError("no cluster")

    with pytest.raises(ConnectionRefusedError):
        rmr.sweep(tiny(tmp_path, DONE), [1], map=share)


def test_a_task_has_lab_program_and_users_files_with_it(tmp_path):
    """The lab is gone where the task comes to; what it says of the user's file names that as it was."""
    tiny(tmp_path, ACTING)
    (tmp_path / "wave.py").write_text(WAVE)
    (tmp_path / "events.py").write_text(EVENTS)
    options = Options(actions=tmp_path / "wave.py", event_file=tmp_path / "events.py")
    loaded = load(tmp_path, options)
    here = [run_seed(loaded, seed) for seed in (1, 2)]
    assert str(tmp_path / "events.py") in here[1].row["error"]
    octets = pickle.dumps(LabTask(loaded, run_seed))
    assert len(octets) < 20_000
    shutil.rmtree(tmp_path)
    task = pickle.loads(octets)
    there = [task(seed) for seed in (1, 2)]
    assert [each.row for each in there] == [each.row for each in here]
    assert [each.report for each in there] == [each.report for each in here]
    rmr.sweep("corridor", [1], robots=1)  # another lab takes its place
    gc.collect()
    assert not [each for each in Path("/tmp").glob("rmr-lab-*/*/wave.py") if each.read_text() == WAVE]

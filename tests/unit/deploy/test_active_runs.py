"""Runs that are found without a daemon: by their folders, by the register, and by what lives of their processes."""

import json
import os
import signal
import subprocess
import sys

import pytest
from command_runner import invoke

from rmr.bus import secret
from rmr_deploy import active_runs as runs_module
from rmr_deploy.active_runs import (
    PROCESSES_FILE,
    REGISTER_VARIABLE,
    active_runs,
    past_runs,
    recorded_run,
    register,
    write_end,
    write_processes,
)
from rmr_deploy.fleet import command
from rmr_deploy.process_identity import lives, signal_process, start_mark
from rmr_world import run_report

OTHER_USER = os.getuid() + 1
LAB = {"name": "hall", "file": "lab.yaml", "robots": 2, "seed": 7, "roster": [1, 2]}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """Return a folder to work in, with a register of its own."""
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def idle():
    """Return a process that does nothing."""
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"]) as process:
        yield process
        process.kill()


def folder_of_run(parent, name="one"):
    folder = parent / name
    folder.mkdir(parents=True)
    return folder


def test_names_of_files_are_those_of_the_modules_that_write_them():
    assert runs_module.REPORT_FILE == run_report.REPORT_FILE
    assert runs_module.SECRET_FILE == secret.SECRET_FILE


def test_run_is_in_the_register_before_its_folder_tells_of_it(here, monkeypatch):
    folder = folder_of_run(here)
    seen = []
    write = runs_module._write

    def watched(path, record):
        write(path, record)
        seen.append(((folder / PROCESSES_FILE).exists(), [run.folder for run in active_runs()]))

    monkeypatch.setattr(runs_module, "_write", watched)
    write_processes(folder, "tcp/127.0.0.1:7", {"world": os.getpid()}, LAB)
    assert seen == [(False, [folder]), (True, [folder])]


def test_process_is_known_by_its_start(idle):
    mark = start_mark(idle.pid)
    assert mark is not None
    assert lives(idle.pid, mark)
    assert not lives(idle.pid, mark + "0")
    idle.kill()
    os.waitid(os.P_PID, idle.pid, os.WEXITED | os.WNOWAIT)
    assert not lives(idle.pid), "it has ended, though nobody has reaped it"


@pytest.mark.parametrize("pid", [None, "7", 0, -1, 1 << 40, True])
def test_what_is_no_id_is_no_process(pid):
    assert start_mark(pid) is None


def test_process_that_got_the_id_of_another_is_not_signalled(idle):
    assert not signal_process(idle.pid, "another boot-7", signal.SIGKILL)
    assert not signal_process(idle.pid, None, signal.SIGKILL)
    assert idle.poll() is None
    assert signal_process(idle.pid, start_mark(idle.pid), signal.SIGKILL)
    assert idle.wait(60) == -signal.SIGKILL


def test_run_in_any_folder_is_found_by_the_register_until_its_end(here):
    folder = folder_of_run(here / "elsewhere")
    write_processes(folder, "tcp/127.0.0.1:7", {"world": os.getpid()}, LAB)
    (run,) = active_runs()
    assert (run.folder, run.lab, run.roster, run.endpoint) == (folder, "hall", (1, 2), "tcp/127.0.0.1:7")
    assert run.launched
    assert [one.name for one in run.living] == ["world"]
    write_end(folder, 4)
    assert active_runs() == []
    assert recorded_run(folder).exit_code == 4


def test_run_whose_folder_was_removed_is_still_found(here):
    folder = folder_of_run(here)
    write_processes(folder, "tcp/127.0.0.1:7", {"world": os.getpid()}, LAB)
    (folder / PROCESSES_FILE).unlink()
    folder.rmdir()
    (run,) = active_runs()
    assert [one.pid for one in run.living] == [os.getpid()]
    write_end(folder, 0)
    assert active_runs() == []


def test_run_is_found_in_runs_where_the_register_is_lost(here):
    folder = folder_of_run(here / "runs")
    write_processes(folder, "tcp/127.0.0.1:7", {}, LAB)
    for path in register().iterdir():
        path.unlink()
    assert [run.folder for run in active_runs()] == [folder]


def test_entry_of_a_launcher_that_was_killed_is_removed(here, idle):
    folder = folder_of_run(here / "runs")
    write_processes(folder, "tcp/127.0.0.1:7", {"world": idle.pid}, LAB)
    for path in (folder / PROCESSES_FILE, next(register().iterdir())):
        record = json.loads(path.read_text())
        record["started"]["launcher"] = "another boot-7"
        path.write_text(json.dumps(record))
    (run,) = active_runs()
    assert not run.launched
    assert [one.name for one in run.living] == ["world"], "it is stranded"
    idle.kill()
    idle.wait()
    assert active_runs() == []
    assert list(register().iterdir()) == []
    assert [run.folder for run in past_runs()] == [folder]


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 5000, '{"launcher": "x", "processes": [1], "lab": 3}', "\0"])
def test_damaged_record_is_no_run(here, text):
    folder = folder_of_run(here / "runs")
    (folder / PROCESSES_FILE).write_text(text)
    (register() / "1.json").write_text(text)
    assert active_runs() == []
    assert recorded_run(folder).processes == []


def test_start_of_a_process_that_has_ended_is_kept(here, idle):
    folder = folder_of_run(here)
    write_processes(folder, "tcp/127.0.0.1:7", {"robot-1": idle.pid}, LAB)
    written = (folder / PROCESSES_FILE).stat().st_mtime_ns
    mark = recorded_run(folder).processes[0].mark
    idle.kill()
    idle.wait()
    write_processes(folder, "tcp/127.0.0.1:7", {"robot-1": idle.pid, "robot-1.1": os.getpid()}, LAB)
    run = recorded_run(folder)
    assert [one.mark for one in run.processes] == [mark, start_mark(os.getpid())]
    assert [one.name for one in run.living] == ["robot-1.1"]
    assert (folder / PROCESSES_FILE).stat().st_mtime_ns == written, "the age of the record is that of the run"


@pytest.mark.parametrize("whose", ["another user's", "writable by others"])
def test_a_record_that_another_user_can_have_written_names_no_run_and_ends_no_process(here, idle, monkeypatch, whose):
    folder = folder_of_run(here / "runs")
    write_processes(folder, "tcp/127.0.0.1:7", {"world": idle.pid}, LAB)
    next(register().iterdir()).unlink()
    assert [run.folder for run in active_runs()] == [folder]
    if whose == "writable by others":
        (folder / PROCESSES_FILE).chmod(0o666)
    else:
        monkeypatch.setattr(os, "getuid", lambda: OTHER_USER)
    assert active_runs() == []
    for words, why in ((["down"], "no lab runs on this machine"), (["down", "--run", "runs/one"], "another user's")):
        answer = invoke(command(), words, name="rmr")
        assert answer.exit_code == 2
        assert why in answer.stderr
    assert idle.poll() is None


def test_a_record_is_its_users_own_whatever_the_umask(here):
    before = os.umask(0)
    try:
        folder = folder_of_run(here / "runs")
        write_processes(folder, "tcp/127.0.0.1:7", {}, LAB)
    finally:
        os.umask(before)
    assert [run.folder for run in active_runs()] == [folder]


def test_process_of_another_user_is_not_signalled_by_root_either(idle, monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: OTHER_USER)
    assert not signal_process(idle.pid, start_mark(idle.pid), signal.SIGKILL)
    assert idle.poll() is None


def test_register_is_the_same_for_shells_with_other_variables(here, monkeypatch):
    monkeypatch.delenv(REGISTER_VARIABLE)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.delenv("TMPDIR", raising=False)
    usual = runs_module.register_places()
    for name in ("XDG_RUNTIME_DIR", "TMPDIR"):
        monkeypatch.setenv(name, str(here))
    places = runs_module.register_places()
    assert [place for place in places if place in usual] == usual
    assert places[0] == usual[0]
    assert set(places) - set(usual) == {here / "rmr", here / f"rmr-{os.getuid()}"}


def test_run_is_found_in_every_place_of_the_register(here, monkeypatch):
    places = [here / "first", here / "second"]
    monkeypatch.setattr(runs_module, "register_places", lambda: places)
    places[0].touch()
    assert register() == places[1], "the first is no folder"
    folder = folder_of_run(here / "elsewhere")
    assert write_processes(folder, "tcp/127.0.0.1:7", {}, LAB) == ""
    places[0].unlink()
    assert register() == places[0]
    assert [run.folder for run in active_runs()] == [folder]
    write_end(folder, 0)
    assert list(places[1].iterdir()) == []


def test_register_that_others_can_write_is_not_used(here):
    register().chmod(0o777)
    assert register() is None
    folder = folder_of_run(here / "runs")
    assert "no folder for it that only you can write" in write_processes(folder, "tcp/127.0.0.1:7", {}, LAB)
    assert [run.folder for run in active_runs()] == [folder]

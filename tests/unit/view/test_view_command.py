"""`rmr view`: what it is told to show, and what it says where that cannot be."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from command_runner import invoke

from rmr.record.record_writer import RecordWriter
from rmr.record.run_about import about_run
from rmr_deploy.active_runs import REGISTER_VARIABLE, write_processes
from rmr_deploy.run_choice import FleetError
from rmr_sim.main import command as sim
from rmr_view.page_server import PageServerError, bind
from rmr_view.view import command
from rmr_view.view_command import find_run


def view(*words):
    answer = invoke(command(), [*map(str, words)], name="rmr view")
    assert "Traceback" not in answer.stderr
    return answer.exit_code, answer.stderr


def test_no_run_is_told_with_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    code, said = view()
    assert (code, said) == (
        1,
        "rmr view: there is no run in ./runs, and none is under way; start one with rmr up LAB or rmr sim LAB, or "
        "name a recording: rmr view RUN\n",
    )


def test_newest_run_is_shown_and_one_that_goes_on_before_those_that_are_over(tmp_path, monkeypatch):
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    for age, name in enumerate(("second", "first")):
        file = tmp_path / "runs" / name / "run.mcap"
        file.parent.mkdir(parents=True)
        RecordWriter(file, about_run("corridor", "simulated", 7, (1,), "sim")).close()
        os.utime(file, ns=(0, 10 - age))
    assert find_run(None) == Path("runs/second")
    assert find_run(None, "corridor") == Path("runs/second"), "by what the recording says"
    with pytest.raises(FleetError, match="no run of lab hall in"):
        find_run(None, "hall")
    going_on = tmp_path / "elsewhere"
    going_on.mkdir()
    write_processes(going_on, "tcp/127.0.0.1:7", {}, {"name": "hall"})
    assert find_run(None) == going_on
    assert find_run(None, "hall") == going_on


def test_run_is_named_once():
    code, said = view("here", "--run", "there")
    assert code == 2
    assert "say one of RUN, --run and --lab" in said


def test_path_that_is_not_there_is_wrong_usage(tmp_path):
    assert view(tmp_path / "nix") == (2, f"rmr view: there is no {tmp_path / 'nix'}\n")


def test_what_is_no_recording_is_invalid(tmp_path):
    code, said = view(tmp_path)
    assert (code, said.count("\n")) == (3, 1)
    assert said.startswith(f"rmr view: {tmp_path}: no recording of a run")
    file = tmp_path / "a.mcap"
    file.write_bytes(b"hello, this is text")
    assert view(file) == (3, f"rmr view: {file}: no MCAP file\n")


def test_control_of_a_run_that_is_over_is_wrong_usage(tmp_path):
    code, said = view(tmp_path, "--control")
    assert (code, said) == (2, f"rmr view: the run in {tmp_path} is over: --control is for a run that goes on\n")


def test_port_in_use_is_told_with_its_number_and_what_to_do():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PageServerError, match=f"port {port} is in use by another program: choose another one"):
            bind(port)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--port", "80"], "--port, --speed and --control are about the page: ask for it with --view"),
        (["--view", "--seeds", "1-3"], "--view shows one run: leave out --seeds and --resume"),
        (["--view", "--speed", "0"], "a number from 0.1 to 100"),
    ],
)
def test_options_of_rmr_sim_that_do_not_go_together_are_wrong_usage(words, said):
    answer = invoke(sim(), ["corridor", *words], name="rmr sim")
    assert answer.exit_code == 2
    assert said in answer.stderr


@pytest.mark.medium
def test_ctrl_c_ends_the_page_of_a_recording_in_order(tmp_path):
    folder = tmp_path / "run"
    assert invoke(sim(), ["corridor", "--robots", "1", "--run", str(folder)], name="rmr sim").exit_code == 0
    words = [sys.executable, "-P", "-m", "rmr_view.view", str(folder)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as page:
        assert page.stdout is not None
        assert page.stdout.readline().startswith("the page: http://127.0.0.1:")
        page.send_signal(2)
        assert page.wait(20) == 0
        assert page.stderr is not None
        assert page.stderr.read() == ""


@pytest.mark.parametrize("words", [["--speed", "2"], ["--foxglove", "--control"], ["--foxglove", "--leave", "3"]])
def test_options_of_page_and_foxglove_that_do_not_go_together_are_wrong_usage(words):
    assert view(*words)[0] == 2


def test_foxglove_of_what_is_no_recording_is_invalid(tmp_path):
    code, said = view(tmp_path, "--foxglove")
    assert (code, said.count("\n")) == (3, 1)

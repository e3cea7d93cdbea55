"""A robot that `rmr stop` has stopped: what the page of the run says, that of its recording, the replay and `why`."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys

import pytest
from shown_run import LABS, ShownRecording, until

from rmr.record.recording import open_recording
from rmr_deploy.run_requests import ask_launcher
from rmr_view.run_data import run_data

RMR = [sys.executable, "-P", "-c", "from rmr.cli import main; main()"]
WITHIN_S = 120.0
"""Wall time that a loaded machine may take for what takes some 25 s."""


def state_of(page, robot):
    """Return the state of `robot` in the list of all robots."""
    rows = page.page.locator("#panel tbody tr").all_inner_texts()
    return next((row for row in rows if row.split()[0] == str(robot)), "")


@pytest.fixture
def up(tmp_path):
    """Start `rmr up` with a page, on the corridor with two robots, of which the first one passes last, and too late.

    It waits for its turn for some 8 s: in that time a page opens on a loaded machine, too.
    """
    shutil.copytree(LABS / "corridor", tmp_path / "lab")
    lab = tmp_path / "lab" / "lab.yaml"
    lab.write_text(lab.read_text().replace("due(@1, 32)", "due(@1, 14)").replace("due(@2, 26)", "due(@2, 12)"))
    output = tmp_path / "output"
    words = [*RMR, "up", "lab", "--robots", "2", "--run", str(tmp_path / "run"), "--view"]
    environment = os.environ | {"RMR_REGISTER": str(tmp_path / "register")}
    with output.open("w") as sink:
        process = subprocess.Popen(words, stdout=sink, stderr=sink, cwd=tmp_path, env=environment)
    yield process, output
    process.kill()
    process.wait()


def test_stopped_robot_is_stopped_on_the_page_in_the_replay_and_to_why(up, visit, tmp_path, monkeypatch):
    process, output = up
    monkeypatch.chdir(tmp_path)
    address = until(lambda: re.search(r"http://\S+", output.read_text()), "an address", WITHIN_S).group()
    live = visit(address)
    until(lambda: " robots ready after " in output.read_text(), "a run", WITHIN_S)
    until(lambda: "asks" in state_of(live, 1) or "waits" in state_of(live, 1), "robot 1 asks for its turn", WITHIN_S)
    ask_launcher(tmp_path / "run", {"do": "stop", "robot": 1})
    until(lambda: "stopped" in state_of(live, 1), "the page of the run says so", WITHIN_S)
    until(lambda: "late" in state_of(live, 1), "its deadline has passed", WITHIN_S)
    live.close()
    process.send_signal(signal.SIGINT)
    process.wait(WITHIN_S)

    report = json.loads((tmp_path / "run" / "report.json").read_text())
    assert (report["stopped"], report["faults"]) == ([1], []), "to stop is no fault"
    shown = ShownRecording(tmp_path / "run")
    try:
        page = visit(shown.address)
        page.pause()
        page.seek(shown.source.clock.end_s)
        until(lambda: "stopped" in state_of(page, 1), "the page of the recording says so")
        assert "stopped" not in state_of(page, 2)
        page.close()
    finally:
        shown.close()
    with open_recording(tmp_path / "run") as recording:
        stop = run_data(recording).timeline["lanes"][0]["intervals"][-1]
    assert stop["kind"] == "stopped", "pictures of the run show it, too"
    said = verb("replay", "run")
    assert f"  it was stopped at {stop['begin_s']:.3f} s, as somebody asked for\n" in said
    assert said.count("was stopped") == 1
    told = json.loads(verb("why", "run", "--missed", "crossing@1", "--json"))
    assert "stopped" in [owner["owner"] for owner in told["delays"][0]["owners"]]


def verb(*words):
    answer = subprocess.run([*RMR, *words], capture_output=True, text=True, check=False, timeout=WITHIN_S)
    return answer.stdout

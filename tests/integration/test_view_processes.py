"""The page of runs that go on: `rmr up --view` and `rmr sim --view`, as a person starts them."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from launched import CORRIDOR, Launched, eventually, runs
from served_page import Browser, heard

pytestmark = pytest.mark.slow


def opened(said: str) -> tuple[Browser, str]:
    """Return the browser and the token of the address that was printed."""
    address = next(line for line in said.splitlines() if "the page: " in line).split("the page: ")[1].strip()
    where, _, token = address.partition("/#token=")
    return Browser(int(where.rstrip("/").rsplit(":", 1)[1])), token


def page_pids(folder: Path) -> list[int]:
    """Return the processes of the page of the run in `folder`."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"rmr_view.view" in words and str(folder).encode() in words:
            found.append(int(path.parent.name))
    return found


@pytest.fixture
def launched(tmp_path):
    started: list[Launched] = []

    def launch(*options: str) -> Launched:
        started.append(Launched(CORRIDOR, tmp_path, *options))
        return started[-1]

    yield launch
    for each in started:
        each.clean_up()
        for pid in page_pids(each.folder):
            os.kill(pid, signal.SIGKILL)


def test_page_of_rmr_up_starts_when_it_is_opened_takes_faults_and_outlives_the_run(launched):
    run = launched("--view", "--control")
    run.running()
    assert page_pids(run.folder) == []  # nobody has looked: it costs nothing
    browser, token = opened(run.out)
    about = browser.get("/api/run")
    assert (about["lab"], about["live"], about["control"], about["steer"]) == ("corridor", True, True, False)
    assert len(page_pids(run.folder)) == 1
    with browser.follow() as following:
        first = heard(following, "poses")["t"]
        while heard(following, "poses")["t"] <= first:
            pass
        assert browser.order("wrong", do="kill", robot=3)[0] == 403
        assert browser.order(token, do="restart", robot=3) == (
            409, {"error": "robot 3 lives: kill it before it is restarted"}
        )  # fmt: skip
        assert browser.order(token, do="kill", robot=3) == (200, {"done": "kill"})
        assert browser.order(token, do="loss", loss=0.2, for_s=1) == (200, {"done": "loss"})
        eventually(lambda: "was killed by SIGKILL" in run.out)
        assert browser.order(token, do="restart", robot=3) == (200, {"done": "restart"})
        lane = eventually(lambda: dead_and_back(browser, 3), 40)
        assert lane[0]["begin_s"] < lane[0]["end_s"]
        assert heard(following, "trace", 40)["entries"]
        state = eventually(lambda: robot_of_epoch(browser, 3, 1), 40)
        assert state["facts"]
        why = browser.get("/api/why?robot=3&fact=waiting(@3)")
        assert why["answers"][0]["cause"] == "rule"
        run.interrupt()
        report = heard(following, "end", 60)["report"]
    assert run.wait() in (1, 2)
    assert [fault for fault in report["faults"] if "kill" in fault or "restart" in fault] == [
        {"at": pytest.approx(lane[0]["begin_s"], abs=5), "kill": 3},
        {"at": pytest.approx(lane[0]["end_s"], abs=5), "restart": 3},
    ]
    after = browser.get("/api/run")
    assert (after["live"], after["control"]) == (False, False)
    assert browser.get("/api/poses")["t"]
    assert browser.order(token, do="kill", robot=3)[0] == 403
    assert run.left() == []


def test_page_of_a_live_run_without_a_recording_says_what_is_missing(launched):
    run = launched("--view", "--no-record", "--robots", "2")
    run.running()
    browser, _ = opened(run.out)
    problems = eventually(lambda: browser.get("/api/run")["problems"])
    assert browser.get("/api/run")["live"] is True
    assert problems == [
        "this run is not recorded (--no-record): only poses are shown; trace, radio, logs, facts and explanations are "
        "missing"
    ]
    run.interrupt()
    run.wait()


def dead_and_back(browser, robot):
    """Return the intervals in which `robot` was dead, once it lives again."""
    timeline = browser.get("/api/timeline")
    lane = next(lane for lane in timeline["lanes"] if lane["robot"] == robot)
    dead = [one for one in lane["intervals"] if one["kind"] == "dead"]
    later = [one for one in lane["intervals"] if dead and one["begin_s"] > dead[0]["end_s"]]
    named = [fault for fault in timeline["faults"] if fault.get("kill") == robot]
    return dead if later and named else None


def robot_of_epoch(browser, robot, epoch):
    status, state, _ = browser.fetch(f"/api/robot/{robot}")
    return state if status == 200 and state.get("epoch") == epoch else None


def test_no_view_and_output_that_is_no_terminal_print_no_address(launched):
    run = launched("--robots", "1", "--json")
    assert run.wait() == 0
    assert "the page" not in run.out + run.err
    json.loads(run.out)


def test_simulated_run_is_paused_stepped_sped_up_and_disturbed_from_the_page(tmp_path):
    words = [sys.executable, "-P", "-m", "rmr_sim.main", "corridor", "--view", "--control", "--json"]
    words += ["--run", str(tmp_path / "run"), "--speed", "0.5"]
    err = tmp_path / "stderr"
    with err.open("w") as sink, subprocess.Popen(words, stdout=subprocess.PIPE, stderr=sink, text=True) as process:
        try:
            eventually(lambda: "the page: " in err.read_text())
            browser, token = opened(err.read_text())
            with browser.follow() as following:
                eventually(lambda: browser.get("/api/run")["end_s"] > 0.2)  # the first tick takes long
                assert browser.order(token, do="pause")[0] == 200
                time.sleep(0.3)
                t = settled(browser)
                assert browser.order(token, do="step")[0] == 200
                assert settled(browser) == pytest.approx(t + 1 / 60, abs=0.002)
                assert browser.order(token, do="kill", robot=3)[0] == 200
                assert browser.order(token, do="partition", groups=[[1, 2], [4, 5]], for_s=1)[0] == 200
                assert browser.order(token, do="restart", robot=1)[0] == 409
                assert browser.get("/api/robot/3")["alive"] is False
                assert browser.order(token, do="restart", robot=3)[0] == 200
                assert browser.order(token, do="step")[0] == 200
                faults = eventually(lambda: (told := browser.get("/api/timeline")["faults"])[1:] and told)
                assert [next(iter(fault.keys() - {"at", "from", "to"})) for fault in faults] == [
                    "kill", "partition", "restart"
                ]  # fmt: skip
                assert browser.order(token, do="speed", speed=100)[0] == 200
                assert browser.order(token, do="resume")[0] == 200
                report = heard(following, "end", 60)["report"]
            assert report["mode"] == "simulated"
            past = browser.get("/api/robot/1?t=3")
            assert past["facts"]
            assert browser.get("/api/why?robot=1&fact=waiting(@1)")["answers"]
            process.send_signal(signal.SIGINT)
            assert process.stdout is not None
            assert json.loads(process.stdout.read()) == report
            assert process.wait(20) == 0
        finally:
            process.kill()
    assert "Traceback" not in err.read_text()
    assert not runs(process.pid)


def settled(browser):
    """Return the instant at which lab time stands."""
    before = -1.0
    while before != (now := browser.get("/api/run")["end_s"]):
        before = now
        time.sleep(0.2)
    return now

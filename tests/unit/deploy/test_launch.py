"""A run seen from its launcher, with stand-ins for world and robots: every way in which it can end."""

import asyncio
import json
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import rmr_deploy.launch as launching
from rmr.bus.secret import make_secret
from rmr_deploy.lab_run import exit_code, make_report
from rmr_deploy.launch import LabRun
from rmr_deploy.preparation import RunPlan
from rmr_deploy.restarts import RestartPolicy
from rmr_deploy.run_options import RunOptions
from rmr_world.lab_file import load_lab
from rmr_world.lab_program import LoadedProgram

pytestmark = pytest.mark.slow

STANDIN = Path(__file__).with_name("standin.py")

LAB = """
lab: standin
program: standin.rmr
duration: 30s
finish: at(R, exit)
arena: {size: [3.0, 3.0]}
areas: {exit: {slots: [[2.0, 2.0], [2.0, 1.5]]}}
robots: [{id: 1, pose: [0.5, 0.5, 0deg]}, {id: 2, pose: [1.0, 0.5, 0deg]}]
"""


class Notes:
    """A screen that keeps what it is shown, and makes the file `ready` when all robots are."""

    def __init__(self, ready: Path):
        self.said, self.lines, self.closed = [], [], False
        self._ready = ready

    def show(self, lab_s, lines):
        self.lines.append((lab_s, list(lines)))

    def say(self, message):
        self.said.append(message)
        if " robots ready after " in message:
            self._ready.touch()

    def close(self):
        self.closed = True


@pytest.fixture
def start(tmp_path, monkeypatch):
    """Return a function that makes the run of two stand-ins with the given behaviours."""
    monkeypatch.setenv("STANDIN_LAB", "standin")
    monkeypatch.setattr(
        launching,
        "world_command",
        lambda plan, endpoint: [
            *(sys.executable, str(STANDIN), "world", "--listen", endpoint, "--secret", str(plan.secret))
        ],
    )
    monkeypatch.setattr(
        launching,
        "agent_command",
        lambda plan, crew, endpoint: [
            *(sys.executable, str(STANDIN), "robot", "--id", str(crew[0]), "--connect", endpoint, "--lab", "standin"),
            *("--secret", str(plan.secret)),
        ],
    )
    ready = tmp_path / "ready"
    monkeypatch.setenv("STANDIN_READY", str(ready))
    (tmp_path / "lab.yaml").write_text(LAB)
    (tmp_path / "run" / "logs").mkdir(parents=True)

    def make(first: str, second: str, **options) -> LabRun:
        monkeypatch.setenv("STANDIN_1", first)
        monkeypatch.setenv("STANDIN_2", second)
        loaded = LoadedProgram(None, b"", 0, "")
        plan = RunPlan(RunOptions(lab=tmp_path, **options), load_lab(tmp_path), loaded, tmp_path / "run")
        plan.secret.unlink(missing_ok=True)
        make_secret(plan.secret)
        return LabRun(plan, Notes(ready))

    return make


def end(run: LabRun):
    """Run to the end; return outcome and report, and check that nothing is left behind."""
    outcome = asyncio.run(run.go())
    pids = json.loads((run.plan.folder / "processes.json").read_text())["processes"]
    assert [name for name, pid in pids.items() if Path(f"/proc/{pid}").exists()] == []
    assert run._screen.closed
    return outcome, make_report(run.plan, outcome, run.monitor)


def at(moment_s: float, call, *arguments):
    """Call later, from within the run's own loop."""
    asyncio.get_running_loop().call_later(moment_s, call, *arguments)


def interrupt_when(run: LabRun, claim, number=signal.SIGINT):
    """Send this process a signal once, as soon as `claim` holds while the run is shown."""
    shown = run._screen.show

    def show(lab_s, lines):
        shown(lab_s, lines)
        if claim(lines) and not run.outcome.interrupted:
            os.kill(os.getpid(), number)

    run._screen.show = show


def working(lines):
    return any(line.state == "running" for line in lines)


def test_a_run_is_over_when_every_robot_holds_the_finish_fact(start):
    outcome, report = end(start("finish", "finish"))
    assert outcome.finished
    assert outcome.reason == "every robot holds the finish fact"
    assert exit_code(outcome, report, strict=True) == 0
    assert report["time_s"] == 0.3
    assert report["deadlines"]["met"] == 2
    assert report["robots"]["2"]["distance_m"] == 1.7
    assert report["min_gap_m"] == 0.02
    assert report["died"] == {}


def test_schedule_reported_by_all_robots_stands_in_the_report_once(start):
    _, report = end(start("finish", "finish"))
    assert report["schedule"] == [{"event": "crossing(exit)", "leader": 1, "term": 1, "order": [1, 2], "formed_s": 0.1}]


def test_the_robots_are_shown_from_start_to_finish(start):
    run = start("finish", "finish")
    end(run)
    states = [[line.state for line in lines] for _, lines in run._screen.lines]
    assert states[0] == ["starting", "starting"]
    assert states[-1] == ["finished", "finished"]
    assert any("2 robots ready after" in message for message in run._screen.said)


def test_plain_output_of_processes_that_left_in_order_is_not_kept(start):
    run = start("finish", "finish")
    end(run)
    assert list(run.plan.logs.glob("*.out")) == []


def test_robot_that_refuses_its_program_ends_the_run_with_its_message_and_exit_code_3(start):
    run = start("finish", "refuse")
    outcome, report = end(run)
    assert exit_code(outcome, report, strict=False) == 3
    assert outcome.died == {"robot-2": 3}
    assert "no handler for action blink" in "\n".join(run._screen.said)


def test_a_robot_that_dies_ends_the_run_and_leaves_its_last_known_part(start):
    run = start("roam", "crash")
    outcome, report = end(run)
    assert exit_code(outcome, report, strict=False) == 1
    assert not outcome.finished
    assert report["died"] == {"robot-2": 1}
    assert report["reason"] == "robot-2 died"
    assert report["schedule"] != []
    said = "\n".join(run._screen.said)
    assert "robot-2 (pid " in said
    assert "ended with exit code 1; its last words:\n    robot: the wheels came off" in said
    assert run._screen.lines[-1][1][1].state == "died"


def test_with_keep_going_the_others_finish_and_the_exit_code_is_1_all_the_same(start):
    outcome, report = end(start("finish", "crash", keep_going=True))
    assert outcome.reason == "every robot that lives holds the finish fact; robot 2 died"
    assert not report["finished"]
    assert report["robots"]["1"]["finish_s"] == 0.3
    assert exit_code(outcome, report, strict=False) == 1


def lives(outcome):
    return [next(key for key in ("stop", "die", "restart") if key in entry) for entry in outcome.lives]


def test_ends_of_robots_that_no_fault_tells_are_kept_for_the_recording(start):
    outcome, report = end(start("crash", "roam", restart=RestartPolicy(1)))
    assert lives(outcome) == ["die", "restart", "die"]
    assert {entry[word] for entry, word in zip(outcome.lives, lives(outcome), strict=True)} == {1}
    assert report["faults"] == []


def test_with_a_quorum_of_the_living_the_run_finishes_without_a_dead_robot(start):
    run = start("finish", "crash")
    run.plan = replace(run.plan, lab=replace(run.plan.lab, quorum="living"))
    outcome, report = end(run)
    assert outcome.reason == "every robot that lives holds the finish fact; robot 2 died"
    assert report["finished"]
    assert report["dead"] == [2]
    assert report["died"] == {"robot-2": 1}
    assert report["time_s"] == 0.3
    assert exit_code(outcome, report, strict=True) == 0


def test_with_a_number_as_quorum_the_run_finishes_when_so_many_robots_have(start):
    run = start("finish", "roam")
    run.plan = replace(run.plan, lab=replace(run.plan.lab, quorum=1))
    outcome, report = end(run)
    assert outcome.reason == "1 robot holds the finish fact"
    assert report["finished"]
    assert report["dead"] == []
    assert report["time_s"] == 0.3
    assert exit_code(outcome, report, strict=True) == 0


def test_quorum_that_the_living_cannot_reach_ends_the_run_unfinished(start):
    run = start("finish", "crash")
    run.plan = replace(run.plan, lab=replace(run.plan.lab, quorum=2))
    outcome, report = end(run)
    assert outcome.reason == "1 robot holds the finish fact, 2 should; robot 2 died"
    assert not report["finished"]
    assert exit_code(outcome, report, strict=False) == 1


def test_wall_time_is_bounded_by_the_timeout(start):
    began = time.monotonic()
    outcome, report = end(start("roam", "roam", timeout_s=1.5))
    assert 1.5 < time.monotonic() - began < 60
    assert outcome.reason == "not finished within 1.5 s of wall time"
    assert exit_code(outcome, report, strict=False) == 1


def test_a_robot_that_never_becomes_ready_is_named(start, monkeypatch):
    run = start("roam", "mute")
    shown = run._screen.show

    def show(lab_s, lines):
        shown(lab_s, lines)
        if lines[0].state == "running":  # the limit passes once the other robot is ready, on a slow machine, too
            monkeypatch.setattr(launching, "READY_S_MAX", 0.0)

    run._screen.show = show
    outcome, _ = end(run)
    assert outcome.reason == "not ready within 0 s: robot 2"


def test_events_that_cannot_be_written_are_told_at_the_end(start):
    run = start("finish", "finish")
    path = run.plan.folder / "events.jsonl"
    path.mkdir()
    outcome, _ = end(run)
    assert outcome.finished
    assert run._screen.said[-1] == f"the log of events is cut short: {path}: Is a directory"


def test_a_run_ends_at_the_labs_duration(start):
    run = start("roam", "roam")
    run.plan = replace(run.plan, lab=replace(run.plan.lab, duration=500_000_000))
    outcome, report = end(run)
    assert outcome.reason == "the lab's duration of 0.5 s has passed"
    assert not report["finished"]
    assert report["time_s"] >= 0.5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_stops_the_run_in_order_and_the_report_holds_the_final_statuses(start, number):
    run = start("roam", "roam")
    interrupt_when(run, working, number)
    outcome, report = end(run)
    assert outcome.reason == "interrupted"
    assert run.monitor.final(1)
    assert run.monitor.final(2)
    assert run.monitor.truth.final
    assert exit_code(outcome, report, strict=False) == 1


def test_signal_before_any_robot_is_ready_stops_the_run(start):
    run = start("mute", "mute")
    interrupt_when(run, lambda lines: True)
    outcome, report = end(run)
    assert outcome.reason == "interrupted"
    assert report["robots"]["1"]["finish_s"] is None


def test_a_process_that_does_not_leave_is_killed_and_named(start, monkeypatch):
    monkeypatch.setattr(launching, "FINAL_S_MAX", 0.2)
    monkeypatch.setattr(launching, "LEAVE_S_MAX", 0.1)
    monkeypatch.setattr("rmr_deploy.process_group.TERM_PATIENCE_S", 0.2)
    run = start("roam", "deaf")
    interrupt_when(run, working)
    end(run)
    assert "robot-2 did not leave at SIGTERM and got SIGKILL" in run._screen.said


def test_a_second_signal_ends_everything_at_once(start, monkeypatch):
    for patience in ("launch.FINAL_S_MAX", "launch.LEAVE_S_MAX", "process_group.TERM_PATIENCE_S"):
        monkeypatch.setattr(f"rmr_deploy.{patience}", 100.0)
    run = start("deaf", "deaf")
    shown, moments = run._screen.show, []

    def show(lab_s, lines):
        shown(lab_s, lines)
        if working(lines) and not moments:
            moments.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGINT)
            at(0.1, os.kill, os.getpid(), signal.SIGINT)

    run._screen.show = show
    outcome, report = end(run)
    assert time.monotonic() - moments[0] < 50.0
    assert outcome.reason == "interrupted"
    assert report["robots"]["1"]["finish_s"] is None

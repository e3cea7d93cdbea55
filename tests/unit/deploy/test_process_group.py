"""The process group with small real processes: no process that it starts outlives it."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rmr.bus.process import LIFELINE
from rmr_deploy.process_group import Child, ProcessGroup

OBEDIENT = "import time; print('up', flush=True); time.sleep(60)"
STUBBORN = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); time.sleep(60)"
ORDERLY = OBEDIENT.replace("import time;", "import signal, time; signal.signal(signal.SIGTERM, lambda *_: exit(0));")
HANGING_ON_THE_LIFELINE = f"import os; print('up', flush=True); os.read(int(os.environ['{LIFELINE}']), 1)"


@pytest.fixture
def group():
    group = ProcessGroup()
    yield group
    group.kill()


def start(group: ProcessGroup, folder: Path, code: str, name: str = "robot-1") -> Child:
    child = group.start(name, [sys.executable, "-S", "-c", code], folder / f"{name}.jsonl")
    eventually(lambda: b"up" in child.output.read_bytes() or child.exit_code() is not None)
    return child


def eventually(claim, within_s: float = 10.0) -> None:
    end = time.monotonic() + within_s
    while not claim():
        assert time.monotonic() < end, "it did not come true in time"
        time.sleep(0.005)


def runs(pid: int) -> bool:
    """Whether `pid` is a process that has not ended; one that nobody has reaped yet has ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_output_of_a_process_goes_to_its_log(group, tmp_path):
    child = start(group, tmp_path, "import sys; print('up'); print('to stderr', file=sys.stderr)")
    eventually(lambda: child.exit_code() == 0)
    assert child.output.read_text().split("\n") == ["up", "to stderr", ""]


def test_a_process_leads_a_session_of_its_own_so_that_ctrl_c_does_not_reach_it(group, tmp_path):
    child = start(group, tmp_path, OBEDIENT)
    assert os.getsid(child.pid) == child.pid != os.getsid(0)


def test_ended_processes_are_returned_with_their_exit_codes(group, tmp_path):
    start(group, tmp_path, OBEDIENT, "world")
    start(group, tmp_path, "raise SystemExit(3)", "robot-1")
    eventually(group.dead)
    assert [(child.name, child.exit_code()) for child in group.dead()] == [("robot-1", 3)]


@pytest.mark.parametrize("how", ["leaves in order", "is killed"])
def test_child_process_of_a_robot_is_killed_with_it(group, tmp_path, how):
    """What a user's action starts is in the process group of its robot, and has no launcher of its own."""
    told = tmp_path / "pid"
    code = f"""
import pathlib, subprocess, sys, time
print("up", flush=True)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(100)"])
pathlib.Path({str(told)!r}).write_text(str(child.pid))
time.sleep(100 if {how == "is killed"} else 0)
"""
    robot = start(group, tmp_path, code)
    eventually(lambda: told.exists() and told.read_text())
    grandchild = int(told.read_text())
    if how == "is killed":
        group.kill()
    eventually(lambda: robot.exit_code() is not None)
    eventually(lambda: not runs(grandchild))


def test_an_obedient_process_leaves_at_sigterm(group, tmp_path):
    child = start(group, tmp_path, OBEDIENT)
    assert asyncio.run(group.stop([child])) == []
    assert child.exit_code() == -signal.SIGTERM


def test_a_process_that_ignores_sigterm_is_killed_after_a_bounded_time(group, tmp_path, monkeypatch):
    monkeypatch.setattr("rmr_deploy.process_group.TERM_PATIENCE_S", 0.1)
    child = start(group, tmp_path, STUBBORN)
    assert asyncio.run(group.stop([child])) == [child]
    assert child.exit_code() == -signal.SIGKILL


def test_a_process_that_is_stopped_is_killed_as_well(group, tmp_path, monkeypatch):
    monkeypatch.setattr("rmr_deploy.process_group.TERM_PATIENCE_S", 0.1)
    child = start(group, tmp_path, ORDERLY)
    os.kill(child.pid, signal.SIGSTOP)
    assert asyncio.run(group.stop([child])) == [child]
    assert not runs(child.pid)


def test_killing_ends_everything_at_once_and_may_be_repeated(group, tmp_path):
    children = [start(group, tmp_path, STUBBORN, name) for name in ("world", "robot-1", "robot-2")]
    group.kill()
    group.kill()
    assert [child.exit_code() for child in children] == [-signal.SIGKILL] * 3


def test_a_command_that_does_not_exist_is_an_error_and_leaves_no_child(group, tmp_path):
    with pytest.raises(FileNotFoundError):
        group.start("world", [str(tmp_path / "missing")], tmp_path / "world.jsonl")
    assert group.children == []


@pytest.mark.medium
def test_the_lifeline_reads_end_of_file_when_the_launcher_lets_go(group, tmp_path, monkeypatch):
    monkeypatch.setattr("rmr_deploy.process_group._signal", lambda children, number: None)
    child = start(group, tmp_path, HANGING_ON_THE_LIFELINE)
    group.kill()
    eventually(lambda: child.exit_code() == 0)


LAUNCHER = """
import pathlib, sys, time
from rmr_deploy.process_group import ProcessGroup
group = ProcessGroup()
for number, code in enumerate(sys.argv[2:]):
    child = group.start(f"child-{number}", [sys.executable, "-S", "-c", code], pathlib.Path(sys.argv[1]) / f"{number}")
    print(child.pid, flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="PR_SET_PDEATHSIG and /proc are Linux's")
def test_a_launcher_that_is_killed_takes_every_process_with_it_even_a_stopped_one(tmp_path):
    codes = [OBEDIENT, STUBBORN, "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"]
    command = [sys.executable, "-c", LAUNCHER, str(tmp_path), *codes]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as launcher:
        pids = [int(launcher.stdout.readline()) for _ in codes]
        eventually(lambda: all(runs(pid) for pid in pids))
        launcher.kill()
    eventually(lambda: not any(runs(pid) for pid in pids))


@pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")
def test_a_child_holds_no_write_end_of_the_lifeline(group, tmp_path):
    child = start(group, tmp_path, OBEDIENT)
    pipe = os.readlink(f"/proc/self/fd/{group._write}")
    ends = [fd for fd in Path(f"/proc/{child.pid}/fd").iterdir() if os.readlink(fd) == pipe]
    assert len(ends) == 1

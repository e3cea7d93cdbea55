"""The logs of a run's processes as one: order, choice of lines, and files that grow or vanish."""

import json
import os

import pytest
from command_runner import invoke

from rmr_deploy.active_runs import REGISTER_VARIABLE, write_end, write_processes
from rmr_deploy.event_log import EventLog
from rmr_deploy.fleet import command
from rmr_deploy.run_logs import HOLD_S, RunLogs

LAB = {"name": "hall", "file": "lab.yaml", "robots": 2, "seed": 7, "roster": [1, 2]}
ZERO_S = 5000.0
"""Wall time at lab time 0."""


def line(wall_s, message, t=None, **fields):
    stamp = {} if t is None else {"t": t}
    return json.dumps({"time": ZERO_S + wall_s, "who": "x", "message": message, **stamp, **fields}) + "\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the folder of a run that is over, with the logs of two robots and the world."""
    monkeypatch.setenv(REGISTER_VARIABLE, str(tmp_path / "register"))
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "hall"
    (folder / "logs").mkdir(parents=True)
    logs = folder / "logs"
    (logs / "world.jsonl").write_text(line(-1.0, "robot 1 is here") + line(4.0, "clock runs"))
    (logs / "robot-1.jsonl").write_text(
        line(-2.0, "begins") + line(1.0, "fired", t=1.0, robot=1, rule="a:3") + line(5.2, "asks", t=5.0, robot=1)
    )
    (logs / "robot-2.jsonl").write_text(line(3.0, "fired", t=0.5, robot=2) + line(5.1, "asks", t=5.05, robot=2))
    write_processes(folder, "tcp/127.0.0.1:7", {}, LAB)
    write_end(folder, 0)
    return folder


def rmr(*words):
    return invoke(command(), words, name="rmr")


def said(*words):
    answer = rmr("logs", "--json", *words)
    assert (answer.exit_code, answer.stderr) == (0, "")
    return [(one["process"], one["message"], one["t"]) for one in map(json.loads, answer.stdout.splitlines())]


WHOLE = [
    ("robot-1", "begins", -2.0),
    ("world", "robot 1 is here", -1.0),
    ("robot-2", "fired", 0.5),
    ("robot-1", "fired", 1.0),
    ("world", "clock runs", 4.0),
    ("robot-1", "asks", 5.0),
    ("robot-2", "asks", 5.05),
]


def test_logs_are_merged_by_lab_time_which_lines_without_it_get_from_the_clock(folder):
    assert said() == WHOLE


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (("1",), [0, 3, 5]),
        (("2",), [2, 6]),
        (("1-2",), [0, 2, 3, 5, 6]),
        (("--tail", "2"), [5, 6]),
        (("--tail", "0"), []),
        (("--since", "1.1s"), [4, 5, 6]),
        (("--since", "500ms", "1"), [5]),
        (("-f",), [0, 1, 2, 3, 4, 5, 6]),
    ],
)
def test_lines_are_chosen_by_robot_number_and_age(folder, words, kept):
    assert said(*words) == [WHOLE[i] for i in kept]


def test_line_for_people_has_time_process_message_and_what_is_told_beside(folder):
    lines = rmr("logs").stdout.splitlines()
    assert lines[0] == "   -2.000 s robot-1    begins"
    assert lines[3] == "    1.000 s robot-1    fired rule=a:3"


def test_line_that_is_still_written_is_left_for_the_next_time(folder):
    path = folder / "logs" / "robot-1.jsonl"
    whole = line(6.0, "late", t=6.0, robot=1)
    with path.open("a") as file:
        file.write(whole[:20])
    logs = RunLogs(folder)
    assert "late" not in [one.fields["message"] for one in logs.lines()]
    with path.open("a") as file:
        file.write(whole[20:] + "no json\n[1]\n{}\n")
    assert [one.fields["message"] for one in logs.lines()] == ["late"]
    assert logs.lines() == []


def test_line_is_held_back_while_earlier_ones_may_come(folder, monkeypatch):
    logs = RunLogs(folder)
    monkeypatch.setattr(RunLogs, "clock_s", ZERO_S + 1.0 + HOLD_S)
    assert [one.fields["message"] for one in logs.lines(held=True)] == ["begins", "robot 1 is here", "fired"]
    assert [one.lab_s for one in logs.lines()] == [0.5, 4.0, 5.0, 5.05]


def test_events_are_shown_alone_or_among_the_logs(folder):
    log = EventLog(folder, lambda: 2.0)
    log.note("process_ended", "robot-1 was killed by SIGKILL", process="robot-1", exit_code=-9)
    log.note_states([(1, "starting"), (2, "running")])
    log.note_states([(1, "starting"), (2, "running")])
    lines = [json.loads(one) for one in rmr("events", "--json").stdout.splitlines()]
    assert [(one["event"], one["t"]) for one in lines] == [("process_ended", 2.0), ("robot_state", 2.0)]
    assert lines[0]["exit_code"] == -9
    assert "    2.000 s rmr up     robot 2: running" in rmr("logs").stdout.splitlines()
    assert "robot 2: running" in rmr("logs", "2").stdout
    assert "robot 2: running" not in rmr("logs", "1").stdout


@pytest.mark.parametrize(
    ("words", "code", "why"),
    [
        (("9",), 2, "lab hall has no robot 9: it has 1-2"),
        (("--run", "nowhere"), 2, "there is no nowhere; rmr ls shows what runs"),
        (("--run", "."), 2, ". is no folder of a run of processes: rmr up makes one"),
        (("--lab", "moon"), 2, "no lab moon runs on this machine, and no run of it has left a folder in ./runs; start"),
        (("--since", "soon"), 2, "--since: should be a duration such as 120s, 500ms or 1.5min"),
        (("x",), 2, "ROBOT"),
    ],
)
def test_wrong_choice_is_told_with_what_to_do(folder, words, code, why):
    answer = rmr("logs", *words)
    assert (answer.exit_code, answer.stdout) == (code, "")
    assert why in answer.stderr


def test_logs_that_went_with_their_folder_are_told(folder):
    write_processes(folder, "tcp/127.0.0.1:7", {"world": os.getpid()}, LAB)  # this process is the launcher
    for path in [*(folder / "logs").iterdir(), *folder.glob("*.json")]:
        path.unlink()
    (folder / "logs").rmdir()
    folder.rmdir()
    answer = rmr("logs", "--lab", "hall")
    write_end(folder, 0)
    assert answer.exit_code == 1
    assert answer.stderr == "rmr logs: the run folder runs/hall was removed, and its logs with it\n"

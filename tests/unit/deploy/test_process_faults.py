"""Faults of robot processes on request, upon processes that do nothing."""

import asyncio
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rmr_deploy.process_faults import ProcessFaults
from rmr_deploy.process_group import ProcessGroup
from rmr_deploy.run_requests import REQUESTS_FOLDER, RequestError, end_requests, put_request, serve_requests

pytestmark = pytest.mark.medium

IDLE = [sys.executable, "-c", "import time; time.sleep(600)"]


class Crew:
    """Two robots' processes."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.group = ProcessGroup()
        self.robots = {1: self.started(1, "robot-1"), 2: self.started(2, "robot-2")}
        self.faults = ProcessFaults(self.robots, self.started, lambda: 4.5)

    def started(self, robot, name):
        return self.group.start(name, IDLE, self.folder / f"{name}.out", threaded="." in name)

    def wait(self, claim):
        end = time.monotonic() + 20
        while not claim():
            assert time.monotonic() < end
            time.sleep(0.02)


@pytest.fixture
def crew(tmp_path):
    crew = Crew(tmp_path)
    yield crew
    crew.faults.resume(everything=True)
    crew.group.kill()


def state(child):
    return Path(f"/proc/{child.pid}/stat").read_text().rpartition(")")[2].split()[0]


def test_killed_robot_is_restarted_under_the_next_name(crew):
    assert crew.faults.perform({"do": "restart", "robot": 1}) == "robot 1 lives: kill it before it is restarted"
    first = crew.robots[1]
    assert crew.faults.perform({"do": "kill", "robot": 1}) == ""
    crew.wait(lambda: first.exit_code() is not None)
    assert crew.faults.killed == {"robot-1"}
    assert crew.faults.perform({"do": "kill", "robot": 1}) == "robot 1 is dead already"
    assert crew.faults.perform({"do": "stall", "robot": 1, "for_s": 1}) == "robot 1 is dead"
    assert crew.faults.perform({"do": "restart", "robot": 1}) == ""
    assert (crew.robots[1].name, crew.robots[1].exit_code()) == ("robot-1.1", None)
    crew.faults.perform({"do": "kill", "robot": 1})
    crew.wait(lambda: crew.robots[1].exit_code() is not None)
    crew.faults.perform({"do": "restart", "robot": 1})
    assert crew.robots[1].name == "robot-1.2"
    assert crew.faults.entries[:2] == [{"at": 4.5, "kill": 1}, {"at": 4.5, "restart": 1}]


def test_stalled_robot_goes_on_when_its_time_is_over(crew):
    assert crew.faults.perform({"do": "stall", "robot": 2, "for_s": 0.3}) == ""
    crew.wait(lambda: state(crew.robots[2]) == "T")

    def goes_on():
        crew.faults.resume()
        return state(crew.robots[2]) != "T"

    crew.wait(goes_on)
    assert crew.faults.entries == [{"from": 4.5, "to": 4.8, "stall": 2}]


def test_slow_robot_runs_in_turns_until_its_time_is_over_or_it_is_killed(crew):
    async def slowed():
        assert crew.faults.perform({"do": "slow", "robot": 1, "for_s": 60.0, "every_s": 0.05}) == ""
        assert crew.faults.perform({"do": "slow", "robot": 1, "for_s": 60.0, "every_s": 0.05}) == (
            "robot 1 is slow already"
        )
        assert crew.faults.perform({"do": "slow", "robot": 2, "for_s": 0.2, "every_s": 0.05}) == ""
        seen = {1: set(), 2: set()}
        end = asyncio.get_running_loop().time() + 60
        while not all(len(states) > 1 for states in seen.values()) and asyncio.get_running_loop().time() < end:
            for robot, states in seen.items():
                states.add(state(crew.robots[robot]) == "T")
            await asyncio.sleep(0.005)
        assert all(len(states) > 1 for states in seen.values()), "both stop and run"
        assert crew.faults.perform({"do": "stop", "robot": 1}) == ""
        async with asyncio.timeout(60):
            while len(asyncio.all_tasks()) > 1 or crew.robots[1].exit_code() is None:
                await asyncio.sleep(0.01)

    asyncio.run(slowed())
    assert crew.robots[1].exit_code() == -signal.SIGTERM
    assert state(crew.robots[2]) != "T"
    assert crew.faults.entries == [
        {"from": 4.5, "to": 4.5, "slow": 1, "every": 0.05},
        {"from": 4.5, "to": 4.7, "slow": 2, "every": 0.05},
    ]


def test_pause_is_a_stall_whose_length_is_known_at_its_end(crew):
    assert crew.faults.perform({"do": "unpause", "robot": 1}) == "robot 1 is not paused"
    assert crew.faults.perform({"do": "pause", "robot": 1}) == ""
    crew.wait(lambda: state(crew.robots[1]) == "T")
    assert (crew.faults.paused, crew.faults.entries) == (["robot-1"], [])
    crew.faults.resume()
    assert crew.faults.perform({"do": "unpause", "robot": 1}) == ""
    crew.wait(lambda: state(crew.robots[1]) != "T")
    assert crew.faults.entries == [{"from": 4.5, "to": 4.5, "stall": 1}]


def test_crash_is_no_kill_by_a_person(crew):
    assert crew.faults.perform({"do": "crash", "robot": 1}) == ""
    crew.wait(lambda: crew.robots[1].exit_code() is not None)
    assert (crew.faults.killed, crew.faults.crashed) == (set(), {"robot-1"})
    assert crew.faults.perform({"do": "start", "robot": 1}) == ""
    assert crew.faults.perform({"do": "start", "robot": 1}) == "robot 1 runs already"


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ({"do": "slow", "robot": 1, "for_s": 1.0, "every_s": 0.01}, "the period of a slow robot is longer than a tick"),
        ({"do": "slow", "robot": 1, "for_s": 0.0, "every_s": 1.0}, "a robot is slow for up to 86400 s"),
        ({"do": "kill", "robot": 1, "signal": 999}, "there is no such signal"),
        ({"do": "kill", "robot": 1, "signal": True}, "there is no such signal"),
        ({"do": ["kill"], "robot": 1}, "unknown request"),
    ],
)
def test_order_with_wrong_values_is_refused(crew, request_, why):
    assert crew.faults.perform(request_).startswith(why)


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        ({"do": "kill", "robot": 9}, "there is no such robot in this run"),
        ({"do": "kill", "robot": "1"}, "there is no such robot in this run"),
        ({"do": "kill"}, "there is no such robot in this run"),
        ({"do": "stall", "robot": 1, "for_s": float("nan")}, "a stall lasts up to 86400 s"),
        ({"do": "stall", "robot": 1}, "a stall lasts up to 86400 s"),
        ({"do": "paint", "robot": 1}, "unknown request"),
    ],
)
def test_request_that_cannot_be_granted_is_refused_with_a_sentence(crew, request_, why):
    assert crew.faults.perform(request_) == why


def test_robots_that_share_a_process_are_not_killed_one_by_one(crew):
    crew.robots[2] = crew.robots[1]
    assert crew.faults.perform({"do": "kill", "robot": 1}) == (
        "robot 1 shares its process with 1 more: start the run without --processes"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="prctl is Linux's")
def test_process_started_beside_threads_dies_with_its_parent(tmp_path):
    code = (
        "import sys, time; from pathlib import Path; from rmr_deploy.process_group import ProcessGroup\n"
        f"child = ProcessGroup().start('x', {IDLE!r}, Path({str(tmp_path / 'x.out')!r}), threaded=True)\n"
        "print(child.pid, flush=True); time.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        command = Path(f"/proc/{pid}/cmdline")
        end = time.monotonic() + 20
        while b"parent_death" in command.read_bytes():  # not its own yet
            assert time.monotonic() < end
        parent.kill()
    while Path(f"/proc/{pid}").exists() and Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < end
        time.sleep(0.02)


# --- requests as files


async def asked(folder, request, perform):
    asking = asyncio.create_task(put_request(folder, request))
    while not asking.done():
        serve_requests(folder, perform)
        await asyncio.sleep(0.01)
    await asking


def test_request_reaches_the_launcher_and_its_refusal_the_asker(tmp_path):
    seen = []
    asyncio.run(asked(tmp_path, {"do": "kill", "robot": 3}, lambda request: seen.append(request) or ""))
    assert seen == [{"do": "kill", "robot": 3}]
    with pytest.raises(RequestError, match=r"^robot 3 is dead already$"):
        asyncio.run(asked(tmp_path, {"do": "kill", "robot": 3}, lambda _: "robot 3 is dead already"))
    assert list((tmp_path / REQUESTS_FOLDER).iterdir()) == []
    end_requests(tmp_path)
    assert not (tmp_path / REQUESTS_FOLDER).exists()


@pytest.mark.parametrize("text", ["", "[1]", "{", "[" * 5000])
def test_request_that_is_no_json_object_is_refused(tmp_path, text):
    folder = tmp_path / REQUESTS_FOLDER
    folder.mkdir()
    (folder / "a.ask").write_text(text)
    serve_requests(tmp_path, lambda _: pytest.fail("performed"))
    assert json.loads((folder / "a.answer").read_text())["refused"].startswith("the request is no JSON")


def test_launcher_that_does_not_answer_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("rmr_deploy.run_requests.PATIENCE_S", 0.1)
    with pytest.raises(RequestError, match="the launcher of this run does not answer"):
        asyncio.run(put_request(tmp_path, {"do": "kill", "robot": 3}))
    assert list((tmp_path / REQUESTS_FOLDER).iterdir()) == []

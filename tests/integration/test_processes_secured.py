"""A secured radio among real processes: who has the key is heard, also after a restart; who has none does not start."""

import shutil
import signal

import pytest
from launched import LABS, Launched
from process_tools import LAB, Stage

KEY = "00112233445566778899aabbccddeeff"


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    (tmp_path / "lab.yaml").write_text(LAB + "radio: {security: enc-mic-32}\n")  # the world needs no key
    (tmp_path / "lab.key").write_text(KEY)
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


def received(newest, robot):
    status = newest.get(robot)
    return status.report.get("frames", {}).get("received", 0) if status is not None else 0


@pytest.mark.slow
def test_robots_with_the_key_communicate_after_a_restart_and_one_without_it_does_not_start(stage):
    stage.world()
    bare = stage.agent(1)
    assert bare.exit_code() == 3
    assert "lab bench: its radio is secured (enc-mic-32): start the robot with --radio-key" in bare.said()
    key = ("--radio-key", stage.folder / "lab.key")
    first, _ = stage.agent(1, *key), stage.agent(2, *key)
    before = stage.statuses(lambda newest: received(newest, 1) and received(newest, 2))
    first.send(signal.SIGKILL)
    first.exit_code()
    stage.agent(1, *key)
    lives = before[1].report["restarts"] + 1
    after = stage.statuses(
        lambda newest: (
            received(newest, 1)
            and newest[1].report["restarts"] == lives
            and received(newest, 2) > received(before, 2) + 2
        )
    )
    for robot in (1, 2):
        counters = after[robot].report["frames"]
        assert [counters[name] for name in ("forged", "replayed", "unsecured")] == [0, 0, 0]


def test_robot_with_an_invalid_key_file_fails_before_connecting(stage):
    (stage.folder / "lab.key").write_text(KEY[:-1])
    robot = stage.agent(1, "--radio-key", stage.folder / "lab.key")
    assert robot.exit_code() == 3
    assert "lab.key: 31 hexadecimal digits instead of 32; to make a key: openssl rand -hex 16 > lab.key" in robot.said()
    assert len(robot.said().splitlines()) == 1


@pytest.mark.slow
def test_a_lab_with_a_key_runs_as_processes_and_the_key_is_in_nothing_that_they_leave(tmp_path):
    lab = tmp_path / "lab"
    shutil.copytree(LABS / "dash", lab)
    (lab / "lab.key").write_text(KEY)
    with (lab / "lab.yaml").open("a") as file:
        file.write("radio: {key_file: lab.key}\n")
    run = Launched(lab, tmp_path)
    try:
        assert run.wait() == 0, run.out + run.err
        counters = [part["frames"] for part in run.report()["robots"].values()]
        assert all(each["received"] > 0 for each in counters)
        assert [each["forged"] + each["unsecured"] + each["replayed"] for each in counters] == [0, 0, 0]
        left = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file() and path != lab / "lab.key"]
        assert not any(KEY.encode() in octets or bytes.fromhex(KEY) in octets for octets in left)
    finally:
        run.clean_up()

"""The secret of a bus among real processes: a session without it is kept out, of `rmr up` and of a world by hand.

The sessions of the outsider are zenoh's own, so that nothing of this project keeps them from trying.
"""

import asyncio
import contextlib
import json
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest
import zenoh
from launched import LABS, Launched
from process_tools import Stage

from rmr.bus import wire
from rmr.bus.keys import ROBOT_ROLE, WORLD, Keys
from rmr.bus.secret import read_secret
from rmr.bus.session import open_bus

pytestmark = pytest.mark.slow

FINISHED = wire.Status("finished", "", True, False, 10**9, {})
ROBOTS = (1, 2, 3)
KEYS = Keys("dash")


@pytest.fixture
def stage(tmp_path):
    stage = Stage(tmp_path)
    yield stage
    stage.end()
    assert not any("Traceback" in started.said() for started in stage.started)


@pytest.fixture
def endless(tmp_path):
    """A run under way of a lab whose finish fact never comes true: only a forged status could end it as finished."""
    folder = tmp_path / "lab"
    shutil.copytree(LABS / "dash", folder)
    lab = folder / "lab.yaml"
    text = lab.read_text().replace("at(R, goal)", "at(R, away)")
    lab.write_text(text.replace("areas:\n", "areas:\n  away: {box: [1.2, 0.1, 1.4, 1.1]}\n"))
    launched = Launched(folder, tmp_path)
    yield launched.running()
    launched.clean_up()


def outsider(mode, endpoint, **settings):
    """Open a session as any program can, in zenoh's `mode`. Raises ZError where it is refused."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "listen/endpoints": [],
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 500,
        "connect/exit_on_failure": mode == "client",
        "scouting/multicast/enabled": False,
        **settings,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


GUESS = {"transport/auth/usrpwd/user": "rmr", "transport/auth/usrpwd/password": "0" * 64}


def test_session_without_the_secret_can_neither_publish_query_nor_see_liveliness(endless):
    for settings in ({}, GUESS):
        with pytest.raises(zenoh.ZError, match="Unable to connect"):
            outsider("client", endless.endpoint, **settings)
        for mode in ("peer", "router"):
            session = outsider(mode, endless.endpoint, **settings)
            try:
                assert attack(session) == ([], [], [])
                assert session.info.routers_zid() == []
            finally:
                session.close()
    assert endless.process.poll() is None, endless.out + endless.err
    assert sorted(endless.left()) == ["robot-1", "robot-2", "robot-3", "world"]


def attack(session):
    """Forge what would end the run, ask, listen; return what was heard, answered and seen alive."""
    heard = []
    subscriber = session.declare_subscriber("rmr/**", heard.append, allowed_origin=zenoh.Locality.REMOTE)
    for _ in range(10):
        for robot in ROBOTS:
            session.put(KEYS.status(robot), wire.encode(robot, 1, 1, FINISHED))
            session.put(KEYS.stop(robot), wire.encode(wire.OPERATOR_ID, 1, 1, wire.Stop("forged")))
        session.put(KEYS.stop(WORLD), wire.encode(wire.OPERATOR_ID, 1, 1, wire.Stop("forged")))
        time.sleep(0.05)  # statuses of the true robots are due meanwhile
    question = wire.encode(1, 1, 1, wire.AskMap(1, 1))
    answers = list(session.get(KEYS.map(1), payload=question, timeout=0.5))
    alive = list(session.liveliness().get("rmr/**", timeout=0.5))
    subscriber.undeclare()
    return heard, answers, alive


def test_forged_status_of_each_robot_ends_the_run_only_with_the_secret(endless):
    """The same messages that have no effect without it do have one with it: what kept them out was the secret.

    They carry the numbers of the robots' sessions, which whoever is let in can listen to.
    """

    async def forge():
        bus = open_bus(wire.OPERATOR_ID, connect=endless.endpoint, secret=read_secret(endless.folder / "secret"))
        sessions, alive = {}, set()
        bus.subscribe(KEYS.statuses, lambda _, message: sessions.setdefault(message.sender, message.run))
        bus.watch_alive(KEYS.alive(ROBOT_ROLE, "*"), lambda key, _: alive.add(key))
        assert len(await bus.ask(KEYS.clock, wire.AskClock(), 2.0)) == 1
        while endless.process.poll() is None:
            for robot in sessions.keys() & set(ROBOTS):
                bus._session.put(KEYS.status(robot), wire.encode(robot, sessions[robot], 1, FINISHED))
            await asyncio.sleep(0.02)
        bus.close()
        return alive

    alive = asyncio.run(asyncio.wait_for(forge(), 30.0))
    assert endless.wait() == 0
    assert alive == {KEYS.alive(ROBOT_ROLE, robot) for robot in ROBOTS}


def test_run_folder_is_private_and_the_secret_stands_in_no_command_line_log_or_report(endless):
    file = endless.folder / "secret"
    password = read_secret(file).password
    assert stat.S_IMODE(endless.folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    for pid in (endless.process.pid, *endless.pids.values()):
        assert password.encode() not in Path(f"/proc/{pid}/cmdline").read_bytes()
        assert password.encode() not in Path(f"/proc/{pid}/environ").read_bytes()
    fault = [sys.executable, "-m", "rmr_deploy.fault", "list"]
    by_folder = subprocess.run([*fault, "--run", endless.folder], capture_output=True, text=True, check=False)
    assert (by_folder.returncode, by_folder.stderr) == (0, "")
    endless.interrupt()
    endless.wait()
    assert not file.exists(), "the run is over"
    left = [path for path in endless.folder.rglob("*") if path.is_file()]
    assert [path.name for path in left if password.encode() in path.read_bytes()] == []
    assert password not in endless.out + endless.err


def test_robots_open_no_listening_port(endless):
    listening = sockets_listening()
    world = endless.pids.pop("world")
    assert [name for name, pid in endless.pids.items() if pid != world and inodes(pid) & listening] == []
    assert inodes(world) & listening


def sockets_listening():
    """Return the inodes of all TCP sockets of this machine that listen (proc(5): state 0A)."""
    rows = [line.split() for name in ("tcp", "tcp6") for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return {row[9] for row in rows if row[3] == "0A"}


def inodes(pid):
    """Return the inodes of a process's sockets."""
    found = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            name = str(descriptor.readlink())
            if name.startswith("socket:["):
                found.add(name[len("socket:[") : -1])
    return found


# --- by hand -------------------------------------------------------------------------------------------------


def test_robot_started_by_hand_joins_with_the_secret_and_is_refused_without_it(endless, stage):
    stage.endpoint = endless.endpoint
    program = endless.folder / "dash.rbc"
    bare = stage.agent(1, program=program)
    assert bare.exit_code() == 1
    assert bare.said() == (
        f"rmr-agent 1: {endless.endpoint} does not let this process in: it has a secret, so name the file with "
        "--secret (of rmr up: secret in its run folder)\n"
    )
    admitted = stage.agent(1, "--secret", endless.folder / "secret", program=program)
    assert admitted.exit_code() == 1
    assert "robot 1 of lab dash is taken" in admitted.said()
    endless.interrupt()
    endless.wait()
    assert "world: rmr-world: refused a process that has no secret" in endless.out + endless.err


def test_world_started_by_hand_creates_the_secret_and_admits_only_its_holders(stage):
    file, other = stage.folder / "lab.secret", stage.folder / "other.secret"
    world = stage.world("--secret", file)
    world.wait_for(f"made a new secret: {file}")
    world.wait_for("lab bench, 2 robots")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    shutil.copy(file, other)
    other.write_text("rmr:" + "0" * 64 + "\n")
    wrong = stage.agent(1, "--secret", other)
    assert wrong.exit_code() == 1
    assert f"it has another secret than the one in {other}" in wrong.said()
    world.wait_for("refused a process that has another secret (attempts so far: ")
    stage.agent(1, "--secret", file).wait_for("robot 1 is in lab bench")
    assert "zenoh" not in world.said()


def test_robot_with_a_secret_does_not_join_a_world_without_one(stage):
    stage.world("--secret", stage.folder / "made").wait_for("made a new secret")
    stage.endpoint = Stage(stage.folder).endpoint
    stage.world().wait_for("lab bench, 2 robots")
    robot = stage.agent(1, "--secret", stage.folder / "made")
    assert robot.exit_code() == 1
    assert f"what listens at {stage.endpoint} has no secret: start it with --secret " in robot.said()


def test_unusable_secret_file_is_one_sentence_and_exit_code_3(stage):
    file = stage.folder / "secret"
    file.write_text("rmr:0123456789abcdef\n")
    file.chmod(0o644)
    for process in (stage.world("--secret", file), stage.agent(1, "--secret", file)):
        assert process.exit_code() == 3
        assert process.said().endswith(f"{file}: other users may read or change this secret; run: chmod 600 {file}\n")
        assert len(process.said().splitlines()) == 1


def test_missing_secret_file_is_wrong_usage_in_every_command(stage):
    missing = stage.agent(1, "--secret", stage.folder / "nothing")
    assert missing.exit_code() == 2
    assert missing.said() == f"rmr-agent 1: {stage.folder / 'nothing'}: No such file or directory\n"
    words = [sys.executable, "-m", "rmr_deploy.fault", "list", "--connect", stage.endpoint]
    fault = subprocess.run(
        [*words, "--secret", str(stage.folder / "nothing")], capture_output=True, text=True, check=False
    )
    assert (fault.returncode, fault.stdout) == (2, "")
    assert fault.stderr == f"rmr fault: {stage.folder / 'nothing'}: No such file or directory\n"


def test_fault_by_endpoint_needs_the_secret(stage):
    file = stage.folder / "secret"
    stage.world("--secret", file).wait_for("lab bench, 2 robots")
    fault = [sys.executable, "-m", "rmr_deploy.fault", "list", "--connect", stage.endpoint]
    bare = subprocess.run(fault, capture_output=True, text=True, check=False)
    assert (bare.returncode, bare.stdout) == (1, "")
    assert bare.stderr.startswith(f"rmr fault: {stage.endpoint} does not let this process in: it has a secret")
    assert subprocess.run([*fault, "--secret", file], capture_output=True, check=False).returncode == 0


def test_a_world_that_is_opened_on_purpose_says_so(stage):
    where = stage.endpoint.replace("127.0.0.1", "0.0.0.0")
    world = stage.start("rmr_world.main", "--config", stage.folder / "lab.yaml", "--listen", where, "--open")
    world.wait_for(f"open: whoever reaches {where}, on any machine, can drive the robots and end the run")
    stage.agent(1).wait_for("robot 1 is in lab")

"""`rmr up LAB --hosts F --here H` on three hosts is one lab: one report, and each command ends with the run."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time

import pytest
from launched import CORRIDOR
from network import Network, not_permitted
from process_tools import Stage, wait_until

from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.secret import make_secret

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

SOON_S = 30.0
"""Far below the minute for which a launcher that is silent is waited for, and enough to stop three hosts in order."""


ORDER = """
import asyncio, os, sys
from pathlib import Path
from rmr.bus import wire
from rmr.bus.certificates import read_credentials
from rmr.bus.keys import Keys
from rmr.bus.session import open_bus

async def order():
    endpoint, keys, request = sys.argv[1:]
    bus = open_bus(wire.OPERATOR_ID, connect=endpoint, secret=read_credentials(Path(keys)))
    print(len(await bus.ask(Keys("corridor").order("a"), wire.HostOrder(request.encode()), 2.0)), "answers", flush=True)
    os._exit(0)

asyncio.run(order())
"""


@pytest.fixture
def network():
    if why := not_permitted():
        pytest.skip(why)
    network = Network("abcd")  # d is no host of the lab
    yield network
    network.remove()


class Hosts:
    """The corridor with the world on a and three robots each on b and c, by `rmr up` on each."""

    def __init__(self, folder, network):
        self.folder = folder
        self.network = network
        self.stage = Stage(folder)
        self.lab = "corridor"
        self.hosts = folder / "hosts.yaml"
        self.hosts.write_text(
            f"hosts:\n  a: {{address: {network.address('a')}, world: true}}\n"
            "  b: {robots: 1-3}\n  c: {robots: 4-6}\n"
        )
        make_secret(folder / "secret")

    def up(self, host, *options, run=None, lab=None, admission=None):
        """Start the command on `host`; `admission` takes the place of the secret."""
        where = ("--hosts", self.hosts, "--here", host, *(admission or ("--secret", self.folder / "secret")))
        words = ("rmr_deploy.up", lab or self.lab, *where, "--run", self.folder / (run or host), *options)
        return self.stage.start(*words, before=self.network.on(host))

    def all_up(self, **options):
        """Start it on all hosts, with the options of each, and wait until all robots drive; return them by host."""
        started = {host: self.up(host, *options.get(host, ())) for host in "abc"}
        for one in started.values():
            one.wait_for("robots ready after")
        return started

    def ask(self, host, *words):
        """Carry out `rmr` on `host`, and wait for its end; no run of this machine is found there."""
        command = [*self.network.on(host), sys.executable, "-m", "rmr", *map(str, words)]
        environment = os.environ | {"RMR_REGISTER": str(self.folder / "nothing")}
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, env=environment)

    def order_by_force(self, host, endpoint, keys, request):
        """Send an order to the launcher of host a from `host`, as a program that asks for no role would."""
        command = [*self.network.on(host), sys.executable, "-c", ORDER, endpoint, keys, json.dumps(request)]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True, timeout=60)
        return done.stdout

    @property
    def place(self):
        """The options of a verb on another machine."""
        return "--connect", f"tcp/{self.network.address('a')}:17447", "--secret", self.folder / "secret"

    def wait_until_driving(self):
        """Wait until a robot of each other host has begun to move."""
        for host in "bc":
            logs = (self.folder / host / "logs").glob("*.jsonl")
            wait_until(lambda logs=list(logs): any('"lineup' in log.read_text() for log in logs))

    def kill(self, host, process):
        """Kill a process as a failure would; return when, on the monotonic clock."""
        pids = json.loads((self.folder / host / "processes.json").read_text())["processes"]
        os.kill(pids[process], signal.SIGKILL)
        return time.monotonic()

    def report(self):
        """Return the report of the run."""
        return json.loads((self.folder / "a" / "report.json").read_text())


@pytest.fixture
def hosts(tmp_path, network):
    hosts = Hosts(tmp_path, network)
    yield hosts
    hosts.stage.end()


def test_one_command_on_each_host_makes_one_lab(hosts):
    c = hosts.up("c")
    c.wait_for("waiting for the world of lab corridor at tcp/10.77.0.1:17447, on host a")
    a = hosts.up("a")
    a.wait_for("waiting for host b (robots 1-3)")
    b = hosts.up("b")
    for started in (a, b, c):
        started.wait_for("robots ready after")
    waited = hosts.ask("d", "wait", *hosts.place)
    assert (waited.returncode, "every robot holds the finish fact; the report is on" in waited.stdout) == (0, True)
    assert [started.process.wait(120) for started in (a, b, c)] == [0, 0, 0], [one.said() for one in (a, b, c)]
    report = hosts.report()
    assert (report["finished"], sorted(report["robots"])) == (True, list("123456"))
    assert all(part["finish_s"] for part in report["robots"].values())
    assert "robot 4 on c  finished" in a.said()
    assert f"every robot holds the finish fact; the report is on host a, in {hosts.folder / 'a'}" in b.said()
    assert "@1" in b.said()
    assert "@4" not in b.said()
    assert not (hosts.folder / "b" / "report.json").exists()
    assert not (hosts.folder / "b" / "secret").exists()
    joins = next(line for line in a.said().splitlines() if "rmr record join" in line)
    command = ["bash", "-c", f"{sys.executable} -m {joins.strip()}"]
    for host in "bc":
        shutil.copytree(hosts.folder / host / "record", hosts.folder / "copied" / host)
    joined = subprocess.run(command, cwd=hosts.folder / "copied", capture_output=True, text=True, check=False)
    assert joined.returncode == 0, joined.stderr
    assert (hosts.folder / "a" / "joined" / "run.mcap").exists()


def ended(started):
    """Return the exit codes of commands that end by themselves."""
    return {host: one.process.wait(150) for host, one in started.items()}


def test_a_robot_that_dies_is_started_again_by_its_host(hosts):
    started = hosts.all_up(c=("--restart", "on-failure"))
    hosts.kill("c", "robot-5")
    started["c"].wait_for("robot 5 is started again")
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    report = hosts.report()
    assert (report["finished"], report["robots"]["5"]["restarts"], report["dead"]) == (True, 1, [])
    assert report["died"] == {"robot-5": -9}
    said = started["a"].said()
    assert said.index("robot 5 on host c has ended") < said.index("robot 5 on host c is started again")
    assert "robot-5 on host c died on the way and came back; the report" in said


def test_a_world_that_is_killed_comes_back_and_the_robots_of_all_hosts_go_on(hosts):
    started = hosts.all_up(a=("--durable",))
    hosts.wait_until_driving()
    hosts.kill("a", "world")
    started["a"].wait_for("the world is started again")
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    report = hosts.report()
    assert (report["finished"], report["dead"], report["collisions"]) == (True, [], 0)
    assert (report["world"], report["died"]) == ({"restarts": 1}, {"world": -9})
    assert {part["restarts"] for part in report["robots"].values()} == {0}
    jobs = [job for part in report["robots"].values() for job in part["assertions"]]
    assert [job["finish_s"] is None for job in jobs] == [False] * 6
    for host, robots in {"b": (1, 2, 3), "c": (4, 5, 6)}.items():
        assert "world died on the way and came back" in started[host].said()
        for robot in robots:
            assert "the world is back" in (hosts.folder / host / "logs" / f"robot-{robot}.jsonl").read_text()
    for host in "bc":
        shutil.copytree(hosts.folder / host / "record", hosts.folder / "copied" / host)
    joins = next(line for line in started["a"].said().splitlines() if "rmr record join" in line)
    command = ["bash", "-c", f"{sys.executable} -m {joins.strip()}"]
    joined = subprocess.run(command, cwd=hosts.folder / "copied", capture_output=True, text=True, check=False)
    assert joined.returncode == 0, joined.stderr


def test_the_world_is_killed_and_started_again_from_every_machine(hosts):
    started = hosts.all_up(a=("--durable",))
    hosts.wait_until_driving()

    def ask(*words):
        return hosts.ask("d", *words, *hosts.place)

    def ask_b(*words):
        return hosts.ask("b", *words, "--run", hosts.folder / "b")

    def state_of_world(told):
        return next(line.split()[1] for line in reversed(told.stdout.splitlines()) if "/world" in line)

    assert ask("pause", "5").stdout == "robot 5 is paused\n"  # it keeps the run from its end
    assert ask("kill", "world").stdout == "the world is killed\n"
    assert ask("kill", "world").stderr == "rmr kill: the world is dead already\n"
    assert ask_b("kill", "world").stderr == "rmr kill: the world is dead already\n"
    assert (state_of_world(ask("ps", "-a")), state_of_world(ask_b("ps", "-a"))) == ("killed", "ended")
    assert ask_b("restart", "world").stdout == "the world is started again\n"
    wait_until(lambda: state_of_world(ask_b("ps", "-a")) == "running")
    assert ask("fault", "kill", "world").stdout == "the world is killed\n"
    started["a"].wait_for("the world is started again", times=2)  # as after a failure
    assert ask("unpause", "5").stdout == "robot 5 is going on\n"
    whose = {line.split(" s ")[1].split()[0] for line in ask("logs", "world").stdout.splitlines()}
    assert whose == {"a/world", "a/world.1", "a/world.2", "a/rmr"}
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    report = hosts.report()
    assert (report["finished"], report["dead"], report["collisions"]) == (True, [], 0)
    assert (report["world"], report["died"]) == ({"restarts": 2}, {"world": -9, "world.1": -9})
    assert {part["restarts"] for part in report["robots"].values()} == {0}


def test_a_router_that_is_killed_is_started_again_and_all_go_on(hosts):
    started = hosts.all_up()
    hosts.wait_until_driving()

    def ask(*words):
        return hosts.ask("d", *words, *hosts.place)

    def listens(router):
        log = hosts.folder / "a" / "logs" / f"{router}.jsonl"
        wait_until(lambda: log.exists() and "a router at" in log.read_text())

    assert ask("pause", "5").stdout == "robot 5 is paused\n"  # it keeps the run from its end
    assert ask("kill", "router").stdout == "the router is killed\n"
    listens("router.1")
    hosts.kill("a", "router.1")
    listens("router.2")
    for words, code, why in (
        (("stop", "router"), 1, "stop: the router can be killed only, and is then started again by itself\n"),
        (("fault", "stall", "router"), 1, "fault stall: the router can be killed only, and is then started again"),
        (("kill", "word"), 2, "write ids such as 4, 2-3 or 0-5,9; or world, or router\n"),
    ):
        refused = ask(*words)
        assert (refused.returncode, refused.stdout) == (code, "")
        assert why in refused.stderr
    assert ask("unpause", "5").stdout == "robot 5 is going on\n"
    whose = {line.split(" s ")[1].split()[0] for line in ask("logs", "router").stdout.splitlines()}
    assert whose == {"a/router", "a/router.1", "a/router.2", "a/rmr"}
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    report = hosts.report()
    assert (report["finished"], report["dead"], report["collisions"]) == (True, [], 0)
    assert report["died"] == {"router": -9, "router.1": -9}
    assert {part["restarts"] for part in report["robots"].values()} == {0}


def test_a_world_that_keeps_no_state_is_killed_by_no_verb_and_its_death_ends_the_run_on_all_hosts_at_once(hosts):
    started = hosts.all_up()
    for refused in (
        hosts.ask("d", "kill", "world", *hosts.place),
        hosts.ask("d", "fault", "kill", "world", *hosts.place),
        hosts.ask("b", "kill", "world", "--run", hosts.folder / "b"),
    ):
        assert (refused.returncode, refused.stdout) == (1, "")
        assert ": the world keeps no state, and the run would end with it: start the lab with rmr up" in refused.stderr
    died = hosts.kill("a", "world")
    assert ended(started) == {"a": 1, "b": 1, "c": 1}
    assert time.monotonic() - died < SOON_S
    for host in "bc":
        assert f"world died; the report is on host a, in {hosts.folder / 'a'}" in started[host].said()
    assert hosts.report()["reason"] == "world died"


def test_a_world_that_is_not_started_again_ends_the_run_on_all_hosts_at_once(hosts):
    started = hosts.all_up(a=("--durable", "--restart", "on-failure:1"))
    hosts.kill("a", "world")
    started["a"].wait_for("the world is started again")
    died = hosts.kill("a", "world.1")
    assert ended(started) == {"a": 1, "b": 1, "c": 1}
    assert time.monotonic() - died < SOON_S
    for host in "bc":
        assert "the world died 2 times, and is not started again; the report is on host a" in started[host].said()


def test_a_launcher_that_is_gone_itself_is_waited_for_and_that_is_said(hosts):
    started = hosts.all_up()
    started["a"].send(signal.SIGKILL)
    killed = time.monotonic()
    for host in "bc":
        started[host].wait_for(
            "no word of host a, which has the world of lab corridor; waiting for it to return, for 60 s"
        )
        assert started[host].process.wait(90) == 1
        assert "no word of host a, which has the world of lab corridor, for 60 s" in started[host].said()
    assert 60 < time.monotonic() - killed < 90


def test_a_robot_that_dies_ends_the_run_on_all_hosts(hosts):
    started = hosts.all_up()
    hosts.kill("c", "robot-5")
    assert ended(started) == {"a": 1, "b": 1, "c": 1}
    for one in started.values():
        assert "robot 5 on host c died" in one.said()
    report = hosts.report()
    assert (report["finished"], report["dead"], report["reason"]) == (False, [5], "robot 5 on host c died")


@pytest.mark.parametrize("length_s", [2.0, 10.0, 30.0])
def test_a_host_that_is_cut_off_comes_back_and_the_others_keep_their_world(hosts, length_s):
    started = hosts.all_up()
    hosts.wait_until_driving()
    hosts.network.cut("c")
    time.sleep(length_s)
    hosts.network.heal("c")
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    assert hosts.report()["collisions"] == 0
    logs = {host: (hosts.folder / host / "logs").glob("robot-?.jsonl") for host in "bc"}
    lost = {host: ["waiting for it to return" in log.read_text() for log in logs[host]] for host in logs}
    assert lost["b"] == [False] * 3
    assert lost["c"] == [True] * 3 or length_s == 2.0, "3 s are the lease; TCP takes its time after a shorter cut"


def test_ctrl_c_on_a_host_stops_its_robots_and_on_that_of_the_world_all(hosts):
    started = hosts.all_up()
    started["c"].send(signal.SIGINT)
    assert started["c"].exit_code() == 1
    assert "interrupted; the run goes on; its report will be on host a" in started["c"].said()
    started["a"].wait_for("host c has left: interrupted")
    again = hosts.up("c", run="c-again")
    again.wait_for("robots ready after")
    assert "robot 1 on b  stopped" not in started["a"].said()
    started["a"].send(signal.SIGINT)
    assert ended({"a": started["a"], "b": started["b"], "c": again}) == {"a": 1, "b": 1, "c": 1}
    assert "interrupted; the report is on host a" in started["b"].said()
    assert "interrupted; the report is on host a" in again.said()


def test_a_host_with_another_program_and_a_host_twice_are_refused(hosts):
    shutil.copytree(CORRIDOR, hosts.folder / "other")
    program = hosts.folder / "other" / "corridor.rmr"
    program.write_text(program.read_text() + "\ntype added(robot).\n")
    a = hosts.up("a")
    a.wait_for("waiting for host b (robots 1-3), c (robots 4-6)")
    b = hosts.up("b")
    b.wait_for("host b takes part in lab corridor")
    other = hosts.up("c", lab=hosts.folder / "other")
    assert other.exit_code() == 3
    assert "host c has another lab than host a: program " in other.said()
    a.wait_for("host c has left: host c has another lab than host a")
    twice = hosts.up("b", run="twice")
    assert twice.exit_code() == 3
    assert "rmr up: host b takes part already: another rmr up --here b runs\n" in twice.said()
    c = hosts.up("c", run="c-again")
    for one in (a, b, c):
        one.wait_for("robots ready after")


def test_hosts_with_keys_are_one_lab_and_each_has_its_own_bundles_alone(hosts):
    lab = hosts.folder / "lab"
    shutil.copytree(CORRIDOR, lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write("bus: {security: mtls}\n")
    ca = Authority.begin(hosts.folder / "ca")
    robots = {"b": (1, 2, 3), "c": (4, 5, 6)}
    for who in (
        holder("operator", "ann"),
        holder("viewer", "bob"),
        *(holder("robot", str(robot)) for robot in range(1, 7)),
    ):
        ca.issue(who)
    ca.issue(holder("world"), [hosts.network.address("a")])
    for host, own in robots.items():
        (hosts.folder / f"keys-{host}").mkdir(0o700)
        write_bundle(ca.bundle(holder("operator", "ann")), hosts.folder / f"keys-{host}" / "operator")
        for robot in own:
            write_bundle(ca.bundle(holder("robot", str(robot))), hosts.folder / f"keys-{host}" / f"robot-{robot}")
    keys = {"a": hosts.folder / "ca", "b": hosts.folder / "keys-b", "c": hosts.folder / "keys-c"}
    for who in (holder("operator", "ann"), holder("viewer", "bob")):
        write_bundle(ca.bundle(who), hosts.folder / who.name)
    durable = {"a": ("--durable",)}
    started = {
        host: hosts.up(host, *durable.get(host, ()), lab=lab, admission=("--keys", folder))
        for host, folder in keys.items()
    }
    started["a"].wait_for("robots ready after")
    place = ("--connect", f"tls/{hosts.network.address('a')}:17447", "--keys")
    assert "c/robot-4" in hosts.ask("d", "ps", *place, hosts.folder / "bob").stdout
    refused = hosts.ask("d", "pause", "4", *place, hosts.folder / "bob")
    assert refused.stderr.endswith(
        "/bob: the keys of viewer/bob, where those of operator are needed; issue them with rmr keys issue\n"
    )
    assert hosts.ask("d", "pause", "4", *place, hosts.folder / "ann").stdout == "robot 4 is paused\n"
    for who, keys in (("viewer/bob", hosts.folder / "bob"), ("robot/1", hosts.folder / "keys-b" / "robot-1")):
        for words in (("kill", "world"), ("fault", "kill", "router")):
            refused = hosts.ask("d", *words, *place, keys)
            assert (refused.returncode, refused.stdout) == (3, "")
            assert f"the keys of {who}, where those of operator are needed" in refused.stderr
        answers = hosts.order_by_force("d", place[1], keys, {"do": "kill", "robot": "world"})
        assert answers == "0 answers\n", "the router carries no order of them, even of another program"
    given = hosts.order_by_force("d", place[1], hosts.folder / "ann", {"do": "pause", "robot": "world"})
    assert given == "1 answers\n"
    assert hosts.ask("d", "kill", "world", *place, hosts.folder / "ann").stdout == "the world is killed\n"
    assert hosts.ask("d", "restart", "world", *place, hosts.folder / "ann").stdout == "the world is started again\n"
    assert hosts.ask("d", "unpause", "4", *place, hosts.folder / "ann").stdout == "robot 4 is going on\n"
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, [one.said() for one in started.values()]
    assert (hosts.report()["finished"], hosts.report()["dead"]) == (True, [])
    assert (hosts.report()["world"], hosts.report()["died"]) == ({"restarts": 1}, {"world": -9})


def test_a_robot_is_shown_and_steered_from_every_host(hosts):
    started = hosts.all_up()

    def ask(host, *words):
        return hosts.ask(host, *words, "--run", hosts.folder / host)

    shown = ask("a", "ps").stdout
    assert [line.split()[0] for line in shown.splitlines()[4:]] == [f"{'bc'[n > 3]}/robot-{n}" for n in range(1, 7)]
    assert [line.split()[0] for line in ask("b", "ps").stdout.splitlines()[5:]] == [
        *("a/world", "c/robot-4", "c/robot-5", "c/robot-6")
    ]
    assert ask("a", "kill", "4").stdout == "robot 4 is killed\n"
    assert ask("a", "kill", "4").stderr == "rmr kill: robot 4 is dead already\n"
    assert "kill robot 4" in ask("c", "events").stdout
    assert ask("b", "restart", "4").stdout == "robot 4 is started again\n"
    started["c"].wait_for("robot 4 is started again")
    assert ask("c", "pause", "1").stdout == "robot 1 is paused\n"
    assert ask("a", "unpause", "1").stdout == "robot 1 is going on\n"
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    report = hosts.report()
    assert report["robots"]["4"]["restarts"] == 1
    faults = [
        next((word, entry[word]) for word in ("kill", "restart", "stall") if word in entry)
        for entry in report["faults"]
    ]
    assert faults == [("kill", 4), ("restart", 4), ("stall", 1)]
    for word, robot, host in (("kill", 4, "c"), ("stall", 1, "b")):
        assert f"{word} robot {robot} on host {host}" in started["a"].said()


def test_a_lab_is_shown_steered_and_ended_from_a_machine_that_is_no_host(hosts):
    started = hosts.all_up(a=("--keep-going",))

    def ask(*words):
        return hosts.ask("d", *words, *hosts.place)

    names = [line.split()[0] for line in ask("ps").stdout.splitlines()]
    assert names == [
        *("NAME", "a/launcher", "a/router", "a/world", "b/launcher", "b/robot-1", "b/robot-2", "b/robot-3"),
        *("c/launcher", "c/robot-4", "c/robot-5", "c/robot-6"),
    ]
    assert ask("kill", "4").stdout == "robot 4 is killed\n"
    assert ask("kill", "4").stderr == "rmr kill: robot 4 is dead already\n"
    gone = next(line for line in ask("ps", "-a").stdout.splitlines() if "robot-4" in line)
    assert gone.split()[:3] == ["c/robot-4", "killed", "(9)"]
    assert ask("restart", "4").stdout == "robot 4 is started again\n"
    started["c"].wait_for("robot 4 is started again")
    assert ask("fault", "stall", "1", "--for", "100ms").stdout == "robot 1 is stalled\n"
    assert ask("pause", "2,5").stdout == "robot 2 is paused\nrobot 5 is paused\n"
    assert ask("unpause", "2").stdout == "robot 2 is going on\n"  # 5 keeps the run from its end meanwhile
    assert "due(@1, " in ask("facts", "1").stdout
    assert list(json.loads(ask("config").stdout)["hosts"]) == []
    used = json.loads(ask("stats", "--once", "--json").stdout)["processes"]
    assert {row["name"] for row in used} == {*names[1:], "c/robot-4.1"} - {"c/robot-4"}
    assert all(row["cpu_s"] > 0 and row["memory_mb"] > 1 for row in used)
    assert ask("wait", "-t", "0.2").stderr == "rmr wait: lab corridor still runs after 0.2 s\n"
    assert "c/rmr up   kill robot 4" in ask("events").stdout
    for words, code, why in (
        (("kill", "9"), 2, "rmr kill: lab corridor has no robot 9: it has 1-6\n"),
        (("ps", "--lab", "hall"), 1, f"rmr ps: no lab hall runs at {hosts.place[1]}, but corridor\n"),
        (("down", "--all"), 2, "rmr down: --all goes without --run, --lab and --connect\n"),
    ):
        assert (ask(*words).returncode, ask(*words).stderr) == (code, why)
    whose = {line.split()[2] for line in ask("logs", "6").stdout.splitlines()}
    assert whose == {"c/robot-6", "a/rmr", "c/rmr"}, "what the robot writes, and what its launchers say of it"
    follows = [*hosts.network.on("d"), sys.executable, "-m", "rmr", "events", "-f", *map(str, hosts.place)]
    waits = ["wait" if word == "events" else word for word in follows if word != "-f"]
    with (
        subprocess.Popen(follows, stdout=subprocess.PIPE, text=True) as followed,
        subprocess.Popen(waits, stdout=subprocess.PIPE, text=True) as waiting,
    ):
        assert "lab corridor starts" in followed.stdout.readline()
        said = ask("down").stdout
        assert "a/rmr up   interrupted" in followed.stdout.read()
        told = waiting.stdout.read()
    assert said == f"lab corridor is down on host a, b, c; the report is on host a, in {hosts.folder / 'a'}\n"
    assert followed.returncode == 0
    assert told == f"lab corridor: interrupted; the report is on host a, in {hosts.folder / 'a'}\n"
    assert waiting.returncode == 1, "it has not finished"
    assert ended(started) == {"a": 1, "b": 1, "c": 1}
    assert hosts.report()["reason"] == "interrupted"


def test_a_host_that_is_cut_off_keeps_no_verb_waiting(hosts):
    hosts.all_up()
    hosts.network.cut("c")
    began = time.monotonic()
    shown = hosts.ask("d", "ps", *hosts.place).stdout.splitlines()
    assert "c/robot-4" in {line.split()[0] for line in shown}, "what the world's host knows of it"
    assert "c/launcher" not in {line.split()[0] for line in shown}
    refused = hosts.ask("d", "kill", "4", *hosts.place)
    assert refused.stderr == f"rmr kill: the launcher of host c does not answer at {hosts.place[1]}\n"
    assert refused.returncode == 1
    said = hosts.ask("d", "down", *hosts.place).stdout
    assert said.startswith("lab corridor is down on host a, b; host c has not said so; the report is on host a"), said
    assert time.monotonic() - began < 60


@pytest.mark.parametrize(
    ("endpoint", "why"),
    [
        ("tcp/10.77.0.1:17448", "nobody listens at tcp/10.77.0.1:17448"),
        ("tcp/10.77.0.9:17447", "nobody listens at tcp/10.77.0.9:17447"),
        ("tcp/nowhere.invalid:17447", "no world at tcp/nowhere.invalid:17447: there is no host nowhere.invalid"),
    ],
)
def test_an_endpoint_where_nobody_is_is_said_within_5_s(hosts, endpoint, why):
    began = time.monotonic()
    done = hosts.ask("d", "ps", "--connect", endpoint, "--secret", hosts.folder / "secret")
    assert (done.returncode, done.stderr) == (1, f"rmr ps: {why}\n")
    assert time.monotonic() - began < 5 + 5, "5 s, and the start of a process on a busy machine"


def test_a_host_whose_world_does_not_come_says_what_it_waited_for(hosts):
    b = hosts.up("b", "--wait-hosts", "3")
    assert b.exit_code() == 1
    where = f"tcp/{hosts.network.address('a')}:17447"
    assert f"rmr up: not ready within 3 s: no world of lab corridor answers at {where}" in b.said()


class PageHosts:
    """Four machines as the page has them, each with a folder of its own in which the commands are given."""

    def __init__(self, folder):
        self.folder = folder
        self.network = Network("abcd", ("10.0.0.5", "10.0.0.6", "10.0.0.7", "10.0.0.8"))
        self.stage = Stage(folder)
        for host in "abcd":
            (folder / host).mkdir()

    def _at(self, host):
        return [*self.network.on(host), "env", "-C", str(self.folder / host)]

    def start(self, host, command):
        return self.stage.start(*shlex.split(command), before=self._at(host))

    def run(self, host, command):
        """Carry a command out and return what it has said."""
        environment = os.environ | {"RMR_REGISTER": str(self.folder / "nothing")}
        words = [*self._at(host), sys.executable, "-m", *shlex.split(command)]
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120, env=environment)
        assert done.returncode == 0, (command, done.stderr)
        return done.stdout


@pytest.fixture
def page_hosts(tmp_path):
    if why := not_permitted():
        pytest.skip(why)
    hosts = PageHosts(tmp_path)
    yield hosts
    hosts.stage.end()
    hosts.network.remove()


def shown_as(expected, said):
    """Whether output has the form of that on the page: what differs from run to run is left out."""
    number = r"[-\d.:]+"
    changes = (r"\S*/runs/corridor-\S+", r"lineup\(.*|moveto\(.*|waiting.*", number)
    for line in expected.splitlines():
        if line == "...":
            continue
        form = " ".join(line.split())
        for change in changes:
            form = re.sub(change, "\0", form)
        form = re.escape(form).replace("\0", ".*").replace(r"\ ", r"\s+")
        if not any(re.search(form, each) for each in said.splitlines()):
            return False
    return True


def test_the_commands_of_the_page_do_what_it_says(page_hosts):
    page = (CORRIDOR.parents[2] / "docs" / "fleet.md").read_text()
    section = page[page.index("## From one machine to many") : page.index("## Faults")]
    for host in "abc":
        (page_hosts.folder / host / "hosts.yaml").write_text(re.search("```yaml\n(.*?)```", section, re.S)[1])
    commands = dict(re.findall(r"^    host (\w):  (rmr up .*)$", section, re.M))
    assert list(commands) == ["a", "b", "c"]
    started = {"a": page_hosts.start("a", commands["a"])}
    started["a"].wait_for("made a new secret: lab.secret; copy it to the other hosts")
    for host in "bcd":
        shutil.copy(page_hosts.folder / "a" / "lab.secret", page_hosts.folder / host)
    started |= {host: page_hosts.start(host, commands[host]) for host in "bc"}
    for one in started.values():
        one.wait_for("robots ready after")
    asked = re.findall(r"^\$ (rmr .*)\n((?:(?!\$ |```).*\n)*)", section, re.M)
    assert [command.split()[1] for command, _ in asked] == [
        *("ps", "kill", "restart", "fault", "logs", "events", "down")
    ]
    (listed, drives), *others = asked
    wait_until(lambda: shown_as(drives, page_hosts.run("d", listed)))  # robot 1 has begun to drive
    for command, expected in others:
        said = page_hosts.run("d", command)
        assert shown_as(expected, said), (command, expected, said)
    assert ended(started) == {"a": 1, "b": 1, "c": 1}
    told = started["a"].said()
    folders = dict(re.findall(r"^host (\w) has its recordings in (.*)$", told, re.M))
    for host in "bc":
        shutil.copytree(folders[host], page_hosts.folder / "a" / host)
    page_hosts.run("a", _expanded(page_hosts, told))
    assert list((page_hosts.folder / "a" / "runs").glob("*/joined/run.mcap"))


def _expanded(page_hosts, told):
    """Return the command that joins the recordings, with the names of the files as a shell gives them."""
    words = shlex.split(re.search("rmr record join.*", told)[0])
    here = page_hosts.folder / "a"
    return shlex.join(name for word in words for name in (sorted(map(str, here.glob(word))) if "*" in word else [word]))

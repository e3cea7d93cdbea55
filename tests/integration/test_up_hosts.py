"""`rmr up LAB --hosts F --here H` on three hosts is one lab: one report, and each command ends with the run."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from launched import CORRIDOR
from network import Network, not_permitted
from process_tools import Stage

from rmr.bus.authority import Authority, holder, write_bundle
from rmr.bus.secret import make_secret

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture
def network():
    if why := not_permitted():
        pytest.skip(why)
    network = Network("abc")
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

    def kill(self, host, robot):
        """Kill the process of a robot as a failure would."""
        pids = json.loads((self.folder / host / "processes.json").read_text())["processes"]
        os.kill(pids[f"robot-{robot}"], signal.SIGKILL)

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
    hosts.kill("c", 5)
    started["c"].wait_for("robot 5 is started again")
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    report = hosts.report()
    assert (report["finished"], report["robots"]["5"]["restarts"], report["dead"]) == (True, 1, [])


def test_a_robot_that_dies_ends_the_run_on_all_hosts(hosts):
    started = hosts.all_up()
    hosts.kill("c", 5)
    assert ended(started) == {"a": 1, "b": 1, "c": 1}
    for one in started.values():
        assert "robot 5 on host c died" in one.said()
    report = hosts.report()
    assert (report["finished"], report["dead"], report["reason"]) == (False, [5], "robot 5 on host c died")


def test_a_host_that_is_cut_off_for_2_s_comes_back(hosts):
    started = hosts.all_up()
    hosts.network.cut("c")
    time.sleep(2.0)
    hosts.network.heal("c")
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    assert hosts.report()["collisions"] == 0


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
    for who in (holder("operator", "ann"), *(holder("robot", str(robot)) for robot in range(1, 7))):
        ca.issue(who)
    ca.issue(holder("world"), [hosts.network.address("a")])
    for host, own in robots.items():
        (hosts.folder / f"keys-{host}").mkdir(0o700)
        write_bundle(ca.bundle(holder("operator", "ann")), hosts.folder / f"keys-{host}" / "operator")
        for robot in own:
            write_bundle(ca.bundle(holder("robot", str(robot))), hosts.folder / f"keys-{host}" / f"robot-{robot}")
    keys = {"a": hosts.folder / "ca", "b": hosts.folder / "keys-b", "c": hosts.folder / "keys-c"}
    started = {host: hosts.up(host, lab=lab, admission=("--keys", folder)) for host, folder in keys.items()}
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, [one.said() for one in started.values()]
    assert (hosts.report()["finished"], hosts.report()["dead"]) == (True, [])


def test_a_robot_is_shown_and_steered_from_every_host(hosts):
    started = hosts.all_up()

    def ask(host, *words):
        command = [*hosts.network.on(host), sys.executable, "-m", "rmr", *words, "--run", hosts.folder / host]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)

    shown = ask("a", "ps").stdout
    assert [line.split()[0] for line in shown.splitlines()[3:]] == [f"{'bc'[n > 3]}/robot-{n}" for n in range(1, 7)]
    assert [line.split()[0] for line in ask("b", "ps").stdout.splitlines()[5:]] == [f"c/robot-{n}" for n in (4, 5, 6)]
    assert ask("a", "kill", "4").stdout == "robot 4 is killed\n"
    assert ask("a", "kill", "4").stderr == "rmr kill: robot 4 is dead already\n"
    assert "kill robot 4" in ask("c", "events").stdout
    assert ask("b", "restart", "4").stdout == "robot 4 is started again\n"
    started["c"].wait_for("robot 4 is started again")
    assert ask("c", "pause", "1").stdout == "robot 1 is paused\n"
    assert ask("a", "unpause", "1").stdout == "robot 1 is going on\n"
    assert ended(started) == {"a": 0, "b": 0, "c": 0}, started["a"].said()
    assert hosts.report()["robots"]["4"]["restarts"] == 1


def test_a_host_whose_world_does_not_come_says_what_it_waited_for(hosts):
    b = hosts.up("b", "--wait-hosts", "3")
    assert b.exit_code() == 1
    where = f"tcp/{hosts.network.address('a')}:17447"
    assert f"rmr up: not ready within 3 s: no world of lab corridor answers at {where}" in b.said()

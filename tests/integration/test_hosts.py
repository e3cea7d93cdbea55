"""Several hosts: network namespaces with cables that can be pulled. The world runs on a, robots on b and c.

Either the world is the router for all of them, or each host has a router of its own, those of b and c joined to that of
a, and its processes know no other.
"""

import os
import signal
import subprocess
import sys
import time

import pytest
from launched import CORRIDOR
from network import Network, not_permitted
from process_tools import PATIENCE_S, Stage

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source

pytestmark = pytest.mark.slow

OWN = "tcp/127.0.0.1:17447"
"""Where the router of a host is for the processes there."""

CUT_S = 10.0
"""How long the cable is out: longer than the lease of a connection and the time after which a full one is closed."""


@pytest.fixture
def network():
    if why := not_permitted():
        pytest.skip(why)
    network = Network("abc")
    yield network
    network.remove()


@pytest.fixture
def stage(tmp_path, network):
    stage = Stage(tmp_path, f"tcp/{network.address('a')}:17447")
    program = compile_source((CORRIDOR / "corridor.rmr").read_text()).program
    assert program is not None
    (tmp_path / "corridor.rbc").write_bytes(codec.encode(program, debug=False))
    yield stage
    stage.end()


def test_robots_of_a_host_keep_their_world_while_another_host_is_cut_off(network, stage):
    listen = ("--listen", "tcp/0.0.0.0:17447", "--open", "--when-ready")
    world = stage.start("rmr_world.main", "--config", CORRIDOR, *listen, before=network.on("a"))
    agents = {
        robot: stage.agent(robot, program="corridor.rbc", before=network.on("b" if robot <= 3 else "c"))
        for robot in range(1, 7)
    }
    world.wait_for("lab time runs")
    time.sleep(3.0)  # robots drive and talk: what c misses fills the router's queues
    network.cut("c")
    time.sleep(CUT_S)
    network.heal("c")
    for robot in (4, 5, 6):
        agents[robot].wait_for("the world is back")
    for robot in (1, 2, 3):
        assert "lost" not in agents[robot].said()


class Joined:
    """Hosts with a router each under one secret, the world on a and three robots each on b and c, driving."""

    def __init__(self, stage, network):
        self._stage = stage
        self._network = network
        self._secret = ("--secret", stage.folder / "secret")
        self.routers = {"a": self.router("a")}
        self.routers["a"].wait_for("a router at")  # it makes the secret
        self.routers |= {host: self.router(host) for host in "bc"}
        own = ("--connect", OWN, *self._secret)
        world = stage.start("rmr_world.main", "--config", CORRIDOR, "--when-ready", *own, before=network.on("a"))
        program = stage.folder / "corridor.rbc"
        self.robots = {
            host: [
                stage.start("rmr_agent.main", "--id", robot, program, *own, before=network.on(host)) for robot in robots
            ]
            for host, robots in (("b", (1, 2, 3)), ("c", (4, 5, 6)))
        }
        world.wait_for("lab time runs")

    def router(self, host):
        """Start the router of `host`."""
        others = () if host == "a" else ("--connect", f"tcp/{self._network.address('a')}:17447")
        words = ("--listen", "tcp/0.0.0.0:17447", *self._secret, *others)
        return self._stage.start("rmr_deploy.router", *words, before=self._network.on(host))

    def ask(self, host, *words):
        """Return how a command on `host` ended that connects to the router there."""
        command = [*self._network.on(host), sys.executable, "-m", *words, "--connect", OWN, *map(str, self._secret)]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)


def test_robots_of_a_host_keep_their_world_while_another_host_with_its_router_is_cut_off(network, stage):
    joined = Joined(stage, network)
    listed = joined.ask("b", "rmr_deploy.fault", "list")
    assert (listed.returncode, listed.stderr) == (0, "")
    network.cut("c")
    joined.routers["c"].wait_for("lost the router at")
    time.sleep(CUT_S)
    network.heal("c")
    joined.routers["c"].wait_for("joined the router at", times=2)
    for robot in joined.robots["c"]:
        robot.wait_for("the world is back")
    for robot in joined.robots["b"]:
        assert "lost" not in robot.said()


def test_robots_of_a_host_keep_their_world_while_the_router_of_another_is_killed_and_started_again(network, stage):
    joined = Joined(stage, network)
    joined.routers["c"].send(signal.SIGKILL)
    joined.routers["c"].exit_code()
    for robot in joined.robots["c"]:
        robot.wait_for("lost")
    again = joined.router("c")
    for robot in joined.robots["c"]:
        robot.wait_for("the world is back")
    again.wait_for("connected: 1 router, 3 processes")
    for robot in joined.robots["b"]:
        assert "lost" not in robot.said()
    again.send(signal.SIGTERM)
    assert again.exit_code() == 0


def test_all_robots_find_the_world_again_when_the_router_that_joins_the_hosts_is_killed_and_started_again(
    network, stage
):
    joined = Joined(stage, network)
    joined.routers["a"].send(signal.SIGKILL)
    joined.routers["a"].exit_code()
    robots = [*joined.robots["b"], *joined.robots["c"]]
    for robot in robots:
        robot.wait_for("lost")
    joined.router("a").wait_for("connected: 2 routers, 1 process")
    for robot in robots:
        robot.wait_for("the world is back")


def test_hosts_leave_nothing_behind(network):
    network.remove()
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert f"rmr-{os.getpid()}-" not in left

"""Several hosts: network namespaces with cables that can be pulled. The world runs on a, robots on b and c."""

import os
import subprocess
import time

import pytest
from launched import CORRIDOR
from network import Network, not_permitted
from process_tools import Stage

from rmr.bytecode import codec
from rmr.lang.compiler import compile_source

pytestmark = pytest.mark.slow

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


def test_hosts_leave_nothing_behind(network):
    network.remove()
    left = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout
    assert f"rmr-{os.getpid()}-" not in left

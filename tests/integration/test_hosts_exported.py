"""What `rmr export systemd` writes for three hosts starts one lab: its commands, each on its host, make one report.

Routers and robots have no packages there but those of the image that deploy/Dockerfile makes for them.
"""

import json
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from network import Network, not_permitted
from process_tools import Stage

from rmr.bus.secret import make_secret

pytestmark = pytest.mark.slow

MODULES = {"rmr": "rmr", "rmr-world": "rmr_world.main", "rmr-agent": "rmr_agent.main"}


ROOT = Path(__file__).parents[2]


def missing_in_the_image():
    """Return the modules of packages that RMR depends on, and the image of robots does not have."""
    image = (ROOT / "deploy" / "Dockerfile").read_text()
    install = re.search("pip install .*versions.txt (.*) eclipse-zenoh (.*)", image)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    depends = project["dependencies"] + project["optional-dependencies"]["keys"]
    there = {"eclipse-zenoh", *install[1].split(), *install[2].split()}
    names = {re.match("[A-Za-z0-9.-]+", each)[0].lower() for each in depends}
    assert there < names
    found = packages_distributions().items()
    return sorted(module for module, of in found if {each.lower() for each in of} & (names - there))


@pytest.fixture
def network():
    if why := not_permitted():
        pytest.skip(why)
    network = Network("abc")
    yield network
    network.remove()


def command_of(unit, folders):
    """Return what a unit starts, as words after `python -m`, with its folders where the test has them."""
    (line,) = [line for line in unit.read_text().splitlines() if line.startswith("ExecStart=")]
    for folder, here in folders.items():
        line = line.replace(folder, str(here))
    program, *words = shlex.split(line.removeprefix("ExecStart="))
    return [MODULES[Path(program).name], *words]


def run(*words, before=()):
    command = [*before, sys.executable, "-m", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=240)


@pytest.mark.timeout(300)
def test_the_units_of_three_hosts_make_one_lab(tmp_path, network):
    hosts = tmp_path / "hosts.yaml"
    hosts.write_text(
        f"hosts:\n  a: {{address: {network.address('a')}, world: true}}\n  b: {{robots: 1-3}}\n  c: {{robots: 4-6}}\n"
    )
    out = tmp_path / "out"
    exported = run("rmr", "export", "systemd", "corridor", "--hosts", hosts, "-o", out)
    assert exported.returncode == 0, exported.stderr
    make_secret(tmp_path / "secret")
    folders = {
        "/etc/rmr-corridor/lab": out / "lab",
        "/etc/rmr-corridor/secret": tmp_path / "secret",
        "/var/lib/rmr-corridor": tmp_path,
    }
    stage = Stage(tmp_path)
    missing = missing_in_the_image()
    assert {"numpy", "pydantic", "pymunk", "starlette"} <= set(missing)
    (tmp_path / "image").mkdir()
    barred = f"import sys\nsys.modules |= dict.fromkeys({missing})\n"
    (tmp_path / "image" / "sitecustomize.py").write_text(barred)
    try:
        for host in "abc":
            for unit in sorted((out / host).glob("*.service")):
                image = [] if "world" in unit.name else ["env", f"PYTHONPATH={tmp_path / 'image'}"]
                stage.start(*command_of(unit, folders), before=[*network.on(host), *image])
        endpoint = ("--connect", "tcp/127.0.0.1:17447", "--secret", tmp_path / "secret")
        watched = run("rmr", "attach", "corridor", *endpoint, "--json", "-t", 120, before=network.on("c"))
        assert watched.returncode == 0, watched.stderr
        assert sorted(json.loads(watched.stdout)["robots"], key=int) == list("123456")
        for process in stage.started:
            process.send(signal.SIGTERM)
        assert [process.exit_code() for process in stage.started] == [0] * 10
    finally:
        stage.end()
    joined = run("rmr", "record", "join", *sorted(tmp_path.glob("*.mcap")), "-o", tmp_path / "run")
    assert joined.returncode == 0, joined.stderr
    assert (tmp_path / "run" / "run.mcap").exists()

"""`rmr export`: the same octets from the same input, what they start, and what engines say of them."""

import configparser
import os
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from command_runner import invoke
from PIL import Image

from rmr_deploy.export import command, exec_start

GOLDEN = Path(__file__).parent / "exported"
HOSTS = """\
hosts:
  a: {address: 10.0.0.5, world: true}
  b: {robots: 1-3}
  c: {robots: 4-6, router: false}
"""


def export(tmp_path, engine, *options, hosts=HOSTS, lab="corridor", out="out"):
    file = tmp_path / "hosts.yaml"
    file.write_text(hosts)
    words = [engine, lab, "--hosts", str(file), "-o", str(tmp_path / out), *options]
    return invoke(command(), words)


def files(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("engine", ["systemd", "compose"])
def test_the_same_input_gives_the_kept_octets(tmp_path, engine):
    assert export(tmp_path, engine).exit_code == 0
    assert export(tmp_path, engine, out="again").exit_code == 0
    found = files(tmp_path / "out")
    assert found == files(tmp_path / "again")
    of_hosts = {name: text for name, text in found.items() if not name.startswith("lab/")}
    if os.environ.get("RMR_REWRITE"):
        for name, text in of_hosts.items():
            path = GOLDEN / engine / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(text)
    assert of_hosts == files(GOLDEN / engine)
    assert sorted(name for name in found if name.startswith("lab/")) == ["lab/lab.yaml", "lab/program.rbc"]


def test_the_lab_has_its_map_with_the_image_and_the_programs_of_its_loads(tmp_path):
    folder = tmp_path / "own"
    (folder / "floor").mkdir(parents=True)
    for name in ("work.rmr", "next.rmr"):
        (folder / name).write_text("done(R).\n")
    (folder / "floor" / "map.yaml").write_text("{image: floor.png, resolution: 0.05}")
    Image.new("L", (20, 20), 255).save(folder / "floor" / "floor.png")
    (folder / "lab.yaml").write_text(
        "{lab: own, program: work.rmr, duration: 2s, arena: {size: [1, 1]}, map: floor/map.yaml,"
        " robots: [{id: 1, pose: [0.5, 0.5, 0deg]}], loads: [{at: 1s, program: next.rmr}]}"
    )
    hosts = "hosts:\n  a: {world: true, robots: 1}\n"
    assert export(tmp_path, "systemd", "--open", hosts=hosts, lab=str(folder)).exit_code == 0
    assert sorted(name for name in files(tmp_path / "out") if name.startswith("lab/")) == [
        "lab/floor/floor.png",
        "lab/floor/map.yaml",
        "lab/lab.yaml",
        "lab/next.rmr",
        "lab/program.rbc",
    ]


def test_units_start_the_commands_of_a_host(tmp_path):
    export(tmp_path, "systemd")
    started = {}
    for path in (tmp_path / "out").glob("*/*.service"):
        unit = configparser.ConfigParser(strict=False, interpolation=None)
        unit.optionxform = str
        unit.read_string(path.read_text())
        assert unit["Service"]["User"] == "rmr"
        assert unit["Service"]["ProtectSystem"] == "strict"
        started[f"{path.parent.name}/{path.stem.removeprefix('rmr-corridor-')}"] = unit["Service"]["ExecStart"]
    robots = [f"b/robot-{robot}" for robot in (1, 2, 3)] + [f"c/robot-{robot}" for robot in (4, 5, 6)]
    assert sorted(started) == ["a/router", "a/world", *robots[:3], "b/router", *robots[3:]]
    secret = "--secret /etc/rmr-corridor/secret"
    assert started["a/router"] == f"/opt/rmr/bin/rmr router --listen tcp/0.0.0.0:17447 {secret}"
    assert started["b/router"].endswith(f"--listen tcp/127.0.0.1:17447 --connect tcp/10.0.0.5:17447 {secret}")
    assert "--connect tcp/127.0.0.1:17447" in started["b/robot-1"]
    assert "--connect tcp/10.0.0.5:17447" in started["c/robot-4"]


def test_services_are_not_root_and_read_only(tmp_path):
    export(tmp_path, "compose")
    for path in (tmp_path / "out").glob("*/compose.yaml"):
        for name, service in yaml.safe_load(path.read_text())["services"].items():
            assert (service["user"], service["read_only"], service["cap_drop"]) == ("10001:10001", True, ["ALL"])
            assert service["healthcheck"]["test"][0] == "CMD"
            assert ("ports" in service) == (path.parent.name == "a" and name == "router")


def test_without_a_secret_a_listener_is_open_on_purpose(tmp_path):
    export(tmp_path, "systemd", "--open")
    text = (tmp_path / "out" / "a" / "rmr-corridor-router.service").read_text()
    assert "--listen tcp/0.0.0.0:17447 --open\n" in text
    assert "--open" not in (tmp_path / "out" / "b" / "rmr-corridor-router.service").read_text()


def test_what_cannot_be_exported_is_told(tmp_path):
    done = export(tmp_path, "systemd", hosts="hosts:\n  a: {world: true}\n")
    assert (done.exit_code, "robots 1-6 are on no host" in done.stderr) == (3, True)
    done = invoke(command(), ["compose", "corridor", "-o", str(tmp_path / "none")])
    assert (done.exit_code, "has no hosts: name a file that has with --hosts FILE" in done.stderr) == (2, True)
    done = export(tmp_path, "compose", out=".")
    assert (done.exit_code, "is there already and not empty" in done.stderr) == (2, True)
    done = export(tmp_path, "compose", hosts=HOSTS.replace("b:", "lab:"))
    assert (done.exit_code, "a host cannot have the name lab" in done.stderr) == (2, True)
    done = export(tmp_path, "systemd", hosts=HOSTS.replace("10.0.0.5", "127.0.0.1"))
    assert (done.exit_code, "no other host reaches a at 127.0.0.1" in done.stderr) == (2, True)


def test_a_router_in_a_container_is_reached_by_its_machine(tmp_path):
    """What listens at a container's own loopback is reached by nobody."""
    alone = "hosts:\n  a: {address: 127.0.0.1, world: true, robots: 1-6}\n"
    assert export(tmp_path, "compose", "--open", hosts=alone).exit_code == 0
    router = yaml.safe_load((tmp_path / "out" / "a" / "compose.yaml").read_text())["services"]["router"]
    assert router["command"] == ["rmr", "router", "--listen", "tcp/0.0.0.0:17447", "--open"]
    assert router["ports"] == ["127.0.0.1:17447:17447"]


def test_what_rmr_up_carries_out_itself_is_said_to_be_left_out(tmp_path):
    lab = tmp_path / "faulty"
    shutil.copytree(Path(__file__).parents[3] / "deploy" / "labs" / "corridor", lab)
    with (lab / "lab.yaml").open("a") as file:
        file.write("faults: [{kill: 2, at: 5s}]\n")
    assert "are left out: rmr load and rmr fault carry them out" in export(tmp_path, "systemd", lab=str(lab)).stdout
    assert "left out" not in export(tmp_path, "systemd", out="sound").stdout


def test_words_of_commands_are_quoted_as_units_read_them():
    assert exec_start(["a", "b c", "$X", "50%", "back\\"]) == "a 'b c' '$$X' 50%% 'back\\\\'"


def complaints(units):
    words = ["systemd-analyze", "verify", "--man=no", *map(str, units)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return [line for line in done.stderr.splitlines() if "rmr-corridor" in line]


@pytest.mark.real
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze")
def test_systemd_verifies_the_units(tmp_path):
    export(tmp_path, "systemd")
    for path in (tmp_path / "out").glob("*/*.service"):  # it wants programs that are there
        path.write_text(path.read_text().replace("/opt/rmr/bin/", "/bin/true "))
    broken = tmp_path / "rmr-corridor-broken.service"
    broken.write_text("[Service]\nExecStrat=/bin/true\n")
    assert complaints([broken])
    for host in "abc":
        units = sorted((tmp_path / "out" / host).iterdir())
        assert complaints(units) == []

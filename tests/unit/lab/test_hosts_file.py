"""Files that say which host has what: what they mean, and each mistake with its place."""

import json
from pathlib import Path

import pytest
from command_runner import invoke

from rmr_lab.main import check as command
from rmr_world.finding import LabError
from rmr_world.hosts import hub, read_hosts
from rmr_world.lab import LabHost
from rmr_world.lab_file import load_lab

LABS = Path(__file__).parents[3] / "deploy" / "labs"
CORRIDOR = load_lab(LABS / "corridor")
GOOD = """\
hosts:
  a: {address: 10.0.0.5, world: true, port: 7000}
  b: {robots: 1-3}
  c: {address: "fd00::7", robots: [6, 4, 5], router: false}
  relay: {router: true}
"""


def read(tmp_path, text, lab=CORRIDOR):
    file = tmp_path / "hosts.yaml"
    file.write_text(text)
    return read_hosts(file, lab)


def wrong(tmp_path, text, lab=CORRIDOR):
    with pytest.raises(LabError) as caught:
        read(tmp_path, text, lab)
    return str(caught.value).replace(f"{tmp_path}/", "")


def test_a_file_says_who_has_what(tmp_path):
    hosts = read(tmp_path, GOOD)
    assert hosts == (
        LabHost("a", "10.0.0.5", 7000, True, True, ()),
        LabHost("b", "b", 17447, False, True, (1, 2, 3)),
        LabHost("c", "fd00::7", 17447, False, False, (4, 5, 6)),
        LabHost("relay", "relay", 17447, False, True, ()),
    )
    assert hub(hosts).endpoint("tls") == "tls/10.0.0.5:7000"
    assert hosts[2].endpoint("tcp") == "tcp/[fd00::7]:17447"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "hosts:\n  a: {world: true, robots: 1-4}\n  b: {robots: 4-6}\n",
            "hosts.yaml:3:15: hosts.b.robots: robot 4 is on host a already (line 2)",
        ),
        (
            "hosts:\n  a: {world: true, robots: [1, 2, 2, 3, 4, 5, 6]}\n",
            "hosts.yaml:2:28: hosts.a.robots: robot 2 is listed twice",
        ),
        (
            'hosts:\n  a: {world: true, robots: "1-6,2"}\n',
            "hosts.yaml:2:28: hosts.a.robots: robot 2 is listed twice",
        ),
        (
            "hosts:\n  a: {world: true, robots: 1-4}\n",
            "hosts.yaml:1:1: hosts: robots 5-6 are on no host: add robots to one of them",
        ),
        (
            "hosts:\n  a: {world: true, robots: 1-7}\n",
            "hosts.yaml:2:28: hosts.a.robots: robot 7 is not in lab corridor, which has 1-6",
        ),
        (
            "hosts:\n  a: {world: true}\n  b: {world: true, robots: 1-6}\n",
            "hosts.yaml:3:14: hosts.b.world: host a has the world already (line 2): a lab has one",
        ),
        (
            "hosts:\n  a: {robots: 1-6}\n",
            "hosts.yaml:1:1: hosts: no host has the world: give one of them world: true",
        ),
        (
            "hosts:\n  a: {world: true, robots: 1-6, router: false}\n",
            "hosts.yaml:2:41: hosts.a.router: the host with the world has the router that joins the others",
        ),
        (
            "hosts:\n  a: {world: true, robots: 1-6}\n  b: {}\n",
            "hosts.yaml:3:6: hosts.b: has nothing to do",
        ),
        (
            "hosts:\n  a: {world: true, robots: 1-5}\n  b: {address: a, robots: 6}\n",
            "hosts.yaml:3:16: hosts.b.address: the router of host a is at a:17447 already",
        ),
        (
            "hosts:\n  a: {world: true, robots: 1-5}\n  b: {router: false, port: 7000, robots: 6}\n",
            "hosts.yaml:3:28: hosts.b.port: is that of the router, which this host does not have",
        ),
        (
            "hosts:\n  a: {world: true, robot: 1-6}\n",
            "hosts.yaml:2:20: hosts.a.robot: unknown key; did you mean 'robots'?",
        ),
        ("host:\n  a: {}\n", "hosts.yaml:1:1: host: unknown key; did you mean 'hosts'?"),
        ("hosts: {}\n", "hosts.yaml:1:8: hosts: "),
        ("- a\n", "hosts.yaml:1:1: should be a mapping with the key hosts"),
        ("", "hosts.yaml:1:1: is empty"),
        ("hosts:\n  A: {world: true, robots: 1-6}\n", "hosts.yaml:2:3: hosts.A: should be small letters, digits and -"),
        (
            "hosts:\n  a: {address: tcp/b, world: true, robots: 1-6}\n",
            "hosts.yaml:2:16: hosts.a.address: should be the name or the IP address of a host, without protocol",
        ),
        ("hosts:\n  a: {port: 70000, world: true, robots: 1-6}\n", "hosts.yaml:2:13: hosts.a.port: "),
        ("hosts:\n  a: {world: 'yes', robots: 1-6}\n", "hosts.yaml:2:14: hosts.a.world: "),
        ("hosts:\n  a: {world: true, robots: 6-1}\n", "hosts.yaml:2:28: hosts.a.robots: the range 6-1 ends before"),
        ("hosts:\n  a: {world: true\n", "hosts.yaml:3:1: not YAML"),
    ],
)
def test_each_mistake_has_its_place(tmp_path, text, message):
    assert message in wrong(tmp_path, text)


def test_all_mistakes_are_told_at_once(tmp_path):
    said = wrong(tmp_path, "hosts:\n  a: {robots: 1-4}\n  b: {robots: 4-5}\n  c: {}\n")
    assert [line.split(":")[1] for line in said.splitlines()] == ["1", "1", "3", "4"]


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(LabError, match=r"none\.yaml: cannot be read"):
        read_hosts(tmp_path / "none.yaml", CORRIDOR)


def lab_with(tmp_path, hosts):
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "corridor.rmr").write_text((LABS / "corridor" / "corridor.rmr").read_text())
    text = (LABS / "corridor" / "lab.yaml").read_text()
    (folder / "lab.yaml").write_text(f"{text}{hosts}")
    return folder, len(text.splitlines())


def test_a_lab_file_may_have_its_hosts(tmp_path):
    folder, _ = lab_with(tmp_path, GOOD)
    assert load_lab(folder).hosts == read(tmp_path, GOOD)
    assert CORRIDOR.hosts == ()


def test_hosts_of_a_lab_file_are_checked_with_it(tmp_path):
    folder, lines = lab_with(tmp_path, "hosts:\n  a: {world: true, robots: 1-5}\n")
    with pytest.raises(LabError, match=f"lab.yaml:{lines + 1}:1: hosts: robot 6 is on no host"):
        load_lab(folder)


def checked(*words):
    return invoke(command, [*map(str, words)])


def test_rmr_check_reads_hosts_with_the_lab(tmp_path):
    file = tmp_path / "hosts.yaml"
    file.write_text(GOOD)
    done = checked(LABS / "corridor", "--hosts", file)
    assert (done.exit_code, "6 robots" in done.stderr) == (0, True)
    file.write_text("hosts:\n  a: {world: true}\n")
    done = checked(LABS / "corridor", "--hosts", file)
    assert done.exit_code == 3
    assert f"{file}:1:1: error: hosts: robots 1-6 are on no host" in done.stderr
    done = checked(LABS / "corridor", "--hosts", file, "--json")
    assert [each["line"] for each in json.loads(done.stdout)["diagnostics"]] == [1]
    assert checked(LABS / "corridor", "--hosts", tmp_path / "none.yaml").exit_code == 2


def test_hosts_go_with_one_lab(tmp_path):
    done = checked(LABS / "corridor", LABS / "dock", "--hosts", tmp_path / "h")
    assert done.exit_code == 2
    assert "--hosts goes with one lab" in done.stderr

"""`rmr doctor`: what is missing is told with the commands that want it and what mends it."""

import json
import re
import shutil
import socket
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from command_runner import invoke

from rmr import __version__
from rmr.entry import JSON_VERSION
from rmr_deploy import doctor
from rmr_deploy.doctor import EXTRAS, PROGRAMS, USES, checks, command

pytestmark = pytest.mark.real  # it tries a port
PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]


@pytest.fixture
def installed(monkeypatch):
    """Let the distribution be as pyproject.toml says, with everything there; return a dict of other versions."""
    versions = {}
    declared = [
        *PROJECT["dependencies"],
        *(f"{each}; extra == '{name}'" for name, of in PROJECT["optional-dependencies"].items() for each in of),
    ]

    def version(name):
        if versions.get(name, "99") is None:
            raise metadata.PackageNotFoundError(name)
        return versions.get(name, "99")

    monkeypatch.setattr(metadata, "requires", lambda _: declared)
    monkeypatch.setattr(metadata, "version", version)
    return versions


def by_name():
    return {each.name: each for each in checks()}


def test_each_library_and_each_extra_has_its_use(installed):
    assert set(USES) == {re.match(r"[\w.-]+", each)[0].lower() for each in PROJECT["dependencies"]}
    assert set(EXTRAS) == set(PROJECT["optional-dependencies"])


def test_a_machine_with_everything_lacks_nothing(installed):
    answer = invoke(command)
    assert (answer.exit_code, answer.stderr) == (0, "")
    assert f"ok       libraries   all {len(PROJECT['dependencies'])}; eclipse-zenoh 99\n" in answer.stdout
    assert answer.stdout.endswith(f"rmr-robots {__version__}: nothing missing that commands need\n")


def test_a_missing_and_an_old_library_are_told_with_their_commands_and_what_mends_it(installed):
    installed |= {"eclipse-zenoh": None, "lark": "1.1.9", "pymunk": "7.0.0"}
    answer = invoke(command)
    assert answer.exit_code == 1
    lines = answer.stdout.splitlines()
    where = lines.index("LACKS    eclipse-zenoh  no eclipse-zenoh")
    assert lines[where + 1].split("for ", 1)[1] == f"{USES['eclipse-zenoh']}: pip install 'eclipse-zenoh>=1.4'"
    assert "LACKS    lark           lark 1.1.9, older than 1.2" in lines
    assert not any("libraries" in line or "pymunk" in line for line in lines)
    assert lines[-1] == f"rmr-robots {__version__}: 2 missing that commands need"


def test_a_missing_extra_is_no_failure(installed):
    installed["pygls"] = None
    answer = invoke(command)
    assert answer.exit_code == 0
    assert "without  editor      no pygls\n" in answer.stdout
    assert by_name()["editor"].mend == "pip install -e '.[editor]'"


def test_a_wheel_is_asked_for_the_extras_of_users_alone(installed, monkeypatch, tmp_path):
    monkeypatch.setattr(doctor, "CLONE", tmp_path)
    installed |= {"pygls": None, "pytest": None}
    found = by_name()
    assert found["editor"].mend == "pip install 'rmr-robots[editor]'"
    assert {"cluster", "editor", "foxglove", "keys", "maps", "plot", "ros2"} == found.keys() & EXTRAS.keys()


def test_a_tree_that_is_not_installed_says_so(monkeypatch):
    def requires(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", requires)
    found = by_name()["libraries"]
    assert (found.found, found.holds, found.mend) == (False, "rmr-robots is not installed", "pip install rmr-robots")


def test_a_port_in_use_a_program_and_rights_that_are_not_there_are_told(monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = taken.getsockname()[1]
        monkeypatch.setattr("rmr.bus.endpoint.DEFAULT_PORT", number)
        found = by_name()
    assert all(not found[name].found and found[name].mend for name in (*PROGRAMS, "ip netns"))
    port = found[f"port {number}"]
    assert (port.found, port.needed) == (False, False)
    assert port.holds.startswith("in use")


def test_a_register_that_others_may_write_is_lacking(monkeypatch, tmp_path):
    (tmp_path / "register").mkdir()
    (tmp_path / "register").chmod(0o777)
    monkeypatch.setenv("RMR_REGISTER", str(tmp_path / "register"))
    answer = invoke(command)
    assert answer.exit_code == 1
    assert re.search("LACKS    register +no folder that is this user's alone", answer.stdout)
    assert "name a folder of yours in RMR_REGISTER" in answer.stdout


def test_json_has_what_the_table_has():
    answer = invoke(command, ["--json"])
    told = json.loads(answer.stdout)
    assert list(told)[:3] == ["version", "release", "complete"]
    assert (told["version"], told["release"], told["complete"]) == (JSON_VERSION, __version__, answer.exit_code == 0)
    names = [each["name"] for each in told["checks"]]
    assert names == [line[9:].split("  ")[0] for line in invoke(command).stdout.splitlines()[:-1] if line[0] != " "]

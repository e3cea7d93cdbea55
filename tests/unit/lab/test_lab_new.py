"""`rmr new`, `rmr lab list`, `copy` and `schema`: files of one's own that run at once, and are never overwritten."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from command_runner import invoke
from packaging.requirements import Requirement

from rmr import __version__
from rmr_lab.lab_check import check
from rmr_lab.lab_folders import HEADER, LAB_NAME, SCHEMA_FILE
from rmr_lab.main import command, new
from rmr_sim.run_setup import prepare
from rmr_world import schema
from rmr_world.provided_labs import labs_folder, provided_labs, resolve


def run(group, *words):
    result = invoke(group, list(map(str, words)))
    assert result.exception is None or isinstance(result.exception, SystemExit)
    return result


@pytest.mark.medium
def test_new_lab_is_whole_has_no_findings_and_finishes(tmp_path):
    folder = tmp_path / "shop"
    result = run(new, folder)
    assert result.exit_code == 0
    names = {"README.md", "actions.py", "lab.schema.json", "lab.yaml", "shop.rmr", "test_shop.py"}
    assert {file.name for file in folder.iterdir()} == names | {".github", ".gitlab-ci.yml"}
    assert (folder / "lab.yaml").read_text().startswith(HEADER)
    assert check(folder).severities == []
    for seed in (1, 2, 3):
        simulation = prepare(folder, seed=seed)
        assert simulation.run()
        assert simulation.world.collisions == 0
        assert simulation.violations == []


def test_new_lab_has_a_test_that_runs_it(tmp_path):
    run(new, tmp_path / "my-shop")
    text = (tmp_path / "my-shop" / "test_my_shop.py").read_text()
    assert 'run = rmr_sim("lab.yaml", seed=1)' in text
    compile(text, "test_my_shop.py", "exec")


@pytest.mark.medium
def test_python_files_of_a_new_lab_pass_mypy_strict(tmp_path):
    run(new, tmp_path / "depot")
    words = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), "."]
    answer = subprocess.run(words, cwd=tmp_path / "depot", capture_output=True, text=True, check=False)
    assert answer.stdout == "Success: no issues found in 2 source files\n"


def jobs(folder):
    """Return the variables and the commands of both CI files."""
    github = yaml.load((folder / ".github" / "workflows" / "lab.yml").read_text(), yaml.BaseLoader)
    gitlab = yaml.load((folder / ".gitlab-ci.yml").read_text(), yaml.BaseLoader)
    assert github.keys() == {"name", "on", "permissions", "env", "jobs"}
    steps = github["jobs"]["lab"]["steps"]
    assert all(("uses" in step) != ("run" in step) for step in steps)
    yield github["env"], [step["run"] for step in steps if "run" in step]
    yield gitlab["lab"]["variables"], gitlab["lab"]["script"]


def test_both_files_for_a_ci_install_this_version_and_do_the_same(tmp_path):
    run(new, tmp_path / "shop")
    first, second = jobs(tmp_path / "shop")
    assert first == second
    assert first[0] == {"LAB": "."}
    [named] = re.findall("'(rmr-robots~=.*?)'", first[1][0])
    assert Requirement(named).specifier.contains(__version__)
    assert not Requirement(named).specifier.contains(f"{int(__version__.split('.')[0]) + 1}.0.0")


@pytest.mark.medium
def test_what_a_ci_does_passes_in_the_new_folder_and_fails_where_the_lab_does(tmp_path):
    folder = tmp_path / "my-shop"
    run(new, folder)
    (variables, [_, *commands]), _ = jobs(folder)
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, **variables, "PATH": path}

    def done(command, at, **more):
        words = ["sh", "-e", "-c", command]
        return subprocess.run(words, cwd=at, env=environment | more, capture_output=True, text=True, check=False)

    for each in commands:
        answer = done(each, folder)
        assert answer.returncode == 0, (each, answer.stdout, answer.stderr)
    assert "20 of 20 runs" in answer.stderr
    assert done(commands[0], tmp_path, LAB="my-shop").returncode == 0, "from the root of a larger repository"
    file = folder / "lab.yaml"
    file.write_text(re.sub("(?m)^duration: .*$", "duration: 2s", file.read_text()))
    assert [done(each, folder).returncode for each in commands[1:]] == [1, 1]
    file.write_text(file.read_text().replace("program: ", "program: no-"))
    assert done(commands[0], folder).returncode != 0


def test_readme_of_a_new_lab_names_its_files_and_has_about_ten_lines(tmp_path):
    run(new, tmp_path / "shop")
    lines = (tmp_path / "shop" / "README.md").read_text().splitlines()
    assert len(lines) <= 12
    assert "`shop.rmr`" in "\n".join(lines)


def test_new_lab_never_overwrites(tmp_path):
    (tmp_path / "shop").mkdir()
    result = run(new, tmp_path / "shop")
    assert result.exit_code == 2
    assert "is there already, and nothing is ever overwritten" in result.output
    assert list((tmp_path / "shop").iterdir()) == []


@pytest.mark.parametrize("name", ["My Shop", "2nd", "Shop", "a" * 65, "sh$p"])
def test_invalid_lab_name_is_reported(tmp_path, name):
    result = run(new, tmp_path / name)
    assert result.exit_code == 2
    assert "cannot be the name of a lab: small letters, digits, _ and -, a letter first" in result.output
    assert list(tmp_path.iterdir()) == []


def test_name_of_a_new_lab_is_what_the_lab_file_accepts():
    assert f"^{LAB_NAME.pattern}$" == schema.LAB_NAME


@pytest.mark.parametrize("name", sorted(provided_labs()))
def test_copy_of_a_provided_lab_has_its_program_beside_it_and_no_findings(tmp_path, name):
    result = run(command, "copy", name, tmp_path / "copied")
    assert result.exit_code == 0
    files = sorted((tmp_path / "copied").glob("*.yaml"))
    assert [file.name for file in files] == sorted(file.name for file in provided_labs()[name].glob("*.yaml"))
    for file in files:
        found = check(file)
        assert found.severities == []
        assert found.lab.program.resolve().parent == (tmp_path / "copied").resolve()


@pytest.mark.medium
def test_new_lab_from_a_provided_one_bears_its_own_name(tmp_path):
    result = run(new, tmp_path / "mine", "--from", "hall")
    assert result.exit_code == 0
    found = check(tmp_path / "mine")
    assert (found.severities, found.lab.name) == ([], "mine")
    assert (tmp_path / "mine" / "test_mine.py").exists()
    assert len(list(jobs(tmp_path / "mine"))) == 2


def test_copy_of_an_unknown_lab_is_reported_and_writes_nothing(tmp_path):
    for result in (run(command, "copy", "hal", tmp_path / "x"), run(new, tmp_path / "x", "--from", "hal")):
        assert result.exit_code == 2
        assert "did you mean 'hall'?" in result.output
    assert list(tmp_path.iterdir()) == []


def test_list_names_every_provided_lab_with_its_first_comment():
    rows = json.loads(run(command, "list", "--json").stdout)["labs"]
    assert [row["name"] for row in rows] == sorted(provided_labs())
    assert all(row["about"] for row in rows)


def test_path_goes_before_a_provided_lab_of_the_same_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert resolve(Path("corridor")) == labs_folder() / "corridor"
    (tmp_path / "corridor").mkdir()
    assert resolve(Path("corridor")) == Path("corridor")
    assert resolve(Path("./nothing")) == Path("nothing")


def test_schema_is_json_schema_of_the_lab_file_and_knows_its_keys(tmp_path):
    result = run(command, "schema", "-o", tmp_path / "s.json")
    assert result.exit_code == 0
    told = json.loads((tmp_path / "s.json").read_text())
    assert told == json.loads(run(command, "schema").stdout)
    for file in sorted(labs_folder().glob("*/*.yaml")):
        assert set(yaml.safe_load(file.read_text())) <= set(told["properties"])
    assert {"actions", "events"} <= set(told["properties"])


def test_header_of_a_new_lab_is_the_line_that_editors_look_for():
    assert re.fullmatch(r"# yaml-language-server: \$schema=\S+\n", HEADER)
    assert SCHEMA_FILE in HEADER

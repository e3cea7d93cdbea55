"""The wheel: what it holds runs without the tree."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return a folder with the content of the wheel, as an installer leaves it."""
    folder = tmp_path_factory.mktemp("wheel")
    words = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    environment = {name: value for name, value in os.environ.items() if name != "RMR_COMPILE"}
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True, env=environment)
    [wheel] = folder.glob("rmr_robots-*-py3-none-any.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


def run(site, cwd, code, *words):
    environment = {**os.environ, "PYTHONPATH": str(site), "RMR_COMPILED": ""}
    return subprocess.run(
        [sys.executable, "-c", code, *words], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


LAB = "from rmr_lab.main import main; main()"
CHECK = "import sys; from rmr_lab.main import check_main; sys.exit(check_main())"
NEW = "from rmr_lab.main import new_main; new_main()"
SIM = "import sys; from rmr_sim.main import main; sys.exit(main())"


def test_wheel_holds_the_provided_labs_and_runs_them_by_name(site, tmp_path):
    where = run(site, tmp_path, "import rmr_world; print(rmr_world.__file__)")
    assert where.stdout.startswith(str(site))
    names = run(site, tmp_path, LAB, "list")
    expected = sorted(file.parent.name for file in (ROOT / "deploy" / "labs").glob("*/lab.yaml"))
    assert [line.split()[0] for line in names.stdout.splitlines()] == expected
    result = run(site, tmp_path, SIM, "testbed", "--robots", "2", "--run", "run")
    assert result.returncode == 0, result.stderr
    assert run(site, tmp_path, CHECK, *expected).returncode == 0


def test_wheel_holds_the_library(site, tmp_path):
    (tmp_path / "p.rmr").write_text('include "std/gradient.rmr".\ngradient_source(@1, home).\n')
    code = "import sys; from rmr.cli import main; sys.argv = ['rmr', 'check', 'p.rmr']; main()"
    answer = run(site, tmp_path, code)
    assert (answer.returncode, answer.stderr) == (0, "")


def test_wheel_tells_its_name_and_its_commands(site, tmp_path):
    code = (
        "from importlib.metadata import distribution; it = distribution('rmr-robots');"
        "print(it.name, *sorted(each.name for each in it.entry_points if each.group == 'console_scripts'))"
    )
    answer = run(site, tmp_path, code)
    assert (answer.returncode, answer.stdout) == (0, "rmr-robots rmr rmr-agent rmr-world rmrc\n"), answer.stderr


def test_wheel_tells_its_licences_and_brings_their_texts(site):
    [about] = site.glob("rmr_robots-*.dist-info")
    told = (about / "METADATA").read_text()
    assert "\nLicense-Expression: Apache-2.0 AND MIT\n" in told
    texts = re.findall(r"^License-File: (.*)$", told, re.MULTILINE)
    assert len(texts) == 5
    for text in texts:
        assert (about / "licenses" / text).read_bytes() == (ROOT / text).read_bytes()


def test_wheel_writes_a_new_lab_that_runs(site, tmp_path):
    assert run(site, tmp_path, NEW, "shop").returncode == 0
    assert run(site, tmp_path, CHECK, "shop", "--svg", "floor.svg").returncode == 0
    assert run(site, tmp_path, SIM, "shop").returncode == 0


def test_wheel_holds_every_file_of_the_page(site):
    source = ROOT / "deploy" / "rmr_view" / "page"
    files = sorted(file.relative_to(source) for file in source.rglob("*") if file.is_file())
    assert Path("vendor/SHA256SUMS") in files
    for file in files:
        assert (site / "rmr_view" / "page" / file).read_bytes() == (source / file).read_bytes(), file


def test_wheel_packs_the_extension_for_an_editor(site, tmp_path):
    code = "from rmr_editor.main import main; raise SystemExit(main())"
    result = run(site, tmp_path, code, "--vsix", "rmr.vsix")
    assert (result.returncode, result.stderr) == (0, "")
    names = zipfile.ZipFile(tmp_path / "rmr.vsix").namelist()
    source = ROOT / "deploy" / "rmr_editor" / "vscode"
    assert {f"extension/{file.name}" for file in source.iterdir()} <= set(names)

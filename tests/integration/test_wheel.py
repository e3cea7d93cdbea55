"""The wheel: what it holds runs without the tree."""

import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
import venv
import zipfile
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Return the file of the wheel, built of the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    words = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    environment = {name: value for name, value in os.environ.items() if name != "RMR_COMPILE"}
    subprocess.run(words, cwd=ROOT, check=True, capture_output=True, env=environment)
    [wheel] = folder.glob("rmr_robots-*-py3-none-any.whl")
    return wheel


@pytest.fixture(scope="module")
def site(wheel):
    """Return a folder with the content of the wheel, as an installer leaves it."""
    zipfile.ZipFile(wheel).extractall(wheel.parent / "site")
    return wheel.parent / "site"


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


KEPT = re.compile(r"PIP_\w+|(https?|no)_proxy|SSL_CERT_FILE|REQUESTS_CA_BUNDLE", re.IGNORECASE)
"""What pip may need to reach its index; nothing else of the environment is there."""


OCTETS = """
from importlib.metadata import distributions
files = [file.locate() for each in distributions() if each.name not in ("pip", "setuptools") for file in each.files]
print(sum(file.stat().st_size for file in files if file.exists()))
"""
"""Prints the octets of all files that packages have brought to a new environment, which pip itself is in."""


@pytest.mark.timeout(300)
def test_an_empty_machine_installs_the_wheel_and_goes_through_the_first_commands(wheel, tmp_path):
    """`pip install`, then `rmr demo`, `new`, `sim` and `view`, in a new environment and without the tree."""
    venv.create(tmp_path / "machine", with_pip=True)
    commands, home = tmp_path / "machine" / "bin", tmp_path / "home"
    home.mkdir()
    environment = {name: value for name, value in os.environ.items() if KEPT.fullmatch(name)}
    environment |= {"PATH": f"{commands}:/usr/bin:/bin", "HOME": str(home), "TMPDIR": str(tmp_path)}

    def called(*words):
        answer = subprocess.run(
            [commands / words[0], *words[1:]], cwd=home, env=environment, capture_output=True, text=True, check=False
        )
        assert answer.returncode == 0, f"{words}\n{answer.stdout}\n{answer.stderr}"
        return answer.stdout

    called("pip", "install", "--quiet", str(wheel))
    assert int(called("python", "-c", OCTETS)) <= 150_000_000
    where = called("python", "-c", "import rmr, rmr_deploy; print(rmr.__file__, rmr_deploy.__file__)")
    assert all(file.startswith(str(tmp_path / "machine")) for file in where.split())
    called("rmr", "man", "pages")
    brought = tmp_path / "machine" / "share" / "man" / "man1"
    written = {file.name: file.read_text() for file in (home / "pages").iterdir()}
    assert {"rmr.1", "rmr-sim.1", "rmr-world.1"} < written.keys()
    assert {file.name: file.read_text() for file in brought.glob("rmr*.1")} == written
    called("rmr", "demo", "--run", "demo", "--no-view")
    report = json.loads((home / "demo" / "report.json").read_text())
    assert (report["mode"], report["finished"], report["deadlines"]["met"]) == ("processes", True, 6)
    assert "shop/lab.yaml" in called("rmr", "new", "shop")
    assert json.loads(called("rmr", "sim", "shop", "--run", "simulated", "--json"))["finished"]
    for run_folder in ("demo", "simulated"):
        assert "equal" in called("rmr", "replay", run_folder)
        told = viewed([commands / "rmr", "view", run_folder], home, environment)
        assert (told["live"], told["robots"] != []) == (False, True)


def viewed(words, cwd, environment):
    """Return what the page of a run tells of it; its server ends in order at Ctrl-C."""
    with subprocess.Popen(words, cwd=cwd, env=environment, stdout=subprocess.PIPE, text=True) as server:
        try:
            address = next(found[0] for line in server.stdout if (found := re.search(r"http://[\d.]+:\d+/", line)))
            with urllib.request.urlopen(address) as page:
                assert b"<html" in page.read()
            with urllib.request.urlopen(f"{address}api/run") as answer:
                told = json.loads(answer.read())
        finally:
            server.send_signal(signal.SIGINT)
        assert server.wait(20) == 0
    return told

"""A release: what stands against it, what it makes, and that nothing has changed where it fails."""

import hashlib
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

pytestmark = [
    pytest.mark.medium,
    pytest.mark.real,
    pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="no ssh-keygen"),
]

ROOT = Path(__file__).parents[3]
RELEASE = runpy.run_path(str(ROOT / "deploy" / "release" / "release.py"))
VERSION = "7.8.9"
SIGNING = """[user]
  name = A Person
  email = person@example.org
  signingKey = {key}
[gpg]
  format = ssh
[gpg "ssh"]
  allowedSignersFile = {signers}
"""


class Clone:
    """A clone of this tree, as it is, with one commit on main and a key that is thrown away."""

    def __init__(self, folder: Path, source: Path, key: Path) -> None:
        self.folder = folder / "clone"
        self.settings = folder / "gitconfig"
        signers = folder / "signers"
        signers.write_text(f"person@example.org {key.with_suffix('.pub').read_text()}")
        self.settings.write_text(SIGNING.format(key=key, signers=signers))
        git(folder, self.environment, "clone", "--quiet", str(source), str(self.folder))

    @property
    def environment(self) -> dict[str, str]:
        return environment(self.settings)

    def git(self, *words: str) -> str:
        return git(self.folder, self.environment, *words)

    def commit(self, **texts: str) -> None:
        for name, text in texts.items():
            (self.folder / name).write_text(text)
        self.git("commit", "--quiet", "--all", "--message", "test: a change")

    def release(self, *words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "deploy/release/release.py", *words]
        return subprocess.run(
            command, cwd=self.folder, env=self.environment, capture_output=True, text=True, check=False
        )

    def state(self) -> tuple[str, ...]:
        """Return what a release may change."""
        there = [name for name in ("dist", "build") if (self.folder / name).exists()]
        kept = self.git("status", "--porcelain"), self.git("worktree", "list"), " ".join(there)
        return (self.git("for-each-ref"), self.git("rev-parse", "HEAD"), *kept)


def environment(settings: Path) -> dict[str, str]:
    own = {name: value for name, value in os.environ.items() if not name.startswith(("GIT_", "SSH_", "RMR_"))}
    return own | {"GIT_CONFIG_GLOBAL": str(settings), "GIT_CONFIG_NOSYSTEM": "1", "HOME": str(settings.parent)}


def git(folder: Path, env: dict[str, str], *words: str) -> str:
    done = subprocess.run(["git", *words], cwd=folder, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Return a repository with this tree as its only commit, and the file of a key."""
    folder = tmp_path_factory.mktemp("source")
    key = folder / "key"
    words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "person@example.org", "-f", str(key)]
    subprocess.run(words, check=True, capture_output=True)
    settings = folder / "gitconfig"
    settings.write_text(SIGNING.format(key=key, signers="none"))
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        capture_output=True,
    ).stdout.decode()
    tree = folder / "tree"
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, tree / name)
    env = environment(settings)
    git(tree, env, "init", "--quiet", "--initial-branch", "main")
    git(tree, env, "add", "--all")
    git(tree, env, "commit", "--quiet", "--message", "test: the tree")
    return tree, key


@pytest.fixture
def clone(source, tmp_path):
    made = Clone(tmp_path, *source)
    changelog = made.folder / "CHANGELOG.md"
    if not RELEASE["SECTION"].search(changelog.read_text())[1].strip():  # right after a release
        made.commit(
            **{"CHANGELOG.md": changelog.read_text().replace("## Unreleased\n", "## Unreleased\n\n- A thing.\n")}
        )
    return made


def test_a_release_has_version_changelog_files_and_a_tag_that_is_signed(clone):
    before = clone.git("rev-parse", "HEAD").strip()
    notes = RELEASE["SECTION"].search((clone.folder / "CHANGELOG.md").read_text())[1]
    done = clone.release(VERSION)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"git push --atomic origin main v{VERSION}" in done.stdout
    told = clone.git("tag", "-v", f"v{VERSION}")
    assert 'Good "git" signature for person@example.org' in told
    assert clone.git("rev-parse", f"v{VERSION}^{{commit}}", "HEAD~1").split() == [
        clone.git("rev-parse", "main").strip(), before
    ]  # fmt: skip
    assert clone.git("log", "-1", "--format=%s").strip() == f"release: {VERSION}"
    assert clone.git("status", "--porcelain") == ""
    assert clone.git("worktree", "list").count("\n") == 1

    changelog = (clone.folder / "CHANGELOG.md").read_text()
    day = re.search(rf"^## Unreleased\n\n## {VERSION} - (\d{{4}}-\d\d-\d\d)\n", changelog, re.MULTILINE)[1]
    assert changelog.partition(f"## {VERSION} - {day}\n")[2].startswith(notes)
    citation = yaml.safe_load((clone.folder / "CITATION.cff").read_text())
    assert (citation["version"], str(citation["date-released"])) == (VERSION, day)
    for name, pattern in RELEASE["PLACES"].items():
        assert re.findall(pattern, (clone.folder / name).read_text(), re.MULTILINE) == [VERSION], name
    assert tomllib.loads((clone.folder / "pyproject.toml").read_text())["project"]["version"] == VERSION

    built = clone.folder / "dist" / VERSION
    sums = (built / f"rmr-robots-{VERSION}.sha256").read_text()
    assert sums in told, "the signature covers what was built"
    wheel, bill = f"rmr_robots-{VERSION}-py3-none-any.whl", f"rmr-robots-{VERSION}.cdx.json"
    listed = dict(reversed(line.split("  ")) for line in sums.splitlines())
    assert listed.keys() == {bill, wheel, f"rmr_robots-{VERSION}.tar.gz"}
    assert listed == {name: hashlib.sha256((built / name).read_bytes()).hexdigest() for name in listed}
    with zipfile.ZipFile(built / wheel) as archive:
        assert f"\nVersion: {VERSION}\n" in archive.read(f"rmr_robots-{VERSION}.dist-info/METADATA").decode()
        assert f'__version__ = "{VERSION}"' in archive.read("rmr/__init__.py").decode()
    assert json.loads((built / bill).read_text())["metadata"]["component"]["version"] == VERSION

    epoch = clone.git("log", "-1", "--format=%ct").strip()
    again = clone.folder.parent / "again"
    words = [sys.executable, "-m", "hatchling", "build", "--directory", str(again)]
    subprocess.run(
        words, cwd=clone.folder, env=clone.environment | {"SOURCE_DATE_EPOCH": epoch}, check=True, capture_output=True
    )
    for file in again.glob("*.*"):
        if file.name in listed:
            assert hashlib.sha256(file.read_bytes()).hexdigest() == listed[file.name], f"{file.name}, built again"

    state = clone.state()
    assert f"v{VERSION}" in clone.release(VERSION).stderr
    assert clone.state() == state, "the same again is refused"


def test_a_dry_run_tells_what_would_be_done_and_does_nothing(clone):
    state = clone.state()
    done = clone.release(VERSION, "--dry-run")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert all(line.startswith("would ") for line in lines)
    assert f"dist/{VERSION}" in lines[2]
    assert f"sign the tag v{VERSION}" in lines[3]
    assert clone.state() == state


@pytest.mark.parametrize(
    ("old", "new"),
    [("  signingKey = {key}\n", ""), ('  format = ssh\n[gpg "ssh"]', '  program = /no/such/gpg\n[gpg "ssh"]')],
    ids=["ssh", "openpgp"],
)
def test_without_a_key_one_sentence_says_what_to_set(clone, source, old, new):
    text = clone.settings.read_text()
    old = old.format(key=source[1])
    assert old in text
    clone.settings.write_text(text.replace(old, new))
    state = clone.state()
    done = clone.release(VERSION)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith(
        "release: tags cannot be signed: set a key, for SSH by git config gpg.format ssh and "
    )
    assert done.stderr.count("\n") == 1
    assert clone.state() == state


def without_section(clone):
    clone.commit(**{"CHANGELOG.md": (clone.folder / "CHANGELOG.md").read_text().replace("## Unreleased", "## Next")})


def without_text(clone):
    text = (clone.folder / "CHANGELOG.md").read_text()
    clone.commit(**{"CHANGELOG.md": RELEASE["SECTION"].sub("## Unreleased\n\n### Added\n\n", text)})


def with_two_versions(clone):
    text = (clone.folder / "CITATION.cff").read_text()
    clone.commit(**{"CITATION.cff": re.sub("(?m)^version: .*$", "version: 0.0.3", text)})


def without_a_place(clone):
    clone.commit(**{"docs/stability.md": "# Stability\n"})


@pytest.mark.parametrize(
    ("prepare", "version", "said"),
    [
        (
            lambda clone: clone.git("switch", "--quiet", "--create", "next"),
            VERSION,
            "the branch is next: releases are ",
        ),
        (lambda clone: clone.git("switch", "--quiet", "--detach"), VERSION, "the branch is none: releases are made on"),
        (lambda clone: (clone.folder / "new.py").touch(), VERSION, "the tree is not clean (?? new.py): commit it"),
        (without_section, VERSION, "CHANGELOG.md has no section '## Unreleased': write one"),
        (without_text, VERSION, "CHANGELOG.md has nothing under '## Unreleased': write what is new"),
        (with_two_versions, VERSION, "the versions do not agree: "),
        (without_a_place, VERSION, r"docs/stability.md has 0 lines like ^RMR is at version"),
        (lambda clone: None, "0.0.1", "0.0.1 does not come after "),
        (lambda clone: clone.git("tag", f"v{VERSION}"), VERSION, f"there is a tag v{VERSION}: choose the next"),
        (lambda clone: (clone.folder / "dist" / VERSION).mkdir(parents=True), VERSION, "is there from before: remove"),
    ],
)
def test_what_stands_against_a_release_is_told_and_nothing_is_done(clone, prepare, version, said):
    prepare(clone)
    state = clone.state()
    for words in ((version,), (version, "--dry-run")):
        done = clone.release(*words)
        assert (done.returncode, done.stdout) == (1, "")
        assert said in done.stderr
        assert all(line.startswith("release: ") for line in done.stderr.splitlines())
        assert clone.state() == state


def test_a_build_that_fails_leaves_everything_as_it_was(clone):
    clone.commit(**{"hatch_build.py": "raise ValueError('no build today')\n"})
    state = clone.state()
    done = clone.release(VERSION)
    assert (done.returncode, done.stdout) == (1, "")
    assert "hatchling failed: " in done.stderr
    assert "no build today" in done.stderr
    assert clone.state() == state


def test_a_signature_that_fails_in_the_end_leaves_everything_as_it_was(clone):
    once = clone.folder.parent / "sign-once"
    once.write_text(
        '#!/bin/sh\n[ ! -e "$0.used" ] || { echo "the key is gone" >&2; exit 1; }\n'
        ': > "$0.used"\nexec ssh-keygen "$@"\n'
    )
    once.chmod(0o755)
    clone.settings.write_text(clone.settings.read_text() + f"  program = {once}\n")
    state = clone.state()
    done = clone.release(VERSION)
    assert (done.returncode, done.stdout) == (1, "")
    # Where ssh-keygen fails, git 2.39 makes a tag without a signature, and exits with 0.
    assert re.match("release: (git tag --sign failed: .*the key is gone|the tag was not signed)", done.stderr)
    assert [*clone.state()[:4]] == [*state[:4]]
    assert not (clone.folder / "dist" / VERSION).exists()


@pytest.mark.parametrize("words", [(), ("1.2",), ("v1.2.3",), ("1.2.3rc1",), ("01.2.3",), ("1.2.3", "--force")])
def test_wrong_words_are_told(words, capsys):
    with pytest.raises(SystemExit) as ended:
        RELEASE["main"](list(words))
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("usage: release.py")


def test_the_version_stands_nowhere_else():
    """Figures name the version that they were measured with, locks and schemas those of others."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True).stdout.decode()
    own = re.compile(rf"(?i)version[\W_]{{0,6}}{re.escape(version)}(?![\d.]*\d)|\bRMR {re.escape(version)}(?![\d.]*\d)")
    keeps = re.compile(r"docs/(evaluation|radio)|tests/(score|fuzz)/|CHANGELOG\.md$")
    found = set()
    for name in filter(None, listed.split("\0")):
        if not keeps.match(name) and (ROOT / name).is_file():
            text = (ROOT / name).read_bytes().decode(errors="replace")
            found |= {name} if own.search(text) else set()
    assert found - {"tests/unit/release/test_release.py"} == set(RELEASE["PLACES"])

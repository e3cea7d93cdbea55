"""A release: the version in its places, the changelog's section, what users install, a commit and a signed tag.

All of it is made in a work tree beside this one, from what is committed, and comes here only when it is whole: the
built files into `dist/VERSION`, then the tag, then the commit as the head of main. Whatever fails before that leaves
this tree, its branch and its tags as they were. The build has the time of the commit, so that the tag, checked out and
built again, gives the same octets; their check sums are in the signed tag. Nothing is pushed or uploaded.

    python deploy/release/release.py VERSION [--dry-run]
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLACES = {
    "pyproject.toml": r'^version = "(.+)"$',
    "rmr/__init__.py": r'^__version__ = "(.+)"$',
    "CITATION.cff": r"^version: (.+)$",
    "deploy/rmr_editor/vscode/package.json": r'^  "version": "(.+)",$',
    "docs/stability.md": r"^RMR is at version (\S+)\. ",
}
"""File -> where the version of RMR stands in it. Figures name the version that they were measured with, and keep it."""
SECTION = re.compile(r"^## Unreleased\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
"""What is not yet released, in the changelog."""


class ReleaseError(Exception):
    """Why there is no release, and what to do; one sentence."""


def run(*words: str, at: Path, **variables: str) -> str:
    """Return what a command prints. Raises ReleaseError if it fails."""
    environment = {name: value for name, value in os.environ.items() if name != "RMR_COMPILE"} | variables
    try:
        done = subprocess.run(words, cwd=at, env=environment, capture_output=True, text=True, check=False)
    except OSError as error:
        raise ReleaseError(f"{words[0]} cannot be started: {error.strerror}") from None
    if done.returncode:
        said = " ".join((done.stderr or done.stdout).split()) or f"exit code {done.returncode}"
        raise ReleaseError(f"{' '.join(words[:3])} failed: {said[-300:]}")
    return done.stdout.strip()


# -- what must be so


def problems(root: Path, version: str) -> Iterator[str]:
    """Yield what stands against a release of `version`, each with what to do."""
    branch = run("git", "branch", "--show-current", at=root)
    if branch != "main":
        yield f"the branch is {branch or 'none'}: releases are made on main, git switch main"
    if changed := run("git", "status", "--porcelain", at=root).splitlines():
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        yield f"the tree is not clean ({changed[0].strip()}{more}): commit it, or put it away with git stash -u"
    if run("git", "tag", "--list", f"v{version}", at=root):
        yield f"there is a tag v{version}: choose the next version"
    if (root / "dist" / version).exists():
        yield f"dist/{version} is there from before: remove it"
    yield from wrong_versions(root, version)
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    section = SECTION.search(changelog)
    if section is None:
        yield "CHANGELOG.md has no section '## Unreleased': write one, with what is new for users"
    elif not re.search("^- ", section[1], re.MULTILINE):
        yield "CHANGELOG.md has nothing under '## Unreleased': write what is new for users"
    if re.search(rf"^## {re.escape(version)}\b", changelog, re.MULTILINE):
        yield f"CHANGELOG.md has a section of {version} already: choose the next version"
    if said := unsigned(root):
        yield said


def wrong_versions(root: Path, version: str) -> Iterator[str]:
    """Yield what is wrong with the version that stands in the files, or with the one after it."""
    found: dict[str, str] = {}
    for name, pattern in PLACES.items():
        places = re.findall(pattern, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
        if len(places) != 1:
            yield f"{name} has {len(places)} lines like {pattern}: it must be one"
        found |= dict.fromkeys(places, name)
    if len(found) > 1:
        told = ", ".join(f"{name} has {each}" for each, name in found.items())
        yield f"the versions do not agree: {told}; write the same into all of {', '.join(PLACES)}"
    for each in found:
        if re.fullmatch(r"\d+\.\d+\.\d+", each) and as_numbers(version) <= as_numbers(each):
            yield f"{version} does not come after {each}, the present version: choose a later one"


def as_numbers(version: str) -> tuple[int, ...]:
    """Return a version as it is compared."""
    return tuple(map(int, version.split(".")))


def unsigned(root: Path) -> str:
    """Return why a tag cannot be signed; empty if it can. What is signed for that belongs to no branch."""
    try:
        tree = run("git", "rev-parse", "HEAD^{tree}", at=root)
        run("git", "commit-tree", "-S", "-m", "a trial of the signature", tree, at=root)
    except ReleaseError as error:
        return (
            "tags cannot be signed: set a key, for SSH by git config gpg.format ssh and git config user.signingkey "
            f"FILE.pub, for OpenPGP by git config user.signingkey ID ({error})"
        )
    return ""


# -- making it


def write_version(tree: Path, version: str, day: str) -> None:
    """Put the version into its places, and what is not yet released under it."""
    for name, pattern in PLACES.items():
        file = tree / name
        text = file.read_text(encoding="utf-8")
        found = re.search(pattern, text, re.MULTILINE)
        assert found is not None, "it was checked"
        file.write_text(text[: found.start(1)] + version + text[found.end(1) :], encoding="utf-8")
    citation = tree / "CITATION.cff"
    dated = re.sub("(?m)^date-released: .*$", f"date-released: {day}", citation.read_text(encoding="utf-8"))
    citation.write_text(dated, encoding="utf-8")
    changelog = tree / "CHANGELOG.md"
    text = changelog.read_text(encoding="utf-8")
    changelog.write_text(
        text.replace("## Unreleased\n", f"## Unreleased\n\n## {version} - {day}\n", 1), encoding="utf-8"
    )


def build(tree: Path, version: str, folder: Path) -> str:
    """Build wheel, source distribution and bill of materials of a committed tree; return the check sums."""
    epoch = run("git", "log", "-1", "--format=%ct", at=tree)
    words = (sys.executable, "-m", "hatchling", "build", "--directory", str(folder))
    run(*words, at=tree, SOURCE_DATE_EPOCH=epoch)
    bill = str(folder / f"rmr-robots-{version}.cdx.json")
    run(sys.executable, str(tree / "deploy" / "release" / "sbom.py"), bill, at=tree, SOURCE_DATE_EPOCH=epoch)
    files = sorted(file for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))
    sums = "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files)
    (folder / f"rmr-robots-{version}.sha256").write_text(sums, encoding="utf-8")
    return sums


@contextmanager
def work_tree(root: Path) -> Iterator[Path]:
    """Give a work tree of the head, and a folder beside it; both are removed afterwards."""
    with tempfile.TemporaryDirectory(prefix="rmr-release-") as folder:
        tree = Path(folder) / "tree"
        run("git", "worktree", "add", "--quiet", "--detach", str(tree), at=root)
        try:
            yield tree
        finally:
            run("git", "worktree", "remove", "--force", str(tree), at=root)


def release(root: Path, version: str, day: str) -> Path:
    """Make the release; return the folder of what was built. Raises ReleaseError, and then nothing has changed."""
    target = root / "dist" / version
    with work_tree(root) as tree:
        write_version(tree, version, day)
        run("git", "commit", "--quiet", "--all", "--message", f"release: {version}", at=tree)
        built = tree.parent / "built"
        built.mkdir()
        sums = build(tree, version, built)
        try:
            shutil.copytree(built, target)
            run("git", "tag", "--sign", f"v{version}", "--message", f"RMR {version}\n\n{sums}", at=tree)
            if "SIGNATURE-----" not in run("git", "cat-file", "tag", f"v{version}", at=root):
                raise ReleaseError("the tag was not signed, though git says so: look whether the key is still there")
            run("git", "merge", "--quiet", "--ff-only", f"v{version}", at=root)
        except BaseException:
            shutil.rmtree(target, ignore_errors=True)
            subprocess.run(["git", "tag", "--delete", f"v{version}"], cwd=root, capture_output=True, check=False)
            raise
    return target


def main(words: list[str]) -> int:
    """Make the release that `words` name; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="release.py",
        description="Make a release from what is committed on main: version, changelog, dist/VERSION, a commit and a "
        "signed tag. Nothing is pushed or uploaded.",
    )
    parser.add_argument("version", help="the new version, such as 0.2.0")
    parser.add_argument("--dry-run", action="store_true", help="check, print what would be done, and do nothing")
    options = parser.parse_args(words)
    version = options.version
    if not re.fullmatch(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)", version):
        parser.error(f"version: write three numbers, such as 0.2.0, not {version!r:.40}")
    day = datetime.now(UTC).date().isoformat()
    try:
        if found := list(problems(ROOT, version)):
            raise ReleaseError("\nrelease: ".join(found))
        if options.dry_run:
            print(f"would write {version} into {', '.join(PLACES)}, and {day} into CITATION.cff")
            print(f"would put what is under '## Unreleased' in CHANGELOG.md under '## {version} - {day}'")
            print(f"would build a wheel, a source distribution, the bill of materials and check sums in dist/{version}")
            print(f"would commit 'release: {version}' on main, and sign the tag v{version}")
            return 0
        target = release(ROOT, version, day)
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"release: {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    print(f"{', '.join(sorted(file.name for file in target.iterdir()))} in {target.relative_to(ROOT)}")
    print(f"the tag v{version} is signed; publish it: git push --atomic origin main v{version}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Every file has a licence, in `REUSE.toml`; what others have written has theirs; the wheel has them all."""

import re
import tomllib
from pathlib import Path

import pytest
from source_tree import PROJECT, ROOT

PARTS = ("rmr", "agents", "world", "deploy", "docs", "tests")
REUSE = tomllib.loads((ROOT / "REUSE.toml").read_text())
ANNOTATIONS = REUSE["annotations"]
BESIDE = re.compile(r"LICENSE.*|README\.md|SHA256SUMS|__init__\.py")
"""Files of our own, and licences, in a folder of what others have written."""


def pattern(glob: str) -> re.Pattern[str]:
    """Return a glob of REUSE.toml as a regular expression: `*` stays within a folder, `**` does not."""
    return re.compile(
        "".join({"*": "[^/]*", "**": ".*"}.get(word, re.escape(word)) for word in re.split(r"(\*+)", glob))
    )


def annotation(file: Path) -> dict:
    """Return the last annotation that names `file`, which is the one that counts."""
    name = file.relative_to(ROOT).as_posix()
    named = [each for each in ANNOTATIONS if pattern(each["path"]).fullmatch(name)]
    assert named, f"{name} has no licence in REUSE.toml"
    return named[-1]


def licences(expression: str) -> set[str]:
    return set(expression.split(" AND "))


def files(glob: str) -> list[Path]:
    return sorted(file for part in PARTS for file in (ROOT / part).rglob(glob) if file.is_file())


def foreign() -> list[Path]:
    """Return what others have written: the files that have a licence beside them."""
    folders = {file.parent for file in files("LICENSE*")}
    return sorted(file for folder in folders for file in folder.iterdir() if not BESIDE.fullmatch(file.name))


def test_the_table_is_one_of_the_specification():
    assert REUSE["version"] == 1
    required = {"path", "SPDX-FileCopyrightText", "SPDX-License-Identifier"}
    assert all(set(each) - {"precedence"} == required for each in ANNOTATIONS)
    assert {each.get("precedence", "closest") for each in ANNOTATIONS} <= {"closest", "aggregate", "override"}


def test_every_source_file_has_a_licence():
    ours = [file for file in files("*.py") if file not in foreign()]
    assert len(ours) > 1000
    assert {annotation(file)["SPDX-License-Identifier"] for file in ours} == {"Apache-2.0"}


def test_what_others_have_written_has_the_copyright_that_stands_beside_it():
    assert len(foreign()) >= 7
    for file in foreign():
        row = annotation(file)
        assert row.get("precedence") == "override", f"{file} is another's: give it a row in REUSE.toml"
        beside = "".join(each.read_text() for each in file.parent.glob("LICENSE*"))
        holders = row["SPDX-FileCopyrightText"]
        for holder in [holders] if isinstance(holders, str) else holders:
            assert holder in beside, f"{file}: {holder}"


@pytest.mark.parametrize("glob", ["*.py", "*.js", "*.css", "*.rmr"])
def test_no_other_file_names_a_copyright(glob):
    word = re.compile(r"SPDX-License-" + r"Identifier:|Copyright" + r" (\(c\)|©|\d{4})", re.IGNORECASE)
    known = set(foreign())
    assert not [str(file) for file in files(glob) if file not in known and word.search(file.read_text())]


def test_each_licence_that_is_used_has_its_text_and_no_other():
    used = set().union(*(licences(each["SPDX-License-Identifier"]) for each in ANNOTATIONS))
    assert {file.stem for file in (ROOT / "LICENSES").iterdir()} == used
    assert (ROOT / "LICENSES" / "Apache-2.0.txt").read_bytes() == (ROOT / "LICENSE").read_bytes()


def test_the_distribution_tells_all_licences_of_its_packages_and_brings_their_texts():
    project, packages = PROJECT["project"], PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    shipped = [file for file in foreign() if any(file.is_relative_to(ROOT / package) for package in packages)]
    used = set().union({"Apache-2.0"}, *(licences(annotation(file)["SPDX-License-Identifier"]) for file in shipped))
    assert licences(project["license"]) == used
    texts = {file for glob in project["license-files"] for file in ROOT.glob(glob)}
    assert texts == {ROOT / "LICENSE", *(each for file in shipped for each in file.parent.glob("LICENSE*"))}
    assert not [each for each in project.get("classifiers", []) if each.startswith("License ::")]  # PEP 639: one form

"""docs/stability.md and CITATION.cff have the versions of the code."""

import re
import tomllib

import yaml
from doc_pages import ROOT, page, table

import rmr
from rmr.bytecode.layout import VERSION as BYTECODE
from rmr.entry import JSON_VERSION
from rmr.mind.journal import FORMAT as JOURNAL
from rmr.mind.mind_format import VERSION as MIND
from rmr.mind.snapshot import FORMAT as SNAPSHOT
from rmr.record.run_about import FORMAT as RECORDING

PAGE = page("stability")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())


def test_the_versions_of_formats_are_those_of_the_code():
    rows = table(PAGE, "what", "promised", "its version", "what a newer RMR does with an older one")
    stated = {re.sub(r"\[(.*?)\]\(.*?\)", r"\1", row[0]): row[2] for row in rows}
    assert stated["byte-code"] == str(BYTECODE)
    assert stated["JSON of commands"] == str(JSON_VERSION)
    assert stated["recordings"] == RECORDING
    assert stated["minds in recordings"] == str(MIND)
    assert stated["state of durable robots"] == f"journal {JOURNAL}, snapshot {SNAPSHOT}"


def test_the_version_is_one_everywhere():
    assert PROJECT["version"] == rmr.__version__ == str(CITATION["version"])
    assert f"RMR is at version {rmr.__version__}." in PAGE
    assert f"*Python* {PROJECT['requires-python'].removeprefix('>=')} and newer" in PAGE


def test_the_citation_is_of_the_newest_release_and_names_the_paper():
    assert (CITATION["cff-version"], CITATION["type"]) == ("1.2.0", "software")
    assert {"message", "title", "authors"} < CITATION.keys(), "what the format requires"
    assert CITATION["license"] == PROJECT["license"].partition(" AND ")[0], "our own; those of others follow"
    newest = re.search(r"^## (\S+) - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest.groups() == (CITATION["version"], str(CITATION["date-released"]))
    (paper,) = CITATION["references"]
    assert f"*{paper['title']}*" in (ROOT / "README.md").read_text()
    assert {"type", "title", "authors"} < paper.keys(), "what the format requires of a reference"

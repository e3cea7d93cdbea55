"""`rmr man`: each command has a page, with all that its help says."""

import re
import shutil
import subprocess

import pytest
from command_runner import invoke
from test_command_line import EVERY, call

from rmr.commands.man_command import command, page


@pytest.fixture
def pages(tmp_path, monkeypatch):
    """Return file -> text of what the command writes."""
    monkeypatch.setenv("COLUMNS", "80")  # and back again after the test
    answer = invoke(command, [str(tmp_path / "man" / "man1")])
    assert (answer.exit_code, answer.stderr) == (0, "")
    found = {file.name: file.read_text() for file in (tmp_path / "man" / "man1").iterdir()}
    assert answer.stdout == f"{len(found)} pages in {tmp_path / 'man' / 'man1'}\n"
    return found


def test_each_command_has_a_page_with_all_of_its_options(pages):
    names = {name for name in EVERY if not name.startswith("rmr fleet")} | {"rmr agent", "rmr world"}
    assert {f"{name.replace(' ', '-')}.1" for name in names} <= pages.keys()
    for name in sorted(names & EVERY.keys()):
        text = pages[f"{name.replace(' ', '-')}.1"].replace("\\-", "-")
        for option in re.findall(r"^  (?:-\w(?: \S+)?, )?(--[a-z-]+)", call(name, "--help").stdout, re.MULTILINE):
            assert option in text, name


def test_every_heading_of_the_help_is_a_section(pages):
    sections = re.findall(r'^\.SH "?(.*?)"?$', pages["rmr.1"], re.MULTILINE)
    assert sections[:5] == ["NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", "PROGRAMS"]
    assert sections[-1] == "THIS MACHINE"


def test_no_text_is_taken_for_roff():
    text = page("rmr x", "usage: rmr x", [".TH is text. `a'\\n", "options:\n  --x  .y"])
    assert "\n\\&.TH is text. \\(gaa\\(aq\\en\n" in text
    macros = {line.split()[0] for line in text.splitlines() if line.startswith(".")}
    assert macros == {".TH", ".SH", ".PP", ".nf", ".fi"}


@pytest.mark.real
def test_groff_has_no_complaint(pages):
    if shutil.which("groff") is None:
        pytest.skip("no groff on the PATH")
    words = ["groff", "-man", "-Tutf8", "-ww", "-z"]
    answer = subprocess.run(words, input="".join(pages.values()), capture_output=True, text=True, check=True)
    assert answer.stderr == ""


def test_a_folder_that_cannot_be_made_is_wrong_usage(tmp_path):
    (tmp_path / "file").touch()
    answer = invoke(command, [str(tmp_path / "file" / "man1")], name="rmr man")
    assert (answer.exit_code, answer.stdout) == (2, "")
    assert answer.stderr == f"rmr man: {tmp_path}/file/man1: Not a directory\n"

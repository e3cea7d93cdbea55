"""`rmr explain` as a command."""

import json
import os
import re
import subprocess
import sys

import pytest
from command_runner import invoke

from rmr.base.printable import Paint
from rmr.commands import subcommands
from rmr.lang.diagnostics.diagnostic import CODES
from rmr.lang.pages import laid_out, page, plain


def explain(*arguments):
    return invoke(subcommands.command, ["explain", *arguments])


def test_a_code_is_explained_in_plain_text():
    result = explain("E012")
    assert result.exit_code == 0
    assert result.stdout.startswith("E012: wrong kind\n\n")
    assert '\n    start(R), say(R, "hello") -o 1.\n' in result.stdout
    assert "\nWHY\n" in result.stdout
    assert "See also: E010, E013, W108" in result.stdout
    assert "```" not in result.stdout
    assert "](" not in result.stdout


@pytest.mark.skipif(os.name != "posix", reason="needs a terminal")
def test_on_a_terminal_it_is_laid_out_and_coloured():
    reader, terminal = os.openpty()
    run = "from rmr.commands.subcommands import command; command.main(['explain', 'E012'])"
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    environment.pop("NO_COLOR", None)
    process = subprocess.run([sys.executable, "-c", run], stdout=terminal, env=environment, check=True)
    os.close(terminal)
    shown = os.read(reader, 1 << 16).decode()
    os.close(reader)
    assert process.returncode == 0
    assert "\x1b[" in shown
    assert '\x1b[36m    start(R), say(R, "hello") -o 1.\x1b[0m\r\n' in shown
    assert "\x1b[1mWHY\x1b[0m\r\n" in shown
    assert "(\x1b[36mtype unordered sensor\x1b[0m)" in shown
    assert "](" not in shown


@pytest.mark.parametrize("columns", [40, 100])
def test_laid_out_each_page_has_its_words_within_the_width(columns):
    for code in CODES:
        shown = laid_out(page(code), columns, Paint(False))
        assert shown.split() == plain(page(code)).split()
        assert [line for line in shown.split("\n") if len(line) > columns and line[:4].strip() and " " in line] == []
        coloured = re.sub(r"\x1b\[[0-9;]*m", "", laid_out(page(code), columns, Paint(True)))
        assert coloured.replace("`", "") == shown.replace("`", "")


def test_small_letters_do_as_well():
    assert explain("w101").stdout == explain("W101").stdout


@pytest.mark.parametrize(
    ("code", "hint"), [("E12", "did you mean 'E012'?"), ("nonsense", "`rmr explain` lists all codes")]
)
def test_an_unknown_code_is_wrong_usage_with_a_hint(code, hint):
    result = explain(code)
    assert result.exit_code == 2
    assert f"there is no code {code}; {hint}" in result.stderr


def test_without_a_code_all_are_listed():
    assert explain().stdout == "".join(f"{code}  {title}\n" for code, title in CODES.items())


def test_json_has_the_same():
    listed = json.loads(explain("--json").stdout)["codes"]
    assert [(each["code"], each["title"]) for each in listed] == list(CODES.items())
    assert {each["severity"] for each in listed if each["code"].startswith("W")} == {"warning"}
    assert json.loads(explain("E012", "--json").stdout) == {
        "version": 1,
        "code": "E012",
        "severity": "error",
        "title": CODES["E012"],
        "page": page("E012"),
    }

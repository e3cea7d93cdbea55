"""Files on the command line: every command ends with 2 for one that cannot be read, and with 3 for what is none.

An empty program is a program. A file that another one names, such as a lab's program, is part of that one: 3.
"""

import os

import pytest
from command_runner import invoke

from rmr.commands.subcommands import command as rmr
from rmr_agent.main import command as agent
from rmr_deploy.up import command as up
from rmr_lab.main import check
from rmr_sim.main import command as sim
from rmr_world.main import command as world

PROGRAM = "start(R).\n"
LAB = """\
lab: tiny
program: tiny.rmr
arena: {size: [1.0, 1.0]}
robots: [{id: 1, pose: [0.5, 0.5, 0deg]}]
"""
COMMANDS = {
    **{f"rmr {name}": (rmr, name, "FILE") for name in ("compile", "eval", "fmt", "dis")},
    "rmr check": (check, "FILE"),  # what `rmr check` becomes for a bare name: it would take this process's place
    "rmr eval --facts": (rmr, "eval", "tiny.rmr", "--facts", "FILE"),
    "rmr eval --topology": (rmr, "eval", "tiny.rmr", "--topology", "FILE"),
    "rmr up": (up(), "FILE"),
    "rmr up --actions": (up(), "lab.yaml", "--actions", "FILE"),
    "rmr sim": (sim(), "FILE"),
    "rmr sim --actions": (sim(), "lab.yaml", "--actions", "FILE"),
    "rmr sim --events": (sim(), "lab.yaml", "--events", "FILE"),
    "rmr-world": (world(), "--config", "FILE"),
    "rmr-world --program": (world(), "--config", "lab.yaml", "--program", "FILE"),
    "rmr-agent": (agent(), "--id", "1", "FILE"),
    "rmr-agent --actions": (agent(), "--id", "1", "tiny.rbc", "--actions", "FILE"),
    "rmr-agent --radio-key": (agent(), "--id", "1", "tiny.rbc", "--radio-key", "FILE"),
    "rmr-agent --secret": (agent(), "--id", "1", "tiny.rbc", "--secret", "FILE"),
    "rmr-world --connect --secret": (
        world(),
        "--config",
        "lab.yaml",
        "--connect",
        "tcp/127.0.0.1:9",
        "--secret",
        "FILE",
    ),
}


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Return a function that runs a command upon a file; it returns the exit code and what was said."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.rmr").write_text(PROGRAM)
    (tmp_path / "lab.yaml").write_text(LAB)
    (tmp_path / "folder").mkdir()
    (tmp_path / "no-permission").write_text("x")
    (tmp_path / "no-permission").chmod(0)
    (tmp_path / "octets").write_bytes(b"\xff\x00{]")
    assert invoke(rmr, ["compile", "tiny.rmr"]).exit_code == 0

    def call(command, file):
        main, *words = COMMANDS[command]
        words = [file if word == "FILE" else word for word in words]
        answer = invoke(main, words)
        assert isinstance(answer.exception, SystemExit | None), answer.exception
        return answer.exit_code, answer.output

    return call


@pytest.mark.parametrize("file", ["not-there.rmr", "folder", "no-permission"])
@pytest.mark.parametrize("command", COMMANDS)
def test_a_file_that_cannot_be_read_is_wrong_usage_in_every_command(run, command, file, tmp_path):
    if file == "no-permission" and os.access(tmp_path / file, os.R_OK):
        pytest.skip("this user may read everything")
    code, said = run(command, file)
    assert code == 2, said
    assert file in said
    assert "Traceback" not in said


@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in ("rmr eval --topology", "rmr fmt")])
def test_a_file_that_holds_something_else_is_invalid_in_every_command(run, command):
    code, said = run(command, "octets")
    assert code == 3, said
    assert "octets" in said
    assert "Traceback" not in said

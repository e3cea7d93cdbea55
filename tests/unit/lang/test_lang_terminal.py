"""Where diagnostics have colour: on a terminal that can show it and whose user wants it."""

import os
import pty
import subprocess
import sys

import pytest

COLOUR = b"\x1b["
COMMAND = [sys.executable, "-c", "from rmr.cli import main; main()", "check"]


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "a.rmr"
    path.write_text("p(R, X).\n")
    return path


def on_a_terminal(program, **environment):
    """Return what `rmr check` writes to a terminal."""
    leader, follower = pty.openpty()
    inherited = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "TERM")}
    with subprocess.Popen(
        [*COMMAND, program], stderr=follower, stdout=follower, env=inherited | environment
    ) as process:
        assert process.wait() == 3
    os.close(follower)
    with open(leader, "rb", buffering=0) as stream:
        return stream.read(1 << 16)


def test_a_terminal_gets_colour(program):
    assert COLOUR in on_a_terminal(program, TERM="xterm-256color")


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1"}, {"TERM": "dumb"}], ids=str)
def test_colour_is_off_with_no_color_or_dumb_terminal(program, environment):
    shown = on_a_terminal(program, **({"TERM": "xterm"} | environment))
    assert b"E023" in shown
    assert COLOUR not in shown


def test_pipe_gets_no_colour(program):
    answer = subprocess.run([*COMMAND, program], capture_output=True, env=os.environ | {"TERM": "xterm"}, check=False)
    assert answer.returncode == 3
    assert b"E023" in answer.stderr
    assert COLOUR not in answer.stderr

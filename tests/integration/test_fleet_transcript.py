"""The transcript in docs/fleet.md: its commands, upon real processes, print what the page says."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "fleet.md"
WITHIN_S = 60.0
LOOKS = ("ps", "ls")
ROBOT_ROW = re.compile(r"(robot-[\d.]+ +[a-z]+(?: \(\d+\))?) +\d.*")
"""A row of `rmr ps`: what the robot does depends on the moment."""


def transcript():
    """Return the commands of the page with the lines that follow each."""
    text = re.search(r"```shellsession\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
    return list(zip(parts[1::2], [part.splitlines() for part in parts[2::2]], strict=True))


def masked(line):
    """Return a line without what differs from run to run."""
    return re.sub(r" +", " ", re.sub(r"\d+(\.\d+)?", "#", ROBOT_ROW.sub(r"\1", line))).strip()


def matches(shown, printed):
    """Whether the lines that were printed are those of the page, where ``...`` stands for any."""
    if not shown:
        return not printed
    if shown[0] == "...":
        return any(matches(shown[1:], printed[i:]) for i in range(len(printed) + 1))
    return bool(printed) and masked(shown[0]) == masked(printed[0]) and matches(shown[1:], printed[1:])


def looked(command, shown, folder):
    """Run a command that only looks, again until it prints what the page shows: a robot becomes so in its own time."""
    end = time.monotonic() + WITHIN_S
    while True:
        printed = run(command, shown, folder)
        if matches(shown, printed) or time.monotonic() > end:
            return printed


def run(command, shown, folder):
    """Run a command until it ends, or, if the page shows ``^C``, until it has printed what is before that."""
    words = [str(Path(sys.executable).with_name("rmr")), *command.split()[1:]]
    output = folder / "output"
    with output.open("w") as sink:
        process = subprocess.Popen(words, stdout=sink, stderr=sink, cwd=folder)
    try:
        if shown[-1:] == ["^C"]:
            end = time.monotonic() + WITHIN_S
            while not matches(shown[:-1], output.read_text().splitlines()) and time.monotonic() < end:
                assert process.poll() is None, output.read_text()
                time.sleep(0.05)
            process.send_signal(signal.SIGINT)
        assert process.wait(WITHIN_S) == 0, output.read_text()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    return output.read_text().splitlines()


def test_commands_of_the_page_print_what_it_says(tmp_path, monkeypatch):
    monkeypatch.setenv("RMR_REGISTER", str(tmp_path / "register"))
    commands = transcript()
    assert {command.split()[1] for command, _ in commands} >= {"up", "ps", "kill", "restart", "logs", "down", "ls"}
    try:
        for command, shown in commands:
            look = looked if command.split()[1] in LOOKS else run
            printed = look(command, shown, tmp_path)
            wanted = shown[:-1] if shown[-1:] == ["^C"] else shown
            assert matches(wanted, printed), f"$ {command}\n" + "\n".join(printed)
    finally:
        words = [sys.executable, "-P", "-m", "rmr_deploy.fleet", "down", "--all", "--timeout", "5"]
        subprocess.run(words, cwd=tmp_path, check=False, capture_output=True, env=dict(os.environ))
    records = list(tmp_path.glob("runs/*/report.json"))
    assert len(records) == 1

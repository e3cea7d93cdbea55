"""Runs of stand-ins in a process of their own, and the verbs of `rmr-fleet` upon them."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from command_runner import Result, invoke

from rmr_deploy.fleet import command

HERE = Path(__file__).parent
WITHIN_S = 60.0
"""Wall time that a loaded machine may take for what takes a second or two."""

PROGRAM = "type at(robot, symbol).\n"
LAB = """
lab: NAME
program: standin.rmr
duration: 600s
finish: at(R, exit)
arena: {size: [3.0, 3.0]}
areas: {exit: {slots: [[2.0, 2.0], [2.0, 1.5]]}}
robots: [{id: 1, pose: [0.5, 0.5, 0deg]}, {id: 2, pose: [1.0, 0.5, 0deg]}]
"""


def eventually(claim: Callable[[], Any]) -> Any:
    """Wait for `claim` to hold and return what it returned."""
    end = time.monotonic() + WITHIN_S
    while not (value := claim()):
        assert time.monotonic() < end, f"not within {WITHIN_S} s"
        time.sleep(0.02)
    return value


def rmr(*words: str) -> Result:
    """Carry out a verb in this process."""
    return invoke(command(), [str(word) for word in words], name="rmr")


def rows(*words: str) -> dict[str, dict[str, Any]]:
    """Return the rows of `rmr ps -a --json` by name."""
    answer = rmr("ps", "-a", "--json", *words)
    assert answer.exit_code == 0, answer.stderr
    return {row["name"]: row for row in json.loads(answer.stdout)["processes"]}


class StandinRun:
    """A launcher with stand-ins for two robots and the world."""

    def __init__(self, place: Path, name: str, first: str, second: str, *options: str) -> None:
        lab = place / name
        lab.mkdir()
        (lab / "standin.rmr").write_text(PROGRAM)
        (lab / "lab.yaml").write_text(LAB.replace("NAME", name))
        self.folder = place / f"run-{name}"
        self.ready = place / f"ready-{name}"
        self._release = place / f"release-{name}"
        behaviours = {"STANDIN_1": first, "STANDIN_2": second, "STANDIN_LAB": name, "STANDIN_READY": str(self.ready)}
        behaviours["STANDIN_RELEASE"] = str(self._release)
        self._output = place / f"{name}.out"
        with self._output.open("w") as output:
            self.process = subprocess.Popen(
                [sys.executable, str(HERE / "standin_up.py"), str(lab), "--run", str(self.folder), *options],
                stdout=output,
                stderr=output,
                env=os.environ | behaviours,
                cwd=place,
                start_new_session=True,
            )

    @property
    def said(self) -> str:
        """What it has written so far."""
        return self._output.read_text()

    def running(self) -> "StandinRun":
        """Wait until its robots are ready."""
        eventually(lambda: " robots ready after " in self.said or self.process.poll() is not None)
        assert self.process.poll() is None, self.said
        self.ready.touch()
        return self

    def release(self) -> None:
        """Let a robot that stalls finish."""
        self._release.touch()

    def pids(self) -> dict[str, int]:
        """Return the ids of its processes."""
        pids: dict[str, int] = json.loads((self.folder / "processes.json").read_text())["processes"]
        return pids

    def wait(self) -> int:
        """Wait for its end and return its exit code."""
        return self.process.wait(WITHIN_S)

    def report(self) -> dict[str, Any]:
        """Return its report."""
        report: dict[str, Any] = json.loads((self.folder / "report.json").read_text())
        return report

    def end(self) -> None:
        """End it if it still runs; its processes end with it."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.kill()
        self.process.wait()

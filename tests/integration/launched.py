"""`rmr up` as a person starts it, with its processes known by their ids."""

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rmr_deploy.status_monitor import StatusMonitor

LABS = Path(__file__).parent / "labs"
CORRIDOR = Path(__file__).parents[2] / "deploy" / "labs" / "corridor"
TESTBED = CORRIDOR.with_name("testbed")
UP = [sys.executable, "-P", "-m", "rmr_deploy.up"]


def eventually(claim: Callable[[], Any], within_s: float = 60.0) -> Any:
    """Wait for `claim` to hold and return what it returned."""
    end = time.monotonic() + within_s
    while not (value := claim()):
        assert time.monotonic() < end, f"not within {within_s} s"
        time.sleep(0.02)
    return value


def runs(pid: int) -> bool:
    """Whether process `pid` exists and has not ended; one that nobody has reaped yet has ended."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (ProcessLookupError, FileNotFoundError):
        return False


class Launched:
    """One `rmr up` in a folder of its own."""

    def __init__(self, lab: Path, folder: Path, *options: str) -> None:
        self.folder = folder / "run"
        self._out, self._err = folder / "stdout", folder / "stderr"
        words = [*UP, str(lab), "--run", str(self.folder), *options]
        with self._out.open("w") as out, self._err.open("w") as err:
            self.process = subprocess.Popen(words, stdout=out, stderr=err, cwd=folder, start_new_session=True)

    @property
    def out(self) -> str:
        """Standard output so far."""
        return self._out.read_text()

    @property
    def err(self) -> str:
        """Standard error so far."""
        return self._err.read_text()

    def running(self) -> "Launched":
        """Wait until all robots are ready."""
        eventually(lambda: " robots ready after " in self.out + self.err or self.process.poll() is not None)
        assert self.process.poll() is None, self.out + self.err
        return self

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by name, as the run folder has them."""
        pids: dict[str, int] = json.loads((self.folder / "processes.json").read_text())["processes"]
        return pids

    @property
    def endpoint(self) -> str:
        """Where the world of the run listens."""
        endpoint: str = json.loads((self.folder / "processes.json").read_text())["connect"]
        return endpoint

    def left(self) -> list[str]:
        """Return the processes of the run that still live."""
        return [name for name, pid in self.pids.items() if runs(pid)]

    def wait(self, within_s: float = 120.0) -> int:
        """Wait for the command's end and return its exit code."""
        return self.process.wait(within_s)

    def report(self) -> dict[str, Any]:
        """Return the report in the run folder."""
        report: dict[str, Any] = json.loads((self.folder / "report.json").read_text())
        return report

    def interrupt(self) -> None:
        """Press Ctrl-C: the whole foreground process group of the terminal gets SIGINT."""
        os.killpg(self.process.pid, signal.SIGINT)

    def leader(self, lab: str, within_s: float = 60.0) -> int:
        """Wait until every robot has heard of a schedule and return the leader of the newest."""
        return asyncio.run(asyncio.wait_for(self._leader(lab), within_s))

    async def _leader(self, lab: str) -> int:
        robots = [int(name.removeprefix("robot-")) for name in self.pids if name != "world"]
        watch = await StatusMonitor.of(lab, self.endpoint, self.folder / "secret")
        try:
            while not all(watch.report(robot).get("schedules") for robot in robots):
                await asyncio.sleep(0.05)
            told = [schedule for robot in robots for schedule in watch.report(robot)["schedules"]]
            return int(max(told, key=lambda schedule: schedule["formed_s"])["leader"])
        finally:
            watch.close()

    def clean_up(self) -> None:
        """End what a failed test has left."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()

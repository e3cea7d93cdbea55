"""`rmr sim --seeds --jobs`: Ctrl-C ends it in order, a process that dies costs one seed, and none is left behind."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from launched import CORRIDOR, eventually, runs


def workers(parent: int) -> list[int]:
    """Return the ids of the processes that share the work of `parent`."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [int(child) for child in children if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text()]


class Swept:
    """A sweep that takes minutes, as a person starts it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "run"
        words = [sys.executable, "-P", "-m", "rmr_sim.main", str(CORRIDOR), "--seeds", "1-500", "--jobs", "2"]
        self.process = subprocess.Popen(
            [*words, "--run", str(self.folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            text=True,
        )

    def __enter__(self) -> "Swept":
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    def interrupt(self) -> None:
        """Press Ctrl-C: all of a terminal's foreground processes get it."""
        os.killpg(self.process.pid, signal.SIGINT)


def test_ctrl_c_sums_up_the_runs_that_are_over_and_leaves_no_process_behind(tmp_path):
    with Swept(tmp_path) as swept:
        both = eventually(lambda: (found := workers(swept.process.pid)) and len(found) == 2 and found)
        os.kill(both[0], signal.SIGKILL)
        after = eventually(lambda: (now := workers(swept.process.pid)) and len(now) == 2 and now != both and now)
        swept.interrupt()
        out, err = swept.process.communicate(timeout=30)
        assert swept.process.returncode == 1
        assert "Traceback" not in err
        assert err.startswith("interrupted: ")
        assert "seed 1: its process ended with exit code -9" in out or "seed 2: its process" in out
        rows = json.loads((swept.folder / "sweep.json").read_text())["rows"]
        assert 1 <= len(rows) < 500
        eventually(lambda: not any(map(runs, [*both, *after])))


@pytest.mark.slow
def test_killed_sweep_leaves_no_worker_process(tmp_path):
    with Swept(tmp_path) as swept:
        found = eventually(lambda: (now := workers(swept.process.pid)) and len(now) == 2 and now)
        swept.process.kill()
        eventually(lambda: not any(map(runs, found)))

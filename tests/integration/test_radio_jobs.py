"""`rmr radio --jobs`: however it is ended, in order or not, no process of its goes on; Ctrl-C shows no traceback."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from launched import eventually

LONG = ("radio", "contention", "--saturated", "--seconds", "1000", "--seeds", "4", "--jobs", "2")
"""Takes minutes."""


def workers(parent: int) -> list[str]:
    """Return the ids of the processes that share the work of `parent`."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return [child for child in children if "spawn_main" in Path(f"/proc/{child}/cmdline").read_text()]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_worker_processes_end_with_the_command(number):
    words = [sys.executable, "-c", "from rmr.cli import main; main()", *LONG]
    with subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True, text=True
    ) as process:
        try:
            eventually(lambda: len(workers(process.pid)) == 2)
            if number == signal.SIGINT:
                os.killpg(process.pid, number)  # Ctrl-C: all of a terminal's foreground processes get it
            else:
                process.send_signal(number)
            _, errors = process.communicate(timeout=30)  # returns when the last that holds the pipe has ended
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    assert process.returncode == (1 if number == signal.SIGINT else -number)
    if number == signal.SIGINT:  # of a process that was about to begin, Python itself tells that its parent was killed
        assert "Traceback" not in errors
        assert "Process Spawn" not in errors

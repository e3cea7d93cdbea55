"""What the page's server costs, with one client that follows: processor time over lab time.

    python tests/bench/view.py [--lab LAB] [--processes N] [--seconds S]

The hall, fifty robots in two processes, as `rmr up --view` starts it. A client here follows the WebSocket and
asks for the timeline once a second, as the page does. The server's processor time is read from the system's table. The
target is 5 % of a core.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from run import LABS, Figure, show
from websockets.sync.client import connect

SHARE_MAX_PERCENT = 5.0
START_S = 120.0
"""How long the run may take to start, on a machine that does other things as well."""


def cpu_s(pid: int) -> float:
    """Return the processor time of a process so far, seconds."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def server_of(folder: Path) -> int:
    """Return the process of the page of the run in `folder`."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = path.read_bytes().split(b"\0")
        except OSError:
            continue
        if b"rmr_view.view" in words and str(folder).encode() in words:
            return int(path.parent.name)
    raise RuntimeError("the page's server does not run")


def address_in(output: Path) -> str:
    """Return the address that `rmr up` has printed, once all robots are ready."""
    end = time.monotonic() + START_S
    while " robots ready after " not in (text := output.read_text()):
        if time.monotonic() > end:
            raise RuntimeError(f"not ready within {START_S:g} s:\n{text}")
        time.sleep(0.1)
    return text.partition("the page: ")[2].split()[0].rstrip("/")


def follow(address: str, folder: Path, wanted_s: float) -> dict[str, float]:
    """Follow the run for `wanted_s` seconds of lab time; return what was measured."""
    with urllib.request.urlopen(f"{address}/api/run", timeout=60) as answer:
        answer.read()
    pid = server_of(folder)
    counts: dict[str, int] = {}
    octets = 0
    with connect(address.replace("http", "ws") + "/ws", max_size=None, compression=None) as following:
        began = last = asked = 0.0
        before = 0.0
        while not before or last < began + wanted_s:
            text = following.recv(30)
            octets += len(text)
            message = json.loads(text)
            counts[message["type"]] = counts.get(message["type"], 0) + 1
            if message["type"] == "poses":
                last = message["t"]
                if not before and last > 1.0:
                    began, before, octets = last, cpu_s(pid), 0
            if message["type"] == "end":
                break
            if last >= asked + 1.0:
                asked = last
                with urllib.request.urlopen(f"{address}/api/timeline", timeout=60) as answer:
                    answer.read()
    lab_s = last - began
    return {"cpu_s": cpu_s(pid) - before, "lab_s": lab_s, "octets": octets, "poses": counts.get("poses", 0)}


def main() -> int:
    """Take the measure; return 1 if the target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lab", type=Path, default=LABS / "hall")
    parser.add_argument("--processes", default="2")
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        output = Path(scratch) / "output"
        words = [sys.executable, "-P", "-m", "rmr_deploy.up", str(options.lab), "--run", str(folder), "--view"]
        with output.open("w") as sink:
            run = subprocess.Popen([*words, "--processes", options.processes], stdout=sink, stderr=sink)
        try:
            told = follow(address_in(output), folder, options.seconds)
            pid = server_of(folder)
        finally:
            run.send_signal(signal.SIGINT)
            run.wait(60)
        os.kill(pid, signal.SIGTERM)
    share = 100.0 * told["cpu_s"] / told["lab_s"]
    figures = [
        Figure("server of the page, one client: share of a core", share, "%", SHARE_MAX_PERCENT),
        Figure("sent to the client", told["octets"] / told["lab_s"] / 1e3, "kB/s"),
        Figure("messages with poses", told["poses"] / told["lab_s"], "/s"),
    ]
    show(figures, [])
    return int(not all(figure.met for figure in figures))


if __name__ == "__main__":
    sys.exit(main())

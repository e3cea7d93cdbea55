"""What a durable robot costs: the processor time of its journal beside that of its node, and the longest write.

    RMR_COMPILED= python tests/bench/durable_cost.py [LAB] [--seeds N]

A lab runs in virtual time, with durable robots whose journals are real files, and with plain ones. The difference of
the processor time of all calls of their nodes, per robot and second of lab time, is what a journal costs: logging,
encoding and writing. Then the same lab runs as plain processes (`rmr up`), whose processor time per robot and second is
what the cost is compared with: a process also serves the bus and its radio.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from rmr.mind.journal import read_journal
from rmr.mind.mind_versions import is_compiled
from rmr_agent.state_files import JOURNAL
from rmr_agent.state_folder import StateFolder
from rmr_sim.run_setup import Options, load

LABS = Path(__file__).parents[2] / "deploy" / "labs"
SHARE_MAX = 0.05
"""Target: share of the journal in a robot's processor time."""
WRITE_MS_MAX = 1.0
"""Target: processor time of the journal in one call, at `process`."""


class Meter:
    """Sums the processor time of calls, the outermost ones."""

    def __init__(self) -> None:
        self.spent = 0
        self.longest = 0
        self.calls = 0
        self._depth = 0

    def timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return `call`, measured."""

        def measured(*args: Any, **named: Any) -> Any:
            self._depth += 1
            began = time.thread_time_ns()
            try:
                return call(*args, **named)
            finally:
                self._depth -= 1
                if not self._depth:
                    took = time.thread_time_ns() - began
                    self.spent += took
                    self.longest = max(self.longest, took)
                    self.calls += 1

        return measured


def nodes_ns(lab: Path, seed: int, folder: Path | None) -> tuple[int, Meter, int, float]:
    """Run a lab; return the time of all calls of nodes, the meter of commits, octets written, and lab time in s."""
    nodes = Meter()
    commits = Meter()
    simulation = load(lab, Options(durable=folder is not None)).simulation(seed)
    octets = 0
    for robot in simulation.robots:
        node: Any = robot.node
        if folder is not None:
            place = StateFolder(folder / str(robot.robot), robot.robot, node.state.digest, "process")
            node._journal._file = _file(place, read_journal(robot._disk.data + b"".join(robot._disk._chunks)))
            node.commit = commits.timed(node.commit)
        for name in ("tick", "overhear", "insert"):
            setattr(node, name, nodes.timed(getattr(node, name)))
    simulation.run()
    if folder is not None:
        octets = sum(path.stat().st_size for path in folder.glob(f"*/{JOURNAL}"))
    return nodes.spent, commits, octets, simulation.time_s


def _file(folder: StateFolder, begun: Any) -> Any:
    """Return the file to which a journal goes on that has begun in memory."""
    assert begun.header is not None
    return folder._journal(begun.header)._file


def process_ns(lab: Path) -> float:
    """Return the processor time of a plain robot process per second of lab time, in ns."""
    spent: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        words = [sys.executable, "-c", "from rmr.cli import main; main()", "up", str(lab), "--no-view", "--no-record"]
        process = subprocess.Popen([*words, "--run", str(run)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        begun: dict[str, float] = {}
        while process.poll() is None:
            for name, ns in _robots_ns(run).items():
                spent[name] = ns
                if not (run / "report.json").exists():
                    begun.setdefault(name, ns)
            time.sleep(0.05)
        report = json.loads((run / "report.json").read_text("utf-8"))
    # From the first look on: the start of a process is none of the run.
    return sum(spent[name] - begun[name] for name in spent) / len(report["robots"]) / report["time_s"]


def _robots_ns(run: Path) -> dict[str, float]:
    """Return the processor time so far of the robots' processes that are ready, by name."""
    found: dict[str, float] = {}
    try:
        pids = json.loads((run / "processes.json").read_text("utf-8"))["processes"]
    except (OSError, ValueError):
        return found
    for name, pid in pids.items():
        log = run / "logs" / f"{name}.jsonl"
        with suppress(OSError):
            if name.startswith("robot") and "is in lab" in log.read_text("utf-8"):
                words = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
                if words[0] != "Z":
                    found[name] = (int(words[11]) + int(words[12])) * 1e9 / os.sysconf("SC_CLK_TCK")
    return found


def main() -> int:
    """Measure, print, and return 1 if a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("lab", nargs="?", type=Path, default=LABS / "corridor")
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    if is_compiled():
        print(
            "compiled nodes cannot be timed call by call: run it with RMR_COMPILED= in the environment", file=sys.stderr
        )
        return 2
    plain = durable = octets = 0
    longest = written = calls = 0
    lived_s = 0.0
    for seed in range(1, arguments.seeds + 1):
        plain += nodes_ns(arguments.lab, seed, None)[0]
        with tempfile.TemporaryDirectory() as folder:
            spent, commits, size, time_s = nodes_ns(arguments.lab, seed, Path(folder))
        durable += spent
        written += commits.spent
        calls += commits.calls
        longest = max(longest, commits.longest)
        octets += size
        lived_s += time_s * len(load(arguments.lab, Options()).lab.roster)
    process = process_ns(arguments.lab)
    share = (durable - plain) / lived_s / process
    print(f"calls of a node, plain     {plain / lived_s / 1e6:8.2f} ms per second of lab time")
    print(f"calls of a node, durable   {durable / lived_s / 1e6:8.2f} ms")
    print(f"plain robot process        {process / 1e6:8.2f} ms")
    print(f"share of the journal       {100 * share:8.2f} % of the process (target {100 * SHARE_MAX:g} %)")
    print(f"commits                    {calls / lived_s:8.1f} a second, {written / calls / 1000:.0f} us each")
    print(f"longest commit             {longest / 1e6:8.3f} ms (target {WRITE_MS_MAX:g} ms)")
    print(f"journal                    {octets / lived_s / 1000:8.1f} kB a second")
    return int(share > SHARE_MAX or longest / 1e6 > WRITE_MS_MAX)


if __name__ == "__main__":
    sys.exit(main())

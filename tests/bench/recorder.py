"""What recording costs: processor time of robot processes and of the simulator, with and without; octets a second.

    python tests/bench/recorder.py [--rounds N] [--lab LAB] [--output FILE]

Runs with and without `--no-record` take turns, so that whatever else the machine does falls on both. Of a run of
processes the processor time of all robots counts from when all are ready until the last reading before the end, per
second of lab time; the start is told beside it. Targets: at most 5 % of a robot's processor time, 10 kB/s a robot.
The exit code is 0 only if both are met. Linux only (/proc).
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
SHARE_MAX = 0.05
OCTETS_MAX = 10_000.0
POLL_S = 0.1
TICKS = os.sysconf("SC_CLK_TCK")


class Cost(NamedTuple):
    """One run."""

    share: float
    """Processor time of a robot per second of lab time, in seconds."""
    start_s: float
    """Processor time of a robot until all are ready."""
    octets_s: float
    """Of the recording, per robot and second of lab time."""


def cpu_s(pid: int) -> float | None:
    """Return the processor time that a process has used; None when it is gone."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return (int(fields[11]) + int(fields[12])) / TICKS


def run_processes(lab: str, record: bool) -> Cost:
    """Run the lab as processes."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        words = [*rmr("rmr_deploy.up"), lab, "--run", str(folder), *([] if record else ["--no-record"])]
        said = Path(scratch) / "said"
        with said.open("w") as output:
            process = subprocess.Popen(words, stdout=output, stderr=output, cwd=ROOT)
        begun: dict[int, float] = {}
        last: dict[int, float] = {}
        while process.poll() is None:
            time.sleep(POLL_S)
            for pid in robots_of(folder):
                used = cpu_s(pid)
                if used:
                    last[pid] = used
                    if "robots ready" in said.read_text():
                        begun.setdefault(pid, used)
        report = json.loads((folder / "report.json").read_text())
        size = (folder / "run.mcap").stat().st_size if record else 0
        time_s = report["time_s"]
        count = len(begun)
        spent = sum(last.values()) - sum(begun.values())
        return Cost(spent / count / time_s, sum(begun.values()) / count, size / len(report["robots"]) / time_s)


def robots_of(folder: Path) -> list[int]:
    """Return the process ids of the robots of the run."""
    try:
        pids = json.loads((folder / "processes.json").read_text())["processes"]
    except (OSError, ValueError):
        return []
    return [pid for name, pid in pids.items() if name != "world"]


def run_simulated(lab: str, record: bool) -> Cost:
    """Run the lab in virtual time; `start_s` is the whole."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "run"
        before = children_s()
        words = [*rmr("rmr_sim.main"), lab, "--run", str(folder), *([] if record else ["--no-record"])]
        subprocess.run(words, capture_output=True, check=False, cwd=ROOT)
        spent = children_s() - before
        report = json.loads((folder / "report.json").read_text())
        size = (folder / "run.mcap").stat().st_size if record else 0
        robots = len(report["robots"])
        return Cost(spent / robots / report["time_s"], spent, size / robots / report["time_s"])


def children_s() -> float:
    """Return the processor time of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def rmr(module: str) -> list[str]:
    """Return the command that runs `module`."""
    return [sys.executable, "-P", "-m", module]


def compared(name: str, pairs: list[tuple[Cost, Cost]]) -> dict[str, float]:
    """Show the medians of the rounds and return them."""
    without, with_ = (statistics.median(pair[side].share for pair in pairs) for side in (0, 1))
    ratios = sorted(pair[1].share / pair[0].share for pair in pairs)
    figures = {
        "rounds": len(pairs),
        "ms_per_s_without": 1e3 * without,
        "ms_per_s_with": 1e3 * with_,
        "ratio": statistics.median(ratios),
        "ratio_least": ratios[0],
        "ratio_greatest": ratios[-1],
        "start_s_without": statistics.median(pair[0].start_s for pair in pairs),
        "start_s_with": statistics.median(pair[1].start_s for pair in pairs),
        "octets_per_robot_s": statistics.median(pair[1].octets_s for pair in pairs),
    }
    print(
        f"{name}: {figures['ms_per_s_without']:.1f} -> {figures['ms_per_s_with']:.1f} ms of processor time per robot "
        f"and second, ratio {figures['ratio']:.3f} ({ratios[0]:.3f} to {ratios[-1]:.3f}, {len(pairs)} rounds); start "
        f"{figures['start_s_without']:.2f} -> {figures['start_s_with']:.2f} s; "
        f"{figures['octets_per_robot_s'] / 1e3:.1f} kB/s a robot"
    )
    return figures


def main() -> int:
    """Measure; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--lab", default="deploy/labs/corridor")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "bench-recorder.json")
    options = parser.parse_args()
    found = {}
    for name, run in (("processes", run_processes), ("simulated", run_simulated)):
        pairs = [(run(options.lab, False), run(options.lab, True)) for _ in range(options.rounds)]
        found[name] = compared(name, pairs)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(json.dumps(found, indent=1) + "\n")
    processes = found["processes"]
    met = processes["ratio"] <= 1.0 + SHARE_MAX and processes["octets_per_robot_s"] <= OCTETS_MAX
    print("targets met" if met else "targets missed: at most 1.05, and 10 kB/s a robot")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())

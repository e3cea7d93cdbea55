"""The figures that the project promises, taken on this machine: a table, and JSON in build/bench.json.

    python tests/bench/run.py [--quick] [--output FILE]

Each figure is taken through the public commands, as a person would, with its seeds and its target beside it.
A figure that cannot be taken is an error and never a blank; the exit code is 0 only if every figure was taken
and every target is met.
"""

import argparse
import json
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
LABS = ROOT / "deploy" / "labs"
PROGRAMS = ROOT / "tests" / "programs"
RUN_S_MAX = 240
"""Longer than the longest lab and its start; a run that takes longer hangs."""

EVALUATED = 10_000
"""Robots of one evaluation: each is a whole node, and they talk to their neighbours on a grid."""

FORMATTED = 10_000
"""Items of one program that is formatted, at least."""

BOUND_RATIO = {"corridor": 1.8, "testbed": 1.6}
"""Time of a run over its physical bound, at most: what the evaluation asks of the 99th percentile."""


@dataclass(frozen=True)
class Figure:
    """One measured value beside what it should be."""

    name: str
    value: float
    unit: str
    target: float | None = None
    """The bound that must hold; None: for information."""
    at_least: bool = False
    """The target is a lower bound, not an upper one."""
    seeds: str = ""

    @property
    def met(self) -> bool:
        """Whether the target holds."""
        if self.target is None:
            return True
        return self.value >= self.target if self.at_least else self.value <= self.target


class UntakenError(Exception):
    """A figure could not be taken, and why."""


def command(module: str, *arguments: str) -> list[str]:
    return [sys.executable, "-P", "-m", module, *arguments]


def run(words: Sequence[str]) -> subprocess.CompletedProcess[str]:
    """Run a command to its end. Raises UntakenError when it fails."""
    try:
        answer = subprocess.run(words, capture_output=True, text=True, timeout=RUN_S_MAX, check=False)
    except subprocess.TimeoutExpired as error:
        raise UntakenError(f"no end after {RUN_S_MAX} s: {' '.join(words)}") from error
    if answer.returncode:
        last = answer.stderr.strip().splitlines()[-1:] or [""]
        raise UntakenError(f"exit code {answer.returncode}: {' '.join(words)}: {last[0]}")
    return answer


def used(words: Sequence[str]) -> resource.struct_rusage:
    """Run a command whose output is of no interest; return what it used. Raises UntakenError when it fails."""
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise UntakenError(f"exit code {process.returncode}: {' '.join(words)}")
    return usage


# --- single figures -----------------------------------------------------------------------------------------


def help_cpu(repetitions: int) -> Iterable[Figure]:
    """Processor time of ``rmr --help``, the interpreter's start included."""
    code = "import sys; sys.argv = ['rmr', '--help']; from rmr.cli import main; main()"
    usages = [used([sys.executable, "-c", code]) for _ in range(repetitions)]
    taken = [(usage.ru_utime + usage.ru_stime) * 1e3 for usage in usages]
    yield Figure("rmr --help, processor time", statistics.median(taken), "ms", 150)


def formatted() -> Iterable[Figure]:
    """Processor time of ``rmr fmt`` for a program that nobody would write by hand, unformatted."""
    text = (LABS / "corridor" / "corridor.rmr").read_text()
    copies = -(-FORMATTED // len(re.findall(r"^[^/\n]+\.", text, re.MULTILINE)))
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "long.rmr"
        program.write_text(text.replace(", ", ",") * copies)
        usage = used([sys.executable, "-c", "from rmr.cli import main; main()", "fmt", str(program)])
    yield Figure(f"rmr fmt, {FORMATTED} items: processor time", usage.ru_utime + usage.ru_stime, "s", 10)


def octets(name: str, source: Path, target: int) -> Iterable[Figure]:
    """Size of a program's byte-code without debug information."""
    from rmr.bytecode import codec
    from rmr.lang.compiler import compile_file

    compilation = compile_file(source)
    if compilation.program is None:
        raise UntakenError(f"{source} does not compile")
    yield Figure(f"{name}, byte-code", len(codec.encode(compilation.program, debug=False)), "octets", target)


def evaluated() -> Iterable[Figure]:
    """Processor time and memory of ``rmr eval`` with very many robots."""
    words = ["--robots", str(EVALUATED), "--topology", "grid", "--edges", "near"]
    program = str(ROOT / "tests" / "bench" / "programs" / "spread.rmr")
    usage = used([sys.executable, "-c", "from rmr.cli import main; main()", "eval", program, *words])
    yield Figure(f"rmr eval, {EVALUATED} robots: processor time", usage.ru_utime + usage.ru_stime, "s", 60)
    yield Figure(f"rmr eval, {EVALUATED} robots: memory", usage.ru_maxrss / 1024, "MB", 2000)


# --- runs ---------------------------------------------------------------------------------------------------


class Runs:
    """Reports of one lab in one mode over some seeds."""

    def __init__(self, lab: str, mode: str, seeds: Sequence[int]) -> None:
        self.lab, self.mode = lab, mode
        self.seeds = f"{seeds[0]}-{seeds[-1]}" if len(seeds) > 1 else str(seeds[0])
        self._take = simulate if mode == "simulated" else launch
        self.reports = [self._take(LABS / lab, seed) for seed in seeds]

    def figures(self) -> Iterable[Figure]:
        """Yield what all modes have in common."""
        name = f"{self.lab}, {self.mode}"
        ratios = [report["time_s"] / report["bound_s"] for report in self.reports]
        yield Figure(f"{name}: worst time / bound", max(ratios), "", BOUND_RATIO[self.lab], seeds=self.seeds)
        yield Figure(f"{name}: median time / bound", statistics.median(ratios), "", seeds=self.seeds)
        yield self._sum("collisions", [report["collisions"] for report in self.reports])
        yield self._sum("deadlines missed", [report["deadlines"]["missed"] for report in self.reports])
        yield self._sum("runs not finished", [not report["finished"] for report in self.reports])
        yield Figure(
            f"{name}: smallest gap", min(report["min_gap_m"] for report in self.reports) * 1e3, "mm", seeds=self.seeds
        )

    def _sum(self, what: str, values: Iterable[float]) -> Figure:
        return Figure(f"{self.lab}, {self.mode}: {what}", sum(values), "", 0, seeds=self.seeds)


def simulated(lab: str, seeds: Sequence[int]) -> Iterable[Figure]:
    """Figures of a lab in the simulator."""
    runs = Runs(lab, "simulated", seeds)
    yield from runs.figures()
    lab_s = [report["time_s"] for report in runs.reports]
    alone = [time_s / report["simulation_s"] for time_s, report in zip(lab_s, runs.reports, strict=True)]
    whole = [time_s / report["command_cpu_s"] for time_s, report in zip(lab_s, runs.reports, strict=True)]
    name = f"{lab}, simulated"
    target = 20 if lab == "corridor" else None
    yield Figure(f"{name}: speed", statistics.median(alone), "x real time", target, at_least=True, seeds=runs.seeds)
    yield Figure(f"{name}: lab time / processor time of the command", statistics.median(whole), "", seeds=runs.seeds)


def processes(lab: str, seeds: Sequence[int]) -> Iterable[Figure]:
    """Figures of a lab as processes."""
    runs = Runs(lab, "processes", seeds)
    yield from runs.figures()
    ready = [report["ready_s"] for report in runs.reports]
    cpu = [report["robot_cpu"] for report in runs.reports]
    name = f"{lab}, processes"
    yield Figure(f"{name}: all ready after", max(ready), "s", 5, seeds=runs.seeds)
    yield Figure(f"{name}: a robot's processor share", statistics.median(cpu) * 100, "% of a core", seeds=runs.seeds)


def simulate(lab: Path, seed: int) -> dict[str, Any]:
    """Return the report of ``rmr sim`` with `simulation_s`, as the command says, and `command_cpu_s`, all in."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    answer = run(command("rmr_sim.main", str(lab), "--seed", str(seed), "--json"))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    told = re.search(r"simulated in ([\d.]+) s", answer.stderr)
    if told is None:
        raise UntakenError("rmr sim did not say how long it took")
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {**json.loads(answer.stdout), "simulation_s": float(told[1]), "command_cpu_s": cpu_s}


def launch(lab: Path, seed: int) -> dict[str, Any]:
    """Return the report of ``rmr up`` with `ready_s`, from the command's start, and `robot_cpu`, a share of a core."""
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder) / "run"
        words = command("rmr_deploy.up", str(lab), "--seed", str(seed), "--json", "--run", str(where))
        began = time.perf_counter()
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            watch = CpuWatch(where / "processes.json")
            watchdog = threading.Timer(RUN_S_MAX, process.terminate)
            watchdog.start()
            assert process.stderr is not None
            assert process.stdout is not None
            ready_s, last = None, ""
            for line in process.stderr:
                last = line.strip() or last
                if ready_s is None and " robots ready " in line:
                    ready_s = time.perf_counter() - began
                    watch.start()
            output = process.stdout.read()
            watchdog.cancel()
        share = watch.stop()
        if process.returncode not in (0, 1) or not output or ready_s is None:
            raise UntakenError(f"exit code {process.returncode}: {' '.join(words)}: {last}")
    return {**json.loads(output), "ready_s": ready_s, "robot_cpu": share}


class CpuWatch:
    """Processor time of the robot processes of a run, sampled until they end."""

    PERIOD_S = 0.25

    def __init__(self, processes: Path) -> None:
        self._file = processes
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._sample, daemon=True)
        self._shares: list[float] = []

    def start(self) -> None:
        """Begin, now that the processes stand in the run folder."""
        pids = json.loads(self._file.read_text())["processes"]
        self._pids = [pid for name, pid in pids.items() if name.startswith("robot-")]
        self._thread.start()

    def stop(self) -> float:
        """Return the mean share of a core that a robot process used. Raises UntakenError when nothing was sampled."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join()
        if not self._shares:
            raise UntakenError("no processor time of a robot process could be read")
        return self._shares[-1]

    def _sample(self) -> None:
        began, at_first = time.perf_counter(), self._cpu_s()
        while not self._over.wait(self.PERIOD_S):
            used = self._cpu_s()
            if used is None or at_first is None:
                return
            self._shares.append((used - at_first) / (time.perf_counter() - began) / len(self._pids))

    def _cpu_s(self) -> float | None:
        """Return processor seconds used by all robot processes so far; None when one has ended (proc(5), stat)."""
        try:
            fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in self._pids]
        except OSError:
            return None
        if any(field[0] == "Z" for field in fields):
            return None
        return sum(int(field[11]) + int(field[12]) for field in fields) / os.sysconf("SC_CLK_TCK")


# --- all of it ----------------------------------------------------------------------------------------------


def suite(*, quick: bool) -> dict[str, Callable[[], Iterable[Figure]]]:
    """Return what to take, by name."""
    few, more = (range(1, 2), range(1, 4)) if quick else (range(1, 4), range(1, 11))
    return {
        "rmr --help": lambda: help_cpu(5 if quick else 15),
        "rmr eval": evaluated,
        "rmr fmt": formatted,
        "figure 3": lambda: octets("figure 3", PROGRAMS / "figure3.rmr", 256),
        "figure 4": lambda: octets("figure 4", PROGRAMS / "figure4.rmr", 256),
        "corridor.rmr": lambda: octets("corridor.rmr", LABS / "corridor" / "corridor.rmr", 2048),
        "corridor, simulated": lambda: simulated("corridor", more),
        "testbed, simulated": lambda: simulated("testbed", more),
        "corridor, processes": lambda: processes("corridor", few),
        "testbed, processes": lambda: processes("testbed", few),
    }


def take(name: str, figures: Callable[[], Iterable[Figure]]) -> tuple[list[Figure], str | None]:
    """Return the figures and, when they cannot be taken, why."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{name} ...", end="", file=sys.stderr, flush=True)
    try:
        return list(figures()), None
    except Exception as error:
        return [], f"{name}: {error if isinstance(error, UntakenError) else repr(error)}"


def show(figures: Sequence[Figure], errors: Sequence[str]) -> None:
    """Print the table and the errors."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr)
    width = max((len(figure.name) for figure in figures), default=0)
    for figure in figures:
        sign = ">=" if figure.at_least else "<="
        target = "" if figure.target is None else f"{sign} {figure.target:g}"
        seeds = f"seeds {figure.seeds}" if figure.seeds else ""
        verdict = "" if figure.target is None else "ok" if figure.met else "MISSED"
        value = f"{figure.value:.2f}".rstrip("0").rstrip(".")
        print(f"{figure.name:<{width}}  {value:>9} {figure.unit:<12} {target:<9} {verdict:<7} {seeds}".rstrip())
    for error in errors:
        print(f"ERROR  {error}", file=sys.stderr)


def main() -> int:
    """Take all figures; return the exit code."""
    parser = argparse.ArgumentParser(description="Take the figures that the project promises.")
    parser.add_argument("--quick", action="store_true", help="fewer seeds and repetitions")
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "bench.json", metavar="FILE")
    parser.add_argument("--only", metavar="WORD", default="", help="only what has WORD in its name")
    options = parser.parse_args()
    figures: list[Figure] = []
    errors: list[str] = []
    for name, call in suite(quick=options.quick).items():
        if options.only not in name:
            continue
        taken, error = take(name, call)
        figures += taken
        errors += [error] if error else []
    show(figures, errors)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    record = {
        "taken": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {"cores": os.cpu_count(), "python": platform.python_version(), "system": platform.system()},
        "quick": options.quick,
        "figures": [{**asdict(figure), "met": figure.met} for figure in figures],
        "errors": errors,
    }
    options.output.write_text(json.dumps(record, indent=1) + "\n")
    return 0 if figures and not errors and all(figure.met for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())

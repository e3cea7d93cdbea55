"""Compares two trees of RMR, octet by octet: `python tests/compare_trees.py TREE [--runs N] [--first SEED]`.

Runs the same labs in this tree and in TREE, such as a clone of an earlier commit, and compares what comes of them: what
the run prints, report, trace, mind logs, and the answers of `rmr why --missed` and of `rmr why` about a fact that a
robot holds in the end. The labs are, in turn, one of the provided ones and a drawn one (`tests/score/drawn_lab.py`), as
they are in this tree; every third run has chaos. All is done interpreted, and once more compiled where both trees
are built (`make fast`).

For each run and file that differs it names the first difference. Exit code 0 says that there is none, 1 that there is
one, 2 that TREE is none. A change that shall change nothing is shown by `--runs 100`. TREE's sources are run by
the Python that runs this script, so it needs no environment of its own.
"""

import argparse
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any, Final, NamedTuple

HERE: Final = Path(__file__).resolve().parents[1]
PACKAGES: Final = ("", "agents", "world", "deploy")
"""Folders of a tree from which its packages are imported."""
FILES: Final = ("printed.json", "report.json", "trace.jsonl", "minds.txt", "why-missed.json", "why-fact.json")
SOURCES: Final = re.compile(rb"sources\xb0[0-9a-f]{16}")
"""The digest of all sources in the header of a mind log, in which two trees differ in any case."""
CRC_OCTETS: Final = 4
"""Of the check sum behind that header."""
BUILT: Final = "from rmr.compiled import FOLDER, modules_in; print(len(modules_in(FOLDER)))"


class Case(NamedTuple):
    """A run."""

    lab: Path
    name: str
    seed: int
    chaos: bool

    def __str__(self) -> str:
        return f"{self.name} --seed {self.seed}{' --chaos' if self.chaos else ''}"


def cases(folder: Path, first: int, runs: int) -> Iterator[Case]:
    """Yield the runs; their labs are written into `folder`."""
    provided = sorted(path.parent for path in (HERE / "deploy" / "labs").glob("*/lab.yaml"))
    for lab in provided:
        shutil.copytree(lab, folder / lab.name)
    for seed in range(first, first + runs):
        name = provided[seed // 2 % len(provided)].name
        if seed % 2:
            name = f"drawn-{seed}"
            words = [sys.executable, str(HERE / "tests" / "score" / "drawn_lab.py"), str(seed), str(folder / name)]
            subprocess.run(words, env=environment(HERE, compiled=False), stdout=subprocess.DEVNULL, check=True)
        yield Case(folder / name, name, seed, seed % 3 == 0)


def environment(tree: Path, *, compiled: bool) -> dict[str, str]:
    """Return the environment in which Python imports the packages of `tree`."""
    found = {name: value for name, value in os.environ.items() if name != "RMR_COMPILED"}
    found["PYTHONPATH"] = os.pathsep.join(str(tree / package) for package in PACKAGES)
    return found if compiled else found | {"RMR_COMPILED": ""}


def is_built(tree: Path) -> bool:
    """Return whether `tree` has compiled modules of its sources as they are."""
    words = [sys.executable, "-c", BUILT]
    answer = subprocess.run(words, env=environment(tree, compiled=True), capture_output=True, text=True, check=True)
    return int(answer.stdout) > 0


# -- one run, in a process that imports the packages of one tree ----------------------------------------------------


def perform(lab: str, seed: str, folder: Path, *more: str) -> None:
    """Make one run and write `FILES` into `folder`."""
    from rmr.record.recording import open_recording
    from rmr_deploy.why_program import why_command
    from rmr_sim.main import main as simulate

    run = folder / "run"
    words = [lab, "--seed", seed, "--run", str(run), "--trace", str(folder / "trace.jsonl"), *more]
    printed = called(lambda: simulate(words))
    (folder / "printed.json").write_text(json.dumps(printed))
    if not (run / "report.json").exists():
        return  # refused
    shutil.copy(run / "report.json", folder)
    with open_recording(run) as recording, (folder / "minds.txt").open("w") as file:
        for message in recording.messages(("/mind",)):
            mind = dict(message.data)
            if SOURCES.search(mind["data"]):
                mind["data"] = SOURCES.sub(b"sources", mind["data"])[:-CRC_OCTETS]
            file.write(f"{message.at} {mind}\n")
    asked = {"why-missed": ["--missed"], "why-fact": a_fact(json.loads((run / "report.json").read_text()))}
    for name, question in asked.items():
        words = [str(run), *question, "--json"]
        told = called(lambda words=words: why_command().main(words, name="rmr why"))
        (folder / f"{name}.json").write_text(json.dumps(told).replace(str(folder), ""))


def a_fact(report: dict[str, Any]) -> list[str]:
    """Return a fact that a robot holds at the end of a run."""
    return next(([part["facts"][-1]] for part in report["robots"].values() if part.get("facts")), ["at(@1, _)"])


def called(command: Any) -> list[str]:
    """Return how a command has ended, and what it has printed."""
    out = StringIO()
    ended = "returned"
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(StringIO()):
        try:
            command()
        except SystemExit as end:
            ended = f"exit {end.code}"
    return [ended, *out.getvalue().splitlines()]


# -- both runs ------------------------------------------------------------------------------------------------------


def differences(case: Case, tree: Path, *, compiled: bool) -> list[str]:
    """Make a run in both trees; return what differs, a sentence for each file."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"  # the same path for both, as outputs name it
        kept: list[Path] = []
        failed = []
        for number, each in enumerate((HERE, tree)):
            folder.mkdir()
            more = ["--chaos"] if case.chaos else []
            words = [sys.executable, __file__, "--perform", str(case.lab), str(case.seed), str(folder), *more]
            answer = subprocess.run(
                words, env=environment(each, compiled=compiled), capture_output=True, text=True, check=False
            )
            if answer.returncode:
                failed.append(f"{each}: {answer.stderr.strip().splitlines()[-1:]}")
            kept.append(folder.rename(Path(place) / str(number)))
        return failed or [
            f"{name}: {what}" for name in FILES if (what := difference(kept[0] / name, kept[1] / name)) is not None
        ]


def difference(ours: Path, theirs: Path) -> str | None:
    """Return the first difference of two files, in words; None: they are equal, or neither is there."""
    octets = [path.read_bytes() if path.exists() else None for path in (ours, theirs)]
    if octets[0] == octets[1]:
        return None
    if octets[0] is None or octets[1] is None:
        return f"only {'the other tree' if octets[0] is None else 'this tree'} has it"
    lines = [each.splitlines() for each in octets if each is not None]
    for number, (here, there) in enumerate(zip(*lines, strict=False), 1):
        if here != there:
            at = next(
                (place for place, (a, b) in enumerate(zip(here, there, strict=False)) if a != b),
                min(len(here), len(there)),
            )
            begin = max(0, at - 60)
            parts = [each[begin : at + 60].decode(errors="replace") for each in (here, there)]
            return f"line {number}, octet {at}: here {parts[0]!r}, there {parts[1]!r}"
    return f"here {len(lines[0])} lines, there {len(lines[1])}"


def compare(tree: Path, first: int, runs: int) -> int:
    """Make all runs in both trees and print what differs; return how many runs differ."""
    forms = {"interpreted": False} | ({"compiled": True} if is_built(HERE) and is_built(tree) else {})
    differ = 0
    with tempfile.TemporaryDirectory() as labs:
        for case in cases(Path(labs), first, runs):
            for form, compiled in forms.items():
                found = differences(case, tree, compiled=compiled)
                differ += bool(found)
                print(f"{case}, {form}: {'equal' if not found else 'DIFFERS'}", flush=True)
                for each in found:
                    print(f"    {each}", flush=True)
    print(f"{runs} runs, {' and '.join(forms)}: {differ} differ")
    return differ


def main() -> int:
    """Compare; return the exit code."""
    parser = argparse.ArgumentParser(description="Compare this tree with another one, octet by octet.")
    parser.add_argument("tree", type=Path, help="the other tree: a folder with rmr, agents, world and deploy")
    parser.add_argument("--runs", type=int, default=14, help="how many (default: 14, each provided lab once)")
    parser.add_argument("--first", type=int, default=1, help="seed of the first (default: 1)")
    options = parser.parse_args()
    tree = options.tree.resolve()
    if not all((tree / package).is_dir() for package in ("rmr", *PACKAGES)):
        parser.error(f"{tree} is no tree of RMR: it has no folders rmr, agents, world and deploy")
    return 1 if compare(tree, options.first, options.runs) else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--perform"]:
        lab, seed, folder, *more = sys.argv[2:]
        perform(lab, seed, Path(folder), *more)
    else:
        sys.exit(main())

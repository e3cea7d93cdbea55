"""Takes the experiments of docs/evaluation, writes their data, tables and figures, and tells which targets are met.

    python tests/evaluation/evaluate.py [NAME...] [--jobs N] [--seeds A-B] [--quick] [--out DIR]

README.md in this folder says how an experiment is added. The exit code is 0 only if every target is met.
"""

import argparse
import json
import os
import platform
import re
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from traceback import print_exc

from experiment import Data, Experiment, as_json, renewed, table, target_lines

import rmr

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "evaluation"
EXPERIMENTS: tuple[str, ...] = (
    "figure14",
    "seeds",
    "formation",
    "twoway",
    "schedulers",
    "waiting",
    "planning",
    "localisation",
    "standoffs",
)
"""In the order of the page."""
HEADER = ("target", "taken", "bound", "")


def taken(experiment: Experiment, seeds: Sequence[int], jobs: int, *, quick: bool) -> Data:
    """Return all data of an experiment, with when and where they were taken."""
    began = time.monotonic()
    found = experiment.run(seeds, jobs)
    return {
        "name": experiment.NAME,
        "version": rmr.__version__,
        "taken": datetime.now(UTC).date().isoformat(),
        "machine": {"cores": os.cpu_count(), "system": platform.system(), "python": platform.python_version()},
        "wall_s": round(time.monotonic() - began, 1),
        "seeds": f"{seeds[0]}-{seeds[-1]}",
        "quick": quick,
        **found,
    }


def write(folder: Path, experiment: Experiment, data: Data) -> None:
    """Write the data into `folder`, renew the page there if there is one, and draw the figure if that can be."""
    file = folder / f"{experiment.NAME}.json"
    file.write_text(as_json(data), "utf-8")
    page = folder / "README.md"
    if page.is_file():
        text = page.read_text("utf-8")
        for mark, lines in experiment.tables(data).items():
            text = renewed(text, lines, mark)
        page.write_text(text, "utf-8")
    if "figure" in data:
        drawn(file)


def drawn(file: Path) -> None:
    """Draw the figure of a data file beside it; without matplotlib say so."""
    from rmr_view.chart import read

    figure = read(file)
    try:
        from rmr_view.draw import draw

        draw(figure, file.with_suffix(".svg"))
    except ModuleNotFoundError:
        print(f"{file.stem}: not drawn: matplotlib is not installed", file=sys.stderr)


def _jobs(text: str) -> int:
    if not re.fullmatch("[1-9][0-9]?", text):
        raise argparse.ArgumentTypeError(f"1 to 99 processes, not {text!r}")
    return int(text)


def _seeds(text: str) -> range:
    match = re.fullmatch(r"([0-9]{1,18})(?:-([0-9]{1,18}))?", text)
    seeds = range(int(match[1]), int(match[2] or match[1]) + 1) if match else range(0)
    if not seeds:
        raise argparse.ArgumentTypeError(f"seeds such as 1-100, the least first, not {text!r}")
    return seeds


def options(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what is asked for; wrong usage, and a place that cannot be written to, end the process with 2."""
    parser = argparse.ArgumentParser(description="Take the experiments of docs/evaluation.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(EXPERIMENTS)} (default: all)")
    parser.add_argument("--jobs", type=_jobs, default=os.cpu_count() or 1, metavar="N", help="processes at once")
    parser.add_argument("--seeds", type=_seeds, metavar="A-B", help="instead of each experiment's own")
    parser.add_argument("--quick", action="store_true", help="a few seeds, to see that everything works")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to write (quick: build/evaluation)")
    chosen = parser.parse_args(words)
    if unknown := [name for name in chosen.names if name not in EXPERIMENTS]:
        parser.error(f"no such experiment: {', '.join(unknown)}; there are {', '.join(EXPERIMENTS)}")
    chosen.out = chosen.out or (ROOT / "build" / "evaluation" if chosen.quick else FOLDER)
    try:
        chosen.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        parser.error(f"--out {chosen.out}: {error.strerror}")
    return chosen


def seeds_of(experiment: Experiment, chosen: argparse.Namespace) -> Sequence[int]:
    """Return the seeds that the options ask for."""
    if chosen.seeds:
        return chosen.seeds
    return experiment.QUICK if chosen.quick else experiment.SEEDS


def attempted(name: str, chosen: argparse.Namespace, folder: Path) -> bool:
    """Take one experiment and write what it found; return whether that went well. What goes wrong is told."""
    print(f"{name} ...", file=sys.stderr, flush=True)
    try:
        experiment: Experiment = import_module(name)  # type: ignore[assignment]
        data = taken(experiment, seeds_of(experiment, chosen), chosen.jobs, quick=chosen.quick)
        write(folder, experiment, data)
    except Exception:  # the other experiments take their time, and nobody may be there to start them again
        print_exc()
        return False
    print(f"{name}: {data['wall_s']:.0f} s", file=sys.stderr, flush=True)
    return True


def known(folder: Path) -> list[Data]:
    """Return the data in `folder`, in the order of the page."""
    files = [folder / f"{name}.json" for name in EXPERIMENTS]
    return [json.loads(file.read_text("utf-8")) for file in files if file.is_file()]


def overview(found: Sequence[Data]) -> list[str]:
    """Return what the page says of all experiments: missed targets, seeds, when and where they were taken."""
    targets = [each for data in found for each in data.get("targets", [])]
    missed = [each for each in targets if not each["met"]]
    lines = [f"{len(targets) - len(missed)} of {len(targets)} targets are met."]
    if missed:
        lines += ["", *table(HEADER, target_lines(missed))]
    taken_at: dict[str, list[str]] = {}
    for data in found:
        machine = data["machine"]
        where = f"{data['taken']}, {machine['cores']} cores, {machine['system']}, CPython {machine['python']}"
        taken_at.setdefault(where, []).append(f"`{data['name']}` (seeds {data['seeds']})")
    for where, those in taken_at.items():
        lines += ["", f"Taken {where}: {', '.join(those)}."]
    return lines


def main() -> int:
    """Take the experiments; return the exit code."""
    chosen = options()
    folder = chosen.out
    names = chosen.names or EXPERIMENTS
    failed = [name for name in names if not attempted(name, chosen, folder)]
    found = known(folder)
    page = folder / "README.md"
    if page.is_file():
        page.write_text(renewed(page.read_text("utf-8"), overview(found), "targets"), "utf-8")
    targets = [each for data in found if data["name"] in names for each in data.get("targets", [])]
    print("\n".join(table(HEADER, target_lines(targets))))
    for name in failed:
        print(f"{name} could not be taken", file=sys.stderr)
    return 0 if not failed and all(each["met"] for each in targets) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit("interrupted; what was taken before is written")

"""Thousands of drawn labs in worker processes: those that fail, each with the command that repeats it.

    python tests/score/score_campaign.py FIRST LAST [--chaos] [--jobs N | --on tcp://HOST:PORT] [--shard K/N]
        [--out FOLDER] [--resume]

A row for each lab goes into FOLDER/rows.jsonl (build/score-campaign) as soon as its run is over, so that `--resume`
goes on where a campaign ended. Several machines share a campaign as they share a sweep (docs/sweeps.md): as a Dask
cluster, whose workers need no file of this folder, or by shards, whose files of rows `cat` puts together. Exit code 1
if any lab failed: did not finish, touched, violated a rule, or broke down. A lab that is refused before its run has not
failed, and a missed deadline is no failure.

What fails is kept, with its cause, in kept_drawn.toml.
"""

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from drawn_lab import ROOT
from score_run import drawn_entry, taken

from rmr_sim.arguments import shard_in
from rmr_sim.interruption import Interruption, PoolError
from rmr_sim.seed_run import Row
from rmr_sim.worker_pool import pool_of

OWN_MODULES: Final = ("drawn_floor", "drawn_lab", "drawn_program", "score_run")
ROWS: Final = "rows.jsonl"


def symptoms(row: Row) -> list[str]:
    """Return what is wrong with a row, each kind of it in the same words."""
    if row.get("refused"):
        return []
    if row.get("breakdown") or row["time_s"] is None:
        return ["broke down"]
    found = [] if row["finished"] else ["not finished"]
    found += ["contact"] if row["contacts"] else []
    found += sorted(row["violations"])
    known = ("not finished", "contact")
    others = [words for words in row["wrong"] if not words.startswith(known) and "contact" not in words]
    found += ["action failed"] if any(words.startswith("actions that failed") for words in others) else []
    return found


def told(row: Row) -> str:
    """Return a row as one line."""
    kinds = row["kinds"]
    what = f"{kinds['floor']}, {kinds['program']}, {kinds['naming']}, {kinds['robots']} robots of {kinds['radius']:g} m"
    outcome = f"refused: {row['refused'][0]}" if row.get("refused") else "; ".join(row["wrong"]) or "fine"
    return f"{row['name']}: {outcome} ({what} at {kinds['speed']:g} m/s, beacons: {kinds['beacons']})"


def summary(rows: Iterable[Row]) -> list[str]:
    """Return the counts of a campaign as lines."""
    rows = list(rows)
    counts = Counter(symptom for row in rows for symptom in symptoms(row))
    failed = sum(bool(symptoms(row)) for row in rows)
    refused = sum(bool(row.get("refused")) for row in rows)
    lines = [f"drawn labs    {len(rows)}", f"refused       {refused}", f"failed        {failed}"]
    return [*lines, *(f"  {symptom:<12}{count}" for symptom, count in counts.most_common())]


def kept_rows(folder: Path) -> list[Row]:
    """Return the rows of a campaign in `folder`; a last line that a killed process left incomplete is dropped."""
    path = folder / ROWS
    if not path.exists():
        return []
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    return [json.loads(line) for line in lines if line.endswith("\n")]


def _take(seed: int, *, chaos: bool) -> Row:
    return taken(drawn_entry(seed, chaos=chaos))


def _lost(seed: int, reason: str) -> Row:
    entry = drawn_entry(seed)
    unknown = dict.fromkeys(("floor", "program", "naming", "robots", "beacons"), "?") | {"radius": 0.0, "speed": 0.0}
    return {
        "name": entry.name,
        "seed": seed,
        "kinds": unknown,
        "finished": False,
        "time_s": None,
        "wrong": [reason],
        "breakdown": reason,
    }


def _travel() -> None:
    """Let the modules of this folder, which a cluster's workers do not have, go there with what is called."""
    cloudpickle: Any = import_module("cloudpickle")
    for name in (*OWN_MODULES, __name__):
        cloudpickle.register_pickle_by_value(sys.modules[name])


def campaign(
    seeds: Iterable[int], folder: Path, jobs: int, *, chaos: bool, resume: bool, on: str | None = None
) -> list[Row]:
    """Run all seeds that `folder` has no row of; print failures as they come; return all rows. Raises PoolError."""
    if on is not None:
        with suppress(ModuleNotFoundError):  # that is said when the cluster is connected
            _travel()
    folder.mkdir(parents=True, exist_ok=True)
    wanted = list(seeds)
    rows = [row for row in kept_rows(folder) if row["seed"] in set(wanted)] if resume else []
    done = {row["seed"] for row in rows}
    left = [seed for seed in wanted if seed not in done]
    with (folder / ROWS).open("w", encoding="utf-8") as file:
        file.writelines(f"{json.dumps(row)}\n" for row in rows)
    with (
        Interruption() as interruption,
        pool_of(max(1, min(jobs, len(left))), on, partial(_take, chaos=chaos), _lost) as pool,
    ):
        for _, row in pool.outcomes(left, interruption):
            rows.append(row)
            with (folder / ROWS).open("a", encoding="utf-8") as file:
                file.write(f"{json.dumps(row)}\n")
            if symptoms(row):
                print(f"{told(row)}\n    {drawn_entry(row['seed'], chaos=chaos).command}", flush=True)
    return sorted(rows, key=lambda row: int(row["seed"]))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Run drawn labs FIRST to LAST and print those that fail.")
    parser.add_argument("first", type=int, metavar="FIRST")
    parser.add_argument("last", type=int, metavar="LAST")
    parser.add_argument("--chaos", action="store_true", help="with faults drawn from the same seeds")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one per core)"
    )
    parser.add_argument("--on", metavar="tcp://HOST:PORT", help="a Dask cluster, in place of processes")
    parser.add_argument("--shard", metavar="K/N", help="of the seeds the K-th and each N-th after it")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: build/score-campaign, or ...-chaos")
    parser.add_argument("--resume", action="store_true", help="go on with the campaign in the folder")
    options = parser.parse_args()
    if not 0 <= options.first <= options.last:
        parser.error("FIRST and LAST are seeds from 0, FIRST not greater than LAST")
    if options.jobs < 1:
        parser.error("--jobs takes a number from 1")
    options.seeds = range(options.first, options.last + 1)
    if options.shard is not None:
        try:
            options.seeds = shard_in(options.shard).seeds(options.seeds)
        except ValueError as error:
            parser.error(f"--shard: {error}")
    return options


def main() -> int:
    """Run a campaign; return the exit code."""
    options = _arguments()
    folder: Path = options.out or ROOT / "build" / f"score-campaign{'-chaos' if options.chaos else ''}"
    try:
        rows = campaign(options.seeds, folder, options.jobs, chaos=options.chaos, resume=options.resume, on=options.on)
    except PoolError as error:
        print(error, file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{error.filename or folder}: {error.strerror}", file=sys.stderr)
        return 2
    print("\n".join(summary(rows)))
    return 1 if any(map(symptoms, rows)) else 0


if __name__ == "__main__":
    sys.exit(main())

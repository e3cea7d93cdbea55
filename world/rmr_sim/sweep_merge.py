"""`rmr sweep merge DIR... -o DIR`: the shards of a sweep as the one sweep that they are parts of.

What is written is, octet for octet, what `rmr sim LAB --seeds A-B` on one machine writes. So the shards have to agree
on all that their first lines say, and each seed has to be there once. All that is wrong is said, by folder.
"""

import argparse
import shlex
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from shutil import copyfile
from typing import Any

from rmr.entry import ExitCode
from rmr_sim.arguments import Shard
from rmr_sim.seed_run import Row, fails
from rmr_sim.sweep import KEPT_MAX, SWEEP_FILE, exit_code_of, failed_folder, summed_up
from rmr_sim.sweep_rows import NAMES, Rows, RowsError, differences, read, seeds_of, versions
from rmr_world.run_folder import RunFolderError, make_run_folder

TOLD_MAX = 5
"""Seeds and shards that a message names: a missing shard of a large sweep has thousands."""


def merge(arguments: argparse.Namespace) -> int:
    """Carry out `rmr sweep merge`; return the exit code."""
    try:
        first, rows, homes = merged(arguments.folders)
        folder = make_run_folder(first["lab"], arguments.output)
    except (RowsError, RunFolderError) as error:
        print("\n".join(f"rmr sweep merge: {line}" for line in str(error).splitlines()), file=sys.stderr)
        return ExitCode.USAGE
    failing = [row["seed"] for row in rows if fails(row)][:KEPT_MAX]
    lost = [seed for seed in failing if not failed_folder(homes[seed], seed).is_dir()]
    try:
        for seed in failing:
            if seed not in lost:
                _copy(failed_folder(homes[seed], seed), failed_folder(folder, seed))
        Rows(folder, first, rows)
    except OSError as error:
        print(f"rmr sweep merge: cannot write {error.filename or folder}: {error.strerror or error}", file=sys.stderr)
        return ExitCode.FAILED
    written = summed_up(first, rows, folder, sys.stdout, None, json_wanted=arguments.json)
    if lost:
        print(f"rmr sweep merge: no report and trace is left of {_some('seed', lost)}", file=sys.stderr)
    where = f"; all rows are in {folder / SWEEP_FILE}" if written else ""
    print(f"merged {len(rows)} runs of {len(arguments.folders)} shards{where}", file=sys.stderr)
    return exit_code_of(rows, strict=arguments.strict) if written else ExitCode.FAILED


def _copy(source: Path, target: Path) -> None:
    target.mkdir(parents=True)
    for path in source.iterdir():
        copyfile(path, target / path.name)


def merged(folders: Sequence[Path]) -> tuple[dict[str, Any], list[Row], dict[int, Path]]:
    """Return first line and rows of the whole sweep, and the folder of each seed.

    Raises RowsError with a line for each thing that is wrong.
    """
    parts = []
    problems = []
    for folder in folders:
        try:
            parts.append((folder, *read(folder)))
        except RowsError as error:
            problems.append(str(error))
    if problems:
        raise RowsError("\n".join(problems))
    base, whole, _ = parts[0]
    here = differences(whole, versions(), ("version", "sources"))
    problems += [f"{base} is of another rmr than this one; {each}" for each in here]
    for folder, first, _ in parts[1:]:
        different = differences(first, whole, [key for key in NAMES if key != "shard"])
        if first["shard"][1] != whole["shard"][1]:
            different.append(f"shards: {first['shard'][1]} there, {whole['shard'][1]} here")
        problems += [f"{folder} has another sweep than {base}; {each}" for each in different]
    if not problems:
        problems = _gaps([(folder, Shard(*first["shard"]), first, rows) for folder, first, rows in parts])
    if problems:
        raise RowsError("\n".join(problems))
    order = min(parts, key=lambda part: int(part[1]["shard"][0]))[1]
    homes = {row["seed"]: folder for folder, _, rows in parts for row in rows}
    known = {row["seed"]: row for _, _, rows in parts for row in rows}
    return {**order, "shard": list(Shard())}, [known[seed] for seed in sorted(known)], homes


def _gaps(parts: Sequence[tuple[Path, Shard, dict[str, Any], list[Row]]]) -> list[str]:
    """Return what is twice or missing, by folder."""
    problems = []
    places: dict[int, Path] = {}
    for folder, shard, first, rows in parts:
        if shard.number in places:
            problems.append(f"{folder} has shard {shard}, which {places[shard.number]} has, too: leave one of them out")
            continue
        places[shard.number] = folder
        wanted = shard.seeds(seeds_of(first))
        found = [row["seed"] for row in rows]
        twice = sorted(seed for seed, count in Counter(found).items() if count > 1)
        foreign = sorted({seed for seed in found if seed not in wanted})
        missing = sorted({*wanted}.difference(found))
        if twice:
            problems.append(f"{folder} has {_some('seed', twice)} more than once: did two processes write there?")
        if foreign:
            problems.append(f"{folder} has {_some('seed', foreign)}, not of its shard {shard}")
        if missing:
            again = f"{first['command']} --resume {shlex.quote(str(folder))}"
            problems.append(f"{folder}, shard {shard}, has no row of {_some('seed', missing)}; to go on: {again}")
    of = parts[0][1].of
    if absent := [number for number in range(1, of + 1) if number not in places]:
        problems.append(f"no folder has {_some('shard', absent)} of {of}")
    return problems


def _some(name: str, numbers: Sequence[int]) -> str:
    """Return some numbers in words: `seeds 3, 5, 7 and 4 more`."""
    more = f" and {len(numbers) - TOLD_MAX} more" if len(numbers) > TOLD_MAX else ""
    return f"{name}{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers[:TOLD_MAX]))}{more}"

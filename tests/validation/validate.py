"""Validate the radio: everything that ns-3 3.44 measured against this model, and a page that shows it.

    python tests/validation/validate.py --seeds 10 --write docs/radio

Each row of the reference, each broken rule (`mutations`) and each size of group (`coordination`) is a job of its own;
`--jobs` processes share them. What a job has found is kept in build/validation under the digest of the sources that it
depends on, so a run that was ended goes on where it stood, and only what a change touches is run anew. The seeds are
1, 2, 3 ..., the same in every run, so the results are, too.

Ends with 1 if a judged check is missed, if a rule can be broken without a check that notices, or if a kind of check
fails for none of the broken rules.
"""

import argparse
import hashlib
import importlib
import json
import re
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import constants
import curves
import imitation
import judged
import mutations
import overlaps
import report
from experiments import FULL, Effort, measure
from reference import FILES, rows
from verdicts import SHOWN, Check, Data, missed, tally

from rmr.radio.trials import REFERENCE

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "build" / "validation"
EXPERIMENTS = ("rmr/base", "rmr/radio", "tests/validation/experiments.py", "tests/validation/reference")
CHECKS = tuple(f"tests/validation/{name}.py" for name in (*mutations.RELOADED, "mutations", "verdicts", "reference"))
ROUNDS = ("rmr/base", "rmr/radio", "rmr/coord", "tests/coord_harness.py", "tests/validation/coordination.py")
DEPENDS = {
    "row": EXPERIMENTS,
    "imitated": (*EXPERIMENTS, "tests/validation/imitation.py"),
    "capture": EXPERIMENTS,
    "mutation": (*EXPERIMENTS, *CHECKS),
    "guarded": (*EXPERIMENTS, *CHECKS),
    "rounds": ROUNDS,
    "discovery": ROUNDS,
}
"""Kind of job -> the sources that its result depends on."""

CAPTURE = replace(REFERENCE, interference="capture_3db")
SEEDS = {"rounds": 10, "discovery": 30}
"""Of each size of group."""


class Job(NamedTuple):
    """One thing to run; what it finds is plain data."""

    kind: str
    """One of `DEPENDS`."""
    name: str
    """File of the reference, broken rule, or mode of interference."""
    which: int = 0
    """Row of the file, or robots of the group."""

    def __str__(self) -> str:
        return " ".join(map(str, self[: 2 + (self.kind != "mutation")]))


def perform(job: Job, effort: Effort) -> Data:
    """Return what a job finds."""
    if job.kind == "row":
        return measure(job.name, job.which, effort)
    if job.kind == "imitated":
        with imitation.forgetful():
            return measure(job.name, job.which, effort)
    if job.kind == "capture":
        return measure(job.name, job.which, effort._replace(until_narrow=False), CAPTURE)
    if job.kind in ("rounds", "discovery"):
        found: Data = getattr(_coordination(), job.kind)(job.which, range(1, SEEDS[job.kind] + 1), job.name)
        return found
    if job.kind == "guarded":
        return {"guarded": [list(each) for each in mutations.guarded()]}
    return {"noticed": [list(each) for each in mutations.noticed(job.name)]}


def _coordination() -> ModuleType:
    """Return the module `coordination`, which needs what stands beside this folder."""
    beside = str(ROOT / "tests")
    if beside not in sys.path:
        sys.path.append(beside)
    return importlib.import_module("coordination")


def all_jobs(only: str | None) -> list[Job]:
    """Return the jobs, the long ones first: only those of one file or kind, if asked for."""
    coordination = _coordination()
    jobs = [Job("row", file, index) for file in judged.FILES for index in range(len(rows(file)))]
    jobs += [Job("imitated", "hidden_terminal", index) for index in judged.FORGETFUL]
    jobs += [Job("capture", file, index) for file, index in captured()]
    jobs += [Job("mutation", name) for name in mutations.NAMES]
    jobs += [Job("guarded", "mutation")]
    jobs += [Job("rounds", "capture_3db", members) for members in coordination.MEMBERS]
    jobs += [Job("discovery", "capture_3db", members) for members in coordination.DISCOVERY]
    return sorted((job for job in jobs if only in (None, job.name, job.kind)), key=cost, reverse=True)


def captured() -> list[tuple[str, int]]:
    """Return the rows that are also run in mode ``capture_3db``: broadcasts, as (file, index)."""
    wanted = [("contention", i) for i, row in enumerate(rows("contention")) if row["type"] == "broadcast"]
    wanted += [
        ("reply_storm", i)
        for i, row in enumerate(rows("reply_storm"))
        if row["replies"] == "broadcast" and judged.geometry(row) == "circle"
    ]
    return wanted


def cost(job: Job) -> float:
    """Return how long a job takes, roughly, to begin with the long ones."""
    if job.kind in ("rounds", "discovery"):
        return float(job.which)
    if job.kind in ("mutation", "guarded"):
        return 20.0
    row = rows(job.name)[job.which]
    stations: int = row.get("N_senders") or row.get("N_members") or 5
    return stations * (5.0 if row.get("saturated") else 1.0)


def digest(job: Job, effort: Effort) -> str:
    """Return what names the state of everything that a job depends on."""
    state = hashlib.sha256(_sources(job.kind))
    state.update(repr((mutations.of(job.name) if job.kind == "mutation" else "", effort, SEEDS)).encode())
    return state.hexdigest()[:12]


@cache
def _sources(kind: str) -> bytes:
    """Return the digest of the sources that a kind of job depends on."""
    state = hashlib.sha256()
    for place in DEPENDS[kind]:
        path = ROOT / place
        for file in [path] if path.is_file() else sorted(path.rglob("*.*")):
            if file.suffix in (".py", ".json"):
                state.update(file.read_bytes())
    return state.digest()


def run(jobs: Sequence[Job], effort: Effort, processes: int, tell: Callable[[str], None]) -> dict[Job, Data]:
    """Return what all jobs find, from what is kept or anew."""
    files = {job: KEPT / f"{re.sub('[^A-Za-z0-9.]+', '_', str(job))}-{digest(job, effort)}.json" for job in jobs}
    found = {job: json.loads(file.read_text("utf-8")) for job, file in files.items() if file.exists()}
    KEPT.mkdir(parents=True, exist_ok=True)
    todo = [job for job in jobs if job not in found]
    tell(f"{len(jobs)} jobs, {len(found)} of them kept from before")
    with ProcessPoolExecutor(processes) as pool:
        begun = time.monotonic()
        running = {pool.submit(perform, job, effort): job for job in todo}
        for done, future in enumerate(as_completed(running), 1):
            job = running[future]
            found[job] = future.result()
            files[job].write_text(json.dumps(found[job]), "utf-8")
            tell(f"{done}/{len(todo)} {time.monotonic() - begun:.0f} s: {job}")
    return found


def all_checks(found: dict[Job, Data]) -> list[Check]:
    """Return all checks, in the order of the files of the reference; first those that need no chance."""
    exact: list[Iterable[Check]] = [constants.checks(), curves.per_vs_snr(), curves.psr_vs_distance()]
    exact += [overlaps.capture_overlap(), overlaps.capture_rules()]
    exact += [overlaps.capture_sent(), overlaps.stations_sent()]
    checks = [check for group in exact for check in group]
    for job in sorted((job for job in found if job.kind in ("row", "imitated")), key=lambda job: job[1:]):
        checks += judged.checks(job.name, job.which, found[job], imitated=job.kind == "imitated")
    wide = [check for check in checks if check.unjudged == judged.BLURRED]
    if wide:
        checks.append(judged.together(wide, wide[0].file))
    order = [*FILES, "capture_3db"]
    return sorted(checks, key=lambda check: order.index(check.file))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for. Returns the exit code."""
    parser = argparse.ArgumentParser(description="Validate the radio against ns-3's results.")
    parser.add_argument("--seeds", type=int, default=FULL.seeds, help="replications of each row, at least (10)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (2)")
    parser.add_argument("--only", help="one file of the reference or kind of job: row, capture, mutation, rounds, ...")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write FOLDER/validation.json, the page, figures")
    options = parser.parse_args(arguments)

    def tell(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    effort = FULL._replace(seeds=options.seeds)
    found = run(all_jobs(options.only), effort, options.jobs, tell)
    checks = all_checks(found)
    data = report.gathered(checks, found, effort)
    if options.write:
        report.write(options.write, data)
    for file, met, failed, shown in tally(checks):
        tell(f"{file}: {met} met, {failed} missed, {shown} shown")
    for check in missed(checks):
        tell(f"missed: {check.name}: {check.ours} +- {check.ours_half:.3g}, ns-3 {check.theirs}, by {check.difference}")
    for check in checks:
        if check.verdict != SHOWN and not check.narrow:
            tell(f"wide: {check.name}: {check.ours_half:.3g} for a tolerance of {check.tolerance:.3g}")
    unnoticed = [row["rule"] for row in data["mutations"] if not row["noticed"]]
    for rule in unnoticed:
        tell(f"broken without a check that notices: {rule}")
    for family, quantity in data["unguarded"]:
        tell(f"a check that no broken rule makes fail: {family}: {quantity}")
    return 1 if missed(checks) or unnoticed or data["unguarded"] else 0


if __name__ == "__main__":
    sys.exit(main())

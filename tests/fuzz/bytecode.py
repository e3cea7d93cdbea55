"""A fuzzer of the byte-code: whatever the octets, they are refused with a reason or run within bounds.

    python tests/fuzz/bytecode.py --cases 1000000 --seed 1 --jobs 2
    python tests/fuzz/bytecode.py --seed 1 --case 4711

The second form repeats one case. A failure shows its octets too; the exit status is 1 if there is one.
"""

import argparse
import resource
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import starmap
from pathlib import Path

BATCH = 2000
"""Cases that a worker does at a time."""

MEMORY_MAX = 2 << 30
"""Octets that a worker may take; a program that takes more fails."""


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--case", type=int, help="repeat this one alone")
    options = parser.parse_args()
    _limit_memory()
    if options.case is not None:
        return repeat(options.seed, options.case)
    return campaign(options.seed, options.cases, options.jobs)


def repeat(seed: int, case: int) -> int:
    """Run one case and print what became of it; return 1 if it fails."""
    from fuzz_cases import Failure, judged

    kind, outcome = judged(seed, case)
    failed = isinstance(outcome, Failure)
    print(f"{outcome.trace}{outcome.octets}" if isinstance(outcome, Failure) else f"{kind}: {outcome.value}")
    return int(failed)


def campaign(seed: int, cases: int, jobs: int) -> int:
    """Run the cases from 0 up to `cases` and print what became of them; return 1 if one fails."""
    from fuzz_cases import Tally, report

    total = Tally()
    failed = 0
    for number, (tally, failures) in enumerate(_batches(seed, cases, jobs), 1):
        total += tally
        failed += len(failures)
        for each in failures:
            print(f"FAILED seed {seed} case {each.case} ({each.kind})\n{each.trace}{each.octets}\n", flush=True)
        print(f"{min(number * BATCH, cases)} cases, {failed} failed", file=sys.stderr, flush=True)
    print(f"seed {seed}, {cases} cases, {failed} failed\n{report(total)}")
    return int(failed > 0)


def _batches(seed: int, cases: int, jobs: int) -> Iterator[tuple]:
    from fuzz_cases import batch

    work = [(seed, start, min(start + BATCH, cases)) for start in range(0, cases, BATCH)]
    if jobs == 1:
        yield from starmap(batch, work)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(batch, *zip(*work, strict=True))


def _limit_memory() -> None:
    """Bound this process and its workers."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MAX, MEMORY_MAX))


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    sys.exit(main())

"""A fuzzer of the engines: whatever the program and whatever happens, they do what the interpreter does.

    python tests/fuzz/engines.py --cases 100000 --seed 1 --jobs 2
    python tests/fuzz/engines.py --seed 1 --case 4711

The second form shows one case. Of each kind of difference the first case is made small and written into a folder; put
into tests/fuzz/kept, the suite plays it for ever. The exit status is 1 if there is a difference.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import starmap
from pathlib import Path

BATCH = 500
"""Cases that a worker does at a time."""

SHOWN_MAX = 20
"""Differences shown with their cases; of all the kinds are counted."""


def main() -> int:
    """Run the command."""
    from fuzz_broken import BREAKS

    from rmr.vm.engines import Engine

    names = [engine.value for engine in Engine]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--case", type=int, help="show this one alone")
    parser.add_argument("--engine", choices=names, default=Engine.GENERATED.value, help="held against the interpreter")
    parser.add_argument(
        "--broken", choices=list(BREAKS), help="hold an interpreter against it that is wrong on purpose"
    )
    parser.add_argument("--into", type=Path, default=Path("build/fuzz"), help="folder for small cases")
    options = parser.parse_args()
    if options.broken:
        options.engine = Engine.INTERPRETER.value
    if options.case is not None:
        return repeat(options.seed, options.case, options.engine, options.broken)
    return campaign(options)


def repeat(seed: int, number: int, engine: str, wrong: str | None) -> int:
    """Show one case and where the engines part; return 1 if they do."""
    from fuzz_engine_cases import judged

    from rmr.bytecode.codec import encode
    from rmr.bytecode.disassemble import disassemble
    from rmr.vm.engines import Engine

    found = judged(seed, number, Engine(engine), wrong)
    print(disassemble(encode(found.case.program, debug=True)))
    print(f"{found.kind}, {found.case.budget} firings a run")
    for place, step in enumerate(found.case.script):
        print(f"{place:3} {step.call}{step.args}")
    print(found.difference.text(found.case) if found.difference else "no difference")
    return int(found.difference is not None)


def campaign(options: argparse.Namespace) -> int:
    """Judge the cases from 0 up and print what was alive and where the engines part; return 1 if they do."""
    alive: Counter[str] = Counter()
    kinds: Counter[str] = Counter()
    done = 0
    for tally, found in _batches(options):
        alive += tally
        done = min(done + BATCH, options.cases)
        for each in found:
            kind = each.difference.kind()
            kinds[kind] += 1
            if kinds.total() <= SHOWN_MAX:
                print(
                    f"DIFFERENT seed {options.seed} case {each.number}: {each.difference.text(each.case)}", flush=True
                )
            if kinds[kind] == 1:
                _keep(options, each, kind)
        print(f"{done} cases, {kinds.total()} different", file=sys.stderr, flush=True)
    for name, count in sorted(alive.items()):
        print(f"{count:8} {name}")
    print(f"seed {options.seed}, {done} cases, {kinds.total()} different: {dict(kinds)}")
    return int(bool(kinds))


def _keep(options: argparse.Namespace, found, kind: str) -> None:
    """Make a case small and write it."""
    from fuzz_engine_cases import smallest
    from fuzz_keep import write

    from rmr.vm.engines import Engine

    case, difference = smallest(found, Engine(options.engine), options.broken)
    path = options.into / f"{options.broken or kind}-{options.seed}-{found.number}.json"
    write(path, case, difference.text(case))
    print(f"written: {path}", flush=True)


def _batches(options: argparse.Namespace) -> Iterator[tuple]:
    from fuzz_engine_cases import batch

    size = options.cases
    work = [(options.seed, n, min(n + BATCH, size), options.engine, options.broken) for n in range(0, size, BATCH)]
    if options.jobs == 1:
        yield from starmap(batch, work)
        return
    with ProcessPoolExecutor(options.jobs) as pool:
        yield from pool.map(batch, *zip(*work, strict=True))


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    sys.exit(main())

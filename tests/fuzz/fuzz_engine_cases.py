"""The cases of the engines' fuzzer: made from a seed and a number alone, so that each can be repeated.

Most programs are drawn, some of them to search for a goal over a map (`fuzz_search`), to serve goals (`fuzz_serving`),
with jobs that compete (`fuzz_pressing`), or to consume next to nothing (`fuzz_growing`). Some are compiled: every
program of the library, the examples and the labs; and some are made from either by putting parts of one in the place
of parts of another, as long as the verifier accepts it.
"""

from collections import Counter
from contextlib import nullcontext
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import NamedTuple

from fuzz_broken import broken
from fuzz_compare import Case, Difference, Seen, difference, expected
from fuzz_events import Script
from fuzz_growing import growing
from fuzz_mutations import parts, restructured
from fuzz_pressing import pressing
from fuzz_programs import HOME, Lively
from fuzz_search import Searching
from fuzz_serving import serving
from fuzz_shrink import shrunk

from rmr.bytecode.codec import BytecodeError, decode
from rmr.bytecode.program import Program
from rmr.bytecode.verify import verify
from rmr.lang.compiler import compile_file
from rmr.lang.lower.goal_paths import with_leads
from rmr.vm.engines import Engine

ROOT = Path(__file__).parents[2]
SOURCES = sorted(
    [
        *(ROOT / "tests" / "programs").rglob("*.rmr"),
        *(ROOT / "docs" / "examples").glob("*.rmr"),
        *(ROOT / "deploy" / "labs").rglob("*.rmr"),
    ]
)

KINDS = ["growing", *["drawn"] * 16, "compiled", *["mutated"] * 2, *["searching"] * 2, "serving", "pressing"]
BUDGETS = [1, 1, 1, 2, 2, 7, 7, 500]
"""Firings of one run: few, so that events come while rules are still satisfied."""

ROBOTS = [HOME] * 5 + [2]
"""On which robot the program runs; most of what is drawn is for the first."""

TRACED = 0.7
"""How often facts that come and go are told."""

SMALL_BOUNDS = {"drawn": 0.1, "searching": 0.1, "growing": 0.5}
"""How often the bounds are small; else programs are too small for what an engine does with many matches."""

MUTATIONS = 6
"""How often to try for a mutation that the verifier accepts."""


class Judged(NamedTuple):
    """What became of a case."""

    number: int
    kind: str
    case: Case
    alive: Counter[str]
    """What was alive in it, each once."""
    difference: Difference | None


@cache
def compiled(number: int) -> Program | None:
    """Return the program of a source; None if it has none because it shows a mistake."""
    return compile_file(SOURCES[number]).program


def made(seed: int, number: int) -> tuple[str, Case]:
    """Return a case with its kind."""
    rng = Random(f"{seed}/{number}")
    kind = rng.choice(KINDS)
    program = MAKERS[kind](rng)
    script = Script(program, rng).steps()
    small = kind in SMALL_BOUNDS and rng.random() < SMALL_BOUNDS[kind]
    # Where a rule fires many times on end it does so only with a large budget, and while nothing is traced.
    budgets, told = ([7, 40, 500], 1 - TRACED) if kind == "growing" else (BUDGETS, TRACED)
    budget, robot, traced = rng.choice(budgets), rng.choice(ROBOTS), rng.random() < told
    return kind, Case(program, tuple(script), budget, f"{seed}/{number}", robot, small, traced)


def judged(seed: int, number: int, engine: Engine, wrong: str | None = None) -> Judged:
    """Make a case and hold an engine against the interpreter; `wrong` names a way in which it is broken on purpose."""
    kind, case = made(seed, number)
    seen, alive = expected(case)
    return Judged(number, kind, case, Counter(dict.fromkeys(+alive.tally, 1)), parted(case, seen, engine, wrong))


def parted(case: Case, seen: list[Seen], engine: Engine, wrong: str | None = None) -> Difference | None:
    """Return where an engine parts from what the interpreter has been `seen` to do."""
    with broken(wrong) if wrong else nullcontext():
        return difference(case, seen, engine)


def alike(case: Case, kind: str, engine: Engine, wrong: str | None = None) -> bool:
    """Tell whether a case shows a difference of a kind."""
    found = parted(case, expected(case)[0], engine, wrong)
    return found is not None and found.kind() == kind


def smallest(found: Judged, engine: Engine, wrong: str | None = None) -> tuple[Case, Difference]:
    """Return a small case that shows the difference of the one found, and the difference."""
    assert found.difference is not None
    kind = found.difference.kind()
    case = shrunk(found.case, lambda each: alike(each, kind, engine, wrong))
    left = parted(case, expected(case)[0], engine, wrong)
    assert left is not None
    return case, left


def _drawn(rng: Random, maker: type[Lively] = Lively) -> Program:
    program = maker(rng.getrandbits(64)).program()
    wrong = verify(program)
    assert not wrong, wrong
    return program


def _compiled(rng: Random) -> Program:
    return next(each for _ in range(1000) if (each := compiled(rng.randrange(len(SOURCES)))) is not None)


def _mutated(rng: Random) -> Program:
    """Return a program with parts of another; leads are worked out anew, for only true ones may be stated."""
    one, other = (_drawn(rng) if rng.random() < 0.7 else _compiled(rng) for _ in range(2))
    own, others = parts(one), parts(other)
    for _ in range(MUTATIONS):
        data = restructured(rng, own, own if rng.random() < 0.5 else others)
        try:
            program = decode(data) if data is not None else one
        except BytecodeError:
            continue
        bare = replace(program, goals=tuple([replace(goal, leads=None) for goal in program.goals]))
        return with_leads(bare) if bare.goals and rng.random() < 0.5 else bare
    return one


MAKERS = {
    "drawn": _drawn,
    "compiled": _compiled,
    "mutated": _mutated,
    "searching": partial(_drawn, maker=Searching),
    "serving": serving,
    "growing": growing,
    "pressing": pressing,
}


def batch(seed: int, start: int, stop: int, engine: str, wrong: str | None = None) -> tuple[Counter[str], list[Judged]]:
    """Judge the cases from `start` up to `stop`: what was alive, in how many cases, and those with a difference."""
    alive: Counter[str] = Counter()
    found = []
    for number in range(start, stop):
        each = judged(seed, number, Engine(engine), wrong)
        alive += each.alive
        alive[f"a program {each.kind}"] += 1
        if each.difference is not None:
            found.append(each)
    return alive, found

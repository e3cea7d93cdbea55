"""The cases of the byte-code fuzzer: made from a seed and a number alone, so that each can be repeated."""

import traceback
from collections import Counter
from functools import lru_cache
from random import Random
from typing import NamedTuple

from fuzz_mutations import Part, damaged, damaged_table, parts, random_octets, restructured
from fuzz_trial import Outcome, tried
from program_maker import Maker

from rmr.bytecode.codec import encode

PROGRAMS_EVERY = 500
"""Cases after which other programs are damaged."""

PROGRAMS = 16
"""Programs that are damaged meanwhile."""

KINDS = ["random", *["octets"] * 3, *["table"] * 2, *["structure"] * 4]


class Base(NamedTuple):
    """A sound program that is damaged: its octets, its parts."""

    data: bytes
    parts: list[Part]


class Failure(NamedTuple):
    """A case in which something went wrong."""

    seed: int
    case: int
    kind: str
    octets: str
    trace: str


@lru_cache(maxsize=2 * PROGRAMS)
def base(seed: int, number: int) -> Base:
    """Return one of the programs of a seed."""
    program = Maker(seed << 32 | number).program()
    return Base(encode(program, debug=number % 2 == 0), parts(program))


def made(seed: int, case: int) -> tuple[str, bytes | None, Random]:
    """Return a case: its kind, its octets (None: there are none), the stream of what happens to it."""
    rng = Random(f"{seed}/{case}")
    kind = rng.choice(KINDS)
    first = case // PROGRAMS_EVERY * PROGRAMS
    one, other = (base(seed, first + rng.randrange(PROGRAMS)) for _ in range(2))
    if kind == "random":
        return kind, random_octets(rng), rng
    if kind == "octets":
        return kind, damaged(rng, one.data, other.data), rng
    if kind == "table":
        return kind, damaged_table(rng, one.data, other.data), rng
    return kind, restructured(rng, one.parts, one.parts if rng.random() < 0.5 else other.parts), rng


def judged(seed: int, case: int) -> tuple[str, Outcome | Failure]:
    """Make a case and try it."""
    kind, data, rng = made(seed, case)
    if data is None:
        return kind, Outcome.UNWRITABLE
    try:
        return kind, tried(data, rng)
    except Exception:
        return kind, Failure(seed, case, kind, data.hex(), traceback.format_exc())


Tally = Counter[tuple[str, Outcome]]


def batch(seed: int, start: int, stop: int) -> tuple[Tally, list[Failure]]:
    """Judge the cases from `start` up to `stop`."""
    tally: Tally = Counter()
    failures = []
    for case in range(start, stop):
        kind, outcome = judged(seed, case)
        if isinstance(outcome, Failure):
            failures.append(outcome)
        else:
            tally[kind, outcome] += 1
    return tally, failures


def report(tally: Tally) -> str:
    """Return a table: what became of each kind of case."""
    head = f"{'':10}" + "".join(f"{outcome.value:>12}" for outcome in Outcome)
    rows = [
        f"{kind:10}" + "".join(f"{tally[kind, outcome]:>12}" for outcome in Outcome) for kind in dict.fromkeys(KINDS)
    ]
    return "\n".join([head, *rows])

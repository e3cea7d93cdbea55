"""What rules over several robots cost: frames and latency of a firing, philosophers, an auction.

    python tests/bench/ensemble_rules.py [--seconds 20]

Everything runs in the virtual time of `rmr eval`, at 5 ms a hop and without loss, so the figures are the same on each
machine. Philosophers that are always hungry share forks, each at a robot of its own; beside them stand the same ones
with a central lock server over the same radio. The auction of ten robots stands beside one in which the auctioneer
calls for bids. Targets that are missed are printed as such.
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise
from statistics import median
from typing import Any

from rmr.eval.api import Evaluation, evaluate

HOP_S = 0.005
THINKERS = 10
EATS_S = (0.02, 0.1, 1.0)
MEALS = 60
"""Least length of a run, in meals."""

LINKS = """
type !left(robot, robot).
type !right(robot, robot).
type !third(robot, robot).
type waiting(robot, int).
type free(robot, int).
left(@1, @2).
right(@1, @3).
third(@1, @4).
free(@2, 1). free(@2, 2). free(@3, 1). free(@3, 2). free(@4, 1). free(@4, 2).
"""
FIRINGS = (
    ("offered", 2, "waiting(A, X), left(A, B), free(B, X) -o got(A, X), gave(B, X)."),
    ("two others", 5, "waiting(A, X), left(A, B), right(A, C), free(B, X), free(C, X) -o got(A, X), gave(C, X)."),
    (
        "three others",
        None,
        "waiting(A, X), left(A, B), right(A, C), third(A, D), free(B, X), free(C, X), free(D, X)"
        " -o got(A, X), gave(C, X).",
    ),
)
"""Name, most frames of a firing, rule."""

SHARED_FORKS = """
type !left(robot, robot).
type !right(robot, robot).
type fork(robot).
type hungry(robot).
type action eat(R: robot, L: robot, M: robot) -o done(R, L, M).
hungry(A), left(A, L), right(A, M), fork(L), fork(M) -o eat(A, L, M).
done(A, L, M) -o fork(L), fork(M), hungry(A).
"""
LOCK_SERVER = """
const server = @{server}.
type !left(robot, robot).
type !right(robot, robot).
type fork(robot, robot).
type hungry(robot).
type asks(robot, robot, robot, robot).
type action eat(R: robot, L: robot, M: robot) -o done(R, L, M).
hungry(A), left(A, L), right(A, M) -o asks(server, A, L, M).
asks(S, A, L, M), fork(S, L), fork(S, M) -o eat(A, L, M).
done(A, L, M) -o fork(server, L), fork(server, M), hungry(A).
"""

CALLS_FOR_BIDS = """
const bidders = 9.
type task(robot, item, float, float).
type !stands(robot, float, float).
type !offer(robot, item, robot, float).
type !done(robot, item).
type action fetch(R: robot, I: item) -o fetched(R, I).
task(A, I, X, Y) -o open(A, I), {B | peer(A, B) | call(B, A, I, X, Y)}.
call(R, A, I, X, Y), stands(R, PX, PY) -o bid(A, I, R, dist(PX, PY, X, Y)).
bid(A, I, B, Cost) -o offer(A, I, B, Cost), check(A, I).
check(A, I) -o [count => N | offer(A, I, B, Cost) | bids(A, I, N)].
bids(A, I, N), N < bidders -o 1.
bids(A, I, bidders), open(A, I) -o [min Cost => Best | offer(A, I, B, Cost) | award(B, A, I)].
bids(A, I, bidders), not open(A, I) -o 1.
award(R, A, I) -o mine(R, A, I), fetch(R, I).
fetched(R, I), mine(R, A, I) -o done(A, I).
"""
IS_TOLD = """
const bidders = 9.
type task(robot, item, float, float).
type !bidder(robot, robot).
type !stands(robot, float, float).
type !place(robot, robot, float, float).
type !done(robot, item).
type action fetch(R: robot, I: item, A: robot) -o fetched(R, I, A).
bidder(A, B), stands(B, X, Y) -o place(A, B, X, Y).
task(A, I, X, Y), count(place(A, _, _, _)) = bidders
    -o [min Cost => Best | place(A, B, PX, PY), Cost = dist(PX, PY, X, Y) | fetch(B, I, A)].
fetched(_, I, A) -o done(A, I).
"""


def sent(run: Evaluation) -> int:
    """Return the frames of a run, without acknowledgements."""
    frames: int = run.report["messages"]["sent"]
    return frames


def firing(rule: str) -> tuple[int, float]:
    """Return the frames of a firing, and the hops from the draw to the firing at the robot that decides."""
    inserts = ["0s: waiting(@1, 1)", "2s: waiting(@1, 2)"]
    first, both = (evaluate(LINKS + rule, robots=4, insert=inserts[:many], trace=True) for many in (1, 2))
    assert any("got(@1, 2)" in fact for fact in both.facts(1))
    begun = next(each["t"] for each in both.trace if each["t"] >= 2.0 and each["what"] == "fired")
    last = "@2" if "right" not in rule else "@3" if "third" not in rule else "@4"
    decided = [
        each["t"]
        for each in both.trace
        if each["t"] >= 2.0 and each["what"] == "fired" and each["robot"] == int(last[1:])
    ]
    return sent(both) - sent(first), (decided[0] - begun) / HOP_S


def table(served: bool) -> str:
    """Return a program of philosophers around a table."""
    forks = range(THINKERS + 1, 2 * THINKERS + 1)
    facts = [f"hungry(@{each}). left(@{each}, @{forks[each - 1]})." for each in range(1, THINKERS + 1)]
    facts += [f"right(@{each}, @{forks[each % THINKERS]})." for each in range(1, THINKERS + 1)]
    server = 2 * THINKERS + 1
    facts += [f"fork(@{server}, @{each})." if served else f"fork(@{each})." for each in forks]
    return (LOCK_SERVER.replace("{server}", str(server)) if served else SHARED_FORKS) + "\n".join(facts)


def philosophers(served: bool, eats_s: float, seconds: float) -> dict[str, float]:
    """Return meals a second, frames a meal, and the waits of the hungry."""
    seconds = max(seconds, MEALS * eats_s)
    run = evaluate(table(served), robots=2 * THINKERS + 1, until=seconds, action_time=eats_s)
    ends = [[at for at, _ in run.report["robots"][str(each)]["actions"]] for each in range(1, THINKERS + 1)]
    waits = [after - before - eats_s for each in ends for before, after in pairwise(each)]
    waits += [seconds - each[-1] - eats_s if each else seconds for each in ends]
    meals = sum(map(len, ends))
    return {
        "meals/s": meals / seconds,
        "frames/meal": sent(run) / meals,
        "median": median(waits),
        "longest": max(waits),
        "least": min(map(len, ends)),
        "most": max(map(len, ends)),
    }


def auction(program: str, tasks: int) -> int:
    """Return the frames of an auction of ten robots."""
    facts = [f"stands(@{each}, {each}.0, {each * each % 7}.0)." for each in range(2, 11)]
    facts += [f"task(@1, item{each}, {each % 11}.5, {each % 5}.5)." for each in range(tasks)]
    if "bidder(" in program:
        facts += [f"bidder(@1, @{each})." for each in range(2, 11)]
    run = evaluate(program + "\n".join(facts), robots=10)
    assert run.quiescent
    assert sum(fact.startswith("!done") for fact in run.facts(1)) == tasks
    return sent(run)


def verdict(value: float, *, at_most: float | None = None, at_least: float | None = None) -> str:
    """Return what a target says of a value."""
    if at_most is not None:
        return f"target <= {at_most:g}: {'met' if value <= at_most + 1e-9 else 'MISSED'}"
    if at_least is not None:
        return f"target >= {at_least:g}: {'met' if value >= at_least - 1e-9 else 'MISSED'}"
    return ""


def lines(seconds: float) -> Iterator[str]:
    """Yield the tables."""
    yield "firing           frames   hops to the decision"
    for name, most, rule in FIRINGS:
        frames, hops = firing(rule)
        told = verdict(frames, at_most=most)
        told += "; " + verdict(hops, at_most=1.2) if name == "offered" else ""
        yield f"{name:15}  {frames:6}   {hops:6.2f}   {told}".rstrip()
    yield ""
    yield f"{THINKERS} philosophers   meal  meals/s  frames/meal  median wait  longest wait  least and most meals"
    for eats_s in EATS_S:
        found: dict[bool, dict[str, Any]] = {each: philosophers(each, eats_s, seconds) for each in (False, True)}
        for served, row in found.items():
            name = "lock server" if served else "shared forks"
            rate = f"{row['meals/s']:7.1f}  {row['frames/meal']:11.1f}"
            waits = f"{row['median']:9.3f} s  {row['longest']:10.3f} s"
            yield f"{name:15}  {eats_s:4.2f} s  {rate}  {waits}  {row['least']:6.0f} {row['most']:6.0f}"
        ratio = found[False]["meals/s"] / found[True]["meals/s"]
        longest = found[False]["longest"] / max(found[False]["median"], HOP_S)
        yield f"  throughput ratio {ratio:.2f}, {verdict(ratio, at_least=0.5)}"
        yield f"  longest / median wait {longest:.1f}, {verdict(longest, at_most=5.0)}"
    yield ""
    yield "auction of ten robots   calls for bids   is told   ratio"
    for tasks in (2, 4, 10):
        calls, told = auction(CALLS_FOR_BIDS, tasks), auction(IS_TOLD, tasks)
        ratio = told / calls
        yield f"{tasks:3} tasks, frames       {calls:14}   {told:7}   {ratio:5.2f}   {verdict(ratio, at_most=0.5)}"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="virtual time of the philosophers")
    for line in lines(parser.parse_args().seconds):
        print(line, flush=True)


if __name__ == "__main__":
    main()

"""Draws programs in which jobs of one robot compete: tasks with deadlines, several steps to each."""

from random import Random

from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source

DECLARED = """
type task(robot, int, int).  type step(robot, int, int).  type done(robot, int).  type free(robot).
type !part(robot, int).  type sensor seen(robot, int).  type told(robot, robot, int).  type late(robot, int).
type action work(R: robot, N: int) -o done(R, N), free(R) else step(R, N, 0).
type action stop(robot).
"""

RULES = [
    "task(R, N, _) -o step(R, N, 2).",
    "task(R, N, _), free(R) -o work(R, N).",
    "step(R, N, K), K > 0, $free(R) -o step(R, N, K - 1).",
    "step(R, N, 0), free(R) -o work(R, N).",
    "step(R, N, 0) -o done(R, N).",
    "step(R, N, _), part(R, M) -o done(R, M), told(R, R, N).",
    "part(R, N), seen(R, N) -o step(R, N, 1).",
    "told(R, B, N) -o done(B, N).",
    "task(R, N, D), D > 1 -o told(@2, R, N).",
    "late(R, N) -o step(R, N, 3 % N).",
    "done(R, N), done(R, N) -o free(R).",
    "part(R, N) -o free(R), task(R, N, 3).",
]

JOBS = [
    "job_a: assert(task(R, N, D), done(R, N), D, stop(R)).",
    "job_b: watch(task(R, N, D), done(R, N), D, stop(R)).",
    "job_c: watch(step(R, N, K), free(R), K + 1, stop(R)).",
    "job_d: watch(seen(R, N), done(R, N), 1, stop(R)).",
    "job_e: assert(task(R, N, _), done(@2, N), 2, stop(R)).",
    "job_f: watch(told(R, B, N), done(B, N), 1.5, stop(R)).",
    "job_g: watch(task(R, N, D), done(R, N), D, late(R, N)).",
    "job_h: watch(step(R, N, _), done(R, N), 1, free(R)).",
]


def pressing(rng: Random) -> Program:
    """Return a program with orders that start jobs, and rules that work them off by deadline."""
    rules = rng.sample(RULES, k=rng.randint(2, 6))
    jobs = rng.sample(JOBS, k=rng.randint(1, 3))
    given = [f"task(R, {rng.randint(0, 3)}, {rng.randint(0, 4)})." for _ in range(rng.randint(2, 5))]
    given += [f"part(R, {rng.randint(0, 3)})." for _ in range(rng.randint(0, 3))]
    given += ["free(R)."] * rng.randint(0, 2)
    goals = [rng.choice(["?done(R, 1).", "?done(R, _).", "?free(R)."]) for _ in range(rng.choice([0, 0, 0, 1]))]
    order = rng.choice(["order deadline."] * 5 + [""])
    source = "\n".join([order, DECLARED, *given, *goals, *rules, *jobs])
    program = compile_source(source).program
    assert program is not None, source
    return program

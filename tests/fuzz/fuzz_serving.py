"""Draws programs whose rules read goals and open further ones: sub-goals, and actions that serve goals."""

from random import Random

from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source

WANTED = ["a", "b", "c", "s"]
"""Predicates of goals; the last one is sensed."""

DECLARED = """
type a(robot, int).  type b(robot, int).  type c(robot, int).  type sensor s(robot, int).
type off(robot, int).  type noted(robot, int).
type action do(R: robot, N: int) -o a(R, N) else noted(R, N).
type action make(R: robot, N: int) -o b(R, N), s(R, N) else off(R, N).
type action look(R: robot, N: int).
"""


def serving(rng: Random) -> Program:
    """Return a program with goals for others, often in circles, and actions under way for them."""
    strategy = rng.choice(["", "order textual."])
    rules = [_rule(rng) for _ in range(rng.randint(2, 5))]
    calls = [f"off(R, N) -o not ?{name}(R, N)." for name in WANTED if rng.random() < 0.4]
    given = [f"{rng.choice(WANTED[:3])}(R, {rng.randint(0, 2)})." for _ in range(rng.randint(0, 2))]
    goals = [f"?{rng.choice(WANTED)}(R, {rng.randint(0, 2)})." for _ in range(rng.randint(1, 3))]
    source = "\n".join([strategy, DECLARED, *given, *goals, *rules, *calls, "noted(R, _) -o 1."])
    program = compile_source(source).program
    assert program is not None, source
    return program


def _rule(rng: Random) -> str:
    """Return a rule that reads a goal, or two, and derives goals, actions or facts for them."""
    body = [f"?{rng.choice(WANTED)}(R, N)"]
    if rng.random() < 0.3:
        body.append(f"?{rng.choice(WANTED)}(R, {rng.choice(['M', 'N'])})")
    if rng.random() < 0.3:
        body.append(f"{rng.choice(['', '$'])}{rng.choice(WANTED[:3])}(R, _)")
    return f"{', '.join(body)} -o {', '.join([_item(rng) for _ in range(rng.randint(1, 3))])}."


def _item(rng: Random) -> str:
    number = rng.choice(["N", "N", "(N + 1) % 3", str(rng.randint(0, 2))])
    draw = rng.random()
    if draw < 0.5:
        return f"?{rng.choice(WANTED)}(R, {number})"
    if draw < 0.6:
        return f"{rng.choice(WANTED[:3])}(R, {number})"
    step = f"{rng.choice(['do', 'make', 'look'])}(R, {number})"
    after = rng.choice([f"look(R, {number})", f"?{rng.choice(WANTED)}(R, N)", "do(R, N)"])
    return f"{step} then {after}" if rng.random() < 0.3 else step

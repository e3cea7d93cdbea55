"""Draws programs whose rules mostly consume nothing: what they derive for all matches of facts that never go."""

from random import Random

from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source

DECLARED = """
type !edge(robot, int, int).  type !way(robot, int, int).  type !mark(robot, int).  type !weight(robot, int, int).
type sensor near(robot, int, int).  type walk(robot, int, int).  type token(robot, int).  type !name(robot, string).
"""

LASTING = ["edge", "way", "way", "mark", "weight"]
"""Predicates of bodies."""

ARITY = {"edge": 2, "way": 2, "mark": 1, "weight": 2, "near": 2, "walk": 2, "token": 1}

OTHERS = [
    "edge(R, A, B) -o way(R, A, B).",
    "mark(R, A), A > 0 -o token(R, A).",
    "token(R, A), $walk(R, A, B) -o mark(R, B).",
    "way(R, A, A) -o walk(R, A, 0).",
    "token(R, A) -o edge(R, A, (A + 1) % 4).",
    "way(R, A, B), near(R, B, A) -o mark(R, A).",
    'way(R, 0, B), mark(R, B) -o name(R, "a").',
]


def growing(rng: Random) -> Program:
    """Return a program of rules that fire once for each match, with a few others among them."""
    rules = [_rule(rng) for _ in range(rng.choice([1, 1, 1, 2, 3]))] + rng.sample(OTHERS, k=rng.choice([0, 0, 1, 2, 4]))
    rng.shuffle(rules)
    names = ["edge", "edge", "way", "mark", "token"]
    given = [_atom(rng.choice(names), _number, rng) for _ in range(rng.choice([4, 8, 20]))]
    source = "\n".join([rng.choice(["", "order textual."]), DECLARED, *[f"{each}." for each in given], *rules])
    program = compile_source(source).program
    assert program is not None, source
    return program


def _number(rng: Random) -> str:
    return str(rng.choice([0, 1, 1, 2, 3, 4, 5]))


def _atom(name: str, argument, rng: Random) -> str:
    return f"{name}(R, {', '.join([argument(rng) for _ in range(ARITY[name])])})"


def _rule(rng: Random) -> str:
    """Return a rule over facts that never go; often it derives what it begins with."""
    names = [rng.choice(LASTING) for _ in range(rng.choice([2, 2, 2, 3]))]
    bound: list[str] = []

    def argument(rng: Random) -> str:
        if rng.random() < 0.1:
            return rng.choice(["_", _number(rng)])
        bound.append(rng.choice(["A", "B", "B", "C", "D"]))
        return bound[-1]

    body = [_atom(name, argument, rng) for name in names]
    bound = bound or ["0"]
    if rng.random() < 0.3 and bound != ["0"]:
        body.append(f"{rng.choice(bound)} {rng.choice(['<', '!=', '>='])} {rng.choice([*bound, '1'])}")
    made = [names[0]] * 3 + ["way", "mark", "walk", "token"]
    wrapped = rng.random() < 0.1
    heads = [
        _atom(rng.choice(made), lambda rng: f"{rng.choice(bound)}{' * 2 % 3' if wrapped else ''}", rng)
        for _ in range(rng.choice([1, 1, 1, 2]))
    ]
    return f"{', '.join(body)} -o {', '.join(heads)}."

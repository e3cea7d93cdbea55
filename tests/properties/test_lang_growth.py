"""The time of the compiler grows no faster than about linearly with the source, whatever is long in it."""

import time

import pytest

from rmr.lang.compiler import compile_source

pytestmark = pytest.mark.medium

P = "type p(robot, int).\n"
LONG = {
    "minus signs": lambda n: f"{P}p(R, X) -o p(R, {'-' * n}X).",
    "an arrow of minus signs": lambda n: f"{P}p(R, X) {'-' * n}oo p(R, X).",
    "opening marks": lambda n: f"{P}p(R, X) -o {'„' * n}.",
    "single opening marks": lambda n: f"{P}p(R, X) -o {chr(0x2018) * n}.",
    "escaped quotes in a string without an end": lambda n: f'{P}p(R, X) -o p(R, "' + '\\"' * n,
    "signs of foreign comments": lambda n: P + "% " * n + ".",
    "comments": lambda n: P + "/* * / */ // x\n" * n,
    "a comment without an end": lambda n: P + "/* " * n,
    "backslashes": lambda n: P + "=" * n + "\\" * n,
    "points": lambda n: P + "1." * n,
    "brackets": lambda n: f"{P}p(R, X) -o p(R, {'(' * n}X{')' * n}).",
    "negations": lambda n: f"{P}p(R, X), {'not ' * n} X = 1 -o 1.",
    "a sum": lambda n: f"{P}p(R, X) -o p(R, {' + '.join(['X'] * n)}).",
    "a list": lambda n: f"type l(robot, list int).\nl(@1, [{', '.join(['1'] * n)}]).",
    "a body": lambda n: f"{P}{', '.join(['p(R, X)'] * n)} -o p(R, 1).",
    "a chain of bindings": lambda n: f"{P}p(R, X0), {', '.join(f'X{i + 1} = X{i}' for i in range(n))} -o p(R, X{n}).",
    "a head": lambda n: f"{P}p(R, X) -o {', '.join(['p(R, X)'] * n)}.",
    "nothing but errors": lambda n: P + "p(R -o .\n" * n,
}
"""Lexical and syntactic constructs, by a number of their parts."""
MANY = {
    "facts": lambda n: P + "".join(f"p(@1, {i}).\n" for i in range(n)),
    "rules": lambda n: P + "".join(f"p(R, {i}) -o p(R, {i + 1}).\n" for i in range(n)),
    "predicates of inferred types": lambda n: (
        "".join(f"q{i + 1}(R, X) -o q{i}(R, X).\n" for i in range(n)) + f"q{n}(@1, 1)."
    ),
    "unbound variables": lambda n: P + "".join(f"p(R, X) -o p(R, Y{i}).\n" for i in range(n)),
    "wrong types": lambda n: P + "".join('p(R, X), X < "a" -o p(R, 1).\n' for i in range(n)),
    "missing full stops": lambda n: P + "p(@1, 2)\n" * n,
    "constants": lambda n: "".join(f"const c{i + 1} = c{i}.\n" for i in reversed(range(n))) + "const c0 = 1.",
    "functions": lambda n: "".join(f"fun f{i + 1}(X) = f{i}(X).\n" for i in range(n)) + "fun f0(X) = X + 1.",
    "actions": lambda n: "".join(
        f"type action a{i}(R: robot) -o d{i}(R).\nd{i}(R) -o a{i + 1}(R).\n" for i in range(n)
    ),
    "assertions": lambda n: P + "".join(f"w{i}: watch(p(R, {i}), p(R, {i + 1}), 1, stop(R)).\n" for i in range(n)),
    "rules over robots": lambda n: "type q(robot).\n" + "q(A), peer(A, B), q(B) -o q(A).\n" * (n // 8),
    "misspelt symbols": lambda n: "".join(f"s(@1, syn{i}).\ns(R, sym{i}) -o s(R, aaa).\n" for i in range(n)),
}
"""Items, by their number."""


def taken(text):
    """Processor time, the shorter of two."""
    times = []
    for _ in range(2):
        began = time.process_time()
        compile_source(text)
        times.append(time.process_time() - began)
    return min(times)


@pytest.mark.parametrize("construct", LONG)
def test_eight_times_as_long_takes_about_eight_times_as_long(construct):
    # Quadratic time would be 64 times as long; where the shorter one takes no time, the longer one is little anyway.
    assert taken(LONG[construct](32_000)) < 24 * max(taken(LONG[construct](4000)), 0.02)


@pytest.mark.parametrize("construct", MANY)
def test_eight_times_as_many_take_about_eight_times_as_long(construct):
    assert taken(MANY[construct](1600)) < 24 * max(taken(MANY[construct](200)), 0.02)

"""The workloads in experta, a Rete network in Python after CLIPS. Whoever imports this has it installed.

Each is written as its documentation would, conditions on one fact inside the fact's pattern. It is slow: small sizes.
"""

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

from experta import AS, MATCH, TEST, DefFacts, Fact, KnowledgeEngine, P, Rule
from systems import EXPERTA, Lap, System, clock
from workloads import Workload

Rules = dict[str, Any]
"""Decorated methods by name."""


def counter(fact: Any, size: int) -> Rules:
    def step(self: Any, f: Any, n: int) -> None:
        self.retract(f)
        self.declare(fact.count(s0=n + 1))

    return {"step": Rule(AS.f << fact.count(s0=MATCH.n & P(lambda n: n < size)))(step)}


def ping_pong(fact: Any, size: int) -> Rules:
    return {
        f"{here}{turn}": _throw(getattr(fact, here), getattr(fact, there), turn, size)
        for here, there in (("ping", "pong"), ("pong", "ping"))
        for turn in range(4)
    }


def _throw(here: Any, there: Any, turn: int, size: int) -> Any:
    def throw(self: Any, f: Any, n: int) -> None:
        self.retract(f)
        self.declare(there(s0=n + 1))

    return Rule(AS.f << here(s0=MATCH.n & P(lambda n: n % 4 == turn and n < size)))(throw)


def closure(fact: Any, size: int) -> Rules:
    def first(self: Any, a: int, b: int) -> None:
        self.declare(fact.path(s0=a, s1=b))

    def onward(self: Any, a: int, c: int) -> None:
        self.declare(fact.path(s0=a, s1=c))

    return {
        "first": Rule(fact.edge(s0=MATCH.a, s1=MATCH.b))(first),
        "onward": Rule(fact.edge(s0=MATCH.b, s1=MATCH.c), fact.path(s0=MATCH.a, s1=MATCH.b))(onward),
    }


def gradient(fact: Any, size: int) -> Rules:
    def relax(self: Any, f: Any, b: int, h: int) -> None:
        self.retract(f)
        self.declare(fact.hops(s0=b, s1=h + 1))

    body = (
        fact.edge(s0=MATCH.a, s1=MATCH.b),
        fact.hops(s0=MATCH.a, s1=MATCH.h),
        AS.f << fact.hops(s0=MATCH.b, s1=MATCH.k),
    )
    return {"relax": Rule(*body, TEST(lambda h, k: k > h + 1))(relax)}


def join(fact: Any, size: int) -> Rules:
    def bring(self: Any, f: Any, g: Any, h: Any, x: int, w: int) -> None:
        for used in (f, g, h):
            self.retract(used)
        self.declare(fact.d(s0=x, s1=w))

    body = (
        AS.f << fact.a(s0=MATCH.x, s1=MATCH.y),
        AS.g << fact.b(s0=MATCH.y, s1=MATCH.z),
        AS.h << fact.c(s0=MATCH.z, s1=MATCH.w),
    )
    return {"bring": Rule(*body)(bring)}


def tokens(fact: Any, size: int) -> Rules:
    def consume(self: Any, f: Any) -> None:
        self.retract(f)

    return {"consume": Rule(AS.f << fact.token())(consume)}


def accumulator(fact: Any, size: int) -> Rules:
    def add(self: Any, f: Any, g: Any, s: int, x: int) -> None:
        self.retract(f)
        self.retract(g)
        self.declare(fact.acc(s0=s + x))

    return {"add": Rule(AS.f << fact.acc(s0=MATCH.s), AS.g << fact.token(s0=MATCH.x))(add)}


def comprehension(fact: Any, size: int) -> Rules:
    def note(self: Any, t: int, b: int, v: int) -> None:
        self.declare(fact.heard(s0=t, s1=b, s2=v))

    def over(self: Any, f: Any) -> None:
        self.retract(f)

    body = fact.near(s0=MATCH.b), fact.value(s0=MATCH.b, s1=MATCH.v), fact.tick(s0=MATCH.t)
    return {"note": Rule(*body, salience=10)(note), "over": Rule(AS.f << fact.tick())(over)}


RULES: dict[str, Callable[[Any, int], Rules]] = {
    "counter": counter,
    "ping-pong": ping_pong,
    "closure": closure,
    "gradient": gradient,
    "join": join,
    "tokens": tokens,
    "accumulator": accumulator,
    "comprehension": comprehension,
}


class ExpertaSystem(System):
    """experta in this process."""

    name = EXPERTA

    def __init__(self, workload: Workload) -> None:
        self._arity = workload.arity
        self._kinds = {name: type(name, (Fact,), {}) for name in workload.arity}

        def start(engine: Any) -> Iterator[Any]:
            for name, row in workload.facts:
                yield self._kinds[name](**{f"s{k}": value for k, value in enumerate(row)})

        rules = RULES[workload.name](SimpleNamespace(**self._kinds), workload.size)
        self._type = type("Engine", (KnowledgeEngine,), {**rules, "start": DefFacts()(start)})
        self.firings = self.expected_firings = None

    def once(self) -> Lap:
        """Reset a new engine, whose network is built before, and run it."""
        self._engine = engine = self._type()
        began = clock()
        engine.reset()
        loaded = clock()
        engine.run()
        return Lap(loaded - began, clock() - loaded)

    def held(self, predicate: str) -> list[tuple[int, ...]]:
        """Return the facts' values."""
        kind, slots = self._kinds[predicate], [f"s{k}" for k in range(self._arity[predicate])]
        return [tuple(fact[slot] for slot in slots) for fact in self._engine.facts.values() if type(fact) is kind]

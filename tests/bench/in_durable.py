"""The workloads in durable_rules, an engine in C that is driven from Python rule by rule. Whoever imports this has it.

Events are used up by the first match, facts stay. Its conditions know no remainder, so the guards of the ping-pong
cannot be said, and one event cannot be used up by eight matches together, so the comprehension cannot. What is
derived and matched by no rule it refuses; such results are noted in a list.
"""

import itertools
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from durable import lang
from durable.engine import Host, MessageNotHandledException, MessageObservedException
from durable.lang import assert_facts, c, delete_state, get_facts, get_pending_events, m, post_batch, ruleset, when_all
from systems import DURABLE, Lap, System, clock
from workloads import Row, Workload

Note = Callable[[str, Row], None]
"""Takes down what is derived."""


def counter(size: int, note: Note) -> None:
    @when_all(m.s0 < size)
    def step(c: Any) -> None:
        c.post({"kind": "count", "s0": c.m.s0 + 1})

    @when_all(m.s0 >= size)
    def end(c: Any) -> None:
        note("count", (c.m.s0,))


def closure(size: int, note: Note) -> None:
    def reach(c: Any, start: int, end: int) -> None:
        with suppress(MessageObservedException):  # a path that is known
            c.assert_fact({"kind": "path", "s0": start, "s1": end})

    @when_all(m.kind == "edge")
    def first(c: Any) -> None:
        reach(c, c.m.s0, c.m.s1)

    @when_all(c.path << m.kind == "path", c.edge << (m.kind == "edge") & (m.s0 == c.path.s1))
    def onward(c: Any) -> None:
        reach(c, c.path.s0, c.edge.s1)


def gradient(size: int, note: Note) -> None:
    @when_all(
        c.near << m.kind == "hops",
        c.edge << (m.kind == "edge") & (m.s0 == c.near.s0),
        c.far << (m.kind == "hops") & (m.s0 == c.edge.s1) & (m.s1 > c.near.s1 + 1),
    )
    def relax(c: Any) -> None:
        c.retract_fact(c.far)
        c.assert_fact({"kind": "hops", "s0": c.far.s0, "s1": c.near.s1 + 1})


def join(size: int, note: Note) -> None:
    @when_all(
        c.a << m.kind == "a",
        c.b << (m.kind == "b") & (m.s0 == c.a.s1),
        c.c << (m.kind == "c") & (m.s0 == c.b.s1),
    )
    def bring(c: Any) -> None:
        note("d", (c.a.s0, c.c.s1))


def tokens(size: int, note: Note) -> None:
    @when_all(m.kind == "token")
    def consume(c: Any) -> None:
        pass


def accumulator(size: int, note: Note) -> None:
    @when_all(c.acc << m.kind == "acc", c.token << m.kind == "token")
    def add(c: Any) -> None:
        c.post({"kind": "acc", "s0": c.acc.s0 + c.token.s0})


RULES: dict[str, Callable[[int, Note], None]] = {
    "counter": counter,
    "closure": closure,
    "gradient": gradient,
    "join": join,
    "tokens": tokens,
    "accumulator": accumulator,
}

LASTING = {"closure", "gradient"}
"""Workloads over facts; the others' are events."""

_numbers = itertools.count()


class QuietHost(Host):  # type: ignore[misc]
    """The engine without its two threads for timers, which no workload has: their time would count with others'."""

    def _run(self) -> None:
        """Start no thread."""


lang._main_host = QuietHost()


class DurableSystem(System):
    """durable_rules in this process."""

    name = DURABLE

    def __init__(self, workload: Workload) -> None:
        self._workload = workload
        self._noted: dict[str, list[Row]] = {}
        self._rules = f"{workload.name}-{next(_numbers)}"
        self._session = ""
        with ruleset(self._rules):
            RULES[workload.name](workload.size, lambda name, row: self._noted.setdefault(name, []).append(row))
        self.firings = self.expected_firings = None

    def once(self) -> Lap:
        """Hand in all facts at once, which runs the rules; loading cannot be told from running."""
        if self._session:
            delete_state(self._rules, self._session)
        self._session = f"s{next(_numbers)}"
        self._noted.clear()
        messages = [
            {"sid": self._session, "kind": name} | {f"s{k}": value for k, value in enumerate(row)}
            for name, row in self._workload.facts
        ]
        hand_in = assert_facts if self._workload.name in LASTING else post_batch
        began = clock()
        with suppress(MessageNotHandledException):
            hand_in(self._rules, messages)
        return Lap(0.0, clock() - began)

    def held(self, predicate: str) -> list[Row]:
        """Return what was noted, and the facts."""
        slots = [f"s{k}" for k in range(self._workload.arity[predicate])]
        facts = [fact for fact in get_facts(self._rules, self._session) if fact["kind"] == predicate]
        pending = [event for event in get_pending_events(self._rules, self._session) if event["kind"] == predicate]
        return self._noted.get(predicate, []) + [tuple(fact[slot] for slot in slots) for fact in facts + pending]

"""What engines are compared by: each workload once as an RMR program and once, equivalently, for CLIPS.

A workload is facts, rules in either language, and what must hold at the end, which is worked out here without any
engine. The facts are the same on all sides: numbers; RMR's belong to the one robot that runs. The CLIPS rules are the
fastest of those tried: templates or ordered facts, `modify` or `retract` and `assert`, the order of the patterns and of
the facts, the strategies, fact duplication allowed or not. None of this is tuned to a size.
"""

import random
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

Row = tuple[int, ...]
Facts = list[tuple[str, Row]]
Ending = dict[str, list[Row]]
"""The facts that hold at the end, sorted, of the predicates that tell whether all went well."""

SEED = 7
"""Of the random graphs and of the order of facts."""

EDGES = 200
"""Of the graph whose closure is taken."""

DEGREE = 4
"""Neighbours of a node in the graph of the gradient, in the mean."""

FAR = 1_000_000
"""More hops than any graph here has."""

NEIGHBOURS = 8


@dataclass(frozen=True)
class Workload:
    """One thing to do, for several engines."""

    name: str
    size: int
    facts: Facts
    """What holds at the start."""
    rmr: str
    """Declarations and rules; the facts are added."""
    clips: str
    """Rules; the templates, whose slots are s0, s1, ..., and the facts are added."""
    arity: dict[str, int]
    """How many arguments the facts of a predicate have."""
    ending: Ending
    firings: int
    """How often a rule fires."""
    clips_firings: int | None = None
    """The same for CLIPS where it needs another number of them."""
    strategy: str = "depth"
    """CLIPS's: its default, or what makes it faster."""

    @property
    def source(self) -> str:
        """Return the RMR program."""
        return self.rmr + "".join(f"{name}(R, {', '.join(map(str, row))}).\n" for name, row in self.facts)


def counter(size: int) -> Workload:
    """Count to `size`: every firing consumes one fact and makes one."""
    return Workload(
        name="counter",
        size=size,
        facts=[("count", (0,))],
        rmr=f"type count(robot, int).\ncount(R, N), N < {size} -o count(R, N + 1).\n",
        clips=f"(defrule step ?f <- (count (s0 ?n&:(< ?n {size}))) => (modify ?f (s0 (+ ?n 1))))",
        arity={"count": 1},
        ending={"count": [(size,)]},
        firings=size,
    )


def ping_pong(size: int) -> Workload:
    """Throw two facts to and fro, `size` times each; of eight guarded rules one fits a fact, and the first goes."""
    drawn = ping_pong_drawn(size)
    return replace(drawn, name="ping-pong", rmr="order textual.\n" + drawn.rmr)


def ping_pong_drawn(size: int) -> Workload:
    """The same with RMR's own strategy: of the two rules that are satisfied one is drawn each time."""
    throws = [("ping", "pong", turn) for turn in range(4)] + [("pong", "ping", turn) for turn in range(4)]
    rmr = [f"{here}(R, N), N % 4 = {turn}, N < {size} -o {there}(R, N + 1).\n" for here, there, turn in throws]
    clips = [
        f"(defrule {here}-{turn} ?f <- ({here} (s0 ?n&:(= (mod ?n 4) {turn})&:(< ?n {size})))"
        f" => (retract ?f) (assert ({there} (s0 (+ ?n 1)))))\n"
        for here, there, turn in throws
    ]
    return Workload(
        name="ping-pong, drawn",
        size=size,
        facts=[("ping", (0,)), ("pong", (0,))],
        rmr="type ping(robot, int).\ntype pong(robot, int).\n" + "".join(rmr),
        clips="".join(clips),
        arity={"ping": 1, "pong": 1},
        ending={"ping": [(size,)], "pong": [(size,)]},
        firings=2 * size,
    )


def closure(size: int) -> Workload:
    """Find which of `size` nodes can be reached from which over 200 edges; nothing is consumed."""
    edges = _edges(size, min(EDGES, size * 3 // 2))
    paths = [(start, end) for start in range(size) for end in sorted(_reached(edges, start))]
    onward = [sum(1 for edge in edges if edge[0] == node) for node in range(size)]
    return Workload(
        name="closure",
        size=size,
        facts=[("edge", edge) for edge in edges],
        rmr="type !edge(robot, int, int).\ntype !path(robot, int, int).\n"
        "edge(R, A, B) -o path(R, A, B).\npath(R, A, B), edge(R, B, C) -o path(R, A, C).\n",
        clips="(defrule first (edge (s0 ?a) (s1 ?b)) => (assert (path (s0 ?a) (s1 ?b))))\n"
        "(defrule next (edge (s0 ?b) (s1 ?c)) (path (s0 ?a) (s1 ?b)) => (assert (path (s0 ?a) (s1 ?c))))",
        arity={"edge": 2, "path": 2},
        ending={"path": paths},
        firings=len(edges) + sum(onward[end] for _, end in paths),
    )


def gradient(size: int) -> Workload:
    """Give each of `size` nodes its distance from one of them, by relaxation; a node's fact is replaced."""
    one_way = _edges(size, size * DEGREE // 2, both=True)
    edges = one_way + [(end, start) for start, end in one_way]
    source = edges[0][0]
    hops = _hops(edges, source)
    return Workload(
        name="gradient",
        size=size,
        facts=[("edge", edge) for edge in edges] + [("hops", (node, FAR * (node != source))) for node in range(size)],
        rmr="type !edge(robot, int, int).\ntype hops(robot, int, int).\n"
        "$hops(R, A, H), edge(R, A, B), hops(R, B, K), K > H + 1 -o hops(R, B, H + 1).\n",
        clips="(defrule relax (edge (s0 ?a) (s1 ?b)) (hops (s0 ?a) (s1 ?h))"
        " ?f <- (hops (s0 ?b) (s1 ?k&:(> ?k (+ ?h 1)))) => (modify ?f (s1 (+ ?h 1))))",
        arity={"edge": 2, "hops": 2},
        ending={"hops": [(node, hops.get(node, FAR)) for node in range(size)]},
        firings=len(hops) - 1,
        strategy="breadth",
    )


def join(size: int) -> Workload:
    """Bring facts of three predicates together, `size` of each, by keys that stand once; one result a match."""
    rng = random.Random(SEED)
    columns = [rng.sample(range(size), size) for _ in range(4)]
    facts: Facts = []
    for name, left, right in (("a", 0, 1), ("b", 1, 2), ("c", 2, 3)):
        facts += [(name, (columns[left][k], columns[right][k])) for k in rng.sample(range(size), size)]
    return Workload(
        name="join",
        size=size,
        facts=facts,
        rmr="".join(f"type {name}(robot, int, int).\n" for name in "abcd")
        + "a(R, X, Y), b(R, Y, Z), c(R, Z, W) -o d(R, X, W).\n",
        clips="(defrule join ?a <- (a (s0 ?x) (s1 ?y)) ?b <- (b (s0 ?y) (s1 ?z)) ?c <- (c (s0 ?z) (s1 ?w))"
        " => (retract ?a ?b ?c) (assert (d (s0 ?x) (s1 ?w))))",
        arity=dict.fromkeys("abcd", 2),
        ending={"a": [], "b": [], "c": [], "d": sorted(zip(columns[0], columns[3], strict=True))},
        firings=size,
    )


def tokens(size: int) -> Workload:
    """Consume `size` facts, one each firing, and make nothing."""
    return Workload(
        name="tokens",
        size=size,
        facts=[("token", (number,)) for number in range(size)],
        rmr="type token(robot, int).\ntoken(R, _) -o 1.\n",
        clips="(defrule consume ?f <- (token) => (retract ?f))",
        arity={"token": 1},
        ending={"token": []},
        firings=size,
    )


def accumulator(size: int) -> Workload:
    """Add up `size` facts: every firing consumes one, and the sum so far, and makes the next sum."""
    return Workload(
        name="accumulator",
        size=size,
        facts=[("acc", (0,)), *[("token", (number,)) for number in range(1, size + 1)]],
        rmr="type acc(robot, int).\ntype token(robot, int).\nacc(R, S), token(R, T) -o acc(R, S + T).\n",
        clips="(defrule add ?a <- (acc (s0 ?s)) ?t <- (token (s0 ?x)) => (retract ?t) (modify ?a (s0 (+ ?s ?x))))",
        arity={"acc": 1, "token": 1},
        ending={"acc": [(size * (size + 1) // 2,)], "token": []},
        firings=size,
    )


def comprehension(size: int) -> Workload:
    """At each of `size` ticks note the values of eight neighbours.

    RMR fires one rule a tick. CLIPS is faster with a rule for each neighbour's value, and one that retracts the tick
    after them, than with `do-for-all-facts` in one rule.
    """
    neighbours = range(1, NEIGHBOURS + 1)
    return Workload(
        name="comprehension",
        size=size,
        facts=[("near", (b,)) for b in neighbours]
        + [("value", (b, 10 * b)) for b in neighbours]
        + [("tick", (tick,)) for tick in range(size)],
        rmr="type tick(robot, int).\ntype !near(robot, int).\ntype !value(robot, int, int).\n"
        "type heard(robot, int, int, int).\n"
        "tick(R, T) -o {B, V | near(R, B), value(R, B, V) | heard(R, T, B, V)}.\n",
        clips="(defrule note (declare (salience 10)) (near (s0 ?b)) (value (s0 ?b) (s1 ?v)) (tick (s0 ?t))"
        " => (assert (heard (s0 ?t) (s1 ?b) (s2 ?v))))\n"
        "(defrule over ?f <- (tick) => (retract ?f))",
        arity={"tick": 1, "near": 1, "value": 2, "heard": 3},
        ending={"tick": [], "heard": [(tick, b, 10 * b) for tick in range(size) for b in neighbours]},
        firings=size,
        clips_firings=size * (NEIGHBOURS + 1),
    )


@dataclass(frozen=True)
class Entry:
    """How large a workload is taken, and what is to be reached."""

    title: str
    make: Callable[[int], Workload]
    size: int
    runs: int
    """Runs that one round times together, so that they take long enough to be timed."""
    small: int
    """The size for engines that need very much longer, and for --quick."""
    target: float | None
    """Time over that of CLIPS, at most."""


SUITE = (
    Entry("counter", counter, 50_000, 1, 400, 0.5),
    Entry("ping-pong", ping_pong, 10_000, 1, 200, 1.0),
    Entry("ping-pong, drawn", ping_pong_drawn, 10_000, 1, 200, None),
    Entry("closure", closure, 130, 3, 40, 0.8),
    Entry("gradient", gradient, 400, 15, 30, 1.0),
    Entry("join of 100", join, 100, 150, 50, 1.0),
    Entry("join of 1,000", join, 1000, 8, 100, 0.7),
    Entry("tokens", tokens, 10_000, 4, 500, 1.0),
    Entry("token x accumulator", accumulator, 1000, 1, 50, 1.0),
    Entry("comprehension", comprehension, 500, 6, 40, 1.0),
)
"""Every workload, with runs that together take CLIPS 20 to 100 ms."""


def _edges(nodes: int, count: int, *, both: bool = False) -> list[Row]:
    """Return different edges between different nodes, drawn at random; with `both` none is another's reverse."""
    rng = random.Random(SEED)
    edges: dict[Row, None] = {}
    while len(edges) < count:
        start, end = rng.randrange(nodes), rng.randrange(nodes)
        if start != end and not (both and (end, start) in edges):
            edges[start, end] = None
    return list(edges)


def _hops(edges: list[Row], start: int) -> dict[int, int]:
    """Return the distances of what can be reached from `start`, which has 0."""
    onward: dict[int, list[int]] = {}
    for here, there in edges:
        onward.setdefault(here, []).append(there)
    hops, waiting = {start: 0}, deque([start])
    while waiting:
        node = waiting.popleft()
        for there in onward.get(node, ()):
            if there not in hops:
                hops[there] = hops[node] + 1
                waiting.append(there)
    return hops


def _reached(edges: list[Row], start: int) -> set[int]:
    """Return what can be reached from `start` over one edge at least."""
    return {node for here, there in edges if here == start for node in _hops(edges, there)}

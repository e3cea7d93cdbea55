"""What one machine costs: from an event to the action it causes, memory, loading. RMR alone, but for the latency.

The program has 30 rules and 50 facts: ten kinds of thing are seen, each kind is carried to its place or, if it is
heavy, lifted with its tool; when that is done, a third rule takes the fact away, so that nothing is left of an event.
"""

import gc
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterable, Sequence
from types import ModuleType
from typing import Any

from run import Figure, UntakenError
from systems import clock, compiled
from workloads import ping_pong

from rmr.base.streams import Choices
from rmr.bytecode import codec
from rmr.bytecode.program import Program
from rmr.vm.engines import new_machine
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived

KINDS = 10
"""Of things: three rules and five facts each."""

HEAVY = 50
"""From this weight on a thing is lifted."""

PLACES = 3
"""That a kind of thing may be carried to."""

WARM = 500
"""Events before any is timed."""

MADE = 100
"""New machines that are timed together."""


def source(heavy: int = HEAVY, *, joins: bool = True) -> str:
    """Return the program: what an event causes hangs on other facts too, unless it `joins` none."""
    lines = [
        "type seen(robot, int, int).",
        "type !place(robot, int, int).",
        "type !limit(robot, int, int).",
        "type tool(robot, int).",
        "type done(robot, int).",
        "type action carry(R: robot, K: int, P: int) -o done(R, K).",
        "type action lift(R: robot, K: int, W: int) -o done(R, K).",
    ]
    for kind in range(KINDS):
        near = f"limit(R, {kind}, P), place(R, {kind}, P), " if joins else ""
        with_tool = f"$tool(R, {kind}), " if joins else ""
        lines += [f"place(R, {kind}, {place})." for place in range(PLACES)]
        lines += [
            f"limit(R, {kind}, 1).",
            f"tool(R, {kind}).",
            f"seen(R, {kind}, W), {near}W < {heavy} -o carry(R, {kind}, {'P' if joins else 1}).",
            f"seen(R, {kind}, W), {with_tool}W >= {heavy} -o lift(R, {kind}, W).",
            f"done(R, {kind}) -o 1.",
        ]
    return "\n".join(lines)


class Stand:
    """A machine under test that is fed events."""

    def __init__(self, program: Program, options: dict[str, Any], name: str = "costs") -> None:
        self.machine: Machine = new_machine(program, 1, Choices(name), **options)
        self._seen = program.index("seen")
        self._now = 0
        self.machine.start(0)
        self._settle()

    def _settle(self) -> None:
        self.machine.run(self._now)
        self.machine.drain()

    def react(self, number: int) -> int:
        """Hand in an event and take away the action; return the nanoseconds of wall time in between.

        Raises:
            UntakenError: there was no action, or not the right one.
        """
        kind, weight = number % KINDS, number * 7 % 100
        machine, seen, args, wall = self.machine, self._seen, (kind, weight), time.perf_counter_ns
        self._now = now = self._now + 1
        began = wall()
        machine.insert(now, seen, args)
        machine.run(now)
        events = machine.drain()
        taken = wall() - began
        actions = [event for event in events if isinstance(event, ActionDerived)]
        if [action.args for action in actions] != [(kind, 1 if weight < HEAVY else weight)]:
            raise UntakenError(f"event {number} caused {actions}")
        machine.complete(now, actions[0].serial, True)
        self._settle()
        return taken


def latency(options: dict[str, Any], events: int) -> Iterable[Figure]:
    """From one fact from outside to the action in the host's hands."""
    for name, joins in (("event to action", True), ("event to action by a rule of one atom", False)):
        stand = Stand(compiled(source(joins=joins)), options)
        facts = len(stand.machine.facts())
        assert facts == 5 * KINDS
        for number in range(WARM):
            stand.react(number)
        gc.collect()
        taken = [stand.react(number) / 1e3 for number in range(events)]
        if len(stand.machine.facts()) != facts:
            raise UntakenError("facts pile up")
        yield from _quantiles(name, taken, (3, 10))


def clips_latency(clips: ModuleType, events: int) -> Iterable[Figure]:
    """The same from Python to a Python function that CLIPS calls, for comparison."""
    env, taken_away = clips.Environment(), []
    env.define_function(lambda *action: taken_away.append(action), name="act")
    for name, arity in {"seen": 2, "place": 2, "limit": 2, "tool": 1}.items():
        env.build(f"(deftemplate {name} {' '.join(f'(slot s{k} (default 0))' for k in range(arity))})")
    facts = [f"(place (s0 {k}) (s1 {p}))" for k in range(KINDS) for p in range(PLACES)]
    facts += [f"(limit (s0 {k}) (s1 1)) (tool (s0 {k}))" for k in range(KINDS)]
    env.build(f"(deffacts start {' '.join(facts)})")
    for k in range(KINDS):
        env.build(
            f"(defrule carry{k} ?f <- (seen (s0 {k}) (s1 ?w&:(< ?w {HEAVY}))) (limit (s0 {k}) (s1 ?p))"
            f" (place (s0 {k}) (s1 ?p)) => (retract ?f) (act {k} ?p))"
        )
        env.build(
            f"(defrule lift{k} ?f <- (seen (s0 {k}) (s1 ?w&:(>= ?w {HEAVY}))) (tool (s0 {k}))"
            f" => (retract ?f) (act {k} ?w))"
        )
    env.build("(deffunction see (?k ?w) (assert (seen (s0 ?k) (s1 ?w))) (run) TRUE)")  # the fastest way in
    env.reset()
    see = env.find_function("see")
    taken = []
    for number in range(WARM + events):
        kind, weight = number % KINDS, number * 7 % 100
        began = time.perf_counter_ns()
        see(kind, weight)
        taken.append((time.perf_counter_ns() - began) / 1e3)
        if taken_away.pop() != (kind, 1 if weight < HEAVY else weight):
            raise UntakenError(f"CLIPS did something else at event {number}")
    yield from _quantiles("event to action, CLIPS from Python", taken[WARM:], (None, None))


def _quantiles(name: str, taken: Sequence[float], targets: tuple[float | None, float | None]) -> Iterable[Figure]:
    yield Figure(f"{name}, median of {len(taken)}", statistics.median(taken), "us", targets[0])
    yield Figure(f"{name}, 99 of 100 within", statistics.quantiles(taken, n=100)[98], "us", targets[1])


def memory(options: dict[str, Any], machines: int) -> Iterable[Figure]:
    """All that one more machine adds, the mean of some: facts, indices, counters, its stream; code is shared."""
    thirty, eight = compiled(source()), compiled(ping_pong(20).source)

    def busy(number: int) -> Machine:
        stand = Stand(thirty, options, f"memory {number}")
        for event in range(KINDS):
            stand.react(event)
        return stand.machine

    def small(number: int) -> Machine:
        machine = new_machine(eight, 1, Choices(f"memory {number}"), **options)
        machine.start(0)
        while not machine.quiescent:
            machine.run(0)
            machine.drain()
        return machine

    yield Figure("memory of a machine, 30 rules, 50 facts, after ten events", _traced(busy, machines) / 1e3, "kB", 15)
    yield Figure("memory of a machine, 8 rules, 2 facts, after 40 firings", _traced(small, machines) / 1e3, "kB", 4)


def _traced(make: Callable[[int], Machine], count: int) -> float:
    """Return the octets that one further machine adds, others having made before what all share."""
    others = [make(number) for number in range(3)]
    kept: list[Machine | None] = [None] * count
    tracemalloc.start()
    try:
        for place in range(count):
            kept[place] = make(place)
        gc.collect()
        return tracemalloc.get_traced_memory()[0] / count
    finally:
        tracemalloc.stop()
        del others


def load(options: dict[str, Any], rounds: int) -> Iterable[Figure]:
    """From octets to the first machine with its facts, for programs never seen before and for one that is known."""
    octets = [codec.encode(compiled(source(HEAVY - turn)), debug=False) for turn in range(rounds)]
    cold, known, bare = [], [], []
    for data in octets:
        gc.collect()
        cold.append(_loaded(data, options))
        known.append(_loaded(data, options))
        program = codec.decode(data)
        _started(program, options)
        began = clock()
        machines = [new_machine(program, 1, Choices(""), **options) for _ in range(MADE)]
        bare.append((clock() - began) / len(machines))
    for name, taken in (("never seen before", cold), ("the same again", known)):
        whole = [decoded + started for decoded, started in taken]
        target = 30 if taken is cold else 1
        yield Figure(f"load of 30 rules, {name}: octets to first machine", statistics.median(whole) * 1e3, "ms", target)
        decoding = statistics.median(decoded for decoded, _ in taken)
        yield Figure(f"load of 30 rules, {name}: of this verified decoding", decoding * 1e3, "ms")
    yield Figure("a new machine", statistics.median(bare) * 1e6, "us", 50)


def _loaded(data: bytes, options: dict[str, Any]) -> tuple[float, float]:
    """Return the seconds from octets to a verified program, and from there to a machine that has its facts."""
    began = clock()
    program = codec.decode(data)
    decoded = clock()
    _started(program, options)
    return decoded - began, clock() - decoded


def _started(program: Program, options: dict[str, Any]) -> None:
    machine = new_machine(program, 1, Choices("load"), **options)
    machine.start(0)
    machine.run(0)

"""Plays a script on two machines and tells the first difference.

The reference is played first. After each step everything is noted that a host can see: what the call gave back or
refused, every event by value with its types (their representations tell 1 from 1.0, true and @1), what holds and in
which order, jobs, goals, counts, and the state of the stream from which it draws. A reference that fires or looks
too often is stopped there: how long a program's joins take is its author's affair.
"""

import re
from dataclasses import dataclass
from typing import NamedTuple

from fuzz_alive import Alive, TooLong, observed
from fuzz_bounds import bounds
from fuzz_events import Step
from fuzz_programs import HOME

from rmr.base.streams import Choices
from rmr.bytecode.program import Program
from rmr.vm.engines import Engine, new_machine
from rmr.vm.machine import Machine

FIRINGS_MAX = 150
"""Firings after which a case ends."""

FACTS_MAX = 150
"""Facts with which a case ends."""


WORD = re.compile(r"[A-Za-z]{2,}")


@dataclass(frozen=True)
class Case:
    """A program and what happens to it."""

    program: Program
    script: tuple[Step, ...]
    budget: int
    """Firings of one run."""
    draws: str
    """The name of the stream from which the machine draws."""
    robot: int = HOME
    small: bool = False
    """All bounds are small."""
    trace: bool = True
    """Facts that come and go are told; engines may do without looking there when they are not."""


class Seen(NamedTuple):
    """What can be seen after a step; each field as text or numbers."""

    result: str
    """What the call gave back, or refused."""
    events: tuple[str, ...]
    firings: int
    quiescent: bool
    next_wake: int
    due: int
    held: tuple[str, ...]
    facts: tuple[str, ...]
    """Noted after the last step alone."""
    goals: str
    jobs: str
    counts: str
    """Expressions without value, what was dropped."""
    draws: int


class Difference(NamedTuple):
    """Where two machines part."""

    step: int
    """Of the script."""
    field: str
    """Of `Seen`."""
    expected: object
    found: object

    def text(self, case: Case) -> str:
        """Say it for a reader."""
        step = case.script[self.step]
        both = f"  expected {self.expected}\n  found    {self.found}"
        return f"step {self.step}, {step.call}{step.args}: {self.field}\n{both}"

    def kind(self) -> str:
        """Return a word for the kind of difference, by which cases are told apart."""
        words = [summary(self.expected), summary(self.found)]
        return "-".join(dict.fromkeys([self.field, *words]))


def summary(text: object) -> str:
    """Return the class of an event or exception in a representation, with the reason of a failure; or nothing much."""
    name, _, inside = str(text).partition("(")
    if not name.isidentifier():
        return "value"
    reason = inside.partition("reason=")[2] if name == "ExpressionFailed" else inside if name.endswith("Error") else ""
    return "-".join([name, *WORD.findall(reason)[:6]])


class Play:
    """A machine that plays a script, step by step."""

    def __init__(self, case: Case, engine: Engine) -> None:
        self.case = case
        self.choices = Choices(case.draws)
        self.machine: Machine = new_machine(
            case.program, case.robot, self.choices, engine=engine, firing_budget=case.budget, trace=case.trace
        )

    def step(self, number: int) -> Seen:
        """Do a step and note everything. Raises only what no machine may raise: TooLong."""
        step = self.case.script[number]
        try:
            result = repr(getattr(self.machine, step.call)(*step.args))
        except Exception as error:
            result = f"{type(error).__name__}({error})"
        return self.seen(result, last=number + 1 == len(self.case.script))

    def seen(self, result: str, *, last: bool) -> Seen:
        """Note everything; the facts in program syntax, which take the longest, only at the end."""
        machine = self.machine
        held = tuple([repr(machine.held(index)) for index in range(len(self.case.program.predicates))])
        return Seen(
            result=result,
            events=tuple(map(repr, machine.drain())),
            firings=machine.firings,
            quiescent=machine.quiescent,
            next_wake=machine.next_wake,
            due=machine.due,
            held=held,
            facts=tuple(machine.facts()) if last else (),
            goals=repr(machine.goals()),
            jobs=repr(machine.jobs),
            counts=f"{machine.expression_failures} {machine.dropped}",
            draws=self.choices.state,
        )


def expected(case: Case) -> tuple[list[Seen], Alive]:
    """Play a case on the interpreter, as far as it may go; return what was seen, and what was alive."""
    seen: list[Seen] = []
    with bounds(case.small), observed(case.program, Choices(case.draws).state) as alive:
        play = Play(case, Engine.INTERPRETER)
        for number in range(len(case.script)):
            try:
                seen.append(play.step(number))
            except TooLong:
                break
            if "failures" in play.machine.dropped:  # which are forgotten hangs on how often an engine looks at them
                del seen[-1]
                break
            alive.look(case.script[number].call, seen[-1].result, seen[-1].events, seen[-1].draws)
            held = [len(play.machine.held(index)) for index in range(len(case.program.predicates))]
            alive.tally["many facts of a predicate"] += max(held, default=0) > 12
            alive.tally["many rules"] += len(case.program.rules) > 8
            if play.machine.firings > FIRINGS_MAX or sum(held) > FACTS_MAX:
                break
    return seen, alive


def difference(case: Case, seen: list[Seen], engine: Engine) -> Difference | None:
    """Play a case on another engine as far as the reference was `seen`; return the first difference."""
    with bounds(case.small):
        try:
            play = Play(case, engine)
        except Exception as error:
            return Difference(0, "result", "a machine", f"{type(error).__name__}({error})")
        for number, reference in enumerate(seen):
            other = play.step(number)
            if other != reference:
                return _first(number, reference, other)
    return None


def _first(number: int, reference: Seen, other: Seen) -> Difference:
    field = next(
        name for name in ("result", "events", *Seen._fields) if getattr(reference, name) != getattr(other, name)
    )
    one, two = getattr(reference, field), getattr(other, field)
    if not isinstance(one, tuple):
        return Difference(number, field, one, two)
    place = next((i for i, (a, b) in enumerate(zip(one, two, strict=False)) if a != b), min(len(one), len(two)))
    each = [items[place] if place < len(items) else "nothing more" for items in (one, two)]
    return Difference(number, field, *each)

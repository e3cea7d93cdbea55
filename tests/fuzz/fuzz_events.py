"""What comes from outside: a script of calls of a machine, drawn for a program, and as JSON.

A step is a method of `Machine` with its arguments, so that a script says all and plays on any engine. Times are on
the grid of the deadlines, so that things happen at the very instant of one; several events come between two runs,
and several runs at one instant. Some calls are mistakes, which every engine must refuse alike.
"""

from random import Random
from typing import NamedTuple

from fuzz_programs import BASES, HOME, value_of

from rmr.base.time import NS_PER_S
from rmr.base.values import Robot, Symbol, Value
from rmr.bytecode.heads import items
from rmr.bytecode.program import (
    ANY,
    SELF_SLOT,
    Anything,
    Atom,
    Base,
    Constant,
    DeriveFact,
    Kind,
    Mode,
    Pattern,
    Program,
    Slot,
    Type,
)

PASSING = [0, 0, 0, 0, 1, NS_PER_S // 2, NS_PER_S // 2, NS_PER_S, 2 * NS_PER_S]
"""How much later something happens, in ns."""

OTHERS = [2, 2, 0, HOME, 3]
"""Robots that ask and report."""

CROWDS = 0.008
"""How often what happens is that many facts of a predicate come."""

MISTAKES = 0.01
"""How often a call is a mistake."""

POOLED = 0.5
"""How often a value is one that the program names."""

Argument = int | bool | None | tuple[object, ...] | Anything


class Step(NamedTuple):
    """One call."""

    call: str
    """A method of `Machine`."""
    args: tuple[Argument, ...]


class Script:
    """A script in the making."""

    def __init__(self, program: Program, rng: Random) -> None:
        self.program = program
        self.rng = rng
        self.now = 0
        self.ended = 0
        """How many actions have been ended; serials count from 1."""
        kinds = [each.kind for each in program.predicates]
        self.facts = [i for i, kind in enumerate(kinds) if kind is not Kind.ACTION]
        self.sensed = [i for i, kind in enumerate(kinds) if kind is Kind.SENSED]
        self.actions = [i for i, kind in enumerate(kinds) if kind is Kind.ACTION]
        self.watched = [i for i, each in enumerate(program.assertions) if each.finisher == Constant(Robot(HOME))]
        """Assertions of whose finish facts this robot tells others."""
        self.finishes = [each.finish.predicate for each in program.assertions]
        self.used = [each for rule in program.rules for each in rule.body if isinstance(each, Atom)]
        derived = [item for rule in program.rules for item in items(rule.head)]
        self.derived = [each.predicate for each in derived if isinstance(each, DeriveFact)]
        self.sensing: list[tuple[int, tuple[Value, ...]]] = []
        """Sensed facts that have been inserted."""
        self.known: dict[Base, list[Value]] = {}
        for value in named(program):
            self.known.setdefault(BASES.get(type(value), Base.OPEN), []).append(value)

    def steps(self) -> list[Step]:
        """Return the start, a few things that happen, and a last run."""
        made = [Step("start", (0,))]
        if self.rng.random() < 0.8:
            made.append(self.run())
        for _ in range(self.rng.randint(3, 9) if self.facts else 0):
            self.now += self.rng.choice(PASSING)
            made.extend(self.some())
            if self.rng.random() < 0.6:
                made.append(self.run())
        self.now += self.rng.choice(PASSING)
        return [*made, self.run(), self.run()]

    def some(self) -> list[Step]:
        """Return something that happens, one thing or several at once."""
        rng = self.rng
        draws = (
            [self.insert] * 4
            + [self.feed] * (8 * bool(self.used))
            + [self.withdraw] * (4 * bool(self.sensed))
            + [self.want] * 2
        )
        if self.actions:
            draws += [self.complete, self.complete, self.complete, self.derive_action, self.ask]
        if self.program.assertions:
            draws += [self.await_finish, self.finish_seen, self.insert, self.insert]
        draws += [self.asked_late] * (2 * bool(self.watched))
        made: list[Step] = []
        for _ in range(rng.choice([1, 1, 2, 3])):
            step = self.crowd() if self.chance(CROWDS) else rng.choice(draws)()
            made += step if isinstance(step, list) else [step]
        return made

    def run(self) -> Step:
        return Step("run", (self.now,))

    # ---- values

    def value(self, kind: Type) -> Value:
        known = self.known.get(kind.base)
        if known and self.rng.random() < POOLED:
            return self.rng.choice(known)
        return value_of(self.rng, kind)

    def chance(self, probability: float) -> bool:
        return self.rng.random() < probability

    def values(self, predicate: int) -> tuple[Value, ...]:
        """Return arguments, mostly of the declared types."""
        types = self.program.predicates[predicate].types
        if self.chance(MISTAKES):
            return tuple(self.value(Type(Base.OPEN)) for _ in range(self.rng.randint(0, 3)))
        return tuple(map(self.value, types))

    def any_fact(self) -> int:
        """Return a predicate, mostly one that a rule mentions."""
        if self.finishes and self.chance(0.25):
            return self.rng.choice(self.finishes)
        return self.rng.choice(self.used).predicate if self.used and self.chance(0.7) else self.rng.choice(self.facts)

    # ---- calls

    def insert(self) -> Step:
        predicate = self.any_fact()
        if self.chance(MISTAKES):
            predicate = self.rng.randint(-1, len(self.program.predicates))
            return Step("insert", (self.now, predicate, ()))
        return self.inserted(predicate, self.values(predicate))

    def crowd(self) -> list[Step]:
        """Return so many facts of a predicate that looking at each is no longer the way to find one."""
        predicate = self.any_fact()
        types = self.program.predicates[predicate].types
        return [self.inserted(predicate, tuple(map(self.value, types))) for _ in range(self.rng.choice([14, 30, 75]))]

    def feed(self) -> list[Step]:
        """Return facts that match the atoms of a rule's body together, whatever its conditions say."""
        rule = self.rng.choice(self.program.rules)
        values: dict[int, Value] = {SELF_SLOT: Robot(HOME)}
        fed = []
        for atom in rule.body:
            if not isinstance(atom, Atom) or (atom.mode is Mode.ABSENT and self.chance(0.8)):
                continue
            args = tuple(
                self.fitting(pattern, kind, values)
                for pattern, kind in zip(atom.args, self.program.predicates[atom.predicate].types, strict=True)
            )
            fed.append(self.inserted(atom.predicate, args))
        return fed

    def fitting(self, pattern: Pattern, kind: Type, values: dict[int, Value]) -> Value:
        """Return a value that matches a pattern; the same variable gets the same."""
        if isinstance(pattern, Constant):
            return pattern.value
        value = self.value(kind)
        return values.setdefault(pattern.index, value) if isinstance(pattern, Slot) else value

    def inserted(self, predicate: int, args: tuple[Value, ...]) -> Step:
        if predicate in self.sensed:
            self.sensing.append((predicate, args))
        return Step("insert", (self.now, predicate, args))

    def withdraw(self) -> Step:
        if self.sensing and self.chance(0.8):
            return Step("withdraw", (self.now, *self.rng.choice(self.sensing[-2:])))
        predicate = self.rng.choice(self.facts if self.chance(MISTAKES) else self.sensed)
        return Step("withdraw", (self.now, predicate, self.values(predicate)))

    def want(self) -> Step:
        """Return a goal, mostly one to which a rule leads."""
        predicate = self.rng.choice(self.derived) if self.derived and self.chance(0.6) else self.any_fact()
        args = tuple(ANY if self.chance(0.5) else value for value in self.values(predicate))
        return Step("want", (self.now, predicate, args))

    def derive_action(self) -> Step:
        predicate = self.rng.choice(self.actions)
        origin = self.rng.choice([None, None, (2, 5)])
        return Step("derive_action", (self.now, predicate, self.values(predicate), origin))

    def complete(self) -> Step:
        self.ended += 1
        serial = self.ended if self.chance(0.8) else self.rng.randint(0, 6)
        executor = self.rng.choice([None, None, None, HOME, 2])
        return Step("complete", (self.now, serial, self.chance(0.7), executor))

    def ask(self) -> Step:
        if self.chance(0.5):
            predicate = self.rng.choice(self.actions)
            return Step("serves", (predicate, tuple(map(self.value, self.program.predicates[predicate].types))))
        predicate = self.rng.choice(self.facts)
        args = tuple(
            ANY if self.chance(0.5) else Constant(self.value(t)) for t in self.program.predicates[predicate].types
        )
        return Step("holds", (predicate, args))

    def asked_late(self) -> list[Step]:
        """Return a finish fact that comes, and goes if it can, before another robot asks for it."""
        index = self.rng.choice(self.watched)
        finish = self.program.assertions[index].finish.predicate
        come = self.inserted(finish, tuple(map(self.value, self.program.predicates[finish].types)))
        gone = [come._replace(call="withdraw")] if finish in self.sensed else []
        return [come, *gone, self.await_finish()]

    def await_finish(self) -> Step:
        index = self.rng.choice(self.watched or range(len(self.program.assertions)))
        start = self.values(self.program.assertions[index].start.predicate)
        since = 0 if self.chance(0.5) else max(0, self.now - self.rng.choice(PASSING))
        return Step("await_finish", (self.now, self.rng.choice(OTHERS), index, start, since))

    def finish_seen(self) -> Step:
        index = self.rng.randrange(len(self.program.assertions))
        finish = self.values(self.program.assertions[index].finish.predicate)
        at = max(0, self.now - self.rng.choice(PASSING))
        if self.chance(MISTAKES):
            index = 99
        return Step("finish_seen", (self.now, self.rng.choice(OTHERS), index, finish, at))


def named(program: Program) -> list[Value]:
    """Return the values that a program's facts, goals and bodies name."""
    found = [arg for fact in program.facts for arg in fact.args if isinstance(arg, bool | int | float | str | tuple)]
    patterns = [arg for goal in program.goals for arg in goal.args]
    for rule in program.rules:
        patterns += [arg for each in rule.body for arg in getattr(each, "args", ())]
    return found + [arg.value for arg in patterns if isinstance(arg, Constant)]


# ---- as JSON


def to_json(thing: object) -> object:
    """Return an argument as JSON can say it; what JSON has no word for is an object with one key."""
    match thing:
        case Anything():
            return {"any": None}
        case Constant(value=value):
            return {"constant": to_json(value)}
        case Robot():
            return {"robot": int(thing)}
        case Symbol():
            return {"symbol": str(thing)}
        case tuple():
            return [to_json(item) for item in thing]
        case float() | bool() | int() | str() | None:
            return thing
    raise TypeError(f"{thing!r} has no place in a script")


def from_json(thing: object) -> object:
    """Return what `to_json` has written."""
    if isinstance(thing, list):
        return tuple(map(from_json, thing))
    if not isinstance(thing, dict):
        return thing
    [(kind, inside)] = thing.items()
    made = {"any": lambda _: ANY, "constant": lambda each: Constant(from_json(each)), "robot": Robot, "symbol": Symbol}
    return made[kind](inside)

"""Counts what was alive while cases were played, so that a fuzzer that has gone blind is noticed.

A construct of a rule counts when the rule fires; what happens beside the rules counts when an event tells it. A few
things leave no event: that a match fired again, that ranks decided; they are noted where the interpreter does them.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache

import pytest

from rmr.base.streams import Choices
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.heads import bodies, codes, folds, inner, items
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF_SLOT,
    Aggregate,
    Anything,
    Atom,
    Bind,
    Comprehension,
    Conjunct,
    Constant,
    Guard,
    HeadValue,
    Mode,
    Predicate,
    Program,
    Rule,
    Slot,
    Steps,
    Strategy,
    When,
)
from rmr.vm import interpreter, match, once
from rmr.vm.derive import PlannedRule
from rmr.vm.rotor import Rotor
from rmr.vm.store import Fact, is_open

LOOKS_MAX = 6_000
"""Facts that the reference may look at in one case."""

DERIVATION = 4
"""Looks as which it counts to work out what one match derives."""

FIRED = re.compile(r"RuleFired\(rule=(\d+),")
BOUND = re.compile(r"BoundReached\(what='(\w+)'")
UNDRAW = pow(Choices.GAMMA, -1, 1 << 64)


class TooLong(BaseException):
    """The reference looks at more facts than it may."""


class Alive:
    """What was alive in one case."""

    def __init__(self, program: Program, state: int) -> None:
        """`state` is that of the stream from which the machine draws."""
        self.program = program
        self._state = state
        self.tally: Counter[str] = Counter()
        self.looks = 0
        self._fired: dict[int, set[tuple[int, ...]]] = {}

    def look(self, call: str, result: str, events: Sequence[str], state: int) -> None:
        """Count what a step brought about; `state` is that of the stream after it."""
        self.tally["draw"] += (state - self._state) * UNDRAW % (1 << 64)
        self._state = state
        self.tally[f"call {call}"] += 1
        if result.startswith("ValueError"):
            self.tally["call refused"] += 1
        kinds = [event.split("(", 1)[0] for event in events]
        self.tally.update(f"event {kind}" for kind in kinds)
        self.tally.update(f"bound of {what}" for what in BOUND.findall("\n".join(events)))
        if call == "complete" and result == "True" and {"FactInserted", "FactSent"} & {*kinds}:
            self.tally["effect"] += 1
        if call == "complete" and result == "True" and {"ActionDerived", "GoalSent"} & {*kinds}:
            self.tally["step followed"] += 1
        for number in FIRED.findall("\n".join(events)):
            self.tally.update(constructs(self.program, int(number)))

    def looked(self, count: int) -> None:
        """Count facts that the reference looks at. Raises TooLong."""
        self.looks += count
        if self.looks > LOOKS_MAX:
            raise TooLong

    def again(self, matches: object, facts: Sequence[Fact]) -> None:
        """Note that a match of a rule that consumes nothing fires."""
        fired = self._fired.setdefault(id(matches), set())
        key = once.key_of(facts)
        self.tally["match fired again"] += key in fired
        fired.add(key)


@contextmanager
def observed(program: Program, state: int) -> Iterator[Alive]:
    """Note what the interpreter does, and let it look at so many facts only."""
    alive = Alive(program, state)
    candidates, derive = match.candidates, PlannedRule.derive
    fire, best = once.Changing.fire, interpreter.Interpreter._best
    last, refresh = Rotor.last, interpreter.Interpreter._refresh
    turns: list[int] = []

    def counted(step, store, env):
        found = candidates(step, store, env)
        alive.looked(1 + len(found))
        return found

    def derived(self, *args):
        alive.looked(DERIVATION)
        return derive(self, *args)

    def noted(self, facts):
        alive.again(self, facts)
        fire(self, facts)

    def compared(self):
        found = best(self)
        every = [state.candidate for state in self._states if state.candidate is not None]
        satisfied = every if found else []
        alive.tally["rank decided"] += any(each.rank > found[0].candidate.rank for each in satisfied)
        alike = [each for each in satisfied if each.rank == found[0].candidate.rank]
        alive.tally["urgency decided"] += len(alike) > len(found)
        alive.tally["first of several"] += len(found) > 1 and self._textual
        return found

    def turned(self, *args):
        turns.append(last(self, *args))
        return turns[-1]

    def refreshed(self, state, now):
        turns.clear()
        refresh(self, state, now)
        alive.tally["rotor decided"] += bool(turns and state.candidate and state.candidate.last < turns[0])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Rotor, "last", turned)
        patch.setattr(interpreter.Interpreter, "_refresh", refreshed)
        patch.setattr(match, "candidates", counted)
        patch.setattr(PlannedRule, "derive", derived)
        patch.setattr(once.Changing, "fire", noted)
        patch.setattr(interpreter.Interpreter, "_best", compared)
        yield alive


# ---- the constructs of a rule


def constructs(program: Program, rule: int) -> tuple[str, ...]:
    """Return the constructs that one of a program's rules is made of."""
    return _constructs(program.rules[rule], program.predicates, program.strategy)


@lru_cache(maxsize=64)
def _constructs(rule: Rule, predicates: tuple[Predicate, ...], strategy: Strategy) -> tuple[str, ...]:
    atoms = [each for each in rule.body if isinstance(each, Atom)]
    positive = [atom for atom in atoms if atom.mode is not Mode.ABSENT]
    count = len(positive)
    found = [f"strategy {strategy.name.lower()}", "body of many atoms" if count > 4 else f"body of {count} atoms"]
    found += ["body of only not"] * bool(atoms and not positive)
    found += _in_body(rule.body, predicates, {SELF_SLOT}, "")
    taken = any(atom.mode is Mode.CONSUME for atom in atoms)
    found.append("rule that consumes" if taken else "rule that fires once" + " with not" * (len(atoms) > len(positive)))
    for head in rule.head:
        found.append(_head_name(head))
    for part in inner(rule.head):
        found += _in_body(part.body, predicates, {SELF_SLOT}, "inner ")
    for fold in folds(rule.body):
        found.append(f"fold {fold.operator.name.lower()}")
        found += _in_body(fold.body, predicates, {SELF_SLOT}, "folded ")
    found += [f"head {type(item).__name__}" for item in items(rule.head)] or ["head of nothing"]
    every = [
        *codes(rule.head),
        *(each.code for body in bodies(rule) for each in body if isinstance(each, Guard | Bind)),
    ]
    for code in every:
        found += [f"code {each.op.name}" for each in code] + ["code of many operations"] * (len(code) > 80)
        found += [f"function {FUNCTIONS[each.operand].name}" for each in code if each.op is Op.CALL]
    return tuple(dict.fromkeys(found))


def _in_body(body: Sequence[Conjunct], predicates: Sequence[Predicate], bound: set[int], where: str) -> Iterator[str]:
    seen: list[int] = []
    for each in body:
        if not isinstance(each, Atom):
            yield where + type(each).__name__.lower()
            continue
        declared = predicates[each.predicate]
        slots = [arg.index for arg in each.args if isinstance(arg, Slot)]
        yield f"{where}{declared.kind.name.lower()} {each.mode.name.lower()}"
        if declared.best is not None:
            yield "best is kept" + " with others" * (declared.best.argument + 1 < len(declared.types))
        yield from [f"{where}heard of a neighbour"] * declared.name.startswith("heard__")
        yield from [f"{where}same predicate"] * (each.predicate in seen)
        yield from [f"{where}join"] * any(slot in bound for slot in slots)
        yield from [f"{where}variable twice in an atom"] * (
            len({*slots} - bound) < len([s for s in slots if s not in bound])
        )
        yield from [f"{where}constant"] * any(isinstance(arg, Constant) for arg in each.args)
        yield from [f"{where}anonymous"] * any(isinstance(arg, Anything) for arg in each.args)
        yield from [f"{where}open type"] * any(map(is_open, declared.types))
        yield from [f"argument {kind.base.name.lower()}" for kind in declared.types]
        seen.append(each.predicate)
        if each.mode is not Mode.ABSENT:
            bound = bound | {*slots}


def _head_name(head: object) -> str:
    if isinstance(head, Aggregate):
        return f"aggregate {head.operator.name.lower()}"
    names = {Comprehension: "comprehension", Steps: "steps", HeadValue: "value of a head", When: "conditional head"}
    return names.get(type(head), "plain head")

"""The program read backwards: what a fact of the home robot may come from.

A derivation is one way in which a rule brings about one fact: by a head that says it, or by an action of the
head whose declared effect it is (the effect's arguments are then those of the action). Its premises are the
facts that the rule's body matches, a comprehension's too. Constants and variables are kept, with what
conditions of the form ``X = constant`` and ``X = Y`` say about them; every other expression may have any
value, and every other condition is taken for granted. What a head says of another robot is no derivation.

Reading a derivation backwards means to unify what is wanted with what it derives: the premises, so far as the
unifier says what they are, are what is wanted next.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from rmr.base.values import Robot, Value
from rmr.bytecode.opcodes import FUNCTIONS, Op
from rmr.bytecode.program import (
    ANY,
    SELF_SLOT,
    Anything,
    Atom,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    DeriveFact,
    Effect,
    Guard,
    Head,
    Mode,
    Pattern,
    Program,
    Slot,
)
from rmr.vm.evaluate import NoValue, evaluate, same

Patterns = tuple[Pattern, ...]
Wanted = tuple[int, Patterns]
"""A predicate and what its arguments must be."""
Unifier = dict[int, Pattern]
"""What stands for a slot: a constant or another slot."""


class Derivation(NamedTuple):
    """One way to derive a fact of the home robot."""

    derives: Patterns
    premises: tuple[Wanted, ...]


class Backwards:
    """All derivations of one robot's program."""

    def __init__(self, program: Program, robot: Robot) -> None:
        self._program = program
        self._robot = robot
        self._derivations: dict[int, dict[object, list[Derivation]]] = {}
        self._premises: dict[int, dict[int, None]] = {}
        self._distances: dict[int, dict[int, int]] = {}
        for rule in program.rules:
            self._read(rule.head, rule.body)

    def deriving(self, predicate: int, args: Patterns) -> Iterator[Derivation]:
        """Yield the derivations of a predicate whose first argument may be the one of `args`."""
        filed = self._derivations.get(predicate, {})
        if args and isinstance(args[0], Constant):
            yield from filed.get(value_key(args[0].value), ())
            yield from filed.get(None, ())
        else:
            for group in filed.values():
                yield from group

    def distances(self, predicate: int) -> dict[int, int]:
        """Return how many rules, at least, lie between facts of each predicate and one of `predicate`.

        Predicates from which no rules lead there are missing.
        """
        known = self._distances.get(predicate)
        if known is None:
            known = self._distances[predicate] = {predicate: 0}
            queue = [predicate]
            for each in queue:
                for earlier in self._premises.get(each, ()):
                    if earlier not in known:
                        known[earlier] = known[each] + 1
                        queue.append(earlier)
        return known

    def _read(self, heads: tuple[Head, ...], body: tuple[Conjunct, ...]) -> None:
        """File what `heads` derive when `body` matches."""
        known = equations(body, self._robot)
        if known is None:
            return
        for head in heads:
            if isinstance(head, Comprehension):
                self._read(head.head, (*body, *head.body))
            elif isinstance(head, DeriveFact) and self._is_home(head.owner, known):
                self._file(head.predicate, tuple([self._term(code) for code in head.args]), body, known)
            elif isinstance(head, DeriveAction) and self._is_home(head.owner, known):
                args = tuple([self._term(code) for code in head.args])
                for effect in self._program.predicates[head.predicate].effects:
                    self._file(effect.predicate, self._effect(effect, args), body, known)

    def _file(self, predicate: int, args: Patterns, body: tuple[Conjunct, ...], known: Unifier) -> None:
        """Keep a derivation, by the constant of its first argument (None: it has none)."""
        atoms = [each for each in body if isinstance(each, Atom) and each.mode is not Mode.ABSENT]
        premises = {(atom.predicate, tuple([resolved(arg, known) for arg in atom.args])): None for atom in atoms}
        derives = tuple([resolved(arg, known) for arg in args])
        first = value_key(derives[0].value) if derives and isinstance(derives[0], Constant) else None
        filed = self._derivations.setdefault(predicate, {})
        filed.setdefault(first, []).append(Derivation(derives, tuple(premises)))
        self._premises.setdefault(predicate, {}).update(dict.fromkeys(atom.predicate for atom in atoms))

    def _is_home(self, owner: Code, known: Unifier) -> bool:
        term = resolved(self._term(owner), known)
        return isinstance(term, Constant) and same(term.value, self._robot)

    def _effect(self, effect: Effect, args: Patterns) -> Patterns:
        """Return an effect's arguments, given those of the action."""
        terms = [self._term(code) for code in effect.args]
        return tuple([args[term.index - 1] if isinstance(term, Slot) else term for term in terms])

    def _term(self, code: Code) -> Pattern:
        return term_of(code, self._robot)


def equations(body: Iterable[Conjunct], robot: Robot) -> Unifier | None:
    """Return what the conditions of `body` say about its slots; None if they contradict each other."""
    known: Unifier = {SELF_SLOT: Constant(robot)}
    one: Pattern
    for conjunct in body:
        if isinstance(conjunct, Bind):
            one, other = Slot(conjunct.slot), term_of(conjunct.code, robot)
        elif isinstance(conjunct, Guard) and len(conjunct.code) == 3 and conjunct.code[2].op is Op.EQ:
            one, other = term_of(conjunct.code[:1], robot), term_of(conjunct.code[1:2], robot)
        else:
            continue
        if not unified(one, other, known):
            return None
    return known


def term_of(code: Code, robot: Robot) -> Pattern:
    """Return what an expression is to one who reads backwards: a constant, a slot, or anything."""
    slot = plain_slot(code)
    if slot is not None:
        return Constant(robot) if slot == SELF_SLOT else Slot(slot)
    if not is_constant(code):
        return ANY
    try:
        return Constant(evaluate(code, [robot], 0))
    except NoValue:
        return ANY


def plain_slot(code: Code) -> int | None:
    """Return the slot of which `code` is the value, be it as a float, or None."""
    if code[0].op is Op.LOAD and (len(code) == 1 or (len(code) == 2 and code[1].op is Op.FLOAT)):
        slot = code[0].operand
        assert isinstance(slot, int)
        return slot
    return None


def is_constant(code: Code) -> bool:
    """Tell whether `code` has the same value for one robot at all times."""
    for each in code:
        if each.op is Op.LOAD and each.operand != SELF_SLOT:
            return False
        if each.op is Op.CALL and isinstance(each.operand, int) and FUNCTIONS[each.operand].name == "now":
            return False
    return True


def resolved(term: Pattern, known: Unifier) -> Pattern:
    """Return what is known about `term`."""
    while isinstance(term, Slot) and term.index in known:
        term = known[term.index]
    return term


def unified(one: Pattern, other: Pattern, known: Unifier) -> bool:
    """Add to `known` that the two are equal; False if they cannot be."""
    one, other = resolved(one, known), resolved(other, known)
    if isinstance(one, Anything) or isinstance(other, Anything):
        return True
    if isinstance(one, Slot):
        if one != other:
            known[one.index] = other
        return True
    if isinstance(other, Slot):
        known[other.index] = one
        return True
    return same(one.value, other.value)


def premises(wanted: Patterns, derivation: Derivation) -> Iterator[Wanted]:
    """Yield what is wanted for `derivation` to derive what is `wanted`; nothing if it cannot."""
    known: Unifier = {}
    for one, other in zip(wanted, derivation.derives, strict=True):
        apart = Slot(-1 - one.index) if isinstance(one, Slot) else one
        if not unified(other, apart, known):
            return
    for predicate, args in derivation.premises:
        yield predicate, numbered([resolved(arg, known) for arg in args])


def numbered(terms: list[Pattern]) -> Patterns:
    """Return `terms` with slots numbered from 1 in the order of their mention; what stands once is anything."""
    slots = [term.index for term in terms if isinstance(term, Slot)]
    numbers = {slot: 1 + index for index, slot in enumerate(dict.fromkeys(slots))}
    return tuple(
        [
            term if not isinstance(term, Slot) else Slot(numbers[term.index]) if slots.count(term.index) > 1 else ANY
            for term in terms
        ]
    )


def value_key(value: Value) -> tuple[object, ...]:
    """Return a key that two values share exactly if they are the same: 1 and 1.0 do, 1 and @1 do not."""
    if type(value) is tuple:
        return ("list", *[value_key(item) for item in value])
    return ("number" if type(value) in {int, float} else type(value).__name__, value)

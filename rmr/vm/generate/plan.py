"""The plan of a rule, made before any fact is there: how its matches are found, and which expressions may fail.

There are three ways to find matches:

- SINGLE: a rule of one atom keeps a queue of the facts that it can take.
- JOIN: a rule of several atoms tries the facts of its first atom, the tops, one after another, joins each with the
  facts of the other atoms, and joins each new fact of the other atoms with the tops tried so far. A combination of
  facts is rarely examined twice: only if there are so many new facts that trying all tops again is cheaper.
- REMATCH: all matches are searched anew whenever something has changed, as the specification does it.

REMATCH is the way of a body with ``not``, without an atom, or with an expression before the first atom that may have
no value; of a body that asks for the time; and of a rule in which a variable's value depends on the conjunct that binds
it. Every other rule is rematched, too, once an expression of it has had no value: which failures are reported, and in
which order, is part of the result.
"""

from collections.abc import Iterable
from enum import Enum
from typing import Any

from rmr.bytecode.conform import fits
from rmr.bytecode.heads import bodies, codes, folds
from rmr.bytecode.heads import inner as inner_heads
from rmr.bytecode.program import Atom, Bind, Fold, Guard, Mode, Program, Rule, Slot, Type
from rmr.vm.derive import draws_in
from rmr.vm.generate.body import BoundSlots, Placed, places_of, positives, slots_of
from rmr.vm.generate.expression_source import condition, expression, narrowed
from rmr.vm.generate.fact_tables import FactTable
from rmr.vm.generate.form import ARGS, Column, Local, tuple_of
from rmr.vm.generate.known import NOTHING
from rmr.vm.generate.source import Pool
from rmr.vm.generate.state_layout import VM, RuleFunctions, RuleSlots
from rmr.vm.generate.trees import tree
from rmr.vm.interpreter import uses_now
from rmr.vm.match import plan_atom
from rmr.vm.store import Args, is_open

ATOMS_MAX = 8
"""Atoms of one body up to which source is generated: Python allows twenty nested blocks."""


class Way(Enum):
    """How the matches of a rule are found."""

    SINGLE = 1
    JOIN = 2
    REMATCH = 3


class RulePlan:
    """The static properties of one rule."""

    def __init__(self, program: Program, index: int, tables: list[FactTable]) -> None:
        rule = self.rule = program.rules[index]
        self.index = index
        self.bit = 1 << index
        self.slots = RuleSlots(index)
        """Names of the machine's attributes that hold its matches."""
        self.state = RuleSlots(index, VM)
        """The same attributes as expressions of generated code."""
        self.functions = RuleFunctions(index)
        """Names of its generated functions."""
        self.atoms = positives(rule.body)
        """The atoms that take a fact, with their places."""
        self.facts = {place: f"f{place}" for place in places_of(rule.body)}
        """By place, the variables that hold a match's facts, behind them those of its folds."""
        self._args = [slice(ARGS, ARGS + tables[atom.predicate].arity) for _, atom in self.atoms]
        self.consumed = [place for place, atom in self.atoms if atom.mode is Mode.CONSUME]
        self.once = not self.consumed
        """It consumes nothing and fires once for each match."""
        self.timed = any(map(uses_now, codes(rule.head)))
        self.drawn = any(map(draws_in, codes(rule.head)))
        self.failing = failing(rule, tables)
        """The places of the conjuncts that may have no value."""
        self.absent = [each.predicate for each in rule.body if isinstance(each, Atom) and each.mode is Mode.ABSENT]
        self.folded = any(folds(rule.body))
        inner = [part.body for part in (*inner_heads(rule.head), *folds(rule.body))]
        self.inner = sorted({each.predicate for body in inner for each in body if isinstance(each, Atom)})
        """The predicates that comprehensions, aggregates and folds read."""
        self.way = self._way(tables)
        lasting = all(tables[atom.predicate].lasting for _, atom in self.atoms)
        self.lasting = self.way is Way.JOIN and self.once and lasting and not self.failing
        """Its matches stay valid, and none fails."""
        self._read = {each.predicate for body in bodies(rule) for each in body if isinstance(each, Atom)}
        self.valued = False
        """Its head is evaluated when the match is found: it may have no value, or depends on other facts."""
        self.fires_all = False
        """It may fire for its matches as they are found (`rmr.vm.generate.loop.LoopWriter.may_fire_all`)."""

    @property
    def is_eager(self) -> bool:
        """Whether all matches are searched at once, so that failures are reported as specified."""
        return self.once and bool(self.failing)

    @property
    def may_break(self) -> bool:
        """Whether an expression may have no value, so that the rule is matched anew from then on."""
        return bool(self.failing) or self.valued

    @property
    def empty_slots(self) -> list[str]:
        """The names of the machine's attributes that hold no match before the first search: None."""
        slots = self.slots
        names = [slots.match, slots.queue] if self.way is Way.SINGLE else [slots.kept]
        if self.valued:
            names.append(slots.valued)
        if self.way is Way.JOIN:
            names += [slots.queue, *self.join_slots]
        return names

    @property
    def join_slots(self) -> list[str]:
        """The names of the attributes of a JOIN that hold what is to be searched further, beside the queue."""
        return [self.slots.current_top, *[self.slots.new(place) for place, _ in self.atoms[1:]]]

    @property
    def zero_slots(self) -> list[str]:
        """The names of the machine's attributes that hold serial numbers up to which a JOIN has searched."""
        return [self.slots.last_top, self.slots.joined_up_to] if self.way is Way.JOIN else []

    def args_of(self, entry: Iterable[list[Any]]) -> list[Args]:
        """Return the arguments of each fact of a match, without its folds."""
        return [tuple(fact[args]) for fact, args in zip(entry, self._args, strict=False)]

    def names(self) -> list[str]:
        """The fact variables in the order of the atoms."""
        return list(self.facts.values())

    def entry(self) -> str:
        """The representation of a match: the tuple of its facts. The oldest match is the least."""
        return tuple_of(self.names())

    def read(self) -> set[int]:
        """The predicates on which it depends whether the rule is satisfied and what it does."""
        return self._read

    def _way(self, tables: list[FactTable]) -> Way:
        timed = any(
            uses_now(each.code) for body in bodies(self.rule) for each in body if isinstance(each, Guard | Bind)
        )
        if self.absent or self.folded or not self.atoms or timed:
            return Way.REMATCH
        if len(self.atoms) == 1 and not self.failing:
            return Way.SINGLE
        if any(place < self.atoms[0][0] for place in self.failing):
            return Way.REMATCH  # it may fail before there is any fact
        return Way.JOIN if is_settled(self.rule, tables) else Way.REMATCH


def readers_of(plans: Iterable[RulePlan], predicates: int) -> list[list[RulePlan]]:
    """Return, for each of `predicates` predicates, the rules that name it in a body, in the order of the text."""
    readers: list[list[RulePlan]] = [[] for _ in range(predicates)]
    for plan in plans:
        for predicate in sorted(plan.read()):
            readers[predicate].append(plan)
    return readers


def is_settled(rule: Rule, tables: list[FactTable]) -> bool:
    """Return whether every variable has the same value whichever conjunct binds it: 1 meets 1.0 where types differ."""
    kinds: dict[int, Type] = {}
    bound = {each.slot for each in rule.body if isinstance(each, Bind)}
    for _, atom in positives(rule.body):
        for pattern, kind in zip(atom.args, tables[atom.predicate].predicate.types, strict=True):
            if isinstance(pattern, Slot):
                known = kinds.get(pattern.index)
                if pattern.index in bound or (known is not None and (is_open(kind) or not alike(kind, known))):
                    return False
                kinds[pattern.index] = kind
    return True


def alike(one: Type, other: Type) -> bool:
    """Return whether values of two types that are equal are the same; the names of symbol sets make no difference."""
    return fits(one, other) and fits(other, one)


def failing(rule: Rule, tables: list[FactTable]) -> list[int]:
    """Return the places of a body's conjuncts that may have no value."""
    slots = BoundSlots()
    pool = Pool()
    places = list[int]()
    predicates = tuple(table.predicate for table in tables)
    for place, each in enumerate(rule.body):
        if isinstance(each, Guard):
            if condition(each.code, slots.names, slots.known, pool).fails:
                places.append(place)
            slots.known.update(narrowed(each.code, slots.known))
        elif isinstance(each, Bind):
            source = expression(each.code, slots.names, slots.known, pool)
            slots.names[each.slot] = Local(f"b{each.slot}")
            slots.known[each.slot] = source.known
            if source.fails:
                places.append(place)
        elif isinstance(each, Fold):
            slots.names[each.result] = Column(f"f{place}", 0)
            slots.known[each.result] = NOTHING
        elif each.mode is not Mode.ABSENT:
            step = plan_atom(each, predicates, slots.names)
            slots.bind(step, tables[each.predicate], lambda position, place=place: Column(f"f{place}", position))  # type: ignore[misc]
    return places


def order_from(plan: RulePlan, seed: int) -> list[Placed]:
    """Return the other conjuncts of a rule in the order in which to join a new fact of the atom at place `seed`.

    Conditions come as early as possible, and the atoms with most arguments bound come first. No conjunct moves before
    one that precedes it in the text and may have no value, else a failure could be missed.
    """
    body = list(enumerate(plan.rule.body))
    bound = slots_of(body[seed][1]) | {0}
    left = [each for each in body if each[0] != seed]
    order: list[Placed] = []
    while left:
        barrier = next((place for place, _ in left if place in plan.failing), len(body))
        ready = [each for each in left if each[0] <= barrier and _is_ready(each, bound)]
        best = min(ready, key=lambda each: _cost(each, bound))
        left.remove(best)
        order.append(best)
        bound |= slots_of(best[1]) | ({best[1].slot} if isinstance(best[1], Bind) else set())
    return order


def _is_ready(placed: Placed, bound: set[int]) -> bool:
    return isinstance(placed[1], Atom) or slots_of(placed[1]) <= bound


def _cost(placed: Placed, bound: set[int]) -> tuple[int, int]:
    """Return what is to come first: conditions, then the atoms with the fewest arguments free."""
    place, conjunct = placed
    if not isinstance(conjunct, Atom):
        return -1, place
    free = slots_of(conjunct) - bound
    return len(free) + (0 if slots_of(conjunct) & bound else len(conjunct.args)), place


def is_small(program: Program) -> bool:
    """Return whether source can be generated for a program: neither bodies nor functions exceed Python's nesting."""
    return all(tree(function.code) is not None for function in program.functions) and all(
        sum(1 for each in body if isinstance(each, Atom)) <= ATOMS_MAX
        for rule in program.rules
        for body in bodies(rule)
    )

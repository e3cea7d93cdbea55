"""Predicates that hold at most one fact on a robot, for all choices of rules.

The method is a place invariant, as of a Petri net. Facts are resources: a rule takes what it consumes and gives what it
derives. A group of predicates holds at most one fact if no rule gives more facts of the group than it takes, and the
robot starts with at most one of them: that fact is a token that rules pass on. Two kinds of rules may give one more:

- a rule that fires once in a robot's life, since all that it matches is persistent: it counts as an initial fact;
- if there is no such rule, a rule that fires only while the group is empty.

A persistent predicate is a set. For it, it also suffices that all facts stated and derived are the same one.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from rmr.bytecode.heads import items
from rmr.bytecode.octets import identity
from rmr.bytecode.program import (
    SELF,
    Anything,
    Atom,
    DeriveFact,
    InitialFact,
    Kind,
    Mode,
    Program,
    Rule,
    Slot,
)
from rmr.bytecode.program import Derived as Item
from rmr.bytecode.scope import literal

STEPS_MAX = 200_000
"""Search budget: rules and facts examined for all groups of a program. Beyond it a predicate counts as unproven."""

OWNER = "self"
"""In a fact's key, the robot itself."""


@dataclass(frozen=True, slots=True)
class Several:
    """A predicate for which at most one fact per robot is not proven."""

    predicate: int
    derived: int
    """The predicate with too many facts; often the same."""
    rule: int | None
    """The rule that gives more than it takes, or one too many; None: several are stated."""


class _Account:
    """What one rule takes and gives."""

    def __init__(self, rule: Rule, kinds: Sequence[Kind]) -> None:
        """`kinds` are those of the predicates."""
        atoms = [each for each in rule.body if isinstance(each, Atom)]
        self.takes = Counter(each.predicate for each in atoms if each.mode is Mode.CONSUME)
        self.gives = Counter(each.predicate for each in items(rule.head) if isinstance(each, DeriveFact))
        self.without = 0
        """The predicates without any fact whenever the rule fires, as bits."""
        for each in atoms:
            if each.mode is Mode.ABSENT and _matches_all(each):
                self.without |= 1 << each.predicate
        self.once = all(each.mode is Mode.READ and kinds[each.predicate] is Kind.PERSISTENT for each in atoms)
        """It fires once in a robot's life."""

    def exceeds(self, group: int) -> bool:
        """Return whether the rule gives more facts of a group than it takes."""
        return _of(self.gives, group) > _of(self.takes, group)

    def fills(self, group: int) -> bool:
        """Return whether the rule gives one fact of a group, and fires only while the group is empty."""
        return _of(self.gives, group) == 1 and not group & ~self.without


def several(program: Program, stated: Sequence[InitialFact]) -> Iterator[Several]:
    """Yield the predicates for which at most one fact per robot is not proven.

    `stated` are all facts that robots are given; others must not come from outside.
    """
    search = _Search(program, stated)
    for predicate, declared in enumerate(program.predicates):
        if declared.provided or declared.kind not in (Kind.TEMPORARY, Kind.PERSISTENT):
            continue
        if declared.kind is Kind.PERSISTENT and search.is_one(predicate):
            continue
        found = search.danger(predicate)
        if found is not None:
            yield found


class _Search:
    """Looks for a group of each predicate."""

    def __init__(self, program: Program, stated: Sequence[InitialFact]) -> None:
        self._program = program
        kinds = [each.kind for each in program.predicates]
        self._rules = [_Account(rule, kinds) for rule in program.rules]
        self._givers: list[list[int]] = [[] for _ in kinds]
        """By predicate: the rules that derive it."""
        self._derived: list[list[object]] = [[] for _ in kinds]
        """By predicate: the keys of what is derived, None for one that depends on the match."""
        for index, rule in enumerate(program.rules):
            for predicate in self._rules[index].gives:
                self._givers[predicate].append(index)
            for item in items(rule.head):
                self._derived[item.predicate].append(_derived_key(item))
        self._stated: list[list[InitialFact]] = [[] for _ in kinds]
        for fact in stated:
            self._stated[fact.predicate].append(fact)
        self._left = STEPS_MAX
        self._safe = 0
        """The predicates of groups that have been found."""

    def danger(self, predicate: int) -> Several | None:
        """Return what stands in the way of the predicate's first group; None if some group holds one fact at most."""
        if self._safe >> predicate & 1:
            return None
        first: Several | None = None
        known = {1 << predicate}
        todo = [1 << predicate]
        while todo and not (first and self._left <= 0):
            group = todo.pop()
            danger, larger = self._look(predicate, group)
            if danger is None:
                self._safe |= group
                return None
            first = first or danger
            new = [each for each in larger if each not in known]
            known.update(new)
            todo += reversed(new)
        return first

    def _look(self, predicate: int, group: int) -> tuple[Several | None, list[int]]:
        """Return what lets a group hold more than one fact, if anything, and the groups that may do better."""
        members = list(_members(group))
        self._left -= 1 + sum(len(self._givers[each]) + len(self._stated[each]) for each in members)
        given = _most(fact for each in members for fact in self._stated[each])
        if given > 1:
            return Several(predicate, predicate, None), []
        rules = [(each, index, self._rules[index]) for each in members for index in self._givers[each]]
        lasting = any(rule.once for _, _, rule in rules)
        for derived, index, rule in rules:
            if rule.once:
                given += _of(rule.gives, group)
            if given > 1 or (not rule.once and rule.exceeds(group) and (lasting or not rule.fills(group))):
                more = [group | 1 << taken for taken in rule.takes if not group >> taken & 1]
                return Several(predicate, derived, index), more
        return None, []

    def is_one(self, predicate: int) -> bool:
        """Return whether all facts of a predicate, given to one robot and derived, are the same one."""
        given: dict[int | None, list[object]] = {None: []}
        for fact in self._stated[predicate]:
            given.setdefault(fact.owner, []).append(_stated_key(fact))
        common = {*self._derived[predicate], *given.pop(None)}
        return None not in common and all(len(common.union(own)) <= 1 for own in (*given.values(), ()))


def _of(counts: Counter[int], group: int) -> int:
    """Return how many of the counted are of a group."""
    return sum(count for predicate, count in counts.items() if group >> predicate & 1)


def _members(group: int) -> Iterator[int]:
    while group:
        yield (group & -group).bit_length() - 1
        group &= group - 1


def _matches_all(atom: Atom) -> bool:
    """Return whether an atom matches every fact of its predicate."""
    return all(isinstance(arg, Anything) for arg in atom.args)


def _most(facts: Iterable[InitialFact]) -> int:
    """Return how many of the facts one robot is given at most."""
    owners = [fact.owner for fact in facts]
    own = Counter(owner for owner in owners if owner is not None)
    return owners.count(None) + max(own.values(), default=0)


def _stated_key(fact: InitialFact) -> object:
    return tuple([OWNER if isinstance(arg, Slot) else identity(arg) for arg in fact.args])


def _derived_key(item: Item) -> object | None:
    """Return the key of a fact that is the same for every match; None if it is not."""
    key: list[object] = []
    for code in item.args:
        value = literal(code)
        if value is None and code != SELF:
            return None
        key.append(OWNER if value is None else identity(value))
    return tuple(key)

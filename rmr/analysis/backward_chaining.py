"""The program read backwards: what a fact of the home robot may come from.

A derivation is one way in which a rule brings about one fact: by a head that says it, or by an action of the
head whose declared effect it is (the effect's arguments are then those of the action). Its premises are the
facts that the rule's body matches, a comprehension's or an aggregate's too. Constants and variables are kept,
with what conditions of the form ``X = constant`` and ``X = Y`` say about them; every other expression may have
any value, and every other condition is taken for granted. A fact that goes to another robot is no derivation
at home.

Reading a derivation backwards means to unify what is wanted with what it derives: the premises, so far as the
unifier says what they are, are what is wanted next.

The reading is the same for all robots. A slot with a positive index is a variable and may be anything; 0 is
the home robot, and a negative one a value that the caller knows and the program does not (a job's bindings).
Such a given value may or may not equal a constant or another one: a reading that is `sure` takes them for
different, any other takes it that they may be the same.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple, TypeVar

from rmr.base.values import Robot, Value
from rmr.bytecode.heads import items
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    SELF_SLOT,
    Aggregate,
    Anything,
    Atom,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    DeriveFact,
    Guard,
    Head,
    Mode,
    Operator,
    Pattern,
    Program,
    Rule,
    Slot,
    When,
)

APART = 1 << 16
"""Offset of a goal's slots, which renames them apart from a rule's; no rule has that many slots."""

WINNING = frozenset({Operator.MIN, Operator.MAX})
"""Aggregates that derive nothing without a match; the others do of none as well."""

HOME = Slot(SELF_SLOT)
"""The robot that runs the rules."""

T = TypeVar("T")

Patterns = tuple[Pattern, ...]
Wanted = tuple[int, Patterns]
"""A predicate and what its arguments must be."""
Unifier = dict[int, Pattern]
"""What stands for a slot: a constant, another slot, or anything."""


class Brought(NamedTuple):
    """A fact that a firing of a rule brings about."""

    predicate: int
    owner: Pattern
    args: Patterns
    action: int | None
    """The action of the head whose effect it is; None: the head says it."""
    always: bool
    """Every firing brings it, and not only one for which an inner body matches or an effect has a value."""
    body: tuple[Conjunct, ...]
    """What must match, an inner body included."""
    known: Unifier


class Derivation(NamedTuple):
    """One way to derive a fact."""

    rule: int | None
    """Index of the rule; None: any rule that derives the action."""
    action: int | None
    home: Pattern
    """The robot on which it is one: any (``HOME``), or the one that the rule names."""
    derives: Patterns
    premises: tuple[Wanted, ...]


class Backwards:
    """All derivations of a program's rules on the robot that runs them."""

    def __init__(self, program: Program, only: Callable[[Brought], bool] | None = None) -> None:
        """Leave out the derivations of facts that are not what `only` asks for."""
        self.brought: list[tuple[int, ...]] = []
        """For each rule the predicates of the facts that it may bring about, to whomever."""
        self._derivations: dict[int, dict[object, list[Derivation]]] = {}
        self._premises: dict[int, dict[int, None]] = {}
        self._distances: dict[int, dict[int, int]] = {}
        for index, rule in enumerate(program.rules):
            facts = tuple(brings(rule, program))
            self.brought.append(tuple(dict.fromkeys(fact.predicate for fact in facts)))
            for fact in facts:
                if only is None or only(fact):
                    self._read(index, fact)

    def deriving(self, predicate: int, args: Patterns) -> Iterator[Derivation]:
        """Yield the derivations of a predicate whose first argument may be the one of `args`."""
        for group in groups_at_first(self._derivations.get(predicate, {}), args):
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

    def _read(self, index: int, brought: Brought) -> None:
        """File a derivation, if it is one of a fact of the home robot."""
        known = at_home(brought)
        if known is None:
            return
        derivation = derived_by(index, brought, known, brought.args)
        filed = self._derivations.setdefault(brought.predicate, {})
        filed.setdefault(first_key(derivation.derives), []).append(derivation)
        premises = [predicate for predicate, _ in derivation.premises]
        self._premises.setdefault(brought.predicate, {}).update(dict.fromkeys(premises))


def derived_by(index: int, brought: Brought, known: Unifier, args: Patterns) -> Derivation:
    """Return how rule `index` derives `args`, given what is known of its slots."""
    atoms = [each for each in brought.body if isinstance(each, Atom) and each.mode is not Mode.ABSENT]
    wanted = [(atom.predicate, tuple([resolved(arg, known) for arg in atom.args])) for atom in atoms]
    derives = tuple([resolved(arg, known) for arg in args])
    return Derivation(index, brought.action, resolved(HOME, known), derives, tuple(dict.fromkeys(wanted)))


# ---- what a rule brings about


def brings(rule: Rule, program: Program) -> Iterator[Brought]:
    """Yield the facts that a firing may bring about, the declared effects of its actions among them."""
    for _, found in brings_of_heads(rule, program):
        yield from found


def brings_of_heads(rule: Rule, program: Program) -> Iterator[tuple[Head, Iterator[Brought]]]:
    """Yield the same by the parts of the head."""
    known = equations(rule.body, {})
    if known is not None:
        for head in rule.head:
            yield head, _of_head(head, rule.body, known, program)


def _of_head(head: Head, body: tuple[Conjunct, ...], known: Unifier, program: Program) -> Iterator[Brought]:
    """Yield what one head brings."""
    if isinstance(head, When):
        for each in _of_head(head.item, body, known, program):
            yield each._replace(always=False)
        return
    inner = head.body if isinstance(head, Comprehension | Aggregate) else ()
    matchless = isinstance(head, Aggregate) and head.operator not in WINNING
    within = equations(() if matchless else inner, known)
    if within is None:
        return
    if isinstance(head, Aggregate):
        within[head.result] = ANY
    for item in items((head,)):
        if isinstance(item, DeriveFact | DeriveAction):
            for each in _of_item(item, program):
                yield each._replace(always=each.always and not inner, body=(*body, *inner), known=within)


def _of_item(item: DeriveFact | DeriveAction, program: Program) -> Iterator[Brought]:
    """Yield the fact that an item is, or the effects of the action that it is."""
    owner = term_of(item.owner)
    args = tuple([term_of(code) for code in item.args])
    if isinstance(item, DeriveFact):
        yield Brought(item.predicate, owner, args, None, True, (), {})
        return
    slots = (owner, *args)
    for effect in program.predicates[item.predicate].effects:
        codes = (effect.owner, *effect.args)
        has_value = all(len(code) == 1 for code in codes)
        whose, *terms = [slots[term.index] if isinstance(term, Slot) else term for term in map(term_of, codes)]
        yield Brought(effect.predicate, whose, tuple(terms), item.predicate, has_value, (), {})


def at_home(brought: Brought) -> Unifier | None:
    """Return what is known of the slots if the fact is the home robot's, None if it is another's."""
    owner = resolved(brought.owner, brought.known)
    known = dict(brought.known)
    named = isinstance(owner, Constant) and unified(HOME, owner, known)
    return known if named or owner == HOME else None


def equations(body: Iterable[Conjunct], known: Unifier) -> Unifier | None:
    """Return `known` with what the conditions of `body` say about its slots; None if they contradict each other."""
    known = dict(known)
    one: Pattern
    for conjunct in body:
        if isinstance(conjunct, Bind):
            one = Slot(conjunct.slot)
            other = term_of(conjunct.code)
        elif isinstance(conjunct, Guard) and len(conjunct.code) == 3 and conjunct.code[2].op is Op.EQ:
            one = term_of(conjunct.code[:1])
            other = term_of(conjunct.code[1:2])
        else:
            continue
        if not unified(one, other, known):
            return None
    return known


def term_of(code: Code) -> Pattern:
    """Return what an expression is to one who reads backwards: a constant, a slot (be it as a float), or anything."""
    first = code[0]
    if first.op is Op.LOAD and (len(code) == 1 or (len(code) == 2 and code[1].op is Op.FLOAT)):
        assert isinstance(first.operand, int)
        return Slot(first.operand)
    if first.op in {Op.CONST, Op.INT} and len(code) == 1 and first.operand is not None:
        return Constant(first.operand)
    return ANY


# ---- unification


def resolved(term: Pattern, known: Unifier) -> Pattern:
    """Return what is known about `term`."""
    while isinstance(term, Slot) and term.index in known:
        term = known[term.index]
    return term


def unified(one: Pattern, other: Pattern, known: Unifier, sure: bool = False) -> bool:
    """Add to `known` that the two are equal; False if they cannot be, or if `sure` and they need not be."""
    one = resolved(one, known)
    other = resolved(other, known)
    if isinstance(one, Anything) or isinstance(other, Anything):
        return True
    if isinstance(one, Constant) and isinstance(other, Constant):
        return value_key(one.value) == value_key(other.value)
    if isinstance(one, Constant) or (isinstance(other, Slot) and isinstance(one, Slot) and one.index < other.index):
        one, other = other, one
    assert isinstance(one, Slot)
    if one == other:
        return True
    if sure and one.index <= 0:
        return False
    known[one.index] = other
    return True


def premises(
    wanted: Patterns, derivation: Derivation, robot: Robot | None = None, sure: bool = False
) -> Iterator[Wanted]:
    """Yield what is wanted for `derivation` to derive what is `wanted` on `robot` (None: any); nothing if it cannot."""
    known = unifier(wanted, derivation, robot, sure)
    if known is not None:
        for predicate, args in derivation.premises:
            yield predicate, numbered([resolved(arg, known) for arg in args])


def unifier(wanted: Patterns, derivation: Derivation, robot: Robot | None = None, sure: bool = False) -> Unifier | None:
    """Return what the rule's slots are if `derivation` derives what is `wanted`; None if it cannot."""
    known: Unifier = {} if robot is None else {SELF_SLOT: Constant(robot)}
    if not unified(HOME, derivation.home, known, sure):
        return None
    for one, other in zip(wanted, derivation.derives, strict=True):
        apart = Slot(one.index + APART) if isinstance(one, Slot) and one.index > 0 else one
        if not unified(apart, other, known, sure):
            return None
    return known


def numbered(terms: Iterable[Pattern]) -> Patterns:
    """Return `terms` with variables numbered from 1 in the order of their mention; what stands once is anything."""
    terms = tuple(terms)
    slots = [term.index for term in terms if isinstance(term, Slot) and term.index > 0]
    numbers = {slot: 1 + index for index, slot in enumerate(dict.fromkeys(slots))}
    return tuple(
        [
            term
            if not isinstance(term, Slot) or term.index <= 0
            else Slot(numbers[term.index])
            if slots.count(term.index) > 1
            else ANY
            for term in terms
        ]
    )


# ---- keys


def groups_at_first(filed: dict[object, list[T]], args: Patterns) -> Iterable[list[T]]:
    """Return what is filed by the keys of first arguments, as far as these may be the one of `args`."""
    first = first_key(args)
    if first is None:
        return filed.values()
    return [filed[key] for key in (first, None) if key in filed]


def first_key(args: Patterns) -> object:
    """Return the key of the first argument; None if it is no constant."""
    return value_key(args[0].value) if args and isinstance(args[0], Constant) else None


def value_key(value: Value) -> tuple[object, ...]:
    """Return a key that two values share exactly if they are the same: 1 and 1.0 do, 1 and @1 do not."""
    if type(value) is tuple:
        return ("list", *[value_key(item) for item in value])
    return ("number" if type(value) in {int, float} else type(value).__name__, value)

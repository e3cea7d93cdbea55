"""Rules read backwards over facts: what one firing needs so that it derives a wanted fact.

`rmr.analysis.backward_chaining` takes everything but one premise of a rule for granted. A regression keeps the rest of
the body, so that the virtual machine can test it against the facts that hold now. One premise is the chain atom: the
fact that an earlier firing brings. The other atoms are side atoms, and hold now; a ``not`` holds now; a condition is
evaluated as soon as all its variables have values. What an expression derives may have any value, as in
`backward_chaining`.

A regression is the same for all robots except those whose home is another robot than the rule names.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from rmr.analysis.backward_chaining import (
    APART,
    HOME,
    WINNING,
    Brought,
    Patterns,
    Unifier,
    at_home,
    brings_of_heads,
    resolved,
    term_of,
    unified,
    value_key,
)
from rmr.base.identity import ByIdentity
from rmr.base.values import Value
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    SELF_SLOT,
    Aggregate,
    Anything,
    Atom,
    Base,
    Bind,
    Code,
    Conjunct,
    Constant,
    Fold,
    Guard,
    Head,
    Mode,
    Program,
    Rule,
    Slot,
    Type,
    When,
)

Row = tuple[object, ...]
"""The arguments of a fact in the form in which they are compared (`Comparison`)."""


class Comparison(NamedTuple):
    """The form of values in which equality of the language is equality in Python."""

    is_open: bool
    """Whether the program has arguments of open type: only there values of several types meet (1, @1, 1.0, true)."""

    def row(self, args: tuple[Value, ...]) -> Row:
        """Return the form of a fact's arguments."""
        return tuple([value_key(value) for value in args]) if self.is_open else args

    def one(self, value: Value) -> object:
        """Return the form of one value."""
        return value_key(value) if self.is_open else value

    def value(self, form: object) -> Value:
        """Return the value of a form; of equal numbers (1 and 1.0) one."""
        return _value_of(form) if self.is_open else form  # type: ignore[return-value]


class Terms(NamedTuple):
    """The arguments of an atom: what is tested and what is bound. Positions in neither match anything."""

    constants: tuple[tuple[int, object], ...]
    """(position, form of the constant)"""
    slots: tuple[tuple[int, int], ...]
    """(position, slot)"""
    arity: int


class SideAtom(NamedTuple):
    """A positive atom of a body."""

    predicate: int
    terms: Terms


class AbsentAtom(NamedTuple):
    """A ``not`` of a body."""

    predicate: int
    terms: Terms
    """The slots are those that the rest of the body binds."""
    twins: tuple[tuple[int, int], ...]
    """(position, earlier position) of a variable that only the ``not`` has, and has twice."""


class Check(NamedTuple):
    """A condition, or ``X = expression``."""

    code: Code
    target: int | None
    """The slot X; None: a condition."""
    loads: tuple[int, ...]
    """The slots that the code reads."""


class ChainOption(NamedTuple):
    """The choice of the premise that an earlier firing brings."""

    predicate: int
    terms: Terms
    sides: tuple[SideAtom, ...]
    """In the order in which they are joined, once the derived fact is known."""
    rests: tuple[tuple[int, ...], ...]
    """For each side atom the order of the others when that one is joined first: places in `sides`."""


class Regression(NamedTuple):
    """One way in which a firing of a rule derives a fact at home."""

    rule: int
    predicate: int
    home: Constant | None
    """The one robot that may fire it; None: every robot."""
    derives: Terms
    options: tuple[ChainOption, ...]
    absents: tuple[AbsentAtom, ...]
    checks: tuple[Check, ...]
    slots: int
    known: Unifier
    """What stands for a slot that the terms do not mention."""
    source: "BodyParts"


class BodyParts(NamedTuple):
    """The parts of a body before they are turned into terms."""

    rule: int
    predicate: int
    derives: Patterns
    atoms: tuple[Atom, ...]
    optional: tuple[Atom, ...]
    """Atoms that may bring the fact, but need not match: the body of a sum."""
    absents: tuple[Atom, ...]
    bound: frozenset[int]
    """Slots that positive atoms and ``X = expression`` bind."""
    conditions: tuple[Conjunct, ...]
    slots: int


class Regressions:
    """All regressions of a program, by the predicate that they derive."""

    def __init__(self, program: Program) -> None:
        types = [kind for predicate in program.predicates for kind in predicate.types]
        self.compare = Comparison(any(map(has_open_type, types)))
        sources = [each for index, rule in enumerate(program.rules) for each in _sources(index, rule, program)]
        self._derived = {source.predicate for source, _ in sources}
        self.deriving: dict[int, list[Regression]] = {}
        for source, known in sources:
            self.deriving.setdefault(source.predicate, []).append(self._made(source, known))

    def narrowed(self, regression: Regression, wanted: Patterns) -> Regression | None:
        """Return a regression with what it follows for its variables from a wanted pattern; None if it cannot fit."""
        known = dict(regression.known)
        for one, other in zip(wanted, regression.source.derives, strict=True):
            apart = Slot(one.index + APART) if isinstance(one, Slot) and one.index > 0 else one
            if not unified(apart, other, known):
                return None
        return self._made(regression.source, known)

    def _made(self, source: BodyParts, known: Unifier) -> Regression:
        home = resolved(HOME, known)
        derives = self._terms(source.derives, known)
        bound = {SELF_SLOT, *(slot for _, slot in derives.slots)}
        atoms = [SideAtom(atom.predicate, self._terms(atom.args, known)) for atom in source.atoms]
        chains = [(atoms[place], atoms[:place] + atoms[place + 1 :]) for place in range(len(atoms))]
        chains += [(SideAtom(atom.predicate, self._terms(atom.args, known)), atoms) for atom in source.optional]
        return Regression(
            source.rule,
            source.predicate,
            home if isinstance(home, Constant) else None,
            derives,
            tuple([_option(chain, sides, bound) for chain, sides in chains if chain.predicate in self._derived]),
            tuple([self._absent(atom, source.bound, known) for atom in source.absents]),
            tuple([_check(each) for each in source.conditions]),
            source.slots,
            known,
            source,
        )

    def _terms(self, args: Iterable[object], known: Unifier) -> Terms:
        found = [resolved(arg, known) for arg in args]  # type: ignore[arg-type]
        return Terms(
            tuple([(p, self.compare.one(arg.value)) for p, arg in enumerate(found) if isinstance(arg, Constant)]),
            tuple([(p, arg.index) for p, arg in enumerate(found) if isinstance(arg, Slot)]),
            len(found),
        )

    def _absent(self, atom: Atom, bound: frozenset[int], known: Unifier) -> AbsentAtom:
        args = [arg if isinstance(arg, Slot) and arg.index not in bound else resolved(arg, known) for arg in atom.args]
        own = [p for p, arg in enumerate(atom.args) if isinstance(arg, Slot) and arg.index not in bound]
        terms = self._terms([Anything() if p in own else arg for p, arg in enumerate(args)], {})
        first: dict[object, int] = {}
        twins = [(p, first[args[p]]) for p in own if first.setdefault(args[p], p) != p]
        return AbsentAtom(atom.predicate, terms, tuple(twins))


regressions_of: ByIdentity[Program, Regressions] = ByIdentity(Regressions)
"""Returns the regressions of a program, the same for all robots of a process."""


def is_unconditional(brought: Brought) -> bool:
    """Return whether one fact and what unification sees decide alone whether a firing derives the fact."""
    atoms = [each for each in brought.body if isinstance(each, Atom)]
    rest = [each for each in brought.body if not isinstance(each, Atom)]
    return len(atoms) == 1 and atoms[0].mode is not Mode.ABSENT and all(map(_is_equation, rest))


def has_open_type(kind: Type) -> bool:
    """Return whether the type, or that of a list's items, is undetermined."""
    if kind.base is Base.LIST:
        return kind.element is None or has_open_type(kind.element)
    return kind.base is Base.OPEN


def _sources(index: int, rule: Rule, program: Program) -> Iterator[tuple[BodyParts, Unifier]]:
    for head, found in brings_of_heads(rule, program):
        for brought in found:
            known = at_home(brought)
            if known is not None:
                yield _body_parts(index, rule, head, brought), known


def _body_parts(index: int, rule: Rule, head: Head, brought: Brought) -> BodyParts:
    while isinstance(head, When):
        head = head.item
    matchless = isinstance(head, Aggregate) and head.operator not in WINNING
    needed = tuple(_without_folds(rule.body if matchless else brought.body))
    positive = _positive(brought.body)
    held = _positive(needed)
    bound = {arg.index for atom in positive for arg in atom.args if isinstance(arg, Slot)}
    bound |= {each.slot for each in needed if isinstance(each, Bind)}
    return BodyParts(
        index,
        brought.predicate,
        brought.args,
        held,
        positive[len(held) :],
        tuple([each for each in needed if isinstance(each, Atom) and each.mode is Mode.ABSENT]),
        frozenset({SELF_SLOT, *bound}),
        tuple([each for each in needed if not isinstance(each, Atom) and not _is_equation(each)]),
        rule.slots,
    )


def _positive(body: Iterable[Conjunct]) -> tuple[Atom, ...]:
    """Return the atoms of a body that facts must match."""
    return tuple([each for each in body if isinstance(each, Atom) and each.mode is not Mode.ABSENT])


def _without_folds(body: Iterable[Conjunct]) -> Iterator[Conjunct]:
    """Yield what can be told before a firing: an aggregate in a body may change until then, so ranks pass over it."""
    later: set[int] = set()
    for each in body:
        if isinstance(each, Fold):
            later.add(each.result)
        elif isinstance(each, Atom) or later.isdisjoint(_loads(each)):
            yield each
        elif isinstance(each, Bind):
            later.add(each.slot)


def _loads(conjunct: Guard | Bind) -> list[int]:
    """Return the slots that a condition reads."""
    return [each.operand for each in conjunct.code if each.op is Op.LOAD and isinstance(each.operand, int)]


def _is_equation(conjunct: Conjunct) -> bool:
    """Return whether unification has taken a condition in (`backward_chaining.equations`)."""
    if isinstance(conjunct, Bind):
        return not isinstance(term_of(conjunct.code), Anything)
    if not isinstance(conjunct, Guard) or len(conjunct.code) != 3 or conjunct.code[2].op is not Op.EQ:
        return False
    return not any(isinstance(term_of(conjunct.code[place : place + 1]), Anything) for place in (0, 1))


def _check(conjunct: Conjunct) -> Check:
    assert not isinstance(conjunct, Atom | Fold)
    loads = _loads(conjunct)
    target = conjunct.slot if isinstance(conjunct, Bind) else None
    return Check(conjunct.code, target, tuple(dict.fromkeys(loads)))


def _option(chain: SideAtom, sides: Sequence[SideAtom], bound: set[int]) -> ChainOption:
    order = _order(sides, range(len(sides)), bound)
    sides = [sides[place] for place in order]
    rests = []
    for first in range(len(sides)):
        within = bound | {slot for _, slot in sides[first].terms.slots}
        rests.append(tuple(_order(sides, [place for place in range(len(sides)) if place != first], within)))
    return ChainOption(chain.predicate, chain.terms, tuple(sides), tuple(rests))


def _order(sides: Sequence[SideAtom], places: Iterable[int], bound: set[int]) -> list[int]:
    """Return `places` in the order of a greedy join: the atom with the most values known goes next."""
    left = list(places)
    bound = set(bound)
    order = []
    while left:
        best = max(left, key=lambda place: _known_positions(sides[place].terms, bound))
        left.remove(best)
        order.append(best)
        bound |= {slot for _, slot in sides[best].terms.slots}
    return order


def _known_positions(terms: Terms, bound: set[int]) -> int:
    return len(terms.constants) + sum(slot in bound for _, slot in terms.slots)


def _value_of(form: object) -> Value:
    assert isinstance(form, tuple)
    if form[0] == "list":
        return tuple([_value_of(item) for item in form[1:]])
    value: Value = form[1]
    return value

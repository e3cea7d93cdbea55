"""Reachability of facts: the sources of each predicate, and the rules that can never fire for want of one.

Facts may arrive from outside (a lab, a sensor, an action in Python). A declared predicate may therefore have facts
that the program never derives, unless it is known what arrives; an undeclared one has only those that it derives. The
analysis over-approximates: a rule can fire if its facts may exist, and of its conditions only equations of a variable
with a constant count.
"""

from collections.abc import Iterable, Iterator

from rmr.base.record import record
from rmr.base.values import Value
from rmr.bytecode import provided
from rmr.bytecode.program import Kind
from rmr.lang.analyse.names import FactRole, Names, Signature, uses
from rmr.lang.analyse.types import WINNING, constants
from rmr.lang.read.syntax import (
    AggregateNode,
    ComprehensionNode,
    Conjunct,
    Expression,
    FactNode,
    Literal,
    Mark,
    ModuleNode,
    PlainHeadItem,
    RuleItem,
    StepsNode,
    Variable,
    flat,
)

Known = dict[str, Literal]
"""Variables that a rule equates with a constant, and the constant."""


@record
class Firing:
    """An edge of the dependency graph: the premises of a rule or inner body, and the predicates derived from them."""

    premises: list[FactNode]
    derived: tuple[str, ...]
    lacking: set[str]
    """Names of premises that no firing is known to be able to derive yet."""


def _default_effects(names: Names) -> Iterator[str]:
    """Yield the predicates of the default effects of provided actions that are declared without effects."""
    for action in provided.ACTIONS.values():
        signature = names.signatures.get(action.name)
        declared = signature.declaration if signature is not None else None
        if action.effect is not None and declared is not None and not declared.effects:
            yield action.effect


class Supply:
    """The sources and the readers of every predicate of one program."""

    def __init__(self, module: ModuleNode, names: Names) -> None:
        self._names = names
        self._derived: dict[str, list[tuple[FactNode, Known]]] = {}
        self._begun: set[str] = set()
        self._read: set[str] = set()
        self._compared = 0
        self._arriving = frozenset((*_default_effects(names), *names.given))
        self.firings: list[Firing] = []
        """The firings of all rules, in the order of the text."""
        for item in module.items:
            known = constants(item.body) if isinstance(item, RuleItem) else {}
            for use in uses(item):
                if use.role.derives and use.fact.mark is not Mark.GOAL:
                    self._derived.setdefault(use.fact.name.text, []).append((use.fact, known))
                if use.role in {FactRole.FACT, FactRole.EFFECT, FactRole.VIOLATION}:
                    self._begun.add(use.fact.name.text)
                if not use.role.derives or use.fact.mark is Mark.GOAL:
                    self._read.add(use.fact.name.text)
            if isinstance(item, RuleItem):
                self.firings += _firings(item)

    def comes(self, name: str) -> bool:
        """Whether facts of `name` have any source: the program, or something outside."""
        return self._is_outside(name) or name in self._derived

    def inserted(self, name: str) -> bool:
        """Whether facts of `name` are inserted into the run, or are the default effect of a provided action."""
        return name in self._arriving

    def is_derived(self, name: str) -> bool:
        """Whether the program itself states or derives `name`."""
        return name in self._derived

    def is_read(self, name: str) -> bool:
        """Whether a body, a goal or a time assertion reads `name`."""
        return name in self._read

    def may_match(self, wanted: FactNode, known: Known) -> bool:
        """Whether some source may produce a fact that matches `wanted`."""
        name = wanted.name.text
        signature = self._names.of(wanted)
        if signature.kind in {Kind.SENSED, Kind.ACTION} or signature.provided or self.inserted(name):
            return True
        producers = self._derived.get(name, [])
        # Declared and never derived: the purpose of the declaration is that something outside inserts it.
        if not producers and self._is_trusted(signature):
            return True
        self._compared += len(producers)
        # After about a second of comparisons every fact counts as matching.
        return self._compared > 300_000 or any(_may_match(wanted, known, *producer) for producer in producers)

    # ---- circular dependencies

    def circular(self) -> Iterator[tuple[FactNode, str]]:
        """Yield one premise, with its name, for each cycle of rules in which none can fire first.

        A premise without any source is reported elsewhere and counts as present here. Forward propagation from what
        is present, as in the linear-time test of Horn clauses; what it does not reach depends on a cycle.
        """
        waiting: dict[str, list[Firing]] = {}
        deriving: dict[str, list[Firing]] = {}
        ready: list[Firing] = []
        for firing in self.firings:
            firing.lacking.update(fact.name.text for fact in firing.premises if not self._begins(fact.name.text))
            for name in sorted(firing.lacking):
                waiting.setdefault(name, []).append(firing)
            for name in firing.derived:
                deriving.setdefault(name, []).append(firing)
            if not firing.lacking:
                ready.append(firing)
        _release(ready, waiting)
        for firing in self.firings:
            # A reported premise counts as present afterwards, so that its cycle is reported once.
            while firing.lacking:
                premise = _circle(firing, deriving)
                yield premise, premise.name.text
                _release(_supplied(premise.name.text, waiting), waiting)

    def unstarted(self) -> FactNode | None:
        """Return the first premise that only a fact from outside satisfies, if every rule has such a premise.

        Persistent and sensed facts of declared predicates are input data and count as present.
        """
        if self._is_driven:
            return None
        waiting: FactNode | None = None
        for firing in self.firings:
            lacking = next((fact for fact in firing.premises if self._is_awaited(fact.name.text)), None)
            if lacking is None:
                return None
            waiting = waiting or lacking
        return waiting

    @property
    def _is_driven(self) -> bool:
        """Whether the program is event-driven: it declares a sensor, or asserts about a fact that nothing states."""
        declared = (each for each in self._names.signatures.values() if each.declaration is not None)
        if any(each.kind is Kind.SENSED and each.name not in provided.PREDICATES for each in declared):
            return True
        return any(use.role is FactRole.START and self._is_awaited(use.fact.name.text) for use in self._names.uses)

    def _is_awaited(self, name: str) -> bool:
        """Whether facts of `name` are absent at the start and come later: derived, or declared temporary."""
        signature = self._names.signatures[name]
        if signature.provided or signature.declaration is None or signature.kind is not Kind.TEMPORARY:
            return name in self._derived and name not in self._begun and not self._is_outside(name)
        return name not in self._begun and name not in self._arriving

    def _begins(self, name: str) -> bool:
        return self._is_outside(name) or name in self._begun or name not in self._derived

    def _is_outside(self, name: str) -> bool:
        signature = self._names.signatures[name]
        return signature.provided or self._is_trusted(signature) or name in self._arriving

    def _is_trusted(self, signature: Signature) -> bool:
        """Whether a declaration is a reason to expect facts from outside: not where it is known what comes from there.

        Temporary facts are the messages of others as well, and are trusted.
        """
        return signature.declaration is not None and not (self._names.closed and signature.kind is Kind.PERSISTENT)


def only_stated(fact: FactNode, names: Names) -> bool:
    """Whether initial facts are the only source of the predicate."""
    signature = names.of(fact)
    if signature.kind is Kind.SENSED or signature.provided or fact.name.text in names.given:
        return False
    return _has_use(fact, names, {FactRole.FACT}) and not is_brought(fact, names)


def is_brought(fact: FactNode, names: Names) -> bool:
    """Whether a rule, the declared effect of an action or a violation derives facts of the predicate."""
    return _has_use(fact, names, {FactRole.HEAD, FactRole.EFFECT, FactRole.VIOLATION})


def _has_use(fact: FactNode, names: Names, roles: set[FactRole]) -> bool:
    uses_of = (use for use in names.uses if use.fact.name.text == fact.name.text)
    return any(use.role in roles and use.fact.mark is not Mark.GOAL for use in uses_of)


def _supplied(name: str, waiting: dict[str, list[Firing]]) -> list[Firing]:
    """Return the firings whose last missing premise is `name`; remove `name` from all that lack it."""
    ready = []
    for firing in waiting.pop(name, ()):
        firing.lacking.discard(name)
        if not firing.lacking:
            ready.append(firing)
    return ready


def _release(ready: list[Firing], waiting: dict[str, list[Firing]]) -> None:
    """Propagate the derived predicates of `ready` firings until no further firing becomes ready."""
    while ready:
        for name in ready.pop().derived:
            ready += _supplied(name, waiting)


def _circle(firing: Firing, deriving: dict[str, list[Firing]]) -> FactNode:
    """Return a premise on a cycle: follow lacking premises backwards from `firing` until one repeats."""
    # Ends: a lacking premise has a deriving rule (else it counts as present), and that rule lacks one as well.
    seen: dict[str, FactNode] = {}
    while True:
        premise = next(fact for fact in firing.premises if fact.name.text in firing.lacking)
        if premise.name.text in seen:
            return premise
        seen[premise.name.text] = premise
        firing = deriving[premise.name.text][0]


def _firings(rule: RuleItem) -> Iterator[Firing]:
    premises = list(_premises(rule.body))
    plain = [part for part in flat(rule.head) if isinstance(part, FactNode | StepsNode)]
    yield Firing(premises, tuple(_names(plain)), set())
    for part in flat(rule.head):
        match part:
            case ComprehensionNode(body=body):
                yield Firing([*premises, *_premises(body)], tuple(_names([part])), set())
            case AggregateNode(body=body, operator=operator):
                # `count`, `sum` and `collect` derive a value of no match, too: their body is no premise.
                inner = _premises(body) if operator.text in WINNING else ()
                yield Firing([*premises, *inner], tuple(_names([part])), set())
            case FactNode() | StepsNode():
                pass


def _premises(body: tuple[Conjunct, ...]) -> Iterator[FactNode]:
    return (each for each in body if isinstance(each, FactNode) and not each.absent and each.mark is not Mark.GOAL)


def _names(head: Iterable[PlainHeadItem]) -> Iterator[str]:
    """Yield the predicates of the facts that parts of a head derive, goals excluded."""
    for part in head:
        match part:
            case FactNode():
                facts: tuple[FactNode, ...] = (part,)
            case StepsNode(derived=facts) | ComprehensionNode(head=facts) | AggregateNode(head=facts):
                pass
        yield from (fact.name.text for fact in facts if fact.mark is not Mark.GOAL)


# ---- unification of constants


def _may_match(wanted: FactNode, known: Known, producer: FactNode, given: Known) -> bool:
    """Whether the constants of two facts unify, repeated variables of either side included."""

    bound: dict[tuple[bool, str], Value] = {}
    for one, other in zip(wanted.arguments, producer.arguments, strict=False):
        here = _constant(one, known)
        there = _constant(other, given)
        if here is not None and there is not None and here.value != there.value:
            return False
        for named, side, value in ((True, one, there), (False, other, here)):
            if value is None or not isinstance(side, Variable) or side.anonymous:
                continue
            if bound.setdefault((named, side.name), value.value) != value.value:
                return False
    return True


def _constant(argument: Expression, known: Known) -> Literal | None:
    if isinstance(argument, Variable):
        return known.get(argument.name)
    return argument if isinstance(argument, Literal) else None

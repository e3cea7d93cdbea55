"""Doubts: what is legal and yet probably not meant. Warnings never stop compilation.

Facts may arrive from outside (a lab, a sensor, an action in Python), so a declared predicate is taken to be
known to somebody; an undeclared one that nothing states or derives is doubted. After a syntax error what is
missing may stand in the broken item, and nothing is doubted for its absence.
"""

from collections import Counter

from rmr.base.values import Symbol
from rmr.bytecode.program import Kind
from rmr.lang import provided
from rmr.lang.constants import fold
from rmr.lang.diagnostic import Diagnostics
from rmr.lang.names import Names, Role, Use, meant, near
from rmr.lang.syntax import (
    Assertion,
    Binary,
    Comprehension,
    Condition,
    Expression,
    Fact,
    GoalItem,
    Literal,
    Mark,
    Module,
    Rule,
    Variable,
    walk,
)

TICK_S = 1 / 60
"""The robots' executive runs at 60 Hz: nothing is decided faster."""

FACT_OCTETS_MAX = 96
"""What a frame of 127 octets leaves for a fact's values behind the radio's and the runtime's headers."""

PRODUCERS_MAX = 1000
"""A fact with more ways to come about is taken to be reachable."""

_DERIVING = {Role.FACT, Role.HEAD, Role.EFFECT}
_READING = {Role.BODY, Role.START, Role.FINISH, Role.GOAL}


def warn(module: Module, names: Names, found: Diagnostics) -> None:
    """Report the doubts about `module`."""
    _Doubts(module, names, found).run()


class _Doubts:
    def __init__(self, module: Module, names: Names, found: Diagnostics) -> None:
        self._module = module
        self._names = names
        self._found = found
        self._derived: dict[str, list[Fact]] = {}
        self._read: set[str] = set()
        self._doubted: set[str] = set()
        literals = (node for node in walk(module.items) if isinstance(node, Literal))
        self._symbols = {node.value for node in literals if isinstance(node.value, Symbol)}
        self._events = {(item.name or item.finish.name).text for item in module.items if isinstance(item, Assertion)}
        for use in names.uses:
            if use.role in _DERIVING and use.fact.mark is not Mark.GOAL:
                self._derived.setdefault(use.fact.name.text, []).append(use.fact)
            if use.role in _READING or use.fact.mark is Mark.GOAL:
                self._read.add(use.fact.name.text)

    def run(self) -> None:
        for item in self._module.items:
            match item:
                case Rule():
                    self._confusable(item)
                    self._contradiction(item)
                    self._large(item)
                case Assertion():
                    self._confusable(item)
                    self._short(item)
                case _:
                    pass
        if not self._module.broken:
            self._absences()

    def _absences(self) -> None:
        for item in self._module.items:
            if isinstance(item, GoalItem) and not self._reachable(item.fact):
                message = f"nothing in the program derives a fact that matches `{_text(item.fact)}`"
                self._found.report("W103", message, item.fact.span, hint=self._outside(item.fact))
            if isinstance(item, Assertion) and not self._reachable(item.finish):
                message = f"nothing in the program derives a fact that matches `{_text(item.finish)}`"
                message += "; jobs are late unless one comes from outside"
                self._found.report("W104", message, item.finish.span, hint=self._outside(item.finish))
        for use in self._names.uses:
            self._never(use)
            self._unread(use)

    # ---- variables that may be constants

    def _confusable(self, item: Rule | Assertion) -> None:
        counts: Counter[str] = Counter()
        places: dict[str, Variable] = {}
        for node in walk(item):
            if isinstance(node, Variable) and not node.anonymous:
                counts[node.name] += 1
                places[node.name] = node
        for name, count in counts.items():
            constant = name[0].lower() + name[1:]
            if count > 1 or constant == name or self._found.wrong_at(places[name].span):
                continue
            if constant in self._symbols:
                message = f"the variable `{name}` is used only here and matches anything"
                self._found.report("W101", message, places[name].span, hint=f"did you mean the constant `{constant}`?")

    # ---- rules that never fire

    def _contradiction(self, item: Rule) -> None:
        values: dict[str, Literal] = {}
        for conjunct in item.body:
            if not isinstance(conjunct, Condition):
                continue
            match conjunct.expression:
                case Literal(value=False):
                    self._found.report("W102", "this is never true, the rule cannot fire", conjunct.span)
                case Binary("=", Variable(name=name), Literal() as value) if name != "_":
                    if values.setdefault(name, value).value != value.value:
                        message = f"`{name}` cannot be both, the rule cannot fire"
                        self._found.report("W102", message, conjunct.span)
                case _:
                    pass

    def _never(self, use: Use) -> None:
        fact, name = use.fact, use.fact.name.text
        if use.role not in {Role.BODY, Role.START} or fact.absent:
            return
        signature = self._names.of(fact)
        what = "rule cannot fire" if use.role is Role.BODY else "assertion never starts a job"
        absent = name in provided.UNSENSED and signature.declaration is None and name not in self._arriving
        if signature.provided and absent:
            hint = f"declare it if something does: `{provided.declaration_text(name, signature.types, 'sensor ')}`"
            self._found.report("W102", f"no robot senses `{name}`, the {what}", fact.span, hint=hint)
        elif signature.provided:
            self._unknown_event(fact, what)
        elif signature.declaration is None and name not in self._derived and name not in self._arriving:
            if name in self._doubted:
                return
            self._doubted.add(name)
            message = f"nothing states or derives `{name}`, the {what}"
            self._found.report("W102", message, fact.span, hint=self._outside(fact))

    def _unknown_event(self, fact: Fact, what: str) -> None:
        kinds = self._names.of(fact).types
        for argument, kind in zip(fact.arguments[1:], kinds, strict=False):
            if kind.name != provided.EVENT or not isinstance(argument, Literal):
                continue
            if isinstance(argument.value, Symbol) and argument.value not in self._events:
                message = f"no time assertion is called `{argument.value}`, the {what}"
                hint = meant(argument.value, sorted(self._events))
                self._found.report("W102", message, argument.span, hint=hint)

    # ---- facts that nobody derives or reads

    @property
    def _arriving(self) -> frozenset[str]:
        """What comes from outside, and what `moveto` inserts on arrival when its declaration does not say."""
        moveto = self._names.signatures.get("moveto")
        declared = moveto.declaration if moveto is not None else None
        arrival = (provided.ARRIVAL,) if declared is not None and not declared.effects else ()
        return frozenset((*arrival, *self._names.given))

    def _reachable(self, fact: Fact) -> bool:
        name = fact.name.text
        if self._names.of(fact).kind in {Kind.SENSED, Kind.ACTION} or name in self._arriving:
            return True
        producers = self._derived.get(name, [])
        if self._names.of(fact).provided or (not producers and self._names.of(fact).declaration is not None):
            return True
        return len(producers) > PRODUCERS_MAX or any(_may_match(fact, producer) for producer in producers)

    def _outside(self, fact: Fact) -> str | None:
        """Return the hint for a fact that is missing."""
        name = fact.name.text
        if self._names.of(fact).declaration is not None:
            return None
        return self._known(fact) or f"declare it if it comes from outside: `type {name}(...)`"

    def _known(self, fact: Fact) -> str | None:
        """Return the hint that names a known fact with as many arguments."""
        if self._found.many:
            return None
        arity = len(fact.arguments)
        known = [
            each.name
            for each in self._names.signatures.values()
            if each.arity == arity and (each.declaration is not None or each.name in self._derived)
        ]
        known += [
            name
            for name, (_, types) in provided.PREDICATES.items()
            if len(types) + 1 == arity and name not in provided.UNSENSED
        ]
        return meant(fact.name.text, known)

    def _unread(self, use: Use) -> None:
        fact, name = use.fact, use.fact.name.text
        if use.role is not Role.HEAD or name in self._read or self._names.of(fact).declaration is not None:
            return
        if not self._names.of(fact).is_fact or self._found.many:
            return
        message = f"nothing reads the fact `{name}`"
        if name in provided.ACTIONS and len(provided.ACTIONS[name]) + 1 == len(fact.arguments):
            declaration = provided.declaration_text(name, provided.ACTIONS[name], "action ")
            hint = f"to act, declare the action: `{declaration}`"
            self._found.report("W108", f"{message}; no action of that name is declared", fact.span, hint=hint)
            return
        arity = len(fact.arguments)
        known = [
            each.name
            for each in self._names.signatures.values()
            if each.arity == arity and (each.declaration is not None or each.name in self._read)
        ]
        known += [each for each, types in provided.ACTIONS.items() if len(types) + 1 == arity]
        match = near(name, known)
        if match is not None:
            self._found.report("W108", message, fact.span, hint=f"did you mean `{match}`?")

    # ---- sizes and times

    def _large(self, item: Rule) -> None:
        bodies = [each for each in item.body if isinstance(each, Fact) and not each.absent]
        home = bodies[0].owner if bodies else None
        for part in item.head:
            facts = part.head if isinstance(part, Comprehension) else (part,) if isinstance(part, Fact) else ()
            for fact in facts:
                away = isinstance(fact.owner, Variable) and isinstance(home, Variable) and fact.owner.name != home.name
                octets = sum(_octets(argument) for argument in fact.arguments[1:])
                if away and octets > FACT_OCTETS_MAX:
                    message = f"this fact takes {octets} octets and more than one radio frame"
                    self._found.report("W105", message, fact.span, hint="it will be sent in fragments")

    def _short(self, item: Assertion) -> None:
        deadline = fold(item.deadline)
        value = deadline.value if deadline is not None else None
        if isinstance(value, int | float) and not isinstance(value, bool) and value < TICK_S:
            hint = "a robot decides 60 times a second; `500ms` and `2s` are times"
            self._found.report("W106", "this deadline is shorter than a tick", item.deadline.span, hint=hint)


def _text(fact: Fact) -> str:
    return f"?{fact.name.text}(...)" if fact.mark is Mark.GOAL else f"{fact.name.text}(...)"


def _may_match(wanted: Fact, producer: Fact) -> bool:
    pairs = zip(wanted.arguments[1:], producer.arguments[1:], strict=False)
    return all(_may_equal(one, other) for one, other in pairs)


def _may_equal(one: Expression, other: Expression) -> bool:
    return not (isinstance(one, Literal) and isinstance(other, Literal) and one.value != other.value)


def _octets(argument: Expression) -> int:
    """Return about how many octets a value takes at least."""
    if isinstance(argument, Literal) and isinstance(argument.value, str):
        return 2 + len(argument.value.encode())
    return 2

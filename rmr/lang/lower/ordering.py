"""A body of one robot in an order in which every variable is bound before it is used.

Facts stay in the order of the text, each condition stands as soon as it can be decided, `not` once everything
that it shares with the rest is bound. An expression among a fact's arguments becomes an equation behind the
fact. An equation binds a variable that no fact binds, and takes a list apart: `L = [H | T]` for a list L is
`len(L) >= 1`, `nth(L, 0) = H` and `rest(L, 1) = T`, equations again.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from rmr.bytecode.program import Kind, Mode
from rmr.lang.analyse.names import Names, meant
from rmr.lang.analyse.types import equation_of, matched_variables
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.lower.robot_rules import Decide, Environment, Let, MatchStep, Step
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    Binary,
    Call,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    ListTerm,
    Literal,
    Mark,
    Name,
    Variable,
    walk,
)

BOUND_SHOWN_MAX = 8
"""Variables that a hint names."""


def variables(node: object) -> Iterator[Variable]:
    """Yield the named variables that stand in `node`."""
    return (each for each in walk(node) if isinstance(each, Variable) and not each.anonymous)


def bound_hint(variable: Variable, environment: Environment) -> str | None:
    """Return the hint for a variable without value: the one it may be misspelt for, else those that have one."""
    names = [each for each in (*environment.slots, *environment.constants) if each[0].isalpha() and each.isidentifier()]
    names = [each for each in dict.fromkeys(names) if each != variable.name]
    if not names:
        return None
    misspelt = meant(variable.name, names) if len(variable.name) > 2 else None
    shown = ", ".join(f"`{each}`" for each in names[:BOUND_SHOWN_MAX])
    return misspelt or f"bound {'is' if len(names) == 1 else 'are'} {shown}"


@dataclass(slots=True)
class _Body:
    """A body on its way to steps."""

    environment: Environment
    matched: frozenset[str]
    """What its facts bind."""
    waiting: list[Conjunct]
    """Conditions and `not`, what cannot be decided yet."""
    steps: list[Step] = field(default_factory=list)


class Orderer:
    """Orders the bodies of one program."""

    def __init__(self, names: Names, symbols: frozenset[str], found: Diagnostics) -> None:
        self._names = names
        self._symbols = symbols
        self._found = found
        self._fresh = 0

    def order(self, conjuncts: tuple[Conjunct, ...], environment: Environment) -> tuple[Step, ...] | None:
        """Return the steps of a body, whose variables `environment` then knows, or None after reporting why not."""
        # Conditions first wait for their variables; positive facts never wait, since matching them binds.
        held = [each for each in conjuncts if isinstance(each, Condition) or each.absent]
        waiting = [each for each in held if not _is_replaced(each, environment)]
        body = _Body(environment, matched_variables(conjuncts), waiting)
        for fact in conjuncts:
            if isinstance(fact, FactNode) and not fact.absent:
                self._match(fact, body)
                self._ready(body)
        self._ready(body)
        # What still waits for a variable of a `not` alone cannot come earlier: decide each `not`, then look again.
        while absent := [each for each in body.waiting if isinstance(each, FactNode)]:
            body.waiting.remove(absent[0])
            self._absent(absent[0], body)
            self._ready(body)
        for conjunct in body.waiting:
            self.unbound(conjunct, environment)
        return None if body.waiting else tuple(body.steps)

    def unbound(self, node: object, environment: Environment) -> None:
        """Report every variable of `node` that has no value; `_` never has one.

        Each is reported once: what is reported, and what it would have bound, counts as bound from here on.
        """
        missing = [each for each in walk(node) if isinstance(each, Variable) and not environment.knows(each.name)]
        anonymous = [each for each in missing if each.anonymous]
        given = self._given(node, missing)
        is_told = isinstance(node, Condition) and self._found.wrong_within(node.span)
        for each in anonymous if not is_told else ():
            self._found.report("E030", "`_` has no value", each.span, hint="`_` matches anything in a fact")
        for variable in missing if not anonymous and not is_told else ():
            if variable.name != given and not environment.knows(variable.name):
                hint = self._bound_hint(variable, environment)
                self._found.report("E030", f"nothing in the body binds `{variable.name}`", variable.span, hint=hint)
                environment.unbound.add(variable.name)
        if isinstance(node, Condition):
            environment.unbound.update(each.name for each in missing if not each.anonymous)

    @staticmethod
    def _given(node: object, missing: list[Variable]) -> str | None:
        """Return the variable that an equation would bind if the other side had a value."""
        names = {each.name for each in missing}
        for side, other in reversed(_sides(node.expression) if isinstance(node, Condition) else ()):
            lacks = {each.name for each in walk(other) if isinstance(each, Variable)} & names
            if isinstance(side, Variable) and side.name in names and lacks - {side.name}:
                return side.name
        return None

    def _bound_hint(self, variable: Variable, environment: Environment) -> str | None:
        constant = variable.name[0].lower() + variable.name[1:]
        if constant in self._symbols:
            return f"did you mean the constant `{constant}`?"
        return bound_hint(variable, environment)

    # ---- conditions

    def _ready(self, body: _Body) -> None:
        """Move what can be decided from what is waiting to the steps, in the order of the text."""
        index = 0
        while index < len(body.waiting):
            conjunct = body.waiting[index]
            if isinstance(conjunct, FactNode):
                if self._is_absent_now(conjunct, body):
                    body.waiting.pop(index)
                    self._absent(conjunct, body)
                else:
                    index += 1
                continue
            step = self._decided(conjunct.expression, body)
            if step is not None:
                body.waiting.pop(index)
                index = self._take(step, index, body)
            elif (apart := self._apart(conjunct.expression, body)) is not None:
                body.waiting[index : index + 1] = apart
            else:
                index += 1

    @staticmethod
    def _take(step: Step, index: int, body: _Body) -> int:
        """Add `step` and return where to look on: at the beginning if it binds a variable."""
        body.steps.append(step)
        if not isinstance(step, Let):
            return index
        body.environment.slot(step.name)
        return 0

    @staticmethod
    def _is_absent_now(fact: FactNode, body: _Body) -> bool:
        """Whether nothing that is still to come binds a variable of `fact`."""
        free = {each.name for each in variables(fact.arguments) if not body.environment.knows(each.name)}
        later = body.matched | {name for other in body.waiting if other is not fact for name in _may_bind(other)}
        return not free & later

    @staticmethod
    def _decided(expression: Expression, body: _Body) -> Step | None:
        """Return the step that `expression` is as soon as its variables have values, else None."""
        if all_known(expression, body.environment):
            return Decide(expression)
        for side, other in _sides(expression):
            # A variable that a fact binds gets its value there; the equation then is a condition.
            if not isinstance(side, Variable) or side.anonymous or side.name in body.matched:
                continue
            if not body.environment.knows(side.name) and all_known(other, body.environment):
                return Let(side.name, other)
        return None

    def _apart(self, expression: Expression, body: _Body) -> list[Conjunct] | None:
        """Return what takes a list apart whose value is known, or None if there is none to take apart."""
        for side, other in _sides(expression):
            if not isinstance(side, ListTerm) or not all_known(other, body.environment):
                continue
            subject = other
            if not isinstance(other, Variable | Literal):
                subject = self._fresh_variable(side.span)
                self._take(Let(subject.name, other), 0, body)
            return list(_parts(subject, side))
        return None

    # ---- facts

    def _match(self, fact: FactNode, body: _Body) -> None:
        """Add the match of `fact`; equations for the expressions among its arguments wait first of all."""
        arguments: list[Variable | Literal] = []
        equations: list[Conjunct] = []
        for argument in fact.arguments[1:]:
            if isinstance(argument, Literal):
                arguments.append(argument)
                continue
            variable = argument if isinstance(argument, Variable) else self._fresh_variable(argument.span)
            if not variable.anonymous and variable.name not in body.environment.constants:
                body.environment.slot(variable.name)
            if variable is not argument:
                equations.append(_equation(variable, argument))
            arguments.append(variable)
        body.steps.append(MatchStep(fact, tuple(arguments), self._mode(fact)))
        # In front of what waited before: an expression among the arguments is tested right behind its fact.
        body.waiting[:0] = equations

    def _mode(self, fact: FactNode) -> Mode:
        if self._names.of(fact).kind is not Kind.TEMPORARY:
            return Mode.READ
        return Mode.KEEP if fact.mark is Mark.KEEP else Mode.CONSUME

    def _absent(self, fact: FactNode, body: _Body) -> None:
        arguments: list[Variable | Literal] = []
        free = [each.name for each in variables(fact.arguments[1:]) if not body.environment.knows(each.name)]
        own: dict[str, Variable] = {}
        for argument in fact.arguments[1:]:
            if isinstance(argument, Literal):
                arguments.append(argument)
            elif isinstance(argument, Variable):
                unknown = argument.name in free
                arguments.append(self._free(argument, free, own, body.environment) if unknown else argument)
            else:
                self.unbound(argument, body.environment)
                variable = self._fresh_variable(argument.span)
                self._take(Let(variable.name, argument), 0, body)
                arguments.append(variable)
        body.steps.append(MatchStep(fact, tuple(arguments), Mode.ABSENT))

    def _free(
        self, variable: Variable, free: list[str], own: dict[str, Variable], environment: Environment
    ) -> Variable:
        """Return what stands for a variable that only this `not` knows."""
        # Once: any value will do. Twice, as in `not p(R, X, X)`: both values must be equal, so it needs a slot.
        if free.count(variable.name) == 1:
            return Variable("_", variable.span)
        if variable.name not in own:
            own[variable.name] = self._fresh_variable(variable.span)
            environment.slot(own[variable.name].name)
        return own[variable.name]

    def _fresh_variable(self, span: Span) -> Variable:
        self._fresh += 1
        return Variable(f"_{self._fresh}'", span)  # the apostrophe keeps it apart from all names of the source


def all_known(expression: object, environment: Environment) -> bool:
    """Whether every variable of `expression` has a value; `_` has none."""
    return all(environment.knows(each.name) for each in walk(expression) if isinstance(each, Variable))


def _sides(expression: Expression) -> tuple[tuple[Expression, Expression], ...]:
    """Return both sides of an equation, each with the other."""
    if not isinstance(expression, Binary) or expression.operator != "=":
        return ()
    return (expression.left, expression.right), (expression.right, expression.left)


def _parts(subject: Expression, term: ListTerm) -> Iterator[Conjunct]:
    """Yield what holds of the list `subject` if it is `term`."""
    span = term.span
    count = Literal(len(term.items), term.span)
    length = Binary("=" if term.rest is None else ">=", _call("len", span, subject), count, span)
    yield Condition(length, span)
    for index, item in enumerate(term.items):
        yield from _part(_call("nth", item.span, subject, Literal(index, item.span)), item)
    if term.rest is not None:
        yield from _part(_call("rest", term.rest.span, subject, count), term.rest)


def _part(value: Expression, item: Expression) -> Iterator[Conjunct]:
    if not (isinstance(item, Variable) and item.anonymous):
        yield _equation(value, item)


def _equation(left: Expression, right: Expression) -> Condition:
    return Condition(Binary("=", left, right, right.span), right.span)


def _call(name: str, span: Span, *arguments: Expression) -> Call:
    return Call(Name(name, span), arguments, span)


def _is_replaced(conjunct: Conjunct, environment: Environment) -> bool:
    equation = equation_of(conjunct)
    return equation is not None and environment.constants.get(equation[0]) is equation[1]


def _may_bind(conjunct: Conjunct) -> Iterable[str]:
    """Return the variables that `conjunct` might bind."""
    if not isinstance(conjunct, Condition):
        return ()
    sides = [side for side, _ in _sides(conjunct.expression)]
    return [each.name for side in sides for each in _pattern(side)]


def _pattern(side: Expression) -> Iterator[Variable]:
    """Yield the variables that stand for themselves or for a part of a list."""
    stack = [side]
    while stack:
        part = stack.pop()
        if isinstance(part, Variable):
            yield part
        elif isinstance(part, ListTerm):
            stack += part.items
            stack += () if part.rest is None else (part.rest,)

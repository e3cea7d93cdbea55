"""Scheduling of a body: an order of steps in which every variable is bound before it is used (range restriction).

Facts keep the order of the text. A condition stands at the first place at which all its variables are bound, which
prunes the join early. A `not` stands where every variable that it shares with the rest of the body is bound. An
expression among a fact's arguments becomes an equation directly behind the fact. An equation binds a variable that no
fact binds, and destructures a list: `L = [H | T]` for a list L becomes `len(L) >= 1`, `nth(L, 0) = H` and
`rest(L, 1) = T`, which are equations again.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from rmr.bytecode.program import Kind, Mode
from rmr.lang.analyse.names import Names, meant
from rmr.lang.analyse.types import equation_of, matched_variables
from rmr.lang.diagnostics.diagnostic import Diagnostics, WordHint
from rmr.lang.lower.robot_rules import Decide, Environment, Gather, Let, MatchStep, Step
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    Binary,
    Call,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    ListTerm,
    Literal,
    Mark,
    Name,
    Variable,
    walk,
)


def variables(node: object) -> Iterator[Variable]:
    """Yield the occurrences of named variables in `node`, in source order."""
    return (each for each in walk(node) if isinstance(each, Variable) and not each.anonymous)


def bound_hint(variable: Variable, environment: Environment) -> str | None:
    """Return the hint for an unbound variable: the bound variable that it may misspell, else all bound variables."""
    names = [each for each in (*environment.slots, *environment.constants) if each[0].isalpha() and each.isidentifier()]
    names = [each for each in dict.fromkeys(names) if each != variable.name]
    if not names:
        return None
    misspelt = meant(variable.name, names) if len(variable.name) > 2 else None
    shown = ", ".join(f"`{each}`" for each in names[:8])  # more are no hint
    return misspelt or f"bound {'is' if len(names) == 1 else 'are'} {shown}"


@dataclass(slots=True)
class _Body:
    """The state of scheduling one body."""

    environment: Environment
    matched: frozenset[str]
    """The variables that positive facts and folds of the body bind."""
    waiting: list[Conjunct]
    """Conditions, `not` and folds that are not scheduled yet."""
    steps: list[Step] = field(default_factory=list)
    complete: bool = False
    """Whether all facts are matched; folds stand behind them."""


class Orderer:
    """Orders the bodies of one program."""

    def __init__(self, names: Names, symbols: frozenset[str], found: Diagnostics) -> None:
        self._names = names
        self._symbols = symbols
        self._found = found
        self._fresh = 0
        self._keeps = False
        """Whether the body of a fold is being scheduled, which consumes nothing."""

    def order(self, conjuncts: tuple[Conjunct, ...], environment: Environment) -> tuple[Step, ...] | None:
        """Return the steps of a body, or None after reporting unbound variables; `environment` gains the bound ones."""
        # Conditions first wait for their variables; positive facts never wait, since matching them binds.
        held = [each for each in conjuncts if not isinstance(each, FactNode) or each.absent]
        waiting = [each for each in held if not _is_replaced(each, environment)]
        computed = {each.result.name for each in conjuncts if isinstance(each, FoldNode) and each.result is not None}
        body = _Body(environment, matched_variables(conjuncts) | computed, waiting)
        for fact in conjuncts:
            if isinstance(fact, FactNode) and not fact.absent:
                self._match(fact, body)
                self._ready(body)
        body.complete = True
        self._ready(body)
        # What still waits for a variable of a `not` alone cannot come earlier: decide each `not`, then look again.
        while inner := [each for each in body.waiting if not isinstance(each, Condition)]:
            body.waiting.remove(inner[0])
            self._inner(inner[0], body)
            self._ready(body)
        for conjunct in body.waiting:
            self.unbound(conjunct, environment)
        return None if body.waiting else tuple(body.steps)

    def unbound(self, node: object, environment: Environment) -> None:
        """Report every unbound variable of `node`; `_` is always unbound.

        A variable is reported once: a reported one, and one that it would have bound, counts as bound afterwards.
        """
        missing = [each for each in walk(node) if isinstance(each, Variable) and not environment.knows(each.name)]
        anonymous = [each for each in missing if each.anonymous]
        given = self._given(node, missing)
        is_reported = isinstance(node, Condition) and self._found.wrong_within(node.span)
        for each in anonymous if not is_reported else ():
            self._found.report("E030", "`_` has no value", each.span, hint="`_` matches anything in a fact")
        for variable in missing if not anonymous and not is_reported else ():
            if variable.name != given and not environment.knows(variable.name):
                hint = self._bound_hint(variable, environment)
                self._found.report("E030", f"nothing in the body binds `{variable.name}`", variable.span, hint=hint)
                environment.unbound.add(variable.name)
        if isinstance(node, Condition):
            environment.unbound.update(each.name for each in missing if not each.anonymous)

    @staticmethod
    def _given(node: object, missing: list[Variable]) -> str | None:
        """Return the variable that the equation `node` would bind if its other side were bound, else None."""
        names = {each.name for each in missing}
        for side, other in reversed(_sides(node.expression) if isinstance(node, Condition) else ()):
            lacks = {each.name for each in walk(other) if isinstance(each, Variable)} & names
            if isinstance(side, Variable) and side.name in names and lacks - {side.name}:
                return side.name
        return None

    def _bound_hint(self, variable: Variable, environment: Environment) -> str | None:
        # A constant written with a capital letter reads as a variable.
        constant = variable.name[0].lower() + variable.name[1:]
        if constant in self._symbols:
            return WordHint(f"did you mean the constant `{constant}`?", constant)
        return bound_hint(variable, environment)

    # ---- conditions

    def _ready(self, body: _Body) -> None:
        """Schedule the waiting conjuncts whose variables are bound, in the order of the text."""
        index = 0
        while index < len(body.waiting):
            conjunct = body.waiting[index]
            if not isinstance(conjunct, Condition):
                if self._is_inner_now(conjunct, body):
                    body.waiting.pop(index)
                    self._inner(conjunct, body)
                    index = 0 if isinstance(conjunct, FoldNode) else index
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
        """Append `step` and return the index to continue at: 0 after a binding, which may make earlier ones ready."""
        body.steps.append(step)
        if not isinstance(step, Let):
            return index
        body.environment.slot(step.name)
        return 0

    @staticmethod
    def _is_inner_now(part: FactNode | FoldNode, body: _Body) -> bool:
        """Whether no later fact or equation can bind an unbound variable of a negated fact, or of a fold."""
        if isinstance(part, FoldNode) and not body.complete:
            return False
        used = variables(part.arguments if isinstance(part, FactNode) else (part.term, part.body))
        free = {each.name for each in used if not body.environment.knows(each.name)}
        later = body.matched | {name for other in body.waiting if other is not part for name in _may_bind(other)}
        return not free & later

    def _inner(self, part: FactNode | FoldNode, body: _Body) -> None:
        if isinstance(part, FactNode):
            self._absent(part, body)
        else:
            self._fold(part, body)

    def _fold(self, node: FoldNode, body: _Body) -> None:
        """Append a fold; its variables that nothing else binds are its own."""
        outer = body.environment
        inner = outer.inner()
        self._keeps = True
        steps = self.order(node.body, inner)
        self._keeps = False
        if node.term is not None:
            self.unbound(node.term, inner)
        slots = tuple(range(outer.count, inner.count))
        outer.count = inner.count
        result = node.result or self.fresh_variable(node.span)
        body.steps.append(Gather(node, outer.slot(result.name), slots, steps or (), inner))
        if node.result is None:
            none = Binary("=", result, Literal(0, node.span), node.span)
            body.steps.append(Decide(none))

    @staticmethod
    def _decided(expression: Expression, body: _Body) -> Step | None:
        """Return the test or binding for `expression`, or None while too many of its variables are unbound."""
        if all_known(expression, body.environment):
            return Decide(expression)
        for side, other in _sides(expression):
            # A variable that a fact binds gets its value there; the equation is then a test.
            if not isinstance(side, Variable) or side.anonymous or side.name in body.matched:
                continue
            if not body.environment.knows(side.name) and all_known(other, body.environment):
                return Let(side.name, other)
        return None

    def _apart(self, expression: Expression, body: _Body) -> list[Conjunct] | None:
        """Return the equations that destructure a bound list, or None if `expression` is no such equation."""
        for side, other in _sides(expression):
            if not isinstance(side, ListTerm) or not all_known(other, body.environment):
                continue
            subject = other
            # A computed list gets a slot, so that it is evaluated once and not once for each item.
            if not isinstance(other, Variable | Literal):
                subject = self.fresh_variable(side.span)
                self._take(Let(subject.name, other), 0, body)
            return list(_parts(subject, side))
        return None

    # ---- facts

    def _match(self, fact: FactNode, body: _Body) -> None:
        """Append the match of `fact`; put equations for its argument expressions at the head of the waiting list."""
        arguments: list[Variable | Literal] = []
        equations: list[Conjunct] = []
        for argument in fact.arguments[1:]:
            if isinstance(argument, Literal):
                arguments.append(argument)
                continue
            variable = argument if isinstance(argument, Variable) else self.fresh_variable(argument.span)
            if not variable.anonymous and variable.name not in body.environment.constants:
                body.environment.slot(variable.name)
            if variable is not argument:
                equations.append(_equation(variable, argument))
            arguments.append(variable)
        body.steps.append(MatchStep(fact, tuple(arguments), self._mode(fact)))
        # Ahead of earlier ones: an expression among the arguments is tested directly behind its fact.
        body.waiting[:0] = equations

    def _mode(self, fact: FactNode) -> Mode:
        if self._names.of(fact).kind is not Kind.TEMPORARY or fact.mark is Mark.GOAL:
            return Mode.READ
        return Mode.KEEP if fact.mark is Mark.KEEP or self._keeps else Mode.CONSUME

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
                variable = self.fresh_variable(argument.span)
                self._take(Let(variable.name, argument), 0, body)
                arguments.append(variable)
        body.steps.append(MatchStep(fact, tuple(arguments), Mode.ABSENT))

    def _free(
        self, variable: Variable, free: list[str], own: dict[str, Variable], environment: Environment
    ) -> Variable:
        """Return the replacement of a variable that is local to this `not`."""
        # One occurrence is a wildcard. Two, as in `not p(R, X, X)`, must be equal and so need a slot.
        if free.count(variable.name) == 1:
            return Variable("_", variable.span)
        if variable.name not in own:
            own[variable.name] = self.fresh_variable(variable.span)
            environment.slot(own[variable.name].name)
        return own[variable.name]

    def fresh_variable(self, span: Span) -> Variable:
        """Return a variable that no source can name."""
        self._fresh += 1
        return Variable(f"_{self._fresh}'", span)  # the apostrophe keeps it apart from all names of the source


def all_known(expression: object, environment: Environment) -> bool:
    """Whether every variable of `expression` is bound; `_` never is."""
    return all(environment.knows(each.name) for each in walk(expression) if isinstance(each, Variable))


def _sides(expression: Expression) -> tuple[tuple[Expression, Expression], ...]:
    """Return an equation in both orientations, as (side, other side); nothing for any other expression."""
    if not isinstance(expression, Binary) or expression.operator != "=":
        return ()
    return (expression.left, expression.right), (expression.right, expression.left)


def _parts(subject: Expression, term: ListTerm) -> Iterator[Conjunct]:
    """Yield the conditions equivalent to `subject = term`, the length first, so that `nth` stays in range."""
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
    """Return the variables that `conjunct` binds if it is scheduled as a binding."""
    if isinstance(conjunct, FoldNode):
        return () if conjunct.result is None else (conjunct.result.name,)
    if not isinstance(conjunct, Condition):
        return ()
    sides = [side for side, _ in _sides(conjunct.expression)]
    return [each.name for side in sides for each in _pattern(side)]


def _pattern(side: Expression) -> Iterator[Variable]:
    """Yield the variables of a pattern: the side itself, or the variables nested in its list term."""

    stack = [side]
    while stack:
        part = stack.pop()
        if isinstance(part, Variable):
            yield part
        elif isinstance(part, ListTerm):
            stack += part.items
            stack += () if part.rest is None else (part.rest,)

"""From a rule about the ensemble to a rule of one robot.

The facts of a body must belong to one robot, the rule's home. Its owner disappears: on the home robot it is
slot 0. What is left is put into an order in which every variable is bound before it is used: facts in the
order of the text, each condition as soon as it can be decided, `not` once everything that it shares with the
rest is bound. `X = constant` is not computed, it replaces X.
"""

from collections.abc import Iterable

from rmr.base.values import Robot
from rmr.bytecode.program import SELF_SLOT, Kind, Mode
from rmr.lang.diagnostic import Diagnostics, Note
from rmr.lang.names import Names
from rmr.lang.source import Span
from rmr.lang.steps import SELF, Decide, Derivation, Environment, Let, Match, Projected, Step
from rmr.lang.syntax import (
    Aggregate,
    Binary,
    Comprehension,
    Condition,
    Conjunct,
    Expression,
    Fact,
    HeadItem,
    Literal,
    Rule,
    Steps,
    Variable,
    walk,
)
from rmr.lang.types import Types, constants, equation_of, fits, literal_type, matched_variables


def variables(node: object) -> Iterable[Variable]:
    """Return the named variables that stand in `node`."""
    return (each for each in walk(node) if isinstance(each, Variable) and not each.anonymous)


class Projector:
    """Projects the rules of one program."""

    def __init__(self, names: Names, types: Types, symbols: frozenset[str], found: Diagnostics) -> None:
        self._names = names
        self._types = types
        self._symbols = symbols
        self._found = found
        self._fresh = 0
        self._home_term: Expression | None = None

    def rule(self, rule: Rule) -> Projected | None:
        """Return `rule` as the home robot runs it, or None after reporting why it cannot."""
        facts = [each for each in rule.body if isinstance(each, Fact)]
        if not any(not fact.absent for fact in facts):
            self._no_facts(rule)
            return None
        environment = Environment()
        at_home = self._home(facts, environment)
        environment.constants.update(self._constants(rule, environment))
        body = self._order(rule.body, environment)
        head = [self._head(part, environment) for part in rule.head]
        if not at_home or body is None or None in head:
            return None
        home = self._home_term
        if isinstance(home, Literal):
            here = Decide(Binary("=", Variable(SELF, home.span), home, home.span))
            body = (here, *body)
        return Projected(rule, environment, body, tuple(part for part in head if part is not None))

    def _constants(self, rule: Rule, environment: Environment) -> dict[str, Literal]:
        """Return the variables that `rule` equates with a constant which all their places can hold."""
        found = {name: value for name, value in constants(rule.body).items() if not environment.knows(name)}
        for fact in walk(rule) if found else ():
            if not isinstance(fact, Fact):
                continue
            for argument, cell in zip(fact.arguments, self._types.positions[fact.name.text], strict=False):
                value = found.get(argument.name) if isinstance(argument, Variable) else None
                if isinstance(argument, Variable) and value is not None and not fits(literal_type(value), cell.type):
                    del found[argument.name]
        return found

    def _no_facts(self, rule: Rule) -> None:
        span = rule.body[0].span.to(rule.body[-1].span)
        hint = "it would fire at all times; name a fact that must be there"
        self._found.report("E032", "a rule's body needs at least one fact that holds", span, hint=hint)

    # ---- the home robot

    def _home(self, facts: list[Fact], environment: Environment) -> bool:
        positive = [fact for fact in facts if not fact.absent]
        owners: list[Expression] = []
        for fact in positive:
            owner = fact.owner
            if owner is None:
                return False
            if not isinstance(owner, Variable | Literal):
                self._found.report("E021", "the owner of a fact in a body is a variable or a robot", owner.span)
                return False
            if not any(_same_owner(owner, other) for other in owners):
                owners.append(owner)
        if len(owners) > 1:
            notes = (Note(owners[0].span, "one robot's fact"),)
            message = "a rule that joins facts of several robots is not supported yet"
            self._found.report("E002", message, _span_of(positive, owners[1]), notes=notes)
        if isinstance(owners[0], Variable):
            environment.slots[SELF if owners[0].anonymous else owners[0].name] = SELF_SLOT
        environment.slots[SELF] = SELF_SLOT
        self._home_term = owners[0]
        for other in owners[1:]:
            if isinstance(other, Variable) and not other.anonymous:
                environment.slot(other.name)
        if len(owners) > 1:
            return False
        absent = [self._at_home(fact, owners[0], "`not`") for fact in facts if fact.absent]
        return all(absent)

    def _at_home(self, fact: Fact, home: Expression | None, what: str) -> bool:
        if fact.owner is None or home is None:
            return False
        if _same_owner(fact.owner, home) and not (isinstance(home, Variable) and home.anonymous):
            return True
        hint = "another robot's facts are not at hand here"
        if isinstance(home, Variable) or (isinstance(home, Literal) and isinstance(home.value, Robot)):
            named = home.name if isinstance(home, Variable) else repr(home.value)
            hint = f"the rule's home robot is `{named}`; {hint}"
        message = f"{what} may name the facts of the rule's home robot only"
        self._found.report("E033", message, fact.span, hint=hint)
        return False

    # ---- order

    def _order(self, body: tuple[Conjunct, ...], environment: Environment) -> tuple[Step, ...] | None:
        steps: list[Step] = []
        matched = matched_variables(body)
        waiting: list[Conjunct] = [each for each in body if isinstance(each, Condition) or each.absent]
        waiting = [each for each in waiting if not _is_replaced(each, environment)]
        for fact in body:
            if isinstance(fact, Fact) and not fact.absent:
                waiting[:0] = self._match(fact, environment, steps)
                self._ready(waiting, matched, environment, steps)
        self._ready(waiting, matched, environment, steps)
        while absent := [each for each in waiting if isinstance(each, Fact)]:
            waiting.remove(absent[0])
            self._absent(absent[0], environment, steps)
            self._ready(waiting, matched, environment, steps)
        for conjunct in waiting:
            self._unbound(conjunct, environment)
        return None if self._anonymous(body) or waiting else tuple(steps)

    def _anonymous(self, body: tuple[Conjunct, ...]) -> bool:
        """Report every `_` that stands inside an expression, where it has no value, and say whether there is one."""
        expressions: list[Expression] = []
        for conjunct in body:
            if isinstance(conjunct, Condition):
                expressions.append(conjunct.expression)
            else:
                expressions += [each for each in conjunct.arguments if not isinstance(each, Variable)]
        found = [each for each in walk(tuple(expressions)) if isinstance(each, Variable) and each.anonymous]
        for each in found:
            self._found.report("E030", "`_` has no value", each.span, hint="`_` matches anything in a fact")
        return bool(found)

    def _ready(
        self, waiting: list[Conjunct], matched: frozenset[str], environment: Environment, steps: list[Step]
    ) -> None:
        """Move what can be decided from `waiting` to `steps`, in the order of the text."""
        index = 0
        while index < len(waiting):
            conjunct = waiting[index]
            if isinstance(conjunct, Fact):
                if not self._is_absent_now(conjunct, waiting, matched, environment):
                    index += 1
                    continue
                waiting.pop(index)
                self._absent(conjunct, environment, steps)
                continue
            step = self._decided(conjunct.expression, matched, environment)
            if step is None:
                index += 1
                continue
            waiting.pop(index)
            steps.append(step)
            if isinstance(step, Let):
                environment.slot(step.name)
                index = 0

    @staticmethod
    def _is_absent_now(fact: Fact, waiting: list[Conjunct], matched: frozenset[str], environment: Environment) -> bool:
        """Whether nothing that is still to come binds a variable of `fact`."""
        free = {each.name for each in variables(fact.arguments) if not environment.knows(each.name)}
        later = matched | {each.name for other in waiting if other is not fact for each in _lets(other)}
        return not free & later

    def _decided(self, expression: Expression, matched: frozenset[str], environment: Environment) -> Step | None:
        """Return the step that `expression` is as soon as its variables have values, else None."""
        if self._all_known(expression, environment):
            return Decide(expression)
        if isinstance(expression, Binary) and expression.operator == "=":
            for side, other in ((expression.left, expression.right), (expression.right, expression.left)):
                if not isinstance(side, Variable) or side.anonymous or side.name in matched:
                    continue
                if not environment.knows(side.name) and self._all_known(other, environment):
                    return Let(side.name, other)
        return None

    @staticmethod
    def _all_known(expression: Expression, environment: Environment) -> bool:
        return all(environment.knows(each.name) for each in variables(expression))

    def _match(self, fact: Fact, environment: Environment, steps: list[Step]) -> list[Conjunct]:
        """Add the match of `fact`; return the equations for the expressions among its arguments."""
        arguments: list[Variable | Literal] = []
        equations: list[Conjunct] = []
        for argument in fact.arguments[1:]:
            if isinstance(argument, Literal):
                arguments.append(argument)
                continue
            variable = argument if isinstance(argument, Variable) else self._fresh_variable(argument.span)
            if not variable.anonymous and variable.name not in environment.constants:
                environment.slot(variable.name)
            if variable is not argument:
                equations.append(Condition(Binary("=", variable, argument, argument.span), argument.span))
            arguments.append(variable)
        steps.append(Match(fact, tuple(arguments), self._mode(fact)))
        return equations

    def _absent(self, fact: Fact, environment: Environment, steps: list[Step]) -> None:
        arguments: list[Variable | Literal] = []
        free = [each.name for each in variables(fact.arguments[1:]) if not environment.knows(each.name)]
        own: dict[str, Variable] = {}
        for argument in fact.arguments[1:]:
            if isinstance(argument, Literal):
                arguments.append(argument)
            elif isinstance(argument, Variable):
                if argument.name in free:
                    arguments.append(self._free(argument, free, own, environment))
                else:
                    arguments.append(argument)
            else:
                variable = self._fresh_variable(argument.span)
                if not self._all_known(argument, environment):
                    self._unbound(Condition(argument, argument.span), environment)
                environment.slot(variable.name)
                steps.append(Let(variable.name, argument))
                arguments.append(variable)
        steps.append(Match(fact, tuple(arguments), Mode.ABSENT))

    def _free(
        self, variable: Variable, free: list[str], own: dict[str, Variable], environment: Environment
    ) -> Variable:
        """Return what stands for a variable that only this `not` knows."""
        if free.count(variable.name) == 1:
            return Variable("_", variable.span)
        if variable.name not in own:
            own[variable.name] = self._fresh_variable(variable.span)
            environment.slot(own[variable.name].name)
        return own[variable.name]

    def _fresh_variable(self, span: Span) -> Variable:
        self._fresh += 1
        return Variable(f"_{self._fresh}'", span)

    def _mode(self, fact: Fact) -> Mode:
        if self._names.of(fact).kind is not Kind.TEMPORARY:
            return Mode.READ
        return Mode.KEEP if fact.mark.value == "$" else Mode.CONSUME

    def _unbound(self, node: object, environment: Environment) -> None:
        for variable in variables(node):
            if not environment.knows(variable.name):
                message = f"nothing in the body binds `{variable.name}`"
                constant = variable.name[0].lower() + variable.name[1:]
                hint = f"did you mean the constant `{constant}`?" if constant in self._symbols else None
                self._found.report("E030", message, variable.span, hint=hint)

    # ---- heads

    def _head(self, part: HeadItem, environment: Environment) -> Fact | Derivation | None:
        match part:
            case Fact():
                return part if self._bound(part, environment) else None
            case Comprehension():
                return self._comprehension(part, environment)
            case Steps() | Aggregate():
                return None

    def _bound(self, fact: Fact, environment: Environment) -> bool:
        for each in walk(fact):
            if isinstance(each, Variable) and each.anonymous:
                self._found.report("E030", "`_` has no value", each.span, hint="name what is derived")
                return False
        self._unbound(fact.arguments, environment)
        return self._all_known_in(fact, environment)

    @staticmethod
    def _all_known_in(fact: Fact, environment: Environment) -> bool:
        return all(environment.knows(each.name) for each in variables(fact.arguments))

    def _comprehension(self, part: Comprehension, environment: Environment) -> Derivation | None:
        inner = Environment(dict(environment.slots), dict(environment.constants), environment.count)
        for index, variable in enumerate(part.variables):
            twice = variable.name in [each.name for each in part.variables[:index]]
            if environment.knows(variable.name) or twice:
                message = f"`{variable.name}` is {'listed twice' if twice else 'bound by the rule already'}"
                hint = "the variables before the `|` are new; choose another name"
                self._found.report("E031", message, variable.span, hint=hint)
                return None
        facts = [each for each in part.body if isinstance(each, Fact)]
        at_home = [self._at_home(fact, self._home_term, "a comprehension") for fact in facts]
        if not all(at_home):
            return None
        return self._derivation(part, environment, inner)

    def _derivation(self, part: Comprehension, environment: Environment, inner: Environment) -> Derivation | None:
        listed = {variable.name for variable in part.variables}
        for each in variables(part.body):
            if each.name not in listed and not environment.knows(each.name):
                message = f"`{each.name}` is neither bound by the rule nor listed"
                hint = f"list it: `{{{part.variables[0].name}, {each.name} | ...`"
                self._found.report("E030", message, each.span, hint=hint)
                return None
        body = self._order(part.body, inner)
        bound = [self._bound(fact, inner) for fact in part.head]
        if body is None or not all(bound):
            return None
        slots = tuple(range(environment.count, inner.count))
        environment.count = inner.count
        return Derivation(slots, body, part.head, inner)


def _same_owner(one: Expression, other: Expression) -> bool:
    if isinstance(one, Variable) and isinstance(other, Variable):
        return one.name == other.name and not one.anonymous
    return isinstance(one, Literal) and isinstance(other, Literal) and one.value == other.value


def _span_of(facts: list[Fact], owner: Expression) -> Span:
    return next(fact.span for fact in facts if fact.owner is owner)


def _is_replaced(conjunct: Conjunct, environment: Environment) -> bool:
    equation = equation_of(conjunct)
    return equation is not None and environment.constants.get(equation[0]) is equation[1]


def _lets(conjunct: Conjunct) -> Iterable[Variable]:
    """Return the variables that `conjunct` might bind."""
    match conjunct:
        case Condition(expression=Binary("=", left, right)):
            return [each for each in (left, right) if isinstance(each, Variable)]
        case _:
            return []

"""Projection: a rule about the ensemble to a rule of one robot.

The positive facts of a body belong to one robot, the rule's home; a rule over several robots is rewritten before
(`ensemble_rules`). The owner becomes slot 0 on the home robot. The rest of
the body is scheduled (`ordering`). Constant propagation: `X = constant` generates no code, the constant replaces X.
The variables of a head must be bound by the body.
"""

from collections.abc import Sequence

from rmr.base.values import Robot
from rmr.bytecode.program import SELF_SLOT, Operator
from rmr.lang.analyse.names import Names, meant
from rmr.lang.analyse.types import Types, constants, fits, literal_type
from rmr.lang.diagnostics.diagnostic import Diagnostics
from rmr.lang.lower.joint_plan import called
from rmr.lang.lower.joint_plan import same_owner as _same_owner
from rmr.lang.lower.ordering import Orderer, all_known, variables
from rmr.lang.lower.robot_rules import (
    SELF,
    Decide,
    Derived,
    Environment,
    Projected,
    RobotAggregate,
    RobotComprehension,
    RobotValue,
    RobotWhen,
)
from rmr.lang.read.syntax import (
    AggregateNode,
    Binary,
    ChoiceNode,
    ComprehensionNode,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    HeadItem,
    Literal,
    PlainHeadItem,
    RuleItem,
    StepsNode,
    Unary,
    Variable,
    walk,
)

OPERATORS = {operator.name.lower(): operator for operator in Operator}
"""Operators of aggregates by their names in the source."""

WINNING = (Operator.MIN, Operator.MAX)
"""Aggregates with a witness: the head may use the variables of the winning match."""


class Projector:
    """Projects the rules of one program."""

    def __init__(self, names: Names, types: Types, symbols: frozenset[str], found: Diagnostics) -> None:
        self._names = names
        self._types = types
        self._found = found
        self._orderer = Orderer(names, symbols, found)
        self._home: Expression | None = None

    def rule(self, rule: RuleItem) -> Projected | None:
        """Return `rule` as the home robot runs it, or None after reporting why it cannot."""
        facts = [each for each in rule.body if isinstance(each, FactNode)]
        positive = [fact for fact in facts if not fact.absent]
        if not positive:
            self._no_facts(rule)
            return None
        environment = Environment()
        homes = self._homes(positive)
        if not homes:
            return None
        self._settle([owner for owner, _ in homes], environment)
        folds = [each for each in rule.body if isinstance(each, FoldNode)]
        at_home = self._are_at_home([fact for fact in facts if fact.absent], "`not`")
        for fold in folds:
            at_home &= self._are_at_home(fold.body, "`not`" if fold.result is None else f"`{fold.operator.text}`")
            at_home &= self._is_simple(fold.body)
        # After an error, too: one pass reports the mistakes of home, body and head together.
        environment.constants.update(self._constants(rule, environment))
        body = self._orderer.order(rule.body, environment)
        head = [each for part in rule.head for each in self._head(part, environment)]
        if not at_home or body is None or None in head:
            return None
        home = self._home
        # A rule of one robot by number runs on all, and its first step fails on the others.
        if isinstance(home, Literal):
            here = Decide(Binary("=", Variable(SELF, home.span), home, home.span))
            body = (here, *body)
        return Projected(rule, environment, body, tuple(part for part in head if part is not None))

    def is_joint(self, rule: RuleItem) -> bool:
        """Whether the facts of a rule's body have several owners; an owner that is no robot is not reported here."""
        owners = [each.owner for each in rule.body if isinstance(each, FactNode) and not each.absent]
        first = owners[0] if owners else None
        good = all(isinstance(owner, Variable | Literal) for owner in owners)
        return good and first is not None and any(o is not None and not _same_owner(first, o) for o in owners[1:])

    def is_bound(self, rule: RuleItem, owners: Sequence[Expression]) -> bool:
        """Whether a rule over several robots, the first its home, binds the variables that it uses; else reported."""
        environment = Environment()
        self._settle(list(owners), environment)
        simple = [self._is_simple(each.body) for each in rule.body if isinstance(each, FoldNode)]
        environment.constants.update(self._constants(rule, environment))
        body = self._orderer.order(rule.body, environment)
        head = [each for part in rule.head for each in self._head(part, environment)]
        return all(simple) and body is not None and None not in head

    def _constants(self, rule: RuleItem, environment: Environment) -> dict[str, Literal]:
        """Return the variables that a constant can replace: it is equated with them and fits the types of all uses."""
        # Where the constant does not fit, the equation stays as a test at run time.
        found = {name: value for name, value in constants(rule.body).items() if not environment.knows(name)}
        for fact in walk(rule) if found else ():
            if not isinstance(fact, FactNode):
                continue
            for argument, cell in zip(fact.arguments, self._types.positions[fact.name.text], strict=False):
                value = found.get(argument.name) if isinstance(argument, Variable) else None
                if isinstance(argument, Variable) and value is not None and not fits(literal_type(value), cell.type):
                    del found[argument.name]
        return found

    def _no_facts(self, rule: RuleItem) -> None:
        span = rule.body[0].span.to(rule.body[-1].span)
        hint = "it would fire at all times; name a fact that must be there"
        self._found.report("E032", "a rule's body needs at least one fact that holds", span, hint=hint)

    # ---- the home robot

    def _homes(self, positive: list[FactNode]) -> list[tuple[Expression, FactNode]]:
        """Return the owners of a body's facts, each with its first fact; empty after an error in one of them."""
        homes: list[tuple[Expression, FactNode]] = []
        for fact in positive:
            owner = fact.owner
            if owner is None:
                return []
            if not isinstance(owner, Variable | Literal):
                self._found.report("E021", "the owner of a fact in a body is a variable or a robot", owner.span)
                return []
            if not any(_same_owner(owner, other) for other, _ in homes):
                homes.append((owner, fact))
        return homes

    def _settle(self, owners: list[Expression], environment: Environment) -> None:
        """Make the first owner the rule's home; give slots to the others, so that they are not reported as unbound."""
        self._home, *others = owners
        if isinstance(self._home, Variable):
            environment.slots[SELF if self._home.anonymous else self._home.name] = SELF_SLOT
        environment.slots[SELF] = SELF_SLOT
        for other in others:
            if isinstance(other, Variable) and not other.anonymous:
                environment.slot(other.name)

    def _is_at_home(self, fact: FactNode, what: str) -> bool:
        home = self._home
        if fact.owner is None or home is None:
            return False
        if _same_owner(fact.owner, home):
            return True
        hint = "another robot's facts are not at hand here"
        if isinstance(home, Variable) or (isinstance(home, Literal) and isinstance(home.value, Robot)):
            hint = f"the rule's home robot is {called(home)}; {hint}"
        hint += self._names.sharing(fact)
        message = f"{what} may name the facts of the rule's home robot only"
        self._found.report("E033", message, fact.span, hint=hint)
        return False

    def _are_at_home(self, body: Sequence[Conjunct], what: str) -> bool:
        at_home = [self._is_at_home(fact, what) for fact in body if isinstance(fact, FactNode)]
        return all(at_home)

    # ---- heads

    def _head(self, part: HeadItem, environment: Environment) -> list[Derived | None]:
        """Return the items that one item of the source becomes; None in the place of one that is reported."""
        if isinstance(part, ChoiceNode):
            return self._choice(part, environment, None)
        return [self._item(part, environment)]

    def _choice(self, choice: ChoiceNode, environment: Environment, outer: Variable | None) -> list[Derived | None]:
        """Return what a choice becomes, which is considered if the value of `outer` is true."""
        for each in walk(choice.condition):
            if isinstance(each, Variable) and each.anonymous:
                self._found.report("E030", "`_` has no value", each.span, hint="name what is compared")
        self._orderer.unbound(choice.condition, environment)
        if not all_known(choice.condition, environment):
            return [None]
        found: list[Derived | None] = []
        holds = self._valued(choice.condition, outer, environment, found)
        self._branch(choice.then, holds, environment, found)
        if choice.otherwise:
            fails = self._valued(Unary("not", holds, choice.span), outer, environment, found)
            self._branch(choice.otherwise, fails, environment, found)
        return found

    def _valued(
        self, condition: Expression, outer: Variable | None, environment: Environment, found: list[Derived | None]
    ) -> Variable:
        """Add a value that is `condition` where `outer` is true and false elsewhere; return its variable."""
        span = condition.span
        variable = self._orderer.fresh_variable(span)
        whole = condition if outer is None else Binary("&&", outer, condition, span)
        found.append(RobotValue(environment.slot(variable.name), whole))
        return variable

    def _branch(
        self, head: tuple[HeadItem, ...], holds: Variable, environment: Environment, found: list[Derived | None]
    ) -> None:
        slot = environment.slots[holds.name]
        for part in head:
            if isinstance(part, ChoiceNode):
                found += self._choice(part, environment, holds)
                continue
            item = self._item(part, environment)
            found.append(None if item is None else RobotWhen(slot, item))

    def _item(
        self, part: PlainHeadItem, environment: Environment
    ) -> FactNode | StepsNode | RobotComprehension | RobotAggregate | None:
        match part:
            case FactNode():
                return part if self._is_bound(part, environment) else None
            case StepsNode(derived=derived):
                bound = [self._is_bound(fact, environment) for fact in derived]
                return part if all(bound) else None
            case ComprehensionNode():
                return self._comprehension(part, environment)
            case AggregateNode():
                return self._aggregate(part, environment)

    def _is_bound(self, fact: FactNode, environment: Environment) -> bool:
        for each in walk(fact):
            if isinstance(each, Variable) and each.anonymous:
                self._found.report("E030", "`_` has no value", each.span, hint="name what is derived")
                return False
        self._orderer.unbound(fact.arguments, environment)
        return all_known(fact.arguments, environment)

    def _is_simple(self, body: Sequence[Conjunct]) -> bool:
        """Whether an inner body has no aggregate and no `not` of several conjuncts; one is reported."""
        for each in body:
            if isinstance(each, FoldNode):
                what = "`not` of several conjuncts" if each.result is None else f"`{each.operator.text}`"
                message = f"{what} stands in the body of a rule only, not in an inner body"
                self._found.report("E036", message, each.span, hint="work it out in the rule's own body")
                return False
        return True

    # ---- comprehensions

    def _comprehension(self, part: ComprehensionNode, environment: Environment) -> RobotComprehension | None:
        for index, variable in enumerate(part.variables):
            twice = variable.name in [each.name for each in part.variables[:index]]
            if environment.knows(variable.name) or twice:
                message = f"`{variable.name}` is {'listed twice' if twice else 'bound by the rule already'}"
                hint = "the variables before the `|` are new; choose another name"
                self._found.report("E031", message, variable.span, hint=hint)
                return None
        if not self._are_at_home(part.body, "a comprehension") or not self._is_simple(part.body):
            return None
        if not self._all_listed(part, environment):
            return None
        inner = environment.inner()
        body = self._orderer.order(part.body, inner)
        bound = [self._is_bound(fact, inner) for fact in part.head]
        if body is None or not all(bound):
            return None
        slots = tuple(range(environment.count, inner.count))
        environment.count = inner.count
        return RobotComprehension(slots, body, part.head, inner)

    def _all_listed(self, part: ComprehensionNode, environment: Environment) -> bool:
        listed = {variable.name for variable in part.variables}
        for each in variables(part.body):
            if each.name not in listed and not environment.knows(each.name):
                message = f"`{each.name}` is neither bound by the rule nor listed"
                hint = f"list it: `{{{part.variables[0].name}, {each.name} | ...`"
                self._found.report("E030", message, each.span, hint=hint)
                return False
        return True

    # ---- aggregates

    def _aggregate(self, part: AggregateNode, environment: Environment) -> RobotAggregate | None:
        operator = self._operator(part)
        at_home = self._are_at_home(part.body, "an aggregate")
        if operator is None or not at_home or not self._is_new(part, environment):
            return None
        if not self._is_simple(part.body):
            return None
        inner = environment.inner()
        body = self._orderer.order(part.body, inner)
        if body is None:
            return None
        slots = tuple(range(environment.count, inner.count))
        self._orderer.unbound(part.term, inner)
        # The result gets a slot behind those of the body even where the head does not see the body's variables.
        head = inner.inner() if operator in WINNING else environment.inner()
        head.count = inner.count
        result = head.slot(part.result.name)
        environment.count = head.count
        good = self._is_gathered(part, inner, head)
        return RobotAggregate(part, result, slots, body, inner, head) if good else None

    def _operator(self, part: AggregateNode) -> Operator | None:
        name = part.operator.text
        operator = OPERATORS.get(name)
        if operator is None:
            hint = meant(name, list(OPERATORS)) or "known are " + ", ".join(f"`{each}`" for each in OPERATORS)
            self._found.report("E015", f"there is no aggregate `{name}`", part.operator.span, hint=hint)
        elif operator is Operator.COUNT and part.term is not None:
            message = "`count` counts matches and has no term"
            hint = f"`[count => {part.result.name} | ...`"
            self._found.report("E011", message, part.term.span, hint=hint)
        elif operator is not Operator.COUNT and part.term is None:
            hint = f"`[{name} X => {part.result.name} | ...`"
            self._found.report("E011", f"`{name}` needs a term", part.operator.span, hint=hint)
        else:
            return operator
        return None

    def _is_new(self, part: AggregateNode, environment: Environment) -> bool:
        result = part.result
        if result.anonymous:
            return True
        inside = [each for each in variables((part.term, part.body)) if each.name == result.name]
        if not environment.knows(result.name) and not inside:
            return True
        where = "by the rule" if not inside else "inside of the aggregate"
        message = f"`{result.name}` is used {where} already"
        hint = "the variable behind `=>` is new; choose another name"
        self._found.report("E031", message, result.span, hint=hint)
        return False

    def _is_gathered(self, part: AggregateNode, inner: Environment, head: Environment) -> bool:
        """Whether the head of an aggregate uses variables in its scope only; others are reported."""
        lost = [each for each in variables(part.head) if inner.knows(each.name) and not head.knows(each.name)]
        for each in lost:
            message = f"`{each.name}` has another value in each match"
            hint = f"the head of `{part.operator.text}` has `{part.result.name}` and the rule's variables"
            self._found.report("E030", message, each.span, hint=hint)
        if lost:
            return False
        bound = [self._is_bound(fact, head) for fact in part.head]
        return all(bound) and all_known(part.term, inner)

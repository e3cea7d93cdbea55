"""Boolean functions as bare conditions: a call alone in a body is a fact, except `member` and the program's functions.

`member(X, L)` and `not member(X, L)` are calls of the function, as users expect, unless the program has facts of that
name: declares, states, derives or watches one. A function of the program is no name of facts.
"""

from collections.abc import Iterable
from dataclasses import replace

from rmr.bytecode.functions import Gives
from rmr.bytecode.program import Operator
from rmr.lang.analyse.types import CALLABLE
from rmr.lang.read.syntax import (
    AggregateNode,
    AssertionItem,
    Binary,
    Call,
    ChoiceNode,
    ComprehensionNode,
    Condition,
    Conjunct,
    ConstantItem,
    Expression,
    FactItem,
    FactNode,
    FoldNode,
    FunctionItem,
    GoalItem,
    HeadItem,
    IncludeItem,
    Item,
    LetTerm,
    ListTerm,
    Literal,
    Mark,
    ModuleNode,
    PlainHeadItem,
    RuleItem,
    StepsNode,
    StrategyItem,
    TypeDeclaration,
    Unary,
    Variable,
    conjunct_of,
    flat,
)

CONDITIONS = tuple(function.name for function in CALLABLE.values() if function.gives is Gives.BOOL)
"""Names of the Boolean functions."""


OPERATORS = frozenset(operator.name.lower() for operator in Operator)
"""Names of the aggregates."""

FRESH = "'"
"""Keeps the variables of aggregates apart from all names of the source."""


def with_conditions(module: ModuleNode) -> ModuleNode:
    """Return `module` with bare calls of Boolean functions turned into conditions, and aggregates in bodies found."""
    known = {name for item in module.items for name in _facts_of(item)}
    own = {item.name.text for item in module.items if isinstance(item, FunctionItem)}
    rewriter = _Rewriter(frozenset(CONDITIONS) - known | own, frozenset(CALLABLE) | own)
    return replace(
        module, items=tuple(rewriter.rule(each) if isinstance(each, RuleItem) else each for each in module.items)
    )


def _facts_of(item: Item) -> Iterable[str]:
    """Return the predicates that `item` declares, states, derives or watches."""
    match item:
        case TypeDeclaration(name=name, effects=effects, else_effects=others):
            return [name.text, *(fact.name.text for fact in (*effects, *others))]
        case FactItem(fact=fact) | GoalItem(fact=fact):
            return [fact.name.text]
        case RuleItem(head=head):
            return [fact.name.text for part in flat(head) for fact in _derived(part)]
        case AssertionItem(start=start, finish=finish):
            return [start.name.text, finish.name.text]
        case ConstantItem() | IncludeItem() | StrategyItem() | FunctionItem():
            return []


def _derived(part: PlainHeadItem) -> tuple[FactNode, ...]:
    match part:
        case StepsNode(derived=facts) | ComprehensionNode(head=facts) | AggregateNode(head=facts):
            return facts
        case FactNode():
            return (part,)


class _Rewriter:
    """Rewrites the bodies of one program."""

    def __init__(self, conditions: frozenset[str], functions: frozenset[str]) -> None:
        self._conditions = conditions
        """Names that are Boolean functions where a call stands alone."""
        self._functions = functions
        """Names that are functions within expressions."""
        self._fresh = 0

    def rule(self, rule: RuleItem) -> RuleItem:
        """Return a rule rewritten, the same object if there is nothing to rewrite."""
        body = self._body(rule.body)
        head = self._head(rule.head)
        return rule if body is rule.body and head is rule.head else replace(rule, body=body, head=head)

    def _head(self, head: tuple[HeadItem, ...]) -> tuple[HeadItem, ...]:
        return tuple(map(self._part, head)) if any(not isinstance(part, FactNode) for part in head) else head

    def _part(self, part: HeadItem) -> HeadItem:
        if isinstance(part, ChoiceNode):
            return replace(part, then=self._head(part.then), otherwise=self._head(part.otherwise))
        if isinstance(part, ComprehensionNode | AggregateNode):
            return replace(part, body=self._body(part.body))
        return part

    def _body(self, body: tuple[Conjunct, ...]) -> tuple[Conjunct, ...]:
        found: list[Conjunct] = []
        for conjunct in body:
            found += self._conjunct(conjunct)
        same = len(found) == len(body) and all(one is other for one, other in zip(found, body, strict=True))
        return body if same else tuple(found)

    def _conjunct(self, conjunct: Conjunct) -> list[Conjunct]:
        """Return what a conjunct becomes, the aggregates in it before the condition that uses their values."""
        if isinstance(conjunct, FoldNode):
            return [replace(conjunct, body=self._body(conjunct.body))]
        if isinstance(conjunct, FactNode):
            return [self._fact(conjunct)]
        folds: list[Conjunct] = []
        expression = self._expression(conjunct.expression, folds)
        return [*folds, Condition(expression, conjunct.span)] if folds else [conjunct]

    def _fact(self, fact: FactNode) -> Conjunct:
        if fact.name.text not in self._conditions or fact.mark is not Mark.NONE:
            return fact
        call = Call(fact.name, fact.arguments, fact.span)
        return Condition(Unary("not", call, fact.span) if fact.absent else call, fact.span)

    def _expression(self, expression: Expression, folds: list[Conjunct]) -> Expression:
        """Return a condition in which variables stand for its aggregates, which are added to `folds`."""
        match expression:
            case Call(name=name) if name.text in OPERATORS and self._is_fold(expression):
                self._fresh += 1
                result = Variable(f"{name.text}{FRESH}{self._fresh}", expression.span)
                arguments = expression.arguments
                term = None if name.text == "count" else arguments[0]
                body = self._body(tuple(map(conjunct_of, arguments if term is None else arguments[1:])))
                folds.append(FoldNode(name, term, body, expression.span, result))
                return result
            case Unary(operand=operand):
                inner = self._expression(operand, folds)
                return expression if inner is operand else replace(expression, operand=inner)
            case Binary(left=left, right=right):
                one = self._expression(left, folds)
                other = self._expression(right, folds)
                same = one is left and other is right
                return expression if same else replace(expression, left=one, right=other)
            case Variable() | Literal() | Call() | ListTerm() | LetTerm():
                return expression

    def _is_fold(self, call: Call) -> bool:
        """Whether a call of the name of an aggregate is one: an argument behind the term is a fact."""
        if call.name.text not in self._functions:
            return bool(call.arguments)
        facts = [each for each in call.arguments[1:] if isinstance(each, Call) and not each.grouped]
        return any(fact.name.text not in self._functions and fact.name.text != "if" for fact in facts)

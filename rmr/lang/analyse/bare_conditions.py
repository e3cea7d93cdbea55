"""Boolean functions as bare conditions: a call alone in a body is a fact, except `member`.

`member(X, L)` and `not member(X, L)` are calls of the function, as users expect, unless the program has facts of that
name: declares, states, derives or watches one.
"""

from collections.abc import Iterable
from dataclasses import replace

from rmr.bytecode.functions import Gives
from rmr.lang.analyse.types import CALLABLE
from rmr.lang.read.syntax import (
    AggregateNode,
    AssertionItem,
    Call,
    ComprehensionNode,
    Condition,
    Conjunct,
    FactItem,
    FactNode,
    GoalItem,
    HeadItem,
    Item,
    Mark,
    ModuleNode,
    RuleItem,
    StepsNode,
    TypeDeclaration,
    Unary,
)

CONDITIONS = tuple(function.name for function in CALLABLE.values() if function.gives is Gives.BOOL)
"""Names of the Boolean functions."""


def with_conditions(module: ModuleNode) -> ModuleNode:
    """Return `module` with bare calls of Boolean functions turned into conditions."""
    known = {name for item in module.items for name in _facts_of(item)}
    functions = frozenset(CONDITIONS) - known
    if not functions:
        return module
    return replace(
        module, items=tuple(_rule(each, functions) if isinstance(each, RuleItem) else each for each in module.items)
    )


def _facts_of(item: Item) -> Iterable[str]:
    """Return the predicates that `item` declares, states, derives or watches."""
    match item:
        case TypeDeclaration(name=name, effects=effects, else_effects=others):
            return [name.text, *(fact.name.text for fact in (*effects, *others))]
        case FactItem(fact=fact) | GoalItem(fact=fact):
            return [fact.name.text]
        case RuleItem(head=head):
            return [fact.name.text for part in head for fact in _derived(part)]
        case AssertionItem(start=start, finish=finish):
            return [start.name.text, finish.name.text]
        case _:
            return []


def _derived(part: HeadItem) -> tuple[FactNode, ...]:
    match part:
        case StepsNode(derived=facts) | ComprehensionNode(head=facts):
            return facts
        case AggregateNode(head=fact):
            return (fact,)
        case FactNode():
            return (part,)


def _rule(rule: RuleItem, functions: frozenset[str]) -> RuleItem:
    head = tuple(
        replace(part, body=_body(part.body, functions)) if isinstance(part, ComprehensionNode | AggregateNode) else part
        for part in rule.head
    )
    return replace(rule, body=_body(rule.body, functions), head=head)


def _body(body: tuple[Conjunct, ...], functions: frozenset[str]) -> tuple[Conjunct, ...]:
    if not any(isinstance(each, FactNode) and each.name.text in functions for each in body):
        return body
    return tuple(_conjunct(each, functions) for each in body)


def _conjunct(conjunct: Conjunct, functions: frozenset[str]) -> Conjunct:
    if not isinstance(conjunct, FactNode) or conjunct.name.text not in functions or conjunct.mark is not Mark.NONE:
        return conjunct
    call = Call(conjunct.name, conjunct.arguments, conjunct.span)
    return Condition(Unary("not", call, conjunct.span) if conjunct.absent else call, conjunct.span)

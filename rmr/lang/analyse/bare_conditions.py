"""Calls that stand alone in a body are facts, but for `member`, which everybody writes as a condition.

So `member(X, L)` and `not member(X, L)` are the function, unless the program has facts of that name: declares,
states, derives or watches one.
"""

from collections.abc import Iterable
from dataclasses import replace

from rmr.lang.read.syntax import (
    Aggregate,
    Assertion,
    Call,
    Comprehension,
    Condition,
    Conjunct,
    Fact,
    FactItem,
    GoalItem,
    HeadItem,
    Item,
    Mark,
    Module,
    Rule,
    Steps,
    TypeDeclaration,
    Unary,
)

CONDITIONS = ("member",)
"""The functions that say yes or no."""


def with_conditions(module: Module) -> Module:
    """Return `module` with the functions that stand alone in bodies as conditions."""
    known = {name for item in module.items for name in _facts_of(item)}
    functions = frozenset(CONDITIONS) - known
    if not functions:
        return module
    return replace(
        module, items=tuple(_rule(each, functions) if isinstance(each, Rule) else each for each in module.items)
    )


def _facts_of(item: Item) -> Iterable[str]:
    """Yield the names of which `item` says that there are facts."""
    match item:
        case TypeDeclaration(name=name, effects=effects, else_effects=others):
            return [name.text, *(fact.name.text for fact in (*effects, *others))]
        case FactItem(fact=fact) | GoalItem(fact=fact):
            return [fact.name.text]
        case Rule(head=head):
            return [fact.name.text for part in head for fact in _derived(part)]
        case Assertion(start=start, finish=finish):
            return [start.name.text, finish.name.text]
        case _:
            return []


def _derived(part: HeadItem) -> tuple[Fact, ...]:
    match part:
        case Steps(derived=facts) | Comprehension(head=facts):
            return facts
        case Aggregate(head=fact):
            return (fact,)
        case Fact():
            return (part,)


def _rule(rule: Rule, functions: frozenset[str]) -> Rule:
    head = tuple(
        replace(part, body=_body(part.body, functions)) if isinstance(part, Comprehension | Aggregate) else part
        for part in rule.head
    )
    return replace(rule, body=_body(rule.body, functions), head=head)


def _body(body: tuple[Conjunct, ...], functions: frozenset[str]) -> tuple[Conjunct, ...]:
    if not any(isinstance(each, Fact) and each.name.text in functions for each in body):
        return body
    return tuple(_conjunct(each, functions) for each in body)


def _conjunct(conjunct: Conjunct, functions: frozenset[str]) -> Conjunct:
    if not isinstance(conjunct, Fact) or conjunct.name.text not in functions or conjunct.mark is not Mark.NONE:
        return conjunct
    call = Call(conjunct.name, conjunct.arguments, conjunct.span)
    return Condition(Unary("not", call, conjunct.span) if conjunct.absent else call, conjunct.span)

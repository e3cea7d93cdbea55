"""Walks over rules: the items that heads derive, and the bodies and expressions in them."""

from collections.abc import Iterable, Iterator

from rmr.bytecode.program import (
    Aggregate,
    Code,
    Comprehension,
    Conjunct,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
    Fold,
    Head,
    HeadValue,
    Rule,
    Steps,
    When,
)


def items(heads: Iterable[Head]) -> Iterator[Derived]:
    """Yield every fact, goal and action that `heads` derive, in the order of the text."""
    for head in heads:
        yield from _of(head)


def inner(heads: Iterable[Head]) -> Iterator[Comprehension | Aggregate]:
    """Yield the comprehensions and aggregates, conditional ones included."""
    for head in heads:
        part = head.item if isinstance(head, When) else head
        if isinstance(part, Comprehension | Aggregate):
            yield part


def folds(body: Iterable[Conjunct]) -> Iterator[Fold]:
    """Yield the folds of a body."""
    return (each for each in body if isinstance(each, Fold))


def bodies(rule: Rule) -> Iterator[tuple[Conjunct, ...]]:
    """Yield the rule's body, those of its folds, and those of its comprehensions and aggregates."""
    yield rule.body
    for fold in folds(rule.body):
        yield fold.body
    for head in inner(rule.head):
        yield head.body


def codes(heads: Iterable[Head]) -> Iterator[Code]:
    """Yield the expressions of `heads`, without those of inner bodies."""
    for head in heads:
        if isinstance(head, HeadValue):
            yield head.code
        for aggregate in inner((head,)):
            if isinstance(aggregate, Aggregate) and aggregate.term is not None:
                yield aggregate.term
        for item in _of(head):
            yield item.owner
            yield from item.args


def _of(head: Head) -> tuple[Derived, ...]:
    match head:
        case Comprehension(head=derived) | Steps(steps=derived) | Aggregate(head=derived):
            return derived
        case When(item=item):
            return _of(item)
        case HeadValue():
            return ()
        case DeriveFact() | DeriveGoal() | DeriveAction():
            return (head,)

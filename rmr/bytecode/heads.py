"""Walks over rule heads: what a rule derives, and what must be matched for each item of it."""

from collections.abc import Iterable, Iterator

from rmr.bytecode.program import Aggregate, Code, Comprehension, Conjunct, Derived, Head, Rule, Steps


def items(heads: Iterable[Head]) -> Iterator[Derived]:
    """Yield every fact, goal and action that `heads` derive, in the order of the text."""
    for head in heads:
        yield from _of(head)


def readings(rule: Rule) -> Iterator[tuple[Derived, tuple[Conjunct, ...]]]:
    """Yield every item that a rule derives with all that must hold for it: the body, and the inner one behind it."""
    for head in rule.head:
        inner = head.body if isinstance(head, Comprehension | Aggregate) else ()
        for item in _of(head):
            yield item, (*rule.body, *inner)


def bodies(rule: Rule) -> Iterator[tuple[Conjunct, ...]]:
    """Yield the rule's body and those of its comprehensions and aggregates."""
    yield rule.body
    for head in rule.head:
        if isinstance(head, Comprehension | Aggregate):
            yield head.body


def codes(heads: Iterable[Head]) -> Iterator[Code]:
    """Yield the expressions of `heads`, without those of inner bodies."""
    for head in heads:
        if isinstance(head, Aggregate) and head.term is not None:
            yield head.term
        for item in _of(head):
            yield item.owner
            yield from item.args


def _of(head: Head) -> tuple[Derived, ...]:
    match head:
        case Comprehension(head=derived) | Steps(steps=derived):
            return derived
        case Aggregate(head=single):
            return (single,)
        case _:
            return (head,)

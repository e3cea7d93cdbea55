"""Walks over rules: the items that heads derive, and the bodies and expressions in them."""

from collections.abc import Iterable, Iterator

from rmr.bytecode.program import Aggregate, Code, Comprehension, Conjunct, Derived, Head, Rule, Steps


def items(heads: Iterable[Head]) -> Iterator[Derived]:
    """Yield every fact, goal and action that `heads` derive, in the order of the text."""
    for head in heads:
        yield from _of(head)


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

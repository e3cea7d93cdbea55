"""The syntax tree. Names mirror the grammar's rules (rmr.lark); every node knows its place."""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from operator import attrgetter
from typing import Any

from rmr.base.record import record
from rmr.base.values import Value
from rmr.lang.read.source_text import Span


@record
class Name:
    """A name and where it stands."""

    text: str
    span: Span


# ---- expressions


@record
class Variable:
    """``R``; a lone ``_`` is anonymous."""

    name: str
    span: Span

    @property
    def anonymous(self) -> bool:
        """Whether it is ``_``, which is another variable at every place."""
        return self.name == "_"


@record
class Literal:
    """A constant: ``3``, ``2.5``, ``500ms``, ``@4``, ``"text"``, ``true``, the symbol ``middle``, or a list of them."""

    value: Value
    span: Span


@record
class Call:
    """``name(arguments)``: a fact where it stands alone, a function inside an expression."""

    name: Name
    arguments: "tuple[Expression, ...]"
    span: Span
    grouped: bool = False
    """In parentheses: a function also where a call alone would be a fact."""


@record
class Unary:
    """``-X`` or ``not X``."""

    operator: str
    operand: "Expression"
    span: Span


@record
class Binary:
    """Two operands and an operator, spelt ``!=`` where the source has ``<>``."""

    operator: str
    left: "Expression"
    right: "Expression"
    span: Span


@record
class ListTerm:
    """``[1, 2]`` or ``[H | T]``."""

    items: "tuple[Expression, ...]"
    rest: "Expression | None"
    span: Span


Expression = Variable | Literal | Call | Unary | Binary | ListTerm


# ---- facts in rules


class Mark(Enum):
    """What stands before a fact."""

    NONE = ""
    BANG = "!"
    KEEP = "$"
    GOAL = "?"


@record
class FactNode:
    """A fact, goal or action as it stands in a body, a head, an effect or an assertion."""

    name: Name
    arguments: tuple[Expression, ...]
    span: Span
    mark: Mark = Mark.NONE
    absent: bool = False
    """``not p(...)``."""

    @property
    def owner(self) -> Expression | None:
        """The first argument."""
        return self.arguments[0] if self.arguments else None


@record
class Condition:
    """A Boolean expression in a body."""

    expression: Expression
    span: Span


Conjunct = FactNode | Condition


@record
class StepsNode:
    """``a(R) then b(R)``; one fact alone is a Fact."""

    derived: tuple[FactNode, ...]
    span: Span


@record
class ComprehensionNode:
    """``{B | edge(A, B) | ready(B, A)}``."""

    variables: tuple[Variable, ...]
    body: tuple[Conjunct, ...]
    head: tuple[FactNode, ...]
    span: Span


@record
class AggregateNode:
    """``[sum T => V | body | head]``."""

    operator: Name
    term: Expression | None
    result: Variable
    body: tuple[Conjunct, ...]
    head: FactNode
    span: Span


HeadItem = FactNode | StepsNode | ComprehensionNode | AggregateNode


# ---- items


@record
class TypeName:
    """``area``, or ``list T`` with T in `element`."""

    name: str
    element: "TypeName | None"
    span: Span


@record
class Parameter:
    """``A: area`` or ``area``."""

    variable: Variable | None
    type: TypeName
    span: Span


class Declared(Enum):
    """What a type declaration declares."""

    TEMPORARY = "temporary"
    PERSISTENT = "persistent"
    SENSED = "sensed"
    ACTION = "action"


@record
class TypeDeclaration:
    """``type p(...)``, ``type !p(...)``, ``type sensor p(...)``, or an action type with its effects."""

    kind: Declared
    name: Name
    parameters: tuple[Parameter, ...]
    span: Span
    effects: tuple[FactNode, ...] = ()
    else_effects: tuple[FactNode, ...] = ()


@record
class ConstantItem:
    """``const total = 4.``"""

    name: Name
    value: Expression
    span: Span


@record
class IncludeItem:
    """``include "formation.rmr".``"""

    path: str
    span: Span


@record
class FactItem:
    """A fact that holds at the start."""

    fact: FactNode
    span: Span


@record
class GoalItem:
    """A goal of the program."""

    fact: FactNode
    span: Span


@record
class RuleItem:
    """``body -o head.``; an empty head is ``1``."""

    body: tuple[Conjunct, ...]
    head: tuple[HeadItem, ...]
    span: Span


@record
class AssertionItem:
    """``name: assert(start, finish, deadline, violation).``, or ``watch(...)``, which is not scheduled."""

    name: Name | None
    scheduled: bool
    start: FactNode
    finish: FactNode
    deadline: Expression
    violation: FactNode
    span: Span


@record
class StrategyItem:
    """``order textual.``"""

    name: Name
    span: Span


Item = TypeDeclaration | ConstantItem | IncludeItem | FactItem | GoalItem | RuleItem | AssertionItem | StrategyItem


@record
class ModuleNode:
    """What a file holds, or several together."""

    items: tuple[Item, ...]
    broken: frozenset[str] = frozenset()
    """The names that stand in items with syntax errors."""
    complete: bool = True
    """All of it has been read."""


_LEAVES = (Span, Name, Name | None, Value, str, bool, Mark, Declared, frozenset[str])
"""Types of slots that hold no nodes, as they are annotated."""

_PARTS: dict[type, tuple[str, ...]] = {}
_INNER: dict[type, Callable[[Any], tuple[object, ...]]] = {}
"""By node class: the function that returns what stands right below a node, last one first."""


def parts(kind: type) -> tuple[str, ...]:
    """Return the slots of a class of nodes that hold nodes; of what is no node, none."""
    if kind not in _PARTS:
        slots = fields(kind) if is_dataclass(kind) and kind not in {Name, Span} else ()
        _PARTS[kind] = tuple(slot.name for slot in slots if slot.type not in _LEAVES)
    return _PARTS[kind]


def _inner(kind: type) -> Callable[[Any], tuple[object, ...]]:
    return _INNER.setdefault(kind, _getter(parts(kind)[::-1]))


def _getter(names: tuple[str, ...]) -> Callable[[Any], tuple[object, ...]]:
    if len(names) > 1:
        return attrgetter(*names)
    return (lambda node: (getattr(node, names[0]),)) if names else (lambda _: ())


def children(node: object) -> tuple[object, ...]:
    """Return what stands right below `node`, in source order: the parts of a tuple, the parts of a node."""
    if type(node) is tuple:
        return node
    kind = type(node)
    return (_INNER.get(kind) or _inner(kind))(node)[::-1]


def walk(root: object) -> Iterator[object]:
    """Yield every node below and including `root` in source order, without recursion; names are no nodes."""
    stack = [root]
    while stack:
        node = stack.pop()
        kind = type(node)
        if kind is tuple:
            stack += node[::-1]  # type: ignore[index]
        elif node is not None:
            yield node
            stack += (_INNER.get(kind) or _inner(kind))(node)

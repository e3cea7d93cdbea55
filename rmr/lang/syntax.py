"""The syntax tree. Names mirror the grammar's rules (rmr.lark); every node knows its place."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum

from rmr.base.values import Value
from rmr.lang.source import Span


@dataclass(frozen=True, slots=True)
class Name:
    """A name and where it stands."""

    text: str
    span: Span


# ---- expressions


@dataclass(frozen=True, slots=True)
class Variable:
    """``R``; a lone ``_`` is anonymous."""

    name: str
    span: Span

    @property
    def anonymous(self) -> bool:
        """Whether it is ``_``, which is another variable at every place."""
        return self.name == "_"


@dataclass(frozen=True, slots=True)
class Literal:
    """A constant: ``3``, ``2.5``, ``500ms``, ``@4``, ``"text"``, ``true``, the symbol ``middle``, or a list of them."""

    value: Value
    span: Span


@dataclass(frozen=True, slots=True)
class Call:
    """``name(arguments)``: a fact where it stands alone, a function inside an expression."""

    name: Name
    arguments: "tuple[Expression, ...]"
    span: Span
    grouped: bool = False
    """In parentheses: a function also where a call alone would be a fact."""


@dataclass(frozen=True, slots=True)
class Unary:
    """``-X`` or ``not X``."""

    operator: str
    operand: "Expression"
    span: Span


@dataclass(frozen=True, slots=True)
class Binary:
    """Two operands and an operator, spelt ``!=`` where the source has ``<>``."""

    operator: str
    left: "Expression"
    right: "Expression"
    span: Span


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class Fact:
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


@dataclass(frozen=True, slots=True)
class Condition:
    """A Boolean expression in a body."""

    expression: Expression
    span: Span


Conjunct = Fact | Condition


@dataclass(frozen=True, slots=True)
class Steps:
    """``a(R) then b(R)``; one fact alone is a Fact."""

    derived: tuple[Fact, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Comprehension:
    """``{B | edge(A, B) | ready(B, A)}``."""

    variables: tuple[Variable, ...]
    body: tuple[Conjunct, ...]
    head: tuple[Fact, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Aggregate:
    """``[sum T => V | body | head]``."""

    operator: Name
    term: Expression | None
    result: Variable
    body: tuple[Conjunct, ...]
    head: Fact
    span: Span


HeadItem = Fact | Steps | Comprehension | Aggregate


# ---- items


@dataclass(frozen=True, slots=True)
class TypeName:
    """``area``, or ``list T`` with T in `element`."""

    name: str
    element: "TypeName | None"
    span: Span


@dataclass(frozen=True, slots=True)
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


@dataclass(frozen=True, slots=True)
class TypeDeclaration:
    """``type p(...)``, ``type !p(...)``, ``type sensor p(...)``, or an action type with its effects."""

    kind: Declared
    name: Name
    parameters: tuple[Parameter, ...]
    span: Span
    effects: tuple[Fact, ...] = ()
    else_effects: tuple[Fact, ...] = ()


@dataclass(frozen=True, slots=True)
class Constant:
    """``const total = 4.``"""

    name: Name
    value: Expression
    span: Span


@dataclass(frozen=True, slots=True)
class Include:
    """``include "formation.rmr".``"""

    path: str
    span: Span


@dataclass(frozen=True, slots=True)
class FactItem:
    """A fact that holds at the start."""

    fact: Fact
    span: Span


@dataclass(frozen=True, slots=True)
class GoalItem:
    """A goal of the program."""

    fact: Fact
    span: Span


@dataclass(frozen=True, slots=True)
class Rule:
    """``body -o head.``; an empty head is ``1``."""

    body: tuple[Conjunct, ...]
    head: tuple[HeadItem, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Assertion:
    """``name: assert(start, finish, deadline, violation).``, or ``watch(...)``, which is not scheduled."""

    name: Name | None
    scheduled: bool
    start: Fact
    finish: Fact
    deadline: Expression
    violation: Fact
    span: Span


@dataclass(frozen=True, slots=True)
class Strategy:
    """``order textual.``"""

    name: Name
    span: Span


Item = TypeDeclaration | Constant | Include | FactItem | GoalItem | Rule | Assertion | Strategy


@dataclass(frozen=True, slots=True)
class Module:
    """What a file holds, or several together."""

    items: tuple[Item, ...]
    broken: frozenset[str] = frozenset()
    """The names that stand in items with syntax errors."""
    complete: bool = True
    """All of it has been read."""


_CHILDREN: dict[type, tuple[str, ...]] = {}
"""By node class: the fields that may hold nodes, last one first."""


def _children(kind: type) -> tuple[str, ...]:
    if kind not in _CHILDREN:
        names = [part.name for part in fields(kind) if part.name != "span"] if is_dataclass(kind) else []
        _CHILDREN[kind] = tuple(reversed(names))
    return _CHILDREN[kind]


def children(node: object) -> Iterator[object]:
    """Yield what stands right below `node`: the parts of a tuple, the fields of a node."""
    yield from node if isinstance(node, tuple) else [getattr(node, name) for name in reversed(_children(type(node)))]


def walk(root: object) -> Iterator[object]:
    """Yield every node below and including `root` in source order, without recursion."""
    stack = [root]
    while stack:
        node = stack.pop()
        if type(node) is tuple:
            stack += reversed(node)
            continue
        children = _children(type(node))
        if children:
            yield node
            stack += [getattr(node, name) for name in children]

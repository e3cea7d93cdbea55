"""The abstract syntax tree. Names mirror the rules of the grammar (rmr.lark); every node has its span."""

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
    """A name with its span."""

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
        """Whether it is ``_``, which is a variable of its own at every occurrence."""
        return self.name == "_"


@record
class Literal:
    """A constant: ``3``, ``2.5``, ``500ms``, ``@4``, ``"text"``, ``true``, the symbol ``middle``, or a list of them."""

    value: Value
    span: Span


@record
class Call:
    """``name(arguments)``: a fact if it stands alone, a function within an expression."""

    name: Name
    arguments: "tuple[Expression, ...]"
    span: Span
    grouped: bool = False
    """True in parentheses: a function, also where a call alone would be a fact."""


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


@record
class Binding:
    """``X = value`` in a let."""

    variable: Variable
    value: "Expression"
    span: Span


@record
class LetTerm:
    """``let X = value, ... in body``; each value may use the variables before it."""

    bindings: tuple[Binding, ...]
    body: "Expression"
    span: Span


Expression = Variable | Literal | Call | Unary | Binary | ListTerm | LetTerm


# ---- facts in rules


class Mark(Enum):
    """The prefix of a fact."""

    NONE = ""
    BANG = "!"
    KEEP = "$"
    GOAL = "?"


@record
class FactNode:
    """A fact, goal or action in a body, a head, an effect or an assertion."""

    name: Name
    arguments: tuple[Expression, ...]
    span: Span
    mark: Mark = Mark.NONE
    absent: bool = False
    """``not p(...)``; in a head ``not ?p(...)``, which withdraws a goal."""

    @property
    def owner(self) -> Expression | None:
        """The first argument."""
        return self.arguments[0] if self.arguments else None


@record
class Condition:
    """A Boolean expression in a body."""

    expression: Expression
    span: Span


@record
class FoldNode:
    """``count(p(R, X), X > 2)`` within a condition, or ``not (p(R, X), X > 2)``.

    Made of calls by `rmr.lang.analyse.bare_conditions`, where it is known which names are functions.
    """

    operator: Name
    term: Expression | None
    body: "tuple[Conjunct, ...]"
    span: Span
    result: Variable | None = None
    """The variable that stands for it in the condition; None for ``not``."""


Conjunct = FactNode | Condition | FoldNode


def conjunct_of(part: Expression) -> Conjunct:
    """Return the conjunct that an expression is where one stands alone."""
    # A call alone is a fact; a call in parentheses, `(f(X))`, is a Boolean function.
    if isinstance(part, Call) and not part.grouped:
        return FactNode(part.name, part.arguments, part.span)
    if isinstance(part, Unary) and part.operator == "not" and isinstance(part.operand, Call):
        call = part.operand
        if not call.grouped:
            return FactNode(call.name, call.arguments, part.span, absent=True)
    return Condition(part, part.span)


@record
class StepsNode:
    """``a(R) then b(R)``, at least two; one alone is a `FactNode`."""

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
    head: tuple[FactNode, ...]
    span: Span


@record
class ChoiceNode:
    """``if condition then head else head end``; without ``else`` the second head is empty."""

    condition: Expression
    then: "tuple[HeadItem, ...]"
    otherwise: "tuple[HeadItem, ...]"
    span: Span


PlainHeadItem = FactNode | StepsNode | ComprehensionNode | AggregateNode
HeadItem = PlainHeadItem | ChoiceNode


def flat(head: "tuple[HeadItem, ...]") -> Iterator[PlainHeadItem]:
    """Yield the items of a head in source order, those of both branches of a choice included."""
    for part in head:
        if isinstance(part, ChoiceNode):
            yield from flat(part.then)
            yield from flat(part.otherwise)
        else:
            yield part


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
    extreme: str = ""
    """``min`` or ``max``: of facts that agree in all arguments before this one only the best is kept."""


class Declared(Enum):
    """The kinds of type declarations."""

    TEMPORARY = "temporary"
    PERSISTENT = "persistent"
    SENSED = "sensed"
    ACTION = "action"


@record
class TypeDeclaration:
    """``type p(...)``, ``type !p(...)``, ``type sensor p(...)``, or an action type with its effects.

    ``unordered`` behind ``type`` marks what may overtake, and be overtaken by, what else is sent to the same robot;
    ``shared`` marks a temporary fact that neighbours know of.
    """

    kind: Declared
    name: Name
    parameters: tuple[Parameter, ...]
    span: Span
    effects: tuple[FactNode, ...] = ()
    else_effects: tuple[FactNode, ...] = ()
    unordered: Span | None = None
    """The place of the token."""
    shared: Span | None = None
    """The place of the token."""


@record
class ConstantItem:
    """``const total = 4.``"""

    name: Name
    value: Expression
    span: Span


@record
class Formal:
    """A parameter of a function: ``X`` or ``X: float``."""

    variable: Variable
    type: TypeName | None
    span: Span


@record
class FunctionItem:
    """``fun dist(X, Y) = hypot(X, Y).``"""

    name: Name
    parameters: tuple[Formal, ...]
    result: TypeName | None
    body: Expression
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


Item = (
    TypeDeclaration
    | ConstantItem
    | IncludeItem
    | FactItem
    | GoalItem
    | RuleItem
    | AssertionItem
    | StrategyItem
    | FunctionItem
)


@record
class ModuleNode:
    """The items of a file, or of several with their includes."""

    items: tuple[Item, ...]
    broken: frozenset[str] = frozenset()
    """Names in items with errors: their declaration may be missing from `items`."""
    complete: bool = True
    """False if the parser gave up before the end of the text."""


_LEAVES = (Span, Name, Name | None, Value, str, bool, Mark, Declared, frozenset[str])
"""Annotations of fields that hold no nodes."""

_PARTS: dict[type, tuple[str, ...]] = {}
"""Cache of `parts`."""
_INNER: dict[type, Callable[[Any], tuple[object, ...]]] = {}
"""Getter of the child nodes by node class, last child first, as `walk` pushes them on its stack."""


def parts(kind: type) -> tuple[str, ...]:
    """Return the names of the fields of a node class that hold nodes; none for any other class."""
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
    """Return the children of a node, or the items of a tuple, in source order."""
    if type(node) is tuple:
        return node
    kind = type(node)
    return (_INNER.get(kind) or _inner(kind))(node)[::-1]


def walk(root: object) -> Iterator[object]:
    """Yield `root` and all nodes below it in source order; names are no nodes."""
    # An explicit stack: generators within generators cost time in proportion to the depth for every node.
    stack = [root]
    while stack:
        node = stack.pop()
        kind = type(node)
        if kind is tuple:
            stack += node[::-1]  # type: ignore[index]
        elif node is not None:
            yield node
            stack += (_INNER.get(kind) or _inner(kind))(node)

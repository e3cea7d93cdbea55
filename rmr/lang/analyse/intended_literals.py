"""Repair of misspelt literals after a contradiction of types, so that one mistake gives one message.

A symbol may be intended as a variable (`location(r, L)`), an int as a robot (`location(4, s)`), a difference of names
as one name (`left-arm`). The item is replaced by its repaired form and types are inferred again. That suppresses
consequences of the mistake and still finds other errors of the same item.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

from rmr.base.values import ROBOT_ID_MAX, Robot, Symbol
from rmr.bytecode.program import Base
from rmr.lang.analyse.types import CALLABLE, Types
from rmr.lang.diagnostics.diagnostic import Diagnostic, Diagnostics, WordHint
from rmr.lang.read.habits import AGGREGATES, aggregate_hint
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    AssertionItem,
    Binary,
    Call,
    Condition,
    Expression,
    FactItem,
    FactNode,
    GoalItem,
    Item,
    LetTerm,
    ListTerm,
    Literal,
    ModuleNode,
    Name,
    RuleItem,
    Unary,
    Variable,
    parts,
    walk,
)

GATHERING = {
    "count": "[count => N | offer(R, _) | many(R, N)]",
    "sum": "[sum X => S | offer(R, X) | total(R, S)]",
    **dict.fromkeys(
        ("findall", "bagof", "setof", "aggregate_all", "collect"), "[collect X => L | offer(R, X) | offers(R, L)]"
    ),
    "forall": "{X | offer(R, X) | told(R, X)}",
}
"""Aggregating calls of other languages, with the equivalent in RMR."""

Change = Callable[[Any], Any]
"""Rewriting function: node to replacement, the same object for no change."""


def intended(module: ModuleNode, types: Types, errors: list[Diagnostic], found: Diagnostics) -> ModuleNode:
    """Return the repaired module and report each repair; `module` itself if no error could be explained."""
    looked_at = [each for each in errors if each.code in {"E015", "E020", "E021", "E022"}]
    if not looked_at:
        return module
    starts = sorted((each.span.file, each.span.start) for each in looked_at)
    noted = {note.span for each in looked_at for note in each.notes}
    wrong = {each.span for each in looked_at} | noted
    reader = _Reader(module, types, wrong, {each.span for each in looked_at if each.code == "E021"}, found)
    noted_starts = sorted((span.file, span.start) for span in noted)
    items: list[Item] = []
    for item in module.items:
        read = reader.item(item) if _has_one(item, starts) or _has_one(item, noted_starts) else item
        items += [read] if read is not None else []
    if not reader.has_changed:
        return module
    return replace(module, items=tuple(items), broken=module.broken | reader.broken)


def _has_one(item: Item, starts: list[tuple[str, int]]) -> bool:
    """Whether one of `starts` lies within an item."""
    index = bisect_left(starts, (item.span.file, item.span.start))
    return index < len(starts) and starts[index] < (item.span.file, item.span.end)


class _Reader:
    """The repairs of the items that have type errors."""

    def __init__(
        self, module: ModuleNode, types: Types, wrong: set[Span], no_robots: set[Span], found: Diagnostics
    ) -> None:
        self._module = module
        self._types = types
        self._wrong = wrong
        """Places of contradictions, and the origins in their notes."""
        self._no_robots = no_robots
        self._found = found
        self._counts: Counter[str] = Counter()
        self.has_changed = False
        self.broken: set[str] = set()
        """Names in dropped items and in repaired names: their declarations may be missing."""

    def item(self, item: Item) -> Item | None:
        """Return the repaired item, the same object for no change; None if it is dropped."""
        if isinstance(item, RuleItem) and self._is_foreign(item):
            self.has_changed = True
            self.broken.update(node.name.text for node in walk(item) if isinstance(node, FactNode | Call))
            return None
        for read in (self._hyphens, self._numbers, self._symbols):
            changed = read(item)
            if changed is not item:
                self.has_changed = True
                item = changed
        return item

    # ---- calls that are neither facts nor functions

    def _is_foreign(self, rule: RuleItem) -> bool:
        """Whether a rule uses a construct of another language; if so, report it."""
        for node in walk(rule):
            match node:
                case FactNode(name=Name(text="if")) if not self._is_declared("if"):
                    if node in rule.head:
                        message = "`if` chooses between values, not between facts"
                        hint = (
                            "write one rule for each case: `load(R, N), N > 2 -o ...` and `load(R, N), N <= 2 -o ...`"
                        )
                    else:
                        message = "`if` is no fact"
                        hint = "a condition stands alone: `load(R, N), N > 2 -o ...`"
                    self._found.report("E012", message, node.span, hint=hint)
                    return True
                case FactNode(name=Name(text=name)) | Call(name=Name(text=name)) if name in GATHERING:
                    if self._is_declared(name):
                        continue
                    hint = f"in a head aggregates stand between brackets: `{GATHERING[name]}`"
                    self._found.report("E015", f"there is no function `{name}`", node.name.span, hint=hint)
                    return True
                case ListTerm(items=[Literal(value=Symbol() as value)], rest=Call(name=called)) if (
                    value in AGGREGATES and called.text not in CALLABLE
                ):
                    message = "an aggregate stands alone in a head, not in a body or among arguments"
                    self._found.report("E001", message, node.span, hint=aggregate_hint(value))
                    return True
                case ListTerm(items=[Variable(name=item), *_], rest=Call(name=called)) if self._is_declared(
                    called.text
                ):
                    hint = f"a head gathers a list: `[collect {item} => L | {called.text}(...) | ...(R, L)]`"
                    self._found.report("E015", f"`{called.text}(...)` is a fact, no list", node.span, hint=hint)
                    return True
        return False

    def _is_declared(self, name: str) -> bool:
        cells = self._types.positions.get(name)
        return cells is not None and name not in {"findall", "forall", "bagof", "setof", "aggregate_all", "if"}

    # ---- names with hyphens

    def _hyphens(self, item: Item) -> Item:
        def change(node: Any) -> Any:
            if isinstance(node, Condition):
                inner = change(node.expression)
                if inner is not node.expression and isinstance(inner, Call):
                    return FactNode(inner.name, inner.arguments, inner.span)
                return node if inner is node.expression else replace(node, expression=inner)
            if not isinstance(node, Binary) or node.operator != "-":
                return node
            left = change(node.left)
            if not _is_name(left) or left.span.end + 1 != node.right.span.start or not self._is_wrong(node):
                return node
            name = f"{left.value}_"
            span = node.left.span.to(node.right.span)
            match node.right:
                case Literal(value=Symbol() as value):
                    self._hyphen(name + value, span)
                    return Literal(Symbol(name + value), span)
                case Call(name=called, arguments=arguments):
                    self._hyphen(name + called.text, node.left.span.to(called.span))
                    return Call(Name(name + called.text, span), arguments, span)
                case Variable() | Literal() | Unary() | Binary() | ListTerm() | LetTerm():
                    return node

        changed: Item = _changed(item, change)
        return changed

    def _hyphen(self, name: str, span: Span) -> None:
        self.broken.add(name)
        self._found.report("E001", "a name has no hyphen", span, hint=f"`{name}`")

    def _is_wrong(self, node: Binary) -> bool:
        return any(getattr(each, "span", None) in self._wrong for each in walk(node))

    # ---- numbers for robots

    def _numbers(self, item: Item) -> Item:
        replaced: list[tuple[int, Span]] = []

        def change(node: Any) -> Any:
            if not isinstance(node, FactNode):
                return node
            cells = self._types.positions.get(node.name.text, ())
            arguments = list(node.arguments)
            before = len(replaced)
            for index, argument in enumerate(arguments):
                is_robot = index < len(cells) and cells[index].kind.base is Base.ROBOT
                number = _robot_number(argument)
                if number is not None and argument.span in self._wrong and (is_robot or index):
                    replaced.append((number, argument.span))
                    arguments[index] = Literal(Robot(number), argument.span)
            return node if len(replaced) == before else replace(node, arguments=tuple(arguments))

        if not any(span in self._wrong for span in self._robot_numbers(item)):
            return item
        changed: Item = _changed(item, change)
        if replaced:
            value, span = replaced[0]
            message = f"`{value}` is a number, where a robot is needed"
            self._found.report(
                "E021", message, span, hint=WordHint(f"robot {value} is written `@{value}`", f"@{value}")
            )
        return changed

    def _robot_numbers(self, item: Item) -> Iterable[Span]:
        """Yield the places of ints in robot positions, and of those reported as no robots."""
        for fact in walk(item):
            if isinstance(fact, FactNode) and (cells := self._types.positions.get(fact.name.text)):
                for argument, cell in zip(fact.arguments, cells, strict=False):
                    is_wanted = cell.kind.base is Base.ROBOT or argument.span in self._no_robots
                    if _robot_number(argument) is not None and is_wanted:
                        yield argument.span

    # ---- symbols for variables

    def _symbols(self, item: Item) -> Item:
        if not isinstance(item, RuleItem | AssertionItem | FactItem | GoalItem):
            return item
        here = [each for each in walk(item) if isinstance(each, Literal) and isinstance(each.value, Symbol)]
        counts = Counter(str(each.value) for each in here)
        variables = {each.name for each in walk(item) if isinstance(each, Variable)}
        compared = {side.span for side in _compared(item, self._wrong)}
        meant: dict[str, Literal] = {}
        for literal in here:
            name = str(literal.value)
            is_robot = literal.span in self._no_robots
            is_doubtful = literal.span in self._wrong | compared and not isinstance(item, FactItem | GoalItem)
            if is_robot or (is_doubtful and (counts[name] > 1 or _capital(name) in variables)):
                meant.setdefault(name, literal)
        if not meant:
            return item
        first = next(iter(meant.values()))
        others = [
            name for name, count in counts.items() if count > 1 and name not in meant and self._is_own(name, count)
        ]
        names = {*meant, *others} if not isinstance(item, FactItem | GoalItem) else set(meant)
        is_robot = any(each.span in self._no_robots for each in meant.values())
        self._report(first, [name for name in counts if name in names], is_robot, item)

        def change(node: Any) -> Any:
            if isinstance(node, Literal) and isinstance(node.value, Symbol) and str(node.value) in names:
                return Variable(_capital(str(node.value)), node.span)
            if isinstance(node, Condition) and isinstance(node.expression, Literal) and node.expression.value is False:
                return replace(node, expression=Literal(True, node.span))  # `l = s` is no comparison of two symbols
            return node

        changed: Item = _changed(item, change)
        return changed

    def _is_own(self, name: str, count: int) -> bool:
        """Whether all `count` occurrences of the symbol are in one item."""
        if not self._counts:
            literals = (each for each in walk(self._module.items) if isinstance(each, Literal))
            self._counts.update(str(each.value) for each in literals if isinstance(each.value, Symbol))
        return self._counts[name] == count

    def _report(self, literal: Literal, names: list[str], is_robot: bool, item: Item) -> None:
        capitals = ", ".join(f"`{_capital(name)}`" for name in names)
        code = "E021" if is_robot else "E020"
        hint = f"variables begin with an upper-case letter: {capitals}"
        if isinstance(item, FactItem | GoalItem):
            hint = "robots are written `@1`; a variable, `R`, is every robot"
        message = f"`{literal.value}` is a symbol, where {'a robot' if is_robot else 'a variable'} is needed"
        self._found.report(code, message, literal.span, hint=hint)


def _is_name(node: object) -> bool:
    return isinstance(node, Literal) and isinstance(node.value, Symbol)


def _robot_number(node: object) -> int | None:
    """Return the value of an int literal in the range of robot ids, else None."""
    value = node.value if isinstance(node, Literal) else None
    return value if type(value) is int and 0 <= value <= ROBOT_ID_MAX else None


def _capital(name: str) -> str:
    return name[0].upper() + name[1:]


def _compared(item: Item, wrong: set[Span]) -> Iterable[Expression]:
    """Yield both sides of the operations reported as contradictions."""
    for node in walk(item):
        if isinstance(node, Binary) and node.span in wrong:
            yield from (node.left, node.right)


def _changed(node: Any, change: Change) -> Any:
    """Return `node` rewritten by `change`, outermost nodes first; a replaced node is not descended into."""
    new = change(node)
    if new is not node:
        return new
    if isinstance(node, tuple):
        mapped = tuple(_changed(each, change) for each in node)
        return mapped if any(one is not other for one, other in zip(mapped, node, strict=True)) else node
    changes = {}
    for name in parts(type(node)):
        part = getattr(node, name)
        if part is not None and (after := _changed(part, change)) is not part:
            changes[name] = after
    return replace(node, **changes) if changes else node

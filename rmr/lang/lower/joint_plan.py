"""A rule over several robots, taken apart: its home, the robots that it asks, and what each is asked for."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from enum import Enum

from rmr.base.record import record
from rmr.lang.read.source_text import Span
from rmr.lang.read.syntax import (
    Binary,
    Condition,
    Conjunct,
    Expression,
    FactNode,
    FoldNode,
    HeadItem,
    ListTerm,
    Literal,
    RuleItem,
    Variable,
    walk,
)


class JointClass(Enum):
    """How the facts of a remote robot are used."""

    TOLD = "told"
    OFFERED = "offered"


@record
class RemotePart:
    """What a rule reads of one remote robot."""

    owner: Variable | Literal
    kind: JointClass
    facts: tuple[FactNode, ...]
    """Its positive atoms."""
    absent: tuple[FactNode, ...]
    link: FactNode | None
    """The atom of the home that names the robot; None for a constant, or if the value is computed."""
    inverted: FactNode | None = None
    """The remote atom that names the home, if nothing at home names the remote."""
    rejected: str = ""
    """Why its facts are not told, if all are persistent."""


@record
class JointPlan:
    """A rule over several robots, taken apart."""

    rule: RuleItem
    """The rule with a name for each anonymous owner."""
    home: Variable | Literal
    facts: tuple[FactNode, ...]
    """The home's positive atoms."""
    absent: tuple[FactNode, ...]
    folds: tuple[FoldNode, ...]
    conditions: tuple[Condition, ...]
    remotes: tuple[RemotePart, ...]
    others: tuple[tuple[str, str], ...] = ()
    """The robots that were not made home, each with the reason."""

    @property
    def told(self) -> list[RemotePart]:
        """The remotes that only tell."""
        return [each for each in self.remotes if each.kind is JointClass.TOLD]

    @property
    def offered(self) -> list[RemotePart]:
        """The remotes that decide."""
        return [each for each in self.remotes if each.kind is JointClass.OFFERED]


def names_in(node: object) -> Iterator[str]:
    """Yield the names of the variables of `node` in the order of the text, each once."""
    return iter(dict.fromkeys(each.name for each in walk(node) if isinstance(each, Variable) and not each.anonymous))


def known_from(facts: Iterable[FactNode], conditions: Iterable[Condition], known: Iterable[str] = ()) -> set[str]:
    """Return the variables that matching `facts`, and then the equations among `conditions`, bind."""
    found = set(known)
    for fact in facts:
        found.update(each.name for each in fact.arguments if isinstance(each, Variable) and not each.anonymous)
        # A list pattern binds what is in it.
        found.update(name for each in fact.arguments if is_pattern(each) for name in names_in(each))
    waiting = [each.expression for each in conditions if isinstance(each.expression, Binary)]
    grown = True
    while grown:
        grown = False
        for equation in waiting:
            if equation.operator != "=":
                continue
            for side, other in ((equation.left, equation.right), (equation.right, equation.left)):
                binds = isinstance(side, Variable) or is_pattern(side)
                new = set(names_in(side)) - found if binds else set()
                if new and set(names_in(other)) <= found:
                    found |= new
                    grown = True
    return found


def is_pattern(argument: Expression) -> bool:
    """Whether an argument is a list pattern, which binds its variables."""
    return isinstance(argument, ListTerm)


def same_owner(one: Expression | None, other: Expression | None) -> bool:
    """Whether two owners are certainly the same robot."""
    if isinstance(one, Variable) and isinstance(other, Variable):
        return one.name == other.name and not one.anonymous
    return isinstance(one, Literal) and isinstance(other, Literal) and one.value == other.value


def called(owner: Expression | None) -> str:
    """Return an owner as diagnostics name it."""
    if isinstance(owner, Literal):
        return f"`{owner.value!r}`"
    return f"`{owner.name}`" if isinstance(owner, Variable) and "'" not in owner.name else "another robot"


def named_owner(owner: Expression | None) -> str | None:
    """Return the name that the source gives an owner; None for a constant or an anonymous one."""
    return owner.name if isinstance(owner, Variable) and not owner.anonymous and "'" not in owner.name else None


def with_named_owners(rule: RuleItem) -> RuleItem:
    """Return the rule with a variable for each anonymous owner of its positive atoms."""
    body: list[Conjunct] = []
    for number, each in enumerate(rule.body):
        owner = each.owner if isinstance(each, FactNode) and not each.absent else None
        if isinstance(each, FactNode) and isinstance(owner, Variable) and owner.anonymous:
            named = Variable(f"_o{number}'", owner.span)
            body.append(replace(each, arguments=(named, *each.arguments[1:])))
        else:
            body.append(each)
    return replace(rule, body=tuple(body))


def owners_of(rule: RuleItem) -> list[Variable | Literal]:
    """Return the owners of the positive atoms of a rule, in the order of the text."""
    owners: list[Variable | Literal] = []
    for fact in rule.body:
        owner = fact.owner if isinstance(fact, FactNode) and not fact.absent else None
        if isinstance(owner, Variable | Literal) and not any(same_owner(owner, other) for other in owners):
            owners.append(owner)
    return owners


def head_at(item: HeadItem, owner: Expression) -> bool:
    """Whether a head item is one fact, goal or action of `owner`."""
    return isinstance(item, FactNode) and same_owner(item.owner, owner)


def start_of(span: Span) -> Span:
    """Return the empty place before `span`, for what the compiler adds: no expression of the source is there."""
    return Span(span.file, span.start, span.start)

"""Explanations as data: trees of facts, goals, actions and messages, each with its cause, and trees of reasons."""

from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, TypeVar

from rmr.base.time import Instant, in_seconds
from rmr.base.values import Value, format_value
from rmr.bytecode.program import Place
from rmr.why.past_ranks import PastRank


@dataclass(slots=True)
class RuleFiring:
    """The firing that derived an item."""

    number: int
    rule: int
    place: Place | None
    bindings: dict[str, Value]
    """Values by the names of variables; ``$1`` for slot 1, whose name is not known."""
    conditions: tuple[str, ...]
    """Conditions and ``not`` of the body, with their values."""
    goals: tuple[str, ...]
    """Goals that it served."""
    rank: int | None
    """Further firings to the nearest of them."""


@dataclass(slots=True)
class WhyNode:
    """One item and what led to it."""

    number: str
    """Of the item, ``17`` or, of another robot than the question's, ``3.17``; ``--more`` takes it."""
    kind: str
    """``fact``, ``goal``, ``action`` or ``message``."""
    text: str
    robot: int
    at: Instant
    cause: str
    """``given``, ``outside``, ``sensed``, ``rule``, ``effect``, ``step``, ``handler``, ``message``, ``undelivered`` or
    ``deadline``."""
    words: str
    """The cause in words."""
    role: str = ""
    """In the body of the rule above: ``consumed``, ``kept`` or ``read``."""
    firing: RuleFiring | None = None
    children: list["WhyNode"] = field(default_factory=list)
    cut: bool = False
    """Whether there is more below that is not shown."""
    above: bool = False
    """Whether the item is explained elsewhere in the same answer."""
    omitted: int = 0
    """Children left out because there are too many."""

    def as_data(self) -> dict[str, Any]:
        """Return the tree for JSON."""
        data: dict[str, Any] = {
            "number": self.number,
            "kind": self.kind,
            "text": self.text,
            "robot": self.robot,
            "at_s": in_seconds(self.at),
            "cause": self.cause,
            "words": self.words,
            "role": self.role or None,
            "rule": None,
            "more": self.cut,
            "shown_elsewhere": self.above,
            "omitted": self.omitted,
            "children": [child.as_data() for child in self.children],
        }
        if self.firing is not None:
            place = self.firing.place
            data["rule"] = {
                "number": self.firing.rule,
                "file": None if place is None else place.file,
                "line": None if place is None else place.line,
                "column": None if place is None else place.column,
                "firing": self.firing.number,
                "bindings": {name: format_value(value) for name, value in self.firing.bindings.items()},
                "conditions": list(self.firing.conditions),
                "goals": list(self.firing.goals),
                "rank": self.firing.rank,
            }
        return data


@dataclass(slots=True)
class AbsenceNode:
    """A reason, and the reasons for it."""

    kind: str
    """``absent``, ``held``, ``rule``, ``satisfied``, ``missing``, ``blocked``, ``false``, ``undecided``, ``action``,
    ``message``, ``sensor``, ``step``, ``deadline``, ``passed over``, ``match``, ``way`` or ``note``."""
    text: str
    children: list["AbsenceNode"] = field(default_factory=list)
    place: tuple[str, int, int] | None = None
    """Of a rule: file, line, column."""
    rank: PastRank | None = None
    """Of a match that was satisfied, or was chosen."""

    def as_data(self) -> dict[str, Any]:
        """Return the tree for JSON."""
        where = None if self.place is None else dict(zip(("file", "line", "column"), self.place, strict=True))
        data: dict[str, Any] = {"kind": self.kind, "text": self.text, "place": where}
        if self.rank is not None:
            data |= {"rank": self.rank.rank, "ranked_by": self.rank.source.value}
        return {**data, "children": [each.as_data() for each in self.children]}


Node = TypeVar("Node", WhyNode, AbsenceNode)


@dataclass(slots=True)
class Answer(Generic[Node]):
    """What matches a question, or the reasons why nothing does."""

    trees_key: ClassVar[str]
    """The key of the trees in JSON."""
    question: str
    at: Instant
    """As of this instant, the end of what is known at the latest."""
    known_until: Instant
    trees: list[Node] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def as_data(self) -> dict[str, Any]:
        """Return the answer for JSON."""
        return {
            "question": self.question,
            "at_s": in_seconds(self.at),
            "known_until_s": in_seconds(self.known_until),
            self.trees_key: [tree.as_data() for tree in self.trees],
            "notes": self.notes,
        }


class WhyAnswer(Answer[WhyNode]):
    """The answer to a question why."""

    __slots__ = ()
    trees_key = "answers"


class AbsenceAnswer(Answer[AbsenceNode]):
    """The answer to a question why not."""

    __slots__ = ()
    trees_key = "absent"

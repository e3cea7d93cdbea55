"""An answer to the question why a fact does not hold, as data: a tree of reasons."""

from dataclasses import dataclass, field
from typing import Any

from rmr.base.time import Instant, in_seconds
from rmr.why.past_ranks import PastRank


@dataclass(slots=True)
class AbsenceNode:
    """A reason, and the reasons for it."""

    kind: str
    """``absent``, ``held``, ``rule``, ``satisfied``, ``missing``, ``blocked``, ``false``, ``undecided``, ``action``,
    ``message``, ``sensor``, ``step``, ``passed over``, ``match``, ``way`` or ``note``."""
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


@dataclass(slots=True)
class AbsenceAnswer:
    """The answer to a question why not."""

    question: str
    at: Instant
    known_until: Instant
    trees: list[AbsenceNode]
    notes: list[str]

    def as_data(self) -> dict[str, Any]:
        """Return the answer for JSON."""
        return {
            "question": self.question,
            "at_s": in_seconds(self.at),
            "known_until_s": in_seconds(self.known_until),
            "absent": [tree.as_data() for tree in self.trees],
            "notes": self.notes,
        }

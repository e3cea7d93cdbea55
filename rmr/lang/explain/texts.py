"""Words for what an explanation speaks of: places, source texts in one line, facts in the program's own names."""

from collections.abc import Mapping
from dataclasses import dataclass

from rmr.analysis.backward_chaining import Patterns
from rmr.base.values import format_value
from rmr.bytecode.program import SELF_SLOT, Constant, Pattern, Predicate, Slot
from rmr.lang.format import one_line
from rmr.lang.lower.robot_rules import Environment, Projected, RobotAggregate, RobotComprehension, inner_parts
from rmr.lang.read.source_text import SourceText, Span


@dataclass(frozen=True, slots=True)
class Spot:
    """Where something stands; line and column count from 1."""

    file: str
    line: int
    column: int


class Texts:
    """The source texts of one program."""

    def __init__(self, sources: Mapping[str, SourceText]) -> None:
        self._sources = sources

    def spot(self, span: Span) -> Spot:
        """Return where `span` begins."""
        return Spot(span.file, *self._sources[span.file].position(span.start))

    def line(self, span: Span) -> str:
        """Return the text of `span` in one line, without comments."""
        return one_line(self._sources[span.file].text[span.start : span.end])


def environments(rule: Projected) -> list[Environment]:
    """Return what knows the variables of a rule: the rule itself and its inner bodies."""
    inner = inner_parts(rule.head)
    return [
        rule.environment,
        *(part.environment for part in inner if isinstance(part, RobotComprehension)),
        *(part.head_environment for part in inner if isinstance(part, RobotAggregate)),
    ]


class PredicateNames:
    """The names of an item's variables by slot."""

    def __init__(self, *environments: Environment) -> None:
        every = [(slot, name) for each in environments for name, slot in each.slots.items()]
        self._names = {slot: name for slot, name in every if name.isidentifier()}

    @property
    def home(self) -> str:
        """The robot that runs the item."""
        return self._names.get(SELF_SLOT, "_")

    def term(self, pattern: Pattern) -> str:
        """Return a term as the program would write it; `_` is anything."""
        if isinstance(pattern, Constant):
            return format_value(pattern.value)
        return self._names.get(pattern.index, "_") if isinstance(pattern, Slot) else "_"

    def fact(self, predicate: Predicate, owner: Pattern, args: Patterns) -> str:
        """Return a fact or an action as the program would write it."""
        return f"{predicate.name}({', '.join(map(self.term, (owner, *args)))})"

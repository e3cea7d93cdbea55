"""Rules of one robot, on the way to code: steps in the order in which they are taken, variables as slots."""

from dataclasses import dataclass, field

from rmr.base.record import record
from rmr.bytecode.program import SELF_SLOT, Mode
from rmr.lang.read import syntax
from rmr.lang.read.syntax import Expression, FactNode, Literal, RuleItem, Variable

SELF = "@"
"""The home robot's name where the rule gives it none."""


@record
class MatchStep:
    """A fact of the home robot; expressions among its arguments have become slots with an equation behind."""

    fact: FactNode
    arguments: tuple[Variable | Literal, ...]
    """Without the owner."""
    mode: Mode


@record
class Decide:
    """A condition that is decided here."""

    expression: Expression


@record
class Let:
    """A variable that gets its value here."""

    name: str
    expression: Expression


Step = MatchStep | Decide | Let


@dataclass(slots=True)
class Environment:
    """What stands for each variable of a rule."""

    slots: dict[str, int] = field(default_factory=dict)
    constants: dict[str, Literal] = field(default_factory=dict)
    count: int = SELF_SLOT + 1
    unbound: set[str] = field(default_factory=set)
    """Variables without value that have been reported; they count as known, so that each is reported once."""

    def slot(self, name: str) -> int:
        """Return the slot of `name`, a new one at its first mention."""
        if name not in self.slots:
            self.slots[name] = self.count
            self.count += 1
        return self.slots[name]

    def knows(self, name: str) -> bool:
        """Whether `name` has a value already."""
        return name in self.slots or name in self.constants or name in self.unbound

    def inner(self) -> "Environment":
        """Return the same for a body within the rule; what it adds is its own."""
        return Environment(dict(self.slots), dict(self.constants), self.count, set(self.unbound))


@record
class RobotComprehension:
    """A comprehension of one robot."""

    slots: tuple[int, ...]
    body: tuple[Step, ...]
    head: tuple[FactNode, ...]
    environment: Environment


@record
class RobotAggregate:
    """An aggregate of one robot."""

    item: syntax.AggregateNode
    result: int
    slots: tuple[int, ...]
    body: tuple[Step, ...]
    environment: Environment
    """Of the body and the term."""
    head_environment: Environment
    """The rule's and the result; the body's too if one match wins."""


Derived = FactNode | syntax.StepsNode | RobotComprehension | RobotAggregate


@record
class Projected:
    """A rule of one robot."""

    rule: RuleItem
    environment: Environment
    body: tuple[Step, ...]
    head: tuple[Derived, ...]

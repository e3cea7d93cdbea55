"""The intermediate form of a robot's rules: steps in the order of execution, variables as slots."""

from dataclasses import dataclass, field

from rmr.base.record import record
from rmr.bytecode.program import SELF_SLOT, Mode
from rmr.lang.read import syntax
from rmr.lang.read.syntax import Expression, FactNode, Literal, RuleItem, Variable

SELF = "@"
"""Name of the home robot in environments; no identifier, so it clashes with no variable."""


@record
class MatchStep:
    """The match of a fact of the home robot; argument expressions are replaced by variables with an equation behind."""

    fact: FactNode
    arguments: tuple[Variable | Literal, ...]
    """The arguments after the owner."""
    mode: Mode


@record
class Decide:
    """The test of a condition whose variables are bound."""

    expression: Expression


@record
class Let:
    """The binding of a variable to an expression whose variables are bound."""

    name: str
    expression: Expression


@record
class Gather:
    """The value that all matches of an inner body are reduced to, or the test that there is none."""

    node: syntax.FoldNode
    result: int
    slots: tuple[int, ...]
    body: "tuple[Step, ...]"
    environment: "Environment"
    """Scope of the inner body and the term."""


Step = MatchStep | Decide | Let | Gather


@dataclass(slots=True)
class Environment:
    """The variables in scope: each has a slot or a constant."""

    slots: dict[str, int] = field(default_factory=dict)
    constants: dict[str, Literal] = field(default_factory=dict)
    count: int = SELF_SLOT + 1
    unbound: set[str] = field(default_factory=set)
    """Unbound variables that have been reported; they count as known, so that each is reported once."""

    def slot(self, name: str) -> int:
        """Return the slot of `name`, a new one at its first mention."""
        if name not in self.slots:
            self.slots[name] = self.count
            self.count += 1
        return self.slots[name]

    def knows(self, name: str) -> bool:
        """Whether `name` is bound, or has been reported as unbound."""
        return name in self.slots or name in self.constants or name in self.unbound

    def inner(self) -> "Environment":
        """Return a copy for an inner body, whose bindings do not leave it."""
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
    """Scope of the body and the term."""
    head_environment: Environment
    """Scope of the head: the rule's variables and the result; for min and max the body's variables as well."""


@record
class RobotValue:
    """A value that the head computes."""

    slot: int
    expression: Expression


@record
class RobotWhen:
    """An item of the head that is left out unless the value in a slot is true."""

    slot: int
    item: "FactNode | syntax.StepsNode | RobotComprehension | RobotAggregate"


Derived = FactNode | syntax.StepsNode | RobotComprehension | RobotAggregate | RobotValue | RobotWhen


def inner_parts(head: "tuple[Derived, ...]") -> "list[RobotComprehension | RobotAggregate]":
    """Return the comprehensions and aggregates of a head, conditional ones included."""
    parts = [part.item if isinstance(part, RobotWhen) else part for part in head]
    return [part for part in parts if isinstance(part, RobotComprehension | RobotAggregate)]


@record
class Projected:
    """A rule of one robot."""

    rule: RuleItem
    environment: Environment
    body: tuple[Step, ...]
    head: tuple[Derived, ...]

"""The program of one robot, decoded: what the compiler hands to the codec and the codec to the virtual machine.

Everything here is immutable and plain. The owner of a fact is not among its arguments: a robot stores only
its own facts, so `location(R, s)` at home is ``(location, (s,))`` and slot 0 of every rule is the robot
itself. All indices (predicates, slots) refer to the tables of the same program.
"""

from dataclasses import dataclass, field
from enum import IntEnum

from rmr.base.record import record
from rmr.base.values import Value
from rmr.bytecode.opcodes import Op

SELF_SLOT = 0
"""The slot that holds the robot which runs the rule."""


class Kind(IntEnum):
    """What a predicate is."""

    TEMPORARY = 0
    PERSISTENT = 1
    SENSED = 2
    ACTION = 3


class Base(IntEnum):
    """The built-in types; a symbol type has a name of its own."""

    OPEN = 0
    """Nothing fixes it; any value."""
    ROBOT = 1
    INT = 2
    FLOAT = 3
    BOOL = 4
    STRING = 5
    SYMBOL = 6
    LIST = 7


@record
class Type:
    """The type of an argument."""

    base: Base
    name: str = ""
    """For SYMBOL: the open set it belongs to (``area``)."""
    element: "Type | None" = None
    """For LIST."""


@record
class Instruction:
    """One instruction; the operand is decoded (for CONST the value itself, for CALL the function's index)."""

    op: Op
    operand: Value | None = None


Code = tuple[Instruction, ...]
"""An expression; it leaves exactly one value."""

SELF: Code = (Instruction(Op.LOAD, SELF_SLOT),)
"""The robot that runs the rule or executes the action."""


class Anything:
    """The pattern of an anonymous variable: matches anything, binds nothing."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "_"


ANY = Anything()


@record
class Slot:
    """A variable in a pattern. Bound already: the argument must equal it. Else: it is bound to the argument."""

    index: int


@record
class Constant:
    """A constant in a pattern."""

    value: Value


Pattern = Anything | Slot | Constant


class Mode(IntEnum):
    """What an atom does with the fact that it matches."""

    CONSUME = 0
    """A temporary fact, taken when the rule fires."""
    READ = 1
    """A persistent or sensed fact."""
    KEEP = 2
    """``$p(...)``: a temporary fact that must be there and stays."""
    ABSENT = 3
    """``not p(...)``: no fact matches."""


@record
class Atom:
    """A fact of the home robot in a rule's body."""

    predicate: int
    args: tuple[Pattern, ...]
    """Without the owner."""
    mode: Mode


@record
class Guard:
    """A Boolean expression that must be true; its slots are bound by what stands before it."""

    code: Code


@record
class Bind:
    """``X = expression`` where nothing else binds X."""

    slot: int
    code: Code


Conjunct = Atom | Guard | Bind
"""The compiler orders them so that each one's variables are bound before it is reached; positive atoms keep
their textual order."""


@record
class DeriveFact:
    """A fact of the head."""

    predicate: int
    owner: Code
    """The robot it belongs to; ``LOAD 0`` stays at home, another robot's is sent there."""
    args: tuple[Code, ...]


@record
class DeriveGoal:
    """``?p(...)`` in a head."""

    predicate: int
    owner: Code
    args: tuple[Code, ...]


@record
class DeriveAction:
    """An action of the head."""

    predicate: int
    owner: Code
    args: tuple[Code, ...]


Derived = DeriveFact | DeriveGoal | DeriveAction
"""What a head derives, one item."""


@record
class Comprehension:
    """``{B | edge(A, B) | ready(B, A)}``: for every match of the body, derive the head."""

    slots: tuple[int, ...]
    """The listed (new) variables."""
    body: tuple[Conjunct, ...]
    head: tuple[Derived, ...]


class Operator(IntEnum):
    """What an aggregate makes of its matches."""

    COUNT = 0
    SUM = 1
    MIN = 2
    MAX = 3
    COLLECT = 4


@record
class Aggregate:
    """``[min D => V | road(A, B, D) | nearest(A, B, V)]``: one value of all matches of the body, one head."""

    operator: Operator
    term: Code | None
    """What is added up, compared or collected, over the rule's slots and the body's; None: COUNT."""
    result: int
    """The slot of V, bound in the head only."""
    slots: tuple[int, ...]
    """The body's new variables; in the head they are bound for MIN and MAX only, to the winning match."""
    body: tuple[Conjunct, ...]
    head: Derived


@record
class Steps:
    """``a(R) then b(R)``: each is derived when the one before it is complete; all arguments are worked out at once."""

    steps: tuple[Derived, ...]
    """At least two."""


Head = Derived | Comprehension | Aggregate | Steps


@record
class Rule:
    """One projected rule."""

    slots: int
    """How many variable slots it needs, slot 0 included."""
    body: tuple[Conjunct, ...]
    head: tuple[Head, ...]


@record
class Effect:
    """A fact that an action's completion inserts. Slots 1.. are the action's arguments without the executor."""

    predicate: int
    args: tuple[Code, ...]
    owner: Code = SELF
    """The robot that gets it: the executor (slot 0) or one that the action names."""


@record
class Predicate:
    """A predicate or an action."""

    name: str
    kind: Kind
    types: tuple[Type, ...]
    """Without the owner (or executor), which is always a robot."""
    provided: bool = False
    """Sensed by every robot without the program's doing: ``at``, ``pose``, ``turn``, ..."""
    effects: tuple[Effect, ...] = ()
    """Actions only: inserted on completion."""
    else_effects: tuple[Effect, ...] = ()
    """Actions only: inserted on failure."""


@record
class InitialFact:
    """A fact that the program states."""

    predicate: int
    owner: int | None
    """None: every robot."""
    args: tuple[Value | Slot, ...]
    """Slot 0 is the robot itself, the only one that stands here."""


@record
class Lead:
    """A rule whose firing may bring a goal nearer (paper, figure 6)."""

    rule: int
    """Index into the rules."""
    rank: int | None
    """How many further firings lead from it to the goal; None: that depends on the instantiation."""


@record
class InitialGoal:
    """A goal that the program states; ANY arguments match anything."""

    predicate: int
    owner: int | None
    args: tuple[Pattern, ...]
    """Slot 0 is the robot itself; any other one is a variable that stands more than once and matches the same."""
    leads: tuple[Lead, ...] | None = None
    """What the compiler found by reasoning backwards, in the rules' order; a rule that is missing never leads there.
    None: not worked out, the virtual machine does it."""


@record
class Serving:
    """An action whose completion leads to an assertion's finish fact (held back until the job has its turn)."""

    action: int
    args: tuple[Pattern, ...]
    """Patterns over the start fact's slots."""


@record
class Assertion:
    """``assert(S, F, D, V)``. Slot 0 is S's robot, where the job lives; S binds slots 1..; F, D and V are over them."""

    name: str
    """As named, else the predicate of F."""
    slots: int
    start: Atom
    finish: Atom
    deadline: Code
    """Seconds after the start, int or float."""
    violation: DeriveAction
    scheduled: bool
    """False for ``watch``."""
    serving: tuple[Serving, ...] = ()
    robot: int | None = None
    """S names this robot, and no other has such jobs; None: every robot has."""
    finisher: Slot | Constant = Slot(SELF_SLOT)
    """F's robot, which reports to the job's: a slot that S binds, or a robot."""


class Strategy(IntEnum):
    """Which of several satisfied rules of equal rank goes first."""

    RANDOM = 0
    TEXTUAL = 1


@record
class Place:
    """Where something stands in the source."""

    file: str
    line: int
    column: int


@record
class Debug:
    """The optional debug section."""

    rules: tuple[Place, ...] = ()
    assertions: tuple[Place, ...] = ()
    predicates: tuple[Place, ...] = ()


@dataclass(frozen=True, slots=True)
class Program:
    """A whole program, one robot's view."""

    predicates: tuple[Predicate, ...]
    facts: tuple[InitialFact, ...] = ()
    goals: tuple[InitialGoal, ...] = ()
    rules: tuple[Rule, ...] = ()
    assertions: tuple[Assertion, ...] = ()
    strategy: Strategy = Strategy.RANDOM
    debug: Debug | None = field(default=None, compare=False)

    def index(self, name: str) -> int | None:
        """Return the index of the predicate or action called `name`, or None."""
        return next((i for i, p in enumerate(self.predicates) if p.name == name), None)

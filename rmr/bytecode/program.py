"""The program of one robot as immutable data: the output of the compiler, the codec and the input of the machine.

The owner of a fact is not among its arguments, because a robot stores only its own facts: `location(R, s)` at home is
``(location, (s,))``, and slot 0 of every rule is the robot itself. All indices (predicates, slots) refer to the tables
of the same program.
"""

from dataclasses import dataclass, field
from enum import IntEnum

from rmr.base.record import record
from rmr.base.values import Value
from rmr.bytecode.opcodes import Op

SELF_SLOT = 0
"""The slot of the robot that runs the rule."""


class Kind(IntEnum):
    """The kinds of predicates, and actions."""

    TEMPORARY = 0
    PERSISTENT = 1
    SENSED = 2
    ACTION = 3


class Base(IntEnum):
    """The built-in types; a symbol type has a name of its own."""

    OPEN = 0
    """An undetermined type: any value."""
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
    """SYMBOL only: the set of symbols (``area``); a set is open, its members are not declared."""
    element: "Type | None" = None
    """LIST only: the type of the items; None if it is undetermined."""


class OwnFunction:
    """A function of the program: an expression over its arguments, which may call functions of the program.

    Instructions refer to it by identity, and functions may call one another in circles, so the code is set once all
    functions are there.
    """

    __slots__ = ("arity", "code", "name")

    def __init__(self, name: str, arity: int, code: "Code" = ()) -> None:
        self.name = name
        """For messages; several may have the same one."""
        self.arity = arity
        self.code = code
        """Slots 0, 1, ... are the arguments."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, OwnFunction):
            return NotImplemented
        # Not the code: functions that call one another would be compared without end.
        return (self.name, self.arity) == (other.name, other.arity)

    def __hash__(self) -> int:
        return self.arity

    def __repr__(self) -> str:
        return f"OwnFunction({self.name!r}, {self.arity})"


@record
class Instruction:
    """One instruction; the operand is decoded (for CONST the value itself, for CALL the function's index)."""

    op: Op
    operand: Value | None = None
    function: OwnFunction | None = None
    """Of APPLY: what `operand` is the index of."""


Code = tuple[Instruction, ...]
"""The code of an expression, in postfix order; it leaves exactly one value on the stack."""

SELF: Code = (Instruction(Op.LOAD, SELF_SLOT),)
"""The expression of the robot that runs the rule or executes the action."""


class Anything:
    """The pattern of an anonymous variable: matches anything, binds nothing."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "_"


ANY = Anything()


@record
class Slot:
    """A variable in a pattern: an equality test if the slot is bound, else a binding to the argument."""

    index: int


@record
class Constant:
    """A constant in a pattern."""

    value: Value


Pattern = Anything | Slot | Constant


class Mode(IntEnum):
    """The use of the fact that an atom matches."""

    CONSUME = 0
    """A temporary fact, removed when the rule fires."""
    READ = 1
    """A persistent or sensed fact, never removed."""
    KEEP = 2
    """``$p(...)``: a temporary fact that is required and not removed."""
    ABSENT = 3
    """``not p(...)``: negation, no fact matches."""


@record
class Atom:
    """The pattern of a fact of the home robot in a rule's body."""

    predicate: int
    args: tuple[Pattern, ...]
    """The arguments after the owner."""
    mode: Mode


@record
class Guard:
    """A Boolean expression that must be true; its slots are bound by earlier conjuncts."""

    code: Code


@record
class Bind:
    """``X = expression``, which binds X; no other conjunct does."""

    slot: int
    code: Code


class Operator(IntEnum):
    """The operators of aggregates."""

    COUNT = 0
    SUM = 1
    MIN = 2
    MAX = 3
    COLLECT = 4


@record
class Fold:
    """``N = count(p(R, X), X > 2)`` in a body: all matches of an inner body reduced to one value, which a slot gets.

    It reads the facts as they stand before the firing, those that the rule consumes included. Of no match MIN and MAX
    have no value, and the conjunct does not hold.
    """

    operator: Operator
    term: Code | None
    """The value of each match; None for COUNT."""
    result: int
    """The slot that gets the value; nothing else binds it."""
    slots: tuple[int, ...]
    """The variables that the inner body binds; nothing else uses them."""
    body: "tuple[Conjunct, ...]"
    """Atoms that consume nothing, guards and bindings."""


Conjunct = Atom | Guard | Bind | Fold
"""One element of a body. The compiler orders them so that variables are bound before they are used; positive atoms
keep their textual order, and folds stand behind all of them."""


@record
class DeriveFact:
    """A fact that a head derives."""

    predicate: int
    owner: Code
    """The robot it belongs to: with ``LOAD 0`` it is stored at home, else it is sent to the owner."""
    args: tuple[Code, ...]


@record
class DeriveGoal:
    """``?p(...)`` in a head: a goal that is derived."""

    predicate: int
    owner: Code
    args: tuple[Code, ...]


@record
class DeriveAction:
    """An action that a head derives."""

    predicate: int
    owner: Code
    args: tuple[Code, ...]


Derived = DeriveFact | DeriveGoal | DeriveAction
"""One item that a head derives."""


@record
class Comprehension:
    """``{B | edge(A, B) | ready(B, A)}``: for every match of the body, derive the head."""

    slots: tuple[int, ...]
    """The variables listed before the bar; the body binds them anew for each match."""
    body: tuple[Conjunct, ...]
    head: tuple[Derived, ...]


@record
class Aggregate:
    """``[min D => V | road(A, B, D) | nearest(A, B, V)]``: all matches of the body reduced to one value."""

    operator: Operator
    term: Code | None
    """The value of each match, over the slots of the rule and of the body; None for COUNT."""
    result: int
    """The slot of the result V, bound in the head only."""
    slots: tuple[int, ...]
    """The variables that the body binds; the head of MIN and MAX sees those of the winning match."""
    body: tuple[Conjunct, ...]
    head: tuple[Derived, ...]
    """What is derived, at least one item."""


@record
class Steps:
    """``a(R) then b(R)``: a sequence, each step derived when the one before it is complete.

    All arguments are evaluated when the rule fires.
    """

    steps: tuple[Derived, ...]
    """The steps, at least two."""


@record
class HeadValue:
    """A value that the head works out: the slot gets it when all items before have been evaluated."""

    slot: int
    code: Code


@record
class When:
    """An item of a head that is left out unless the Boolean in a slot, which a `HeadValue` has bound, is true."""

    slot: int
    item: "Derived | Comprehension | Aggregate | Steps"


Head = Derived | Comprehension | Aggregate | Steps | HeadValue | When


@record
class Rule:
    """One projected rule."""

    slots: int
    """Number of variable slots, slot 0 included."""
    body: tuple[Conjunct, ...]
    head: tuple[Head, ...]


@record
class Effect:
    """A fact that an action's completion inserts. Slots 1.. are the action's arguments without the executor."""

    predicate: int
    args: tuple[Code, ...]
    owner: Code = SELF
    """The robot that gets the fact: the executor (slot 0) or one of the action's arguments."""


@record
class Best:
    """``min`` or ``max`` of a persistent predicate: of facts that agree before an argument, the best is kept.

    The argument decides, and among equal values those behind it in their order (`rmr.vm.aggregate.replaces`).
    """

    argument: int
    """Its place, the owner not counted."""
    least: bool
    """True for ``min``."""


@record
class Predicate:
    """A predicate or an action."""

    name: str
    kind: Kind
    types: tuple[Type, ...]
    """Types of the arguments after the owner (or executor), which is always a robot."""
    provided: bool = False
    """True if the runtime of every robot maintains the predicate: ``at``, ``pose``, ``turn``, ..."""
    effects: tuple[Effect, ...] = ()
    """Actions only: facts inserted on completion."""
    else_effects: tuple[Effect, ...] = ()
    """Actions only: facts inserted on failure."""
    best: Best | None = None
    """Persistent predicates only: which of several facts is kept; None: all."""
    unordered: bool = False
    """What is sent of it may overtake, and be overtaken by, what else goes to the same robot."""


GOALS_OF = "?"
"""First character of the name of a predicate that stands for the open goals of another one: ``?location``.

It is sensed: bodies read it, the machine itself inserts and withdraws its facts, one for each open goal of constants.
A head that derives a goal of it withdraws the goals that such a fact would fulfil (``not ?location(R, a)``)."""


@record
class InitialFact:
    """A fact that holds at the start."""

    predicate: int
    owner: int | None
    """Id of the robot that has the fact; None: every robot."""
    args: tuple[Value | Slot, ...]
    """Values, or slot 0 for the owner itself; no other slot occurs."""


@record
class Lead:
    """A rule whose firing may bring a goal nearer (paper, figure 6)."""

    rule: int
    """Index into the rules."""
    rank: int | None
    """Number of further firings from this rule to the goal; None: it depends on the instantiation."""


@record
class InitialGoal:
    """A goal that holds at the start; ANY arguments are wildcards."""

    predicate: int
    owner: int | None
    """Id of the robot that has the goal; None: every robot."""
    args: tuple[Pattern, ...]
    """Slot 0 is the owner itself; any other slot is a variable with several occurrences, which match equal values."""
    leads: tuple[Lead, ...] | None = None
    """The rules that lead to the goal, by backward chaining at compile time, in their order; a missing rule never does.
    None: not computed, the virtual machine searches at run time."""


@record
class Serving:
    """An action whose completion leads to an assertion's finish fact; it is held back until the job has its turn."""

    action: int
    args: tuple[Pattern, ...]
    """Patterns over the start fact's slots."""


@record
class Assertion:
    """``assert(S, F, D, V)``: start fact, finish fact, deadline, violation.

    Slot 0 is the robot of S, which holds the job. S binds slots 1..; F, D and V use them.
    """

    name: str
    """The stated name, else the predicate of F."""
    slots: int
    start: Atom
    finish: Atom
    deadline: Code
    """Seconds after the start, int or float."""
    violation: DeriveAction | DeriveFact
    """What is derived when the deadline passes without F."""
    scheduled: bool
    """False for ``watch``."""
    serving: tuple[Serving, ...] = ()
    robot: int | None = None
    """Id of the one robot that has such jobs, if S names it; None: every robot."""
    finisher: Slot | Constant = Slot(SELF_SLOT)
    """The owner of F, which reports to the job's robot: a slot that S binds, or a robot."""


class Duty(IntEnum):
    """What the runtime does with a predicate that the compiler has made for a rule over several robots."""

    VIEW = 0
    """Nothing beyond delivering it until it is acknowledged: what one robot tells another of its persistent facts."""
    MESSAGE = 1
    """A delivery takes effect as it arrives, and is repeated for as long as it is not acknowledged."""
    DECISION = 2
    """A message; when it has been acknowledged its sender gets the fact `other`, with the receiver as its first
    argument."""
    ASIDE = 3
    """A fact of `other` that is set aside while a decision is under way; the first argument is the decision's
    number."""
    RETURN = 4
    """An insertion is one of `other`, a fact that comes back: it starts and ends no job and discharges no goal."""
    LIFE = 5
    """Each robot has one such fact from its start: the number of its earlier starts."""
    RESTARTED = 6
    """After a restart a robot has one such fact for each other robot, which is its argument."""
    NOTE = 7
    """Nothing: a robot's own record."""
    HEARD = 8
    """A sensed fact: a neighbour, the first argument, holds such a fact of `other`, as it was last heard to tell."""


REFERRING_DUTIES = (Duty.DECISION, Duty.ASIDE, Duty.RETURN, Duty.HEARD)
"""Duties that name another predicate."""

SENT_DUTIES = (Duty.VIEW, Duty.MESSAGE, Duty.DECISION)
"""Duties of predicates that are repeated until they are acknowledged."""


@record
class HiddenPredicate:
    """A predicate that the compiler has made; no report shows its facts."""

    predicate: int
    duty: Duty
    other: int | None = None
    """DECISION, ASIDE, RETURN and HEARD only: a predicate."""


class Strategy(IntEnum):
    """Conflict resolution: the order of satisfied rules of equal rank."""

    RANDOM = 0
    TEXTUAL = 1
    DEADLINE = 2
    """The job that is due first; among equals drawn, as with `RANDOM`."""


@record
class Place:
    """A position in the source, line and column from 1."""

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
    functions: tuple[OwnFunction, ...] = ()
    ensemble: tuple[HiddenPredicate, ...] = ()
    """What the compiler has made for rules over several robots, in ascending order."""

    def index(self, name: str) -> int | None:
        """Return the index of the predicate or action called `name`, or None."""
        return next((i for i, p in enumerate(self.predicates) if p.name == name), None)

"""A small vocabulary to make programs by hand, without the compiler: ``V(1)`` a variable, names are symbols."""

from dataclasses import dataclass, field

from rmr.base.streams import Choices
from rmr.base.values import Symbol, Value
from rmr.bytecode.functions import FUNCTIONS
from rmr.bytecode.opcodes import Op
from rmr.bytecode.program import (
    ANY,
    Aggregate,
    Anything,
    Assertion,
    Atom,
    Base,
    Bind,
    Code,
    Comprehension,
    Conjunct,
    Constant,
    DeriveAction,
    Derived,
    DeriveFact,
    DeriveGoal,
    Effect,
    Guard,
    Head,
    InitialFact,
    InitialGoal,
    Instruction,
    Kind,
    Mode,
    Operator,
    Pattern,
    Predicate,
    Program,
    Rule,
    Serving,
    Slot,
    Steps,
    Strategy,
    Type,
)
from rmr.vm.engines import Engine, new_machine
from rmr.vm.machine import Machine
from rmr.vm.machine_events import ActionDerived, FactSent, RuleFired, VmEvent

AREA = Type(Base.SYMBOL, "area")
ROBOT = Type(Base.ROBOT)
INT = Type(Base.INT)
FLOAT = Type(Base.FLOAT)
OPEN = Type(Base.OPEN)
_ = ANY

engine = Engine.GENERATED
"""The engine of the machines made here; with ``usefixtures("each_engine")`` a module's tests run once for each."""


@dataclass(frozen=True)
class V:
    """A variable by its slot; V(0) is the robot."""

    slot: int


Arg = V | Value | Anything | Code


def value(item: Value) -> Value:
    return Symbol(item) if type(item) is str else item


def code(*parts: object) -> Code:
    """An expression in postfix: variables, values, opcodes, function names as ``"call:floor"``."""
    out: list[Instruction] = []
    for part in parts:
        if isinstance(part, V):
            out.append(Instruction(Op.LOAD, part.slot))
        elif isinstance(part, Op):
            out.append(Instruction(part))
        elif isinstance(part, Instruction):
            out.append(part)
        elif isinstance(part, str) and part.startswith("call:"):
            names = [function.name for function in FUNCTIONS]
            out.append(Instruction(Op.CALL, names.index(part.removeprefix("call:"))))
        else:
            out.append(Instruction(Op.CONST, value(part)))  # type: ignore[arg-type]
    return tuple(out)


def as_code(item: object) -> Code:
    if isinstance(item, tuple) and item and isinstance(item[0], Instruction):
        return item
    return code(item)


def pattern(item: object) -> Pattern:
    if isinstance(item, V):
        return Slot(item.slot)
    return item if isinstance(item, Anything) else Constant(value(item))  # type: ignore[arg-type]


def guard(*parts: object) -> Guard:
    return Guard(code(*parts))


def bind(variable: V, *parts: object) -> Bind:
    return Bind(variable.slot, code(*parts))


@dataclass
class Hand:
    """A program in the making."""

    predicates: list[Predicate] = field(default_factory=list)
    facts: list[InitialFact] = field(default_factory=list)
    goals: list[InitialGoal] = field(default_factory=list)
    rules: list[Rule] = field(default_factory=list)
    assertions: list[Assertion] = field(default_factory=list)
    textual: bool = False

    def predicate(self, name: str, kind: Kind, *types: Type, **more: object) -> int:
        self.predicates.append(Predicate(name, kind, types, **more))  # type: ignore[arg-type]
        return len(self.predicates) - 1

    def temporary(self, name: str, *types: Type) -> int:
        return self.predicate(name, Kind.TEMPORARY, *types)

    def persistent(self, name: str, *types: Type) -> int:
        return self.predicate(name, Kind.PERSISTENT, *types)

    def sensed(self, name: str, *types: Type, provided: bool = False) -> int:
        return self.predicate(name, Kind.SENSED, *types, provided=provided)

    def action(self, name: str, *types: Type, effects: tuple[Effect, ...] = (), failed: tuple[Effect, ...] = ()) -> int:
        return self.predicate(name, Kind.ACTION, *types, effects=effects, else_effects=failed)

    def fact(self, predicate: int, *args: Value | V, owner: int | None = None) -> None:
        stated = tuple(Slot(arg.slot) if isinstance(arg, V) else value(arg) for arg in args)
        self.facts.append(InitialFact(predicate, owner, stated))

    def goal(self, predicate: int, *args: object, owner: int | None = None) -> None:
        self.goals.append(InitialGoal(predicate, owner, tuple(map(pattern, args))))  # type: ignore[arg-type]

    def atom(self, predicate: int, *args: object, mode: Mode | None = None) -> Atom:
        """An atom that takes what is temporary and reads what is not."""
        usual = Mode.CONSUME if self.predicates[predicate].kind is Kind.TEMPORARY else Mode.READ
        return Atom(predicate, tuple(map(pattern, args)), usual if mode is None else mode)

    def keep(self, predicate: int, *args: object) -> Atom:
        return self.atom(predicate, *args, mode=Mode.KEEP)

    def absent(self, predicate: int, *args: object) -> Atom:
        return self.atom(predicate, *args, mode=Mode.ABSENT)

    def head(self, predicate: int, *args: object, to: object = V(0)) -> DeriveFact | DeriveAction:
        kind = DeriveAction if self.predicates[predicate].kind is Kind.ACTION else DeriveFact
        return kind(predicate, as_code(to), tuple(map(as_code, args)))

    def want(self, predicate: int, *args: object, to: object = V(0)) -> DeriveGoal:
        return DeriveGoal(predicate, as_code(to), tuple(map(as_code, args)))

    def each(self, variables: list[V], body: list[Conjunct], head: list[Derived]) -> Comprehension:
        return Comprehension(tuple(v.slot for v in variables), tuple(body), tuple(head))

    def fold(
        self, operator: Operator, term: object, result: V, body: list[Conjunct], head: Derived, *variables: V
    ) -> Aggregate:
        """``[operator term => result | body | head]``; `term`: None for COUNT; `variables`: the body's new ones."""
        code = None if term is None else as_code(term)
        return Aggregate(operator, code, result.slot, tuple(v.slot for v in variables), tuple(body), (head,))

    def then(self, *steps: Derived) -> Steps:
        return Steps(steps)

    def rule(self, body: list[Conjunct], head: list[Head], slots: int = 8) -> None:
        self.rules.append(Rule(slots, tuple(body), tuple(head)))

    def asserts(
        self,
        start: Atom,
        finish: Atom,
        deadline: object,
        violation: DeriveFact | DeriveAction,
        *,
        name: str = "",
        serving: tuple[Serving, ...] = (),
        scheduled: bool = True,
        robot: int | None = None,
        finisher: object = V(0),
    ) -> None:
        label, by = name or self.predicates[finish.predicate].name, pattern(finisher)
        assert not isinstance(by, Anything)
        self.assertions.append(
            Assertion(label, 8, start, finish, as_code(deadline), violation, scheduled, serving, robot, by)
        )

    def program(self) -> Program:
        return Program(
            tuple(self.predicates),
            tuple(self.facts),
            tuple(self.goals),
            tuple(self.rules),
            tuple(self.assertions),
            Strategy.TEXTUAL if self.textual else Strategy.RANDOM,
        )

    def machine(self, robot: int = 1, seed: int = 0, **more: object) -> Machine:
        """A machine that has started and become quiet at instant 0."""
        return started(self.program(), robot, seed, **more)


def machine_of(program: Program, robot: int = 1, seed: int = 0, **more: object) -> Machine:
    """A machine as it is before it starts."""
    return new_machine(program, robot, Choices(str(seed)), **{"engine": engine, **more})  # type: ignore[arg-type]


def started(program: Program, robot: int = 1, seed: int = 0, **more: object) -> Machine:
    """A machine that has started and become quiet at instant 0."""
    machine = machine_of(program, robot, seed, **more)
    machine.start(0)
    machine.run(0)
    return machine


def fired(events: list[VmEvent]) -> list[int]:
    return [event.rule for event in events if isinstance(event, RuleFired)]


def actions(events: list[VmEvent]) -> list[ActionDerived]:
    return [event for event in events if isinstance(event, ActionDerived)]


def sent(events: list[VmEvent]) -> list[tuple[int, int, tuple[Value, ...]]]:
    return [(e.destination, e.predicate, e.args) for e in events if isinstance(e, FactSent)]

"""Data that depends on the program alone, computed once in a process and shared by all its machines.

A thousand robots of one process may run one program. A machine's own state holds only what has happened to it.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from rmr.base.identity import ByIdentity
from rmr.base.values import Robot, Value
from rmr.bytecode.heads import items
from rmr.bytecode.program import (
    SELF_SLOT,
    Assertion,
    Atom,
    Constant,
    DeriveAction,
    DeriveGoal,
    Duty,
    Effect,
    InitialFact,
    Kind,
    Mode,
    Program,
    Slot,
)
from rmr.bytecode.provided import ROBOT_NUMBER
from rmr.vm.outside import Gate
from rmr.vm.ranks import reading
from rmr.vm.store import Args
from rmr.vm.type_checks import TypeChecks, type_checks

Mine = tuple[tuple[int, Assertion], ...]
"""The time assertions that may have jobs on a robot, with their indices."""


Effects = tuple[tuple[Effect, TypeChecks], ...]
"""Effects of an action, each with its run-time type checks."""


class Affairs(NamedTuple):
    """The time assertions that involve one robot; the same for all robots that none of them names."""

    mine: Mine
    concerned: frozenset[int]
    """The predicates whose facts start or end its jobs."""
    asked: frozenset[int]
    """The predicates for whose facts jobs of other robots may wait."""


class Shared:
    """The shared data of one program."""

    __slots__ = (
        "_affairs",
        "_alike",
        "_effects",
        "_named",
        "_program",
        "_stated",
        "best",
        "count",
        "gate",
        "goal_tables",
        "hidden",
        "life",
        "number",
        "restarted",
        "returns",
        "serving",
        "violations",
        "withdrawals",
    )

    def __init__(self, program: Program) -> None:
        number = program.index(ROBOT_NUMBER)
        self.number = number if number is not None and program.predicates[number].provided else None
        """The index of `ROBOT_NUMBER` if the program uses it: each machine then inserts its own number."""
        self.gate = Gate(program.predicates)
        self.hidden = {each.predicate: each for each in program.ensemble}
        """By predicate: what the compiler has made for rules over several robots."""
        self.life = next((each.predicate for each in program.ensemble if each.duty is Duty.LIFE), None)
        self.count = next((i for i in self.hidden if program.predicates[i].name.startswith("count__")), None)
        """The predicate whose fact each offer of an ensemble rule takes, with its number; None: nothing is offered."""
        self.restarted = next((each.predicate for each in program.ensemble if each.duty is Duty.RESTARTED), None)
        self.returns = {each.predicate: each.other for each in program.ensemble if each.duty is Duty.RETURN}
        """By predicate whose insertions return a fact that was set aside: the predicate of that fact."""
        self.withdrawals = reading(program).goal_tables
        """By predicate that stands for the open goals of another one: that one."""
        self.goal_tables = {index: table for table, index in self.withdrawals.items()}
        """The reverse."""
        self.serving = _serving(program, self.withdrawals) if self.withdrawals else {}
        """By rule that reads goals and derives goals or actions: the places of these goals among the atoms that take a
        fact, with their predicates."""
        self._stated = [(fact, any(isinstance(arg, Slot) for arg in fact.args)) for fact in program.facts]
        """The stated facts, each with whether the robot itself is one of its arguments."""
        alike = all(fact.owner is None and not itself for fact, itself in self._stated)
        self._alike: list[tuple[int, Args]] | None = list(self._each_fact(0)) if alike else None
        """Their predicates and arguments if they are the same for all robots, else None."""
        self._effects = [
            tuple([_effects(effects, program) for effects in (predicate.else_effects, predicate.effects)])
            for predicate in program.predicates
        ]
        """By action: the effects of its failure (index False) and of its completion (index True)."""
        self.violations = [
            (each.violation, type_checks(each.violation, program.predicates)) for each in program.assertions
        ]
        """By time assertion: its violation and the run-time type checks of that."""
        self._affairs = _affairs(program, None)
        self.best = {index: each.best for index, each in enumerate(program.predicates) if each.best is not None}
        """Which facts are kept of the predicates of which only the best is."""
        self._named: dict[int, Affairs | None] = dict.fromkeys(_robots(program))
        """By robot that a time assertion names: its `Affairs`, None until they are first requested."""
        self._program = program

    def affairs(self, robot: Robot) -> Affairs:
        """Return the time assertions that involve `robot`."""
        if robot not in self._named:
            return self._affairs
        affairs = self._named[robot]
        if affairs is None:
            affairs = self._named[robot] = _affairs(self._program, robot)
        return affairs

    def effects(self, action: int, ok: bool) -> Effects:
        """Return the facts that the end of an action inserts; effects on sensed predicates are left to the sensors."""
        return self._effects[action][ok]

    def facts(self, robot: Robot) -> Iterable[tuple[int, Args]]:
        """Return the predicates and arguments of the facts that the program states for `robot`."""
        return self._each_fact(robot) if self._alike is None else self._alike

    def _each_fact(self, robot: int) -> Iterator[tuple[int, Args]]:
        for fact, itself in self._stated:
            if fact.owner is None or fact.owner == robot:
                yield fact.predicate, _args(fact, Robot(robot)) if itself else fact.args  # type: ignore[misc]


shared_of = ByIdentity(Shared)
"""Returns the shared data of a program."""


def _serving(program: Program, bases: Mapping[int, int]) -> dict[int, tuple[tuple[int, int], ...]]:
    found: dict[int, tuple[tuple[int, int], ...]] = {}
    for index, rule in enumerate(program.rules):
        atoms = [each for each in rule.body if isinstance(each, Atom) and each.mode is not Mode.ABSENT]
        read = [(place, bases[each.predicate]) for place, each in enumerate(atoms) if each.predicate in bases]
        if read and any(isinstance(item, DeriveGoal | DeriveAction) for item in items(rule.head)):
            found[index] = tuple(read)
    return found


def _effects(effects: tuple[Effect, ...], program: Program) -> Effects:
    predicates = program.predicates
    derived = [each for each in effects if predicates[each.predicate].kind is not Kind.SENSED]
    return tuple([(each, type_checks(each, predicates)) for each in derived])


def _args(fact: InitialFact, robot: Robot) -> tuple[Value, ...]:
    return tuple([robot if isinstance(arg, Slot) else arg for arg in fact.args])


def _robots(program: Program) -> Iterator[int]:
    """Yield the robots that time assertions name."""
    for assertion in program.assertions:
        if assertion.robot is not None:
            yield assertion.robot
        if isinstance(assertion.finisher, Constant) and type(assertion.finisher.value) is Robot:
            yield assertion.finisher.value


def _affairs(program: Program, robot: int | None) -> Affairs:
    """Return the time assertions that involve a robot; None stands for any robot that they do not name."""
    mine = tuple([(i, each) for i, each in enumerate(program.assertions) if each.robot in (None, robot)])
    return Affairs(
        mine,
        frozenset([atom.predicate for _, each in mine for atom in (each.start, each.finish)]),
        frozenset([each.finish.predicate for each in program.assertions if _may_be_asked(each, robot)]),
    )


def _may_be_asked(assertion: Assertion, robot: int | None) -> bool:
    """Return whether `robot` may own the finish fact of another robot's job."""
    finisher = assertion.finisher
    if isinstance(finisher, Constant):
        return finisher.value == robot and assertion.robot != robot
    return isinstance(finisher, Slot) and finisher.index != SELF_SLOT

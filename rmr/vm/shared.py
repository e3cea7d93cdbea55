"""Data that depends on the program alone, computed once in a process and shared by all its machines.

A thousand robots of one process may run one program. A machine's own state holds only what has happened to it.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from rmr.base.identity import ByIdentity
from rmr.base.values import Robot, Value
from rmr.bytecode.program import SELF_SLOT, Assertion, Constant, Effect, InitialFact, Kind, Program, Slot
from rmr.vm.outside import Gate
from rmr.vm.store import Args
from rmr.vm.type_checks import TypeChecks, type_checks

ROBOT_NUMBER = "id"
"""The provided persistent predicate ``!id(R, N)``."""


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

    __slots__ = ("_affairs", "_alike", "_effects", "_named", "_program", "_stated", "gate", "number", "violations")

    def __init__(self, program: Program) -> None:
        number = program.index(ROBOT_NUMBER)
        self.number = number if number is not None and program.predicates[number].provided else None
        """The index of `ROBOT_NUMBER` if the program uses it: each machine then inserts its own number."""
        self.gate = Gate(program.predicates)
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

"""What a program says to all robots that run it: worked out once in a process.

A thousand robots of one process run one program. What a machine carries for itself is what has happened to it.
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
"""The time assertions of which a robot may have jobs, with their indices."""


Effects = tuple[tuple[Effect, TypeChecks], ...]
"""Effects, each with what its text leaves in check."""


class Affairs(NamedTuple):
    """What one robot has to do with the time assertions; the same for all robots that none of them names."""

    mine: Mine
    concerned: frozenset[int]
    """The predicates whose facts start or end its jobs."""
    asked: frozenset[int]
    """The predicates for whose facts jobs of other robots may wait."""


class Shared:
    """What a program says to all its robots."""

    __slots__ = ("_affairs", "_alike", "_effects", "_named", "_program", "_stated", "gate", "number", "violations")

    def __init__(self, program: Program) -> None:
        number = program.index(ROBOT_NUMBER)
        self.number = number if number is not None and program.predicates[number].provided else None
        """The index of `ROBOT_NUMBER` if robots are to know theirs."""
        self.gate = Gate(program.predicates)
        self._stated = [(fact, any(isinstance(arg, Slot) for arg in fact.args)) for fact in program.facts]
        """The stated facts, each with whether the robot itself stands in it."""
        alike = all(fact.owner is None and not itself for fact, itself in self._stated)
        self._alike: list[tuple[int, Args]] | None = list(self._each_fact(0)) if alike else None
        """Their predicates and arguments if they are the same for all robots, else None."""
        self._effects = [
            tuple([_effects(effects, program) for effects in (predicate.else_effects, predicate.effects)])
            for predicate in program.predicates
        ]
        """What an action's failure inserts, and its completion."""
        self.violations = [
            (each.violation, type_checks(each.violation, program.predicates)) for each in program.assertions
        ]
        """Of the time assertions, with what their texts leave in check."""
        self._affairs = _affairs(program, None)
        self._named: dict[int, Affairs | None] = dict.fromkeys(_robots(program))
        """Those of the robots that time assertions name, once there are such robots in this process."""
        self._program = program

    def affairs(self, robot: Robot) -> Affairs:
        """Return what `robot` has to do with the time assertions."""
        if robot not in self._named:
            return self._affairs
        affairs = self._named[robot]
        if affairs is None:
            affairs = self._named[robot] = _affairs(self._program, robot)
        return affairs

    def effects(self, action: int, ok: bool) -> Effects:
        """Return what the end of an action inserts; facts that are sensed are left to the senses."""
        return self._effects[action][ok]

    def facts(self, robot: Robot) -> Iterable[tuple[int, Args]]:
        """Return the predicates and arguments of the facts that the program states for `robot`."""
        return self._each_fact(robot) if self._alike is None else self._alike

    def _each_fact(self, robot: int) -> Iterator[tuple[int, Args]]:
        for fact, itself in self._stated:
            if fact.owner is None or fact.owner == robot:
                yield fact.predicate, _args(fact, Robot(robot)) if itself else fact.args  # type: ignore[misc]


shared_of = ByIdentity(Shared)
"""Returns what the robots of a program share."""


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
    """Return what a robot has to do with the time assertions; None: one that they do not name."""
    mine = tuple([(i, each) for i, each in enumerate(program.assertions) if each.robot in (None, robot)])
    return Affairs(
        mine,
        frozenset([atom.predicate for _, each in mine for atom in (each.start, each.finish)]),
        frozenset([each.finish.predicate for each in program.assertions if _may_be_asked(each, robot)]),
    )


def _may_be_asked(assertion: Assertion, robot: int | None) -> bool:
    """Tell whether the finish fact may be `robot`'s while the job is another's."""
    finisher = assertion.finisher
    if isinstance(finisher, Constant):
        return finisher.value == robot and assertion.robot != robot
    return isinstance(finisher, Slot) and finisher.index != SELF_SLOT

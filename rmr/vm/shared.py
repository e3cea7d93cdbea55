"""What all robots that run one program know of it alike: worked out once in a process, changed by nobody.

A thousand robots of one process run one program. What a machine carries for itself is what has happened to it.
"""

from collections.abc import Iterator
from typing import NamedTuple

from rmr.base.identity import ByIdentity
from rmr.base.values import Robot, Value
from rmr.bytecode.program import SELF_SLOT, Assertion, Constant, InitialFact, Program, Slot
from rmr.vm.outside import Gate
from rmr.vm.store import Args

ROBOT_NUMBER = "id"
"""The provided persistent predicate ``!id(R, N)``."""


Mine = tuple[tuple[int, Assertion], ...]
"""The time assertions of which a robot may have jobs, with their indices."""


class Affairs(NamedTuple):
    """What one robot has to do with the time assertions; the same for all robots that none of them names."""

    mine: Mine
    concerned: frozenset[int]
    """The predicates whose facts start or end its jobs."""
    asked: frozenset[int]
    """The predicates for whose facts jobs of other robots may wait."""


class Shared:
    """What a program says to all its robots."""

    __slots__ = ("_affairs", "_named", "_stated", "gate", "number")

    def __init__(self, program: Program) -> None:
        number = program.index(ROBOT_NUMBER)
        self.number = number if number is not None and program.predicates[number].provided else None
        """The index of `ROBOT_NUMBER` if robots are to know theirs."""
        self.gate = Gate(program.predicates)
        self._stated = [(fact, any(isinstance(arg, Slot) for arg in fact.args)) for fact in program.facts]
        """The stated facts, each with whether the robot itself stands in it."""
        self._affairs = _affairs(program, None)
        self._named = {robot: _affairs(program, robot) for robot in _robots(program)}

    def affairs(self, robot: Robot) -> Affairs:
        """Return what `robot` has to do with the time assertions."""
        return self._named.get(robot, self._affairs)

    def facts(self, robot: Robot) -> Iterator[tuple[int, Args]]:
        """Yield the predicates and arguments of the facts that the program states for `robot`."""
        for fact, itself in self._stated:
            if fact.owner is None or fact.owner == robot:
                yield fact.predicate, _args(fact, robot) if itself else fact.args  # type: ignore[misc]


shared_of = ByIdentity(Shared)
"""Returns what the robots of a program share."""


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

"""The parts of a machine beside its rules and facts: goals, actions under way, jobs, watches.

Each part is made lazily, with the first thing that it keeps: most robots never need them all, and a process may host
thousands. Data that depends on the program alone is shared (`rmr.vm.shared`).
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable

from rmr.base.time import Instant
from rmr.base.values import Robot
from rmr.bytecode.program import Program
from rmr.vm.assertions import Assertions
from rmr.vm.bounds import Dropped
from rmr.vm.failures import Failures
from rmr.vm.goals import Goals
from rmr.vm.machine_events import VmEvent
from rmr.vm.shared import shared_of
from rmr.vm.store import Args
from rmr.vm.subgoals import Subgoals
from rmr.vm.underway import UnderWay
from rmr.vm.watches import Watches


class Parts(ABC):
    """The parts of one machine. `_any_goals` and the like are None before there has been one."""

    __slots__ = (
        "_affairs",
        "_any_actions",
        "_any_goals",
        "_any_jobs",
        "_any_subgoals",
        "_any_watches",
        "_dropped",
        "_events",
        "_failures",
        "_shared",
        "program",
        "robot",
    )

    def __init__(self, program: Program, robot: int) -> None:
        self.program = program
        self.robot = Robot(robot)
        self._shared = shared_of(program)
        self._affairs = self._shared.affairs(self.robot)
        self._events: list[VmEvent] = []
        self._dropped = Dropped(self._events)
        self._failures = Failures(program, self._events, self._dropped)
        self._any_goals: Goals | None = None
        self._any_actions: UnderWay | None = None
        self._any_jobs: Assertions | None = None
        self._any_watches: Watches | None = None
        self._any_subgoals: Subgoals | None = None

    @abstractmethod
    def each(self, predicate: int) -> Iterable[Args]:
        """Return the arguments of the facts of `predicate` that hold, oldest first."""

    @abstractmethod
    def dated(self, predicate: int) -> Iterable[tuple[Args, Instant]]:
        """Return the same with the instants of their insertion."""

    @property
    def _goals(self) -> Goals:
        if self._any_goals is None:
            self._any_goals = Goals(self.program, self.robot, self, self._events, self._dropped)
        return self._any_goals

    @property
    def _under_way(self) -> UnderWay:
        if self._any_actions is None:
            self._any_actions = UnderWay(self.robot, self._dropped)
        return self._any_actions

    @property
    def _assertions(self) -> Assertions:
        if self._any_jobs is None:
            mine = self._affairs.mine
            self._any_jobs = Assertions(self.program, self.robot, mine, self, self._failures, self._dropped)
        return self._any_jobs

    @property
    def _subgoals(self) -> Subgoals:
        if self._any_subgoals is None:
            self._any_subgoals = Subgoals(self.program, self.robot, self._goals, self._under_way)
        return self._any_subgoals

    @property
    def _watches(self) -> Watches:
        if self._any_watches is None:
            self._any_watches = Watches(self.program, self.robot, self, self._shared, self._dropped)
        return self._any_watches

"""Simulated actions of robots without bodies: an action takes its time, then it completes, or fails (`--fail`).

`wait` takes the seconds of its argument. Every other action takes the time given for its name (`--action-time`), else
the time given for all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rmr.base.time import Duration, in_seconds
from rmr.base.values import Robot, Value
from rmr.bytecode.program import Kind, Program
from rmr.eval.given import Failing
from rmr.node.actions.built_in import FAILURE_REPEATS, wait
from rmr.node.actions.dispatcher import ActionFailed, Handler, RobotHandle
from rmr.node.actions.node_handle import NodeHandle
from rmr.vm.match import pattern_agrees

WAIT = "wait"
"""The provided action whose argument is its duration."""


@dataclass(slots=True)
class FailingCount:
    """A `--fail`, and the number of actions that have matched it."""

    wanted: Failing
    met: int = 0

    def fails(self, action: str, robot: int, args: tuple[Value, ...]) -> bool:
        """Return whether an action that begins will fail."""
        wanted = self.wanted
        if action != wanted.action or not pattern_agrees(wanted.patterns, (Robot(robot), *args)):
            return False
        self.met += 1
        return wanted.number in (None, self.met)


class Acting:
    """The handlers of one run."""

    def __init__(
        self, program: Program, times: Mapping[str, Duration], usual: Duration, failing: Sequence[Failing]
    ) -> None:
        """`times` are those of some actions, `usual` that of the others."""
        self.failing = [FailingCount(each) for each in failing]
        self._times = times
        self._usual = usual
        self.handlers = {each.name: self._handler(each.name) for each in program.predicates if each.kind is Kind.ACTION}

    @property
    def longest(self) -> Duration:
        """The longest time that is given for an action."""
        return max([self._usual, *self._times.values()])

    def _handler(self, name: str) -> Handler:
        async def perform(robot: NodeHandle, *args: Value) -> None:
            fails = [each for each in self.failing if each.fails(name, robot.id, args)]
            if name == "broadcast":
                for _copy in range(FAILURE_REPEATS):
                    robot.node.broadcast_failure(robot.missed)
            await self._pass_time(robot, name, args)
            if fails:
                raise ActionFailed(f"--fail {fails[0].wanted.text}")

        known = name != WAIT or name in self._times  # else its argument says
        return Handler(name, perform, takes=self._times.get(name, self._usual) if known else None)

    async def _pass_time(self, robot: RobotHandle, name: str, args: tuple[Value, ...]) -> None:
        if name == WAIT and name not in self._times and len(args) == 1 and isinstance(args[0], float):
            await wait(robot, args[0])
            return
        duration = self._times.get(name, self._usual)
        if duration:
            await robot.sleep(in_seconds(duration))

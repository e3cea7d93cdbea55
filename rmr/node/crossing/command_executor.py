"""Carries out the commands that crossings return: what concerns the schedule, and what concerns the robot alone."""

from collections.abc import Sequence

from rmr.base.time import Instant
from rmr.coord.coordination import Coordination
from rmr.coord.events import JobRequest
from rmr.node.crossing.crossing import Crossing
from rmr.node.crossing.crossing_table import gate_of
from rmr.node.crossing.destination import Destinations
from rmr.node.crossing.situation import (
    ChangeRank,
    Command,
    InsideUntil,
    Leave,
    OpenHoldLine,
    Revise,
    RobotCommand,
    SetReady,
    TraceEntry,
    Unforeseen,
    Withdraw,
)
from rmr.node.parts import CrossingHost


class CommandExecutor:
    """Carries out commands for one robot."""

    def __init__(self, robot: CrossingHost, core: Coordination, destinations: Destinations) -> None:
        self._robot = robot
        self._core = core
        self._destinations = destinations

    def execute(self, now: Instant, crossing: Crossing, commands: Sequence[Command]) -> None:
        """Carry out what a crossing orders: nothing else tells the coordination core of it."""
        core = self._core
        group_id = crossing.group_id
        for command in commands:
            match command:
                case SetReady(ready=ready):
                    core.ready(now, group_id, ready)
                case InsideUntil(end=end):
                    core.inside_until(now, group_id, end)
                case Revise(release=release, deadline=deadline, committed=committed):
                    core.revise(now, group_id, release=release, deadline=deadline, underway=committed)
                case JobRequest():
                    core.trigger(now, command)
                case Withdraw():
                    core.withdraw(now, group_id)
                case Leave():
                    core.leave(now, group_id)
                    # A drive that goes on asks at the next entrance, and may lead through none: it is bound to this
                    # passage no longer. One that was let in by the turn of an event asks for no other.
                    if crossing.plan.gated and self._robot.config.arena.has_shared_passages:
                        self._here(now, crossing, crossing.hold_line())
                case OpenHoldLine() | ChangeRank() | TraceEntry() | Unforeseen():
                    self._here(now, crossing, command)

    def _here(self, now: Instant, crossing: Crossing, command: RobotCommand) -> None:
        """Carry out what concerns the robot alone."""
        robot = self._robot
        driver = robot.driver
        match command:
            case OpenHoldLine(opens_at=opens_at, opened=opened, passage=passage):
                if driver is not None and gate_of(robot.driving) is crossing:
                    driver.navigator.gate(opens_at, opened, passage)
            case ChangeRank():
                self._destinations.rank_changed(now, crossing)
            case TraceEntry(what=what, fields=fields):
                robot.trace(now, what, **fields)
            case Unforeseen():
                robot.tell(command)

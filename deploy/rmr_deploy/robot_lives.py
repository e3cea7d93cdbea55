"""The processes of a run's robots: which robot lives, what became of one that does not, and what `rmr ps` is told.

A robot lives while its process runs, while it is about to be started again, or after a process that somebody
has started by hand has taken its place: that one counts from its liveliness token on, but is no child of the launcher.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any

from rmr_deploy.preparation import RunPlan
from rmr_deploy.process_group import Child, how
from rmr_deploy.run_outcome import RunOutcome
from rmr_deploy.screen import RobotLine
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world.quorum import DIED, Fate


class RobotLives:
    """The present process of each robot of one run."""

    def __init__(self, roster: Sequence[int], outcome: RunOutcome, will_start: Callable[[int], bool]) -> None:
        """`will_start` tells whether a robot whose process has ended is about to be started again."""
        self._roster = roster
        self._outcome = outcome
        self._will_start = will_start
        self.children: dict[int, Child] = {}
        """The newest process that the launcher has started for each robot."""
        self.returned: set[int] = set()
        """Robots whose process has ended and whose place a process that was started by hand has taken."""

    def of(self, child: Child) -> list[int]:
        """Return the robots whose process is `child`."""
        return [robot for robot, one in self.children.items() if one is child]

    def lives(self, robot: int) -> bool:
        """Whether `robot` is there, or will be."""
        return self._is_there(robot) or self._will_start(robot)

    def living(self) -> list[int]:
        """Return the robots that are there, or will be."""
        return [robot for robot in self._roster if self.lives(robot)]

    def lost(self) -> dict[int, Fate]:
        """Return what became of the robots that do not live and will not."""
        return {robot: self._fate(robot) for robot in self._roster if not self.lives(robot)}

    def absent(self) -> dict[int, Fate]:
        """Return what became of the robots that are not there now."""
        return {robot: self._fate(robot) for robot in self._roster if not self._is_there(robot)}

    def replaced(self) -> dict[str, Fate]:
        """Return what became of the processes that ended and whose robots live again, or will."""
        lost = {self.children[robot].name for robot in self.lost()}
        return {name: self._outcome.fate(name) for name in sorted(self._outcome.ended) if name not in lost}

    def _is_there(self, robot: int) -> bool:
        child = self.children.get(robot)  # none before the processes of its host are started
        return child is None or child.name not in self._outcome.ended or robot in self.returned

    def _fate(self, robot: int) -> Fate:
        return self._outcome.fate(self.children[robot].name)

    def line(self, robot: int, monitor: StatusMonitor | None) -> RobotLine:
        """Return what is shown of `robot`: what it says of itself, or how its process ended."""
        if self.lives(robot):
            return RobotLine(robot, *(("starting", "") if monitor is None else monitor.line(robot)))
        fate = self._fate(robot)
        return RobotLine(robot, fate, how(self.children[robot].exit_code()) if fate == DIED else "")

    def note_returned(self, monitor: StatusMonitor, note: Callable[[str, int, str], None]) -> None:
        """Take note of robots that were started by hand, and of those of them that have left.

        `note` is called with the event of the event log, the robot and a sentence.
        """
        for robot, child in self.children.items():
            here = child.name in self._outcome.ended and robot in monitor.present
            if here and robot not in self.returned:
                self.returned.add(robot)
                note("robot_back", robot, f"robot {robot} is back: another process has taken its place")
            elif robot in self.returned and not here:
                self.returned.discard(robot)
                note("robot_left", robot, f"robot {robot} has left again")
                monitor.retire(robot, monitor.fate(robot))


# --- what the launcher tells on request


def told_status(
    plan: RunPlan,
    children: Sequence[Child],
    lives: RobotLives,
    monitor: StatusMonitor | None,
    *,
    paused: Sequence[str],
    ready_s: float | None,
) -> dict[str, Any]:
    """Return the state of a run as plain data; `paused` are the names of the processes that are stopped for a while.

    `ready_s` is how long after the launcher's beginning all robots were ready; None before. In the data, `processes`
    has every process that was started, `robots` each robot of the lab with its present process.
    """
    running = monitor is not None and monitor.running(plan.lab.roster)
    return {
        "lab": plan.lab.name,
        "ready_s": ready_s,
        "time_s": round(monitor.now_s, 3) if monitor is not None and running else None,
        "processes": [_process(child, child.name in paused) for child in children],
        "robots": [_robot(robot, lives, monitor) for robot in plan.robots if robot in lives.children],
    }


def _process(child: Child, is_paused: bool) -> dict[str, Any]:
    code = child.exit_code()
    state = "ended" if code is not None else "paused" if is_paused else "running"
    return {
        "name": child.name,
        "pid": child.pid,
        "state": state,
        "exit_code": code,
        "up_s": round(time.monotonic() - child.began_s, 1) if code is None else None,
    }


def _robot(robot: int, lives: RobotLives, monitor: StatusMonitor | None) -> dict[str, Any]:
    child = lives.children[robot]
    _, state, progress, _ = lives.line(robot, monitor)
    if lives.lives(robot) and child.exit_code() is not None and (monitor is None or robot not in monitor.present):
        state, progress = "restarting", ""  # and nobody has started it by hand
    number = child.name.partition(".")[2]
    return {
        "robot": robot,
        "process": child.name,
        "state": state,
        "progress": progress,
        "restarts": int(number or 0),
        "ticks_late": None if monitor is None else monitor.report(robot).get("ticks_late"),
    }


def told_facts(monitor: StatusMonitor | None, robot: object) -> dict[str, Any] | str:
    """Return what `robot` holds, as it said last; a sentence if it is not known."""
    if monitor is None or type(robot) is not int:
        return "no robot has said what it holds yet"
    part = monitor.report(robot) or next(reversed(monitor.past(robot)), {})
    if not part:
        return f"robot {robot} has not said what it holds yet"
    if "facts" in part.get("left_out", ()):
        return f"robot {robot} holds more facts than fit a message"
    return {"facts": part.get("facts", []), "goals": part.get("goals", {})}

"""What the launcher tells of a run on request: its processes, and how the robots are. `rmr ps` shows it."""

import time
from collections.abc import Sequence
from typing import Any

from rmr_deploy.preparation import RunPlan
from rmr_deploy.process_group import Child
from rmr_deploy.robot_lives import RobotLives
from rmr_deploy.status_monitor import StatusMonitor


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
        "robots": [_robot(robot, lives, monitor) for robot in plan.lab.roster],
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
    _, state, progress = lives.line(robot, monitor)
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

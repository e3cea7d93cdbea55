"""What the launcher tells of a run on request: its processes, and how the robots are. `rmr ps` shows it."""

import time
from collections.abc import Mapping, Sequence
from typing import Any

from rmr_deploy.preparation import RunPlan
from rmr_deploy.process_group import Child, how
from rmr_deploy.status_monitor import StatusMonitor


def told_status(
    plan: RunPlan,
    children: Sequence[Child],
    robots: Mapping[int, Child],
    monitor: StatusMonitor | None,
    *,
    living: Sequence[int],
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
        "robots": [_robot(robot, robots[robot], monitor, robot in living) for robot in plan.lab.roster],
    }


def ended(child: Child) -> tuple[str, str]:
    """Return the state of a robot whose process has ended, and how; on request it ends without an error."""
    code = child.exit_code()
    return ("died", how(code)) if code else ("stopped", "")


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


def _robot(robot: int, child: Child, monitor: StatusMonitor | None, lives: bool) -> dict[str, Any]:
    state = ("starting", "") if monitor is None else monitor.line(robot)
    if not lives:
        state = ended(child)
    elif child.exit_code() is not None:  # it is about to be started again, or somebody has started it by hand
        state = ("restarting", "") if monitor is None or robot not in monitor.present else state
    number = child.name.partition(".")[2]
    return {
        "robot": robot,
        "process": child.name,
        "state": state[0],
        "progress": state[1],
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

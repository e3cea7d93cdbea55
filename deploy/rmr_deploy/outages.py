"""Outages of the localisation service, on request: the launcher asks the world, which holds the sensors."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from rmr.base.time import seconds
from rmr_deploy.run_requests import FAULT_S_MAX
from rmr_deploy.status_monitor import StatusMonitor


def ask_outage(
    monitor: StatusMonitor | None, roster: Sequence[int], request: Mapping[str, Any], entries: list[dict[str, Any]]
) -> str:
    """Let a robot hear no beacon for a while, and note it in `entries`; return why that is refused, or nothing."""
    robot = request.get("robot")
    for_s = request.get("for_s")
    if type(robot) is not int or robot not in roster:
        return "there is no such robot in this run"
    if not isinstance(for_s, int | float) or not (isfinite(for_s) and 0.0 < for_s <= FAULT_S_MAX):
        return f"an outage lasts up to {FAULT_S_MAX:g} s"
    if monitor is None or not monitor.running(roster):
        return "lab time does not run yet"
    now_s = round(monitor.now_s, 3)
    monitor.silence(robot, monitor.now + seconds(for_s))
    entries.append({"from": now_s, "to": round(now_s + for_s, 3), "outage": robot})
    return ""

"""The report of a run of processes: what each robot and the world said last, in the form that all modes share.

A robot that died has its last known part, a world that died leaves the last truth that it told; of whom nothing
was ever heard the report says that nothing was done. Times are lab time, except `wall_s` and `ready_s`.
"""

from collections.abc import Mapping
from typing import Any

from rmr_deploy.launch import Outcome
from rmr_deploy.preparation import Plan
from rmr_deploy.status_monitor import Watch
from rmr_world.faults import befallen
from rmr_world.lives import cut_short, of_all_lives
from rmr_world.report import assemble


def make_report(plan: Plan, outcome: Outcome, watch: Watch | None) -> dict[str, Any]:
    """Return the report of a run that is over; `watch` is None when nobody was ever heard."""
    parts = {robot: _part(watch, robot) if watch else {} for robot in plan.lab.roster}
    buses = [part.pop("bus", {}) for part in parts.values()]
    for part in parts.values():
        part.pop("log_cut_short", None)  # for people (`Watch.cut_logs`)
    report = assemble(
        plan.lab,
        mode="processes",
        seed=plan.lab.seed,
        finished=outcome.finished,
        time_s=time_s(parts, outcome, watch),
        wall_s=outcome.wall_s,
        robots=parts,
        truth=truth(watch),
        bus_lost=sum(bus.get("lost", 0) for bus in buses),
    )
    added = watch.world.report.get("faults", ()) if watch and watch.world else ()
    report["faults"] = befallen(plan.lab, added, watch.now_s if watch else 0.0)
    ready_s = None if outcome.ready_s is None else round(outcome.ready_s, 3)
    return {**report, "ready_s": ready_s, "reason": outcome.reason, "died": outcome.died}


def _part(watch: Watch, robot: int) -> dict[str, Any]:
    """Return a robot's part over all of its lives; of one that died and did not return, what it told last."""
    past = [cut_short(part) for part in watch.past(robot)]
    present = watch.report(robot)
    if not present and past:
        present = past.pop()
    return of_all_lives(past, present)


def time_s(parts: Mapping[int, Mapping[str, Any]], outcome: Outcome, watch: Watch | None) -> float:
    """Return lab seconds from the first tick to the last robot's finish, or to the end of a run without one."""
    finishes = [part.get("finish_s") for part in parts.values()]
    if outcome.finished and finishes and None not in finishes:
        return float(max(finish for finish in finishes if finish is not None))
    return watch.now_s if watch else 0.0


def truth(watch: Watch | None) -> dict[str, Any]:
    """Return what the world saw, as the report wants it; empty when it told nothing."""
    told = watch.truth if watch else None
    if told is None:
        return {}
    ways = {robot: distance_m for robot, _x, _y, _theta, distance_m in told.robots}
    return {"collisions": told.collisions, "min_gap_m": told.min_gap_m, "distance_m": ways}

"""From the lab file's words to what goes wrong, and back: faults of robots, disturbances of the radio.

`radio.links` and `radio.partition` hold for the whole run, those `faults` that concern the radio from one instant
to another; all become `rmr.radio.links.Disturbance`. What befalls robots are values of their own.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.radio.links import Disturbance, partition
from rmr_world.document import Path_
from rmr_world.lab import Fault, Kill, Lab, Outage, Restart, Slow, Stall
from rmr_world.schema import FaultSpec, LinkSpec, RadioSpec


def standing(radio: RadioSpec) -> Iterator[tuple[Path_, Disturbance]]:
    """Yield the disturbances that hold for the whole run, each with where its robots stand in the file."""
    for i, spec in enumerate(radio.links):
        yield ("radio", "links", i, "link"), _harm(spec)
    if radio.partition is not None:
        yield ("radio", "partition"), partition(radio.partition)


def passing(spec: FaultSpec, path: Path_, roster: Sequence[int]) -> Iterator[tuple[Path_, Fault | Disturbance]]:
    """Yield what the fault at `path` is, each with where its robots stand in the file."""
    start, end = spec.from_ or 0, spec.to or NEVER
    if spec.kill is not None:
        yield path, Kill(spec.at or 0, spec.kill)
    elif spec.restart is not None:
        yield path, Restart(spec.at or 0, spec.restart)
    elif spec.stall is not None:
        yield path, Stall(start, end, spec.stall)
    elif spec.slow is not None:
        yield path, Slow(start, end, spec.slow, spec.every or 0)
    elif spec.outage is not None:
        yield from (((*path, "outage"), Outage(start, end, robot)) for robot in spec.outage or roster)
    elif spec.partition is not None:
        yield (*path, "partition"), partition(spec.partition, start, end)
    else:
        yield (*path, "link"), _harm(spec)._replace(since=start, until=end)


def deaths(found: Iterable[tuple[Path_, Fault]]) -> Iterator[tuple[Path_, str]]:
    """Yield where a robot is killed that is dead, or started again while it lives, and a complaint about it."""
    dead: set[int] = set()
    turns = [(path, fault) for path, fault in found if isinstance(fault, Kill | Restart)]
    for path, fault in sorted(turns, key=lambda turn: turn[1].at):
        robot, at = fault.robot, f"at {in_seconds(fault.at):g} s"
        if isinstance(fault, Restart):
            if robot not in dead:
                yield path, f"robot {robot} lives {at}: kill it before it is started again"
            dead.discard(robot)
        elif robot in dead:
            yield path, f"robot {robot} is dead {at}: start it again before it is killed once more"
        else:
            dead.add(robot)


def _harm(spec: LinkSpec | FaultSpec) -> Disturbance:
    """Return what `spec` does to its link, or to all links, for ever."""
    groups = tuple((robot,) for robot in spec.link or ())
    attenuation_db = inf if spec.cut else spec.attenuation_db or 0.0
    return Disturbance(groups=groups, one_way=spec.one_way, loss=spec.loss or 0.0, attenuation_db=attenuation_db)


def told(lab: Lab) -> list[dict[str, Any]]:
    """Return the faults of `lab` by their beginning, each as it may stand in a lab file, times in seconds.

    What is wrong with the radio for the whole run is not among them: it stands under ``radio`` there.
    """
    passing = [disturbance for disturbance in lab.disturbances if disturbance.until < NEVER]
    numbered = sorted((_start(fault), i, fault) for i, fault in enumerate((*lab.faults, *passing)))
    return [entry(fault) for _, _, fault in numbered]


def lines(lab: Lab) -> list[str]:
    """Return what `told` tells as lines that may stand under ``faults:`` in a lab file."""
    return [f"- {line(fault)}" for fault in told(lab)]


def ended(lab: Lab) -> list[str]:
    """Return the faults that begin when the lab's duration is over, each as it may stand in a lab file."""
    end_s = in_seconds(lab.duration)
    return [line(fault) for fault in told(lab) if (fault["at"] if "at" in fault else fault["from"]) > end_s]


def line(fault: Mapping[str, Any]) -> str:
    """Return an entry of `told` as one line of a lab file."""
    return "{" + ", ".join(f"{key}: {json.dumps(value)}" for key, value in fault.items()) + "}"


def _start(fault: Fault | Disturbance) -> Instant:
    match fault:
        case Kill(at=at) | Restart(at=at):
            return at
        case Disturbance(since=since):
            return since
        case _:
            return fault.start


def entry(fault: Fault | Disturbance) -> dict[str, Any]:
    """Return a fault as it may stand in a lab file, times in seconds; `to` is left out of one without an end."""
    match fault:
        case Kill(at=at, robot=robot):
            return {"at": in_seconds(at), "kill": robot}
        case Restart(at=at, robot=robot):
            return {"at": in_seconds(at), "restart": robot}
        case Stall(robot=robot):
            what: dict[str, Any] = {"stall": robot}
        case Slow(robot=robot, every=every):
            what = {"slow": robot, "every": in_seconds(every)}
        case Outage(robot=robot):
            what = {"outage": robot}
        case Disturbance():
            end = {} if fault.until >= NEVER else {"to": in_seconds(fault.until)}
            return {"from": in_seconds(fault.since), **end, **_told_harm(fault)}
    return {"from": in_seconds(fault.start), "to": in_seconds(fault.end), **what}


def befallen(lab: Lab, added: Iterable[Mapping[str, Any]], end_s: float) -> list[dict[str, Any]]:
    """Return the faults of a run of processes: those of the lab file that concern the radio, and what was `added`.

    `added` are entries by `rmr fault`; one that nobody has ended lasted until the run's end, `end_s` of lab time.
    """
    ended = [
        {"from": round(fault["from"], 3), "to": round(max(fault["from"], min(fault.get("to", end_s), end_s)), 3)}
        | {key: value for key, value in fault.items() if key not in {"from", "to"}}
        for fault in added
    ]
    return sorted([*told(replace(lab, faults=())), *ended], key=lambda fault: float(fault["from"]))


def _told_harm(harm: Disturbance) -> dict[str, Any]:
    if len(harm.groups) > 2 or any(len(group) > 1 for group in harm.groups):
        return {"partition": [list(group) for group in harm.groups]}
    where: dict[str, Any] = {"link": [robot for (robot,) in harm.groups]} if harm.groups else {}
    if harm.one_way:
        where["one_way"] = True
    if harm.attenuation_db == inf:
        return {**where, "cut": True}
    return {**where, **({"loss": harm.loss} if harm.loss else {"attenuation_db": harm.attenuation_db})}

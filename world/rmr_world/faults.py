"""Faults as entries of a lab file, for reports, logs, and the list that `rmr sim --chaos` prints; and the way back.

An entry is a mapping with times in seconds that may be written under ``faults:`` of a lab file.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, Any

from rmr.base.time import NEVER, Instant, in_seconds
from rmr.radio.links import Disturbance, deafened, muted, partition
from rmr_world.finding import FilePath
from rmr_world.lab import Fault, Kill, Lab, Outage, Restart, Slow, Stall

if TYPE_CHECKING:
    from rmr_world.schema import FaultSpec, LinkSpec, RadioSpec


def fault_entries(lab: Lab) -> list[dict[str, Any]]:
    """Return the entries of all faults of `lab`, ordered by their beginning.

    Disturbances that hold for the whole run are left out: a lab file states them under ``radio``.
    """
    timed = [disturbance for disturbance in lab.disturbances if disturbance.until < NEVER]
    numbered = sorted((_start(fault), i, fault) for i, fault in enumerate((*lab.faults, *timed)))
    return [fault_entry(fault, lab.roster) for _, _, fault in numbered]


def fault_lines(lab: Lab) -> list[str]:
    """Return the entries of `lab` as lines of YAML, each an item of the list ``faults``."""
    return [f"- {fault_line(entry)}" for entry in fault_entries(lab)]


def faults_after_end(lab: Lab) -> list[str]:
    """Return the entries, as YAML, of the faults that begin after the lab's duration."""
    end_s = in_seconds(lab.duration)
    entries = fault_entries(lab)
    return [fault_line(entry) for entry in entries if (entry["at"] if "at" in entry else entry["from"]) > end_s]


def fault_line(entry: Mapping[str, Any]) -> str:
    """Return an entry as one line of YAML."""
    return "{" + ", ".join(f"{key}: {json.dumps(value)}" for key, value in entry.items()) + "}"


def fault_entry(fault: Fault | Disturbance, roster: Sequence[int] = ()) -> dict[str, Any]:
    """Return the entry of a fault; a disturbance without an end has no ``to``.

    With the `roster` of the lab a robot that is mute or deaf is told as such, else as a partition that is one way.
    """
    match fault:
        case Kill(at=at, robot=robot):
            return {"at": in_seconds(at), "kill": robot}
        case Restart(at=at, robot=robot):
            return {"at": in_seconds(at), "restart": robot}
        case Stall(robot=robot):
            effect: dict[str, Any] = {"stall": robot}
        case Slow(robot=robot, every=every):
            effect = {"slow": robot, "every": in_seconds(every)}
        case Outage(robot=robot):
            effect = {"outage": robot}
        case Disturbance():
            end = {} if fault.until >= NEVER else {"to": in_seconds(fault.until)}
            return {"from": in_seconds(fault.since), **end, **_disturbance_effect(fault, roster)}
    return {"from": in_seconds(fault.start), "to": in_seconds(fault.end), **effect}


def _partition_effect(disturbance: Disturbance) -> dict[str, Any]:
    one_way = {"one_way": True} if disturbance.one_way else {}
    return {"partition": [list(group) for group in disturbance.groups], **one_way}


def _mute_or_deaf(disturbance: Disturbance, roster: Sequence[int]) -> dict[str, Any]:
    """Return the effect of a one-way cut between one robot and all others of `roster`; empty for any other."""
    if not disturbance.one_way or disturbance.attenuation_db != inf or len(disturbance.groups) != 2:
        return {}
    for word, (alone, others) in (("mute", disturbance.groups), ("deaf", disturbance.groups[::-1])):
        if len(alone) == 1 and {*alone, *others} == {*roster}:
            return {word: alone[0]}
    return {}


def process_run_faults(lab: Lab, added: Iterable[Mapping[str, Any]], end_s: float) -> list[dict[str, Any]]:
    """Return the entries of a run of processes: the disturbances of the lab file and those that were `added`.

    `added` are the entries of `rmr fault`. One without an end lasted until the end of the run, `end_s` of lab time.
    Faults of robots are left out, for processes do not perform them.
    """
    ended = [
        {"from": round(entry["from"], 3), "to": round(max(entry["from"], min(entry.get("to", end_s), end_s)), 3)}
        | {key: value for key, value in entry.items() if key not in {"from", "to"}}
        for entry in added
    ]
    return sorted([*fault_entries(replace(lab, faults=())), *ended], key=lambda entry: float(entry["from"]))


def _start(fault: Fault | Disturbance) -> Instant:
    match fault:
        case Kill(at=at) | Restart(at=at):
            return at
        case Disturbance(since=since):
            return since
        case Stall() | Slow() | Outage():
            return fault.start


def _disturbance_effect(disturbance: Disturbance, roster: Sequence[int]) -> dict[str, Any]:
    """Return the keys of an entry that say which links are disturbed, and how."""
    groups = disturbance.groups
    if len(groups) > 2 or any(len(group) > 1 for group in groups):
        return _mute_or_deaf(disturbance, roster) or _partition_effect(disturbance)
    effect: dict[str, Any] = {"link": [robot for (robot,) in groups]} if groups else {}
    if disturbance.one_way:
        effect["one_way"] = True
    if disturbance.attenuation_db == inf:
        effect["cut"] = True
    elif disturbance.loss:
        effect["loss"] = disturbance.loss
    else:
        effect["attenuation_db"] = disturbance.attenuation_db
    return effect


# ---- the way back: the schema's models become faults of robots and disturbances of the radio
#
# `radio.links` and `radio.partition` hold for the whole run; an entry of `faults` holds at an instant or for a
# span. All that concerns the radio becomes `rmr.radio.links.Disturbance`. Each value comes with the path of the
# robots in the file.


def permanent_faults(radio: "RadioSpec") -> Iterator[tuple[FilePath, Disturbance]]:
    """Yield the disturbances that hold for the whole run."""
    for i, spec in enumerate(radio.links):
        yield ("radio", "links", i, "link"), _disturbance(spec)
    if radio.partition is not None:
        yield ("radio", "partition"), partition(radio.partition)


def timed_faults(
    spec: "FaultSpec", path: FilePath, roster: Sequence[int]
) -> Iterator[tuple[FilePath, Fault | Disturbance]]:
    """Yield the faults of the entry at `path`; an outage of all robots is one fault for each of `roster`."""
    start = spec.from_ or 0
    end = spec.to or NEVER
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
        yield (*path, "partition"), partition(spec.partition, start, end)._replace(one_way=spec.one_way)
    elif spec.mute is not None or spec.deaf is not None:
        yield from _muted_or_deafened(spec, path, roster)
    else:
        yield (*path, "link"), _disturbance(spec)._replace(since=start, until=end)


def _muted_or_deafened(
    spec: "FaultSpec", path: FilePath, roster: Sequence[int]
) -> Iterator[tuple[FilePath, Disturbance]]:
    """Yield the cut of all frames from or to one robot; none in a lab without other robots."""
    for key, robot, cut in (("mute", spec.mute, muted), ("deaf", spec.deaf, deafened)):
        if robot is not None and any(other != robot for other in roster):
            yield (*path, key), cut(robot, roster, spec.from_ or 0, spec.to or NEVER)


def _disturbance(spec: "LinkSpec | FaultSpec") -> Disturbance:
    """Return the effect of `spec` on its link, or on all links if it names none, without an end."""
    groups = tuple((robot,) for robot in spec.link or ())
    attenuation_db = inf if spec.cut else spec.attenuation_db or 0.0
    return Disturbance(groups=groups, one_way=spec.one_way, loss=spec.loss or 0.0, attenuation_db=attenuation_db)

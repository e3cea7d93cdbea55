"""The resolved lab: a lab file with all defaults, places and random facts as plain data, for `rmr config`."""

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rmr.base.arena import to_data
from rmr.base.file_errors import naming
from rmr.base.time import NEVER, in_seconds
from rmr.base.values import format_value
from rmr.entry import ExitCode
from rmr.radio.links import Disturbance
from rmr_deploy.active_runs import LAB_COPY
from rmr_deploy.run_choice import FleetError
from rmr_world.faults import fault_entries, fault_entry
from rmr_world.finding import LabError
from rmr_world.lab import Lab, LabHost, TopicFact
from rmr_world.lab_file import load_lab
from rmr_world.random_facts import LabFact


def resolved_lab(lab: Lab) -> dict[str, Any]:
    """Return a lab as plain data: metres, seconds, radians, and names as in lab files where they exist."""
    return {
        "lab": lab.name,
        "file": str(lab.path.resolve()),
        "program": str(lab.program.resolve()),
        "actions": None if lab.actions is None else str(lab.actions.resolve()),
        "ros_actions": [
            {**asdict(each), "fields": dict(each.fields), "within": in_seconds(each.within)} for each in lab.ros_actions
        ],
        "seed": lab.seed,
        "duration_s": in_seconds(lab.duration),
        "finish": lab.finish,
        "quorum": lab.quorum,
        "arena": to_data(lab.arena),
        "robots": [{"id": robot.id, "pose": list(robot.pose)} for robot in lab.robots],
        "facts": [*map(_fact, lab.initial_facts), *map(_topic_fact, lab.topic_facts)],
        "radio": {"seed": lab.radio.seed, "security": lab.radio.security, **asdict(lab.radio.config)},
        "bus": {"security": "mtls" if lab.mtls else "secret"},
        "bodies": [{**asdict(body), "origin": list(body.origin), "scan_at": list(body.scan_at)} for body in lab.bodies],
        "hosts": {host.name: _host(host) for host in lab.hosts},
        "localisation": asdict(lab.localisation),
        "disturbances": [_always(one, lab) for one in lab.disturbances if one.until >= NEVER],
        "faults": fault_entries(lab),
    }


def _host(host: LabHost) -> dict[str, Any]:
    return {
        "address": host.address,
        "port": host.port,
        "world": host.has_world,
        "router": host.has_router,
        "robots": list(host.robots),
    }


def _topic_fact(each: TopicFact) -> dict[str, Any]:
    about = {"topic": each.topic, "type": each.type, "every_s": in_seconds(each.every)}
    return about | {"fact": _fact(each.fact)}


def _fact(fact: LabFact) -> str:
    owner = "R" if fact.owner is None else f"@{fact.owner}"
    return f"{fact.name}({', '.join([owner, *map(format_value, fact.args)])})"


def _always(disturbance: Disturbance, lab: Lab) -> dict[str, Any]:
    """Return the entry of a disturbance that holds for the whole run; JSON has no infinity."""
    entry = fault_entry(disturbance, lab.roster)
    return {key: None if value == math.inf else value for key, value in entry.items()}


def write_lab(lab: Lab, folder: Path) -> None:
    """Write the resolved lab into a run folder. Raises OSError."""
    path = folder / LAB_COPY
    with naming(path):
        path.write_text(json.dumps(resolved_lab(lab), indent=2) + "\n")


def resolved_file(source: Path) -> dict[str, Any]:
    """Return the resolved lab in `source`, a lab file, its folder or a provided lab. Raises FleetError."""
    try:
        return resolved_lab(load_lab(source))
    except LabError as error:
        raise FleetError(str(error).rstrip("\n"), ExitCode.INVALID) from None
    except OSError as error:
        raise FleetError(f"{error.filename or source}: {error.strerror}") from None

"""What a hunt tells: the smallest fault lists as lines of a lab file, and as lab files that repeat them.

A lab file that repeats a finding is the lab's own with the faults, the seed and the duration of the finding; so it is
run without further options than those of the hunt.
"""

import json
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rmr.base.time import NS_PER_S, in_seconds
from rmr.entry import JSON_VERSION
from rmr_sim.hunt.harm import Harm, with_harms
from rmr_sim.hunt.hunt_search import HuntFinding, Quarry
from rmr_world.document import read
from rmr_world.faults import fault_entries, fault_line
from rmr_world.lab import Lab

FILES = ("program", "actions", "events")
"""Keys of a lab file that name a file relative to it."""


def entries_of(lab: Lab, harms: Sequence[Harm]) -> list[dict[str, Any]]:
    """Return `harms` as entries of ``faults`` of a lab file, without those of the lab itself."""
    return fault_entries(with_harms(replace(lab, faults=(), disturbances=()), harms))


def duration_s(lab: Lab, finding: HuntFinding) -> float:
    """Return the duration of the run of a finding, seconds."""
    return in_seconds(with_harms(lab, finding.harms).duration)


def finding_lines(lab: Lab, number: int, finding: HuntFinding, command: str, *, ended: bool = True) -> list[str]:
    """Return the lines that tell a finding; `command` repeats it. Not `ended`: the reduction was interrupted."""
    broken = finding.broken
    smallest = "the smallest list" if ended else "the smallest list so far"
    lines = [
        f"{number}. {broken.name} at {broken.at_s:.3f} s of seed {finding.seed}: {broken.words}",
        f"   found after {finding.runs} runs; {smallest}, after {finding.shrink_runs} more:",
        f"duration: {duration_s(lab, finding):g}s",
        "faults:" if finding.harms else "faults: []",
        *(f"  - {fault_line(entry)}" for entry in entries_of(lab, finding.harms)),
    ]
    return [*lines, f"   to repeat it: {command}"]


def finding_entry(lab: Lab, finding: HuntFinding, command: str) -> dict[str, Any]:
    """Return the finding as an entry of the document."""
    broken = finding.broken
    return {
        "property": broken.name,
        "t_s": broken.at_s,
        "robots": list(broken.robots),
        "words": broken.words,
        "seed": finding.seed,
        "duration_s": duration_s(lab, finding),
        "faults": entries_of(lab, finding.harms),
        "faults_at_first": entries_of(lab, finding.at_first),
        "runs": finding.runs,
        "shrink_runs": finding.shrink_runs,
        "command": command,
    }


def hunt_document(
    lab: Lab, quarry: Quarry, command: str, runs: int, closest_m: float, found: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the content of `hunt.json`; `found` are entries of findings."""
    return {
        "version": JSON_VERSION,
        "lab": lab.name,
        "command": command,
        "seed": quarry.seed,
        "properties": list(quarry.properties),
        "methods": list(quarry.methods),
        "runs": runs,
        "closest_m": round(closest_m, 4),
        "found": found,
    }


def lab_text(lab: Lab, finding: HuntFinding, folder: Path) -> str:
    """Return the text of a lab file in `folder` that repeats a finding: a line of JSON, which is YAML, for each key."""
    value = read(lab.path).value
    assert isinstance(value, dict), "the lab has been loaded from this file"
    value = value | {"seed": finding.seed, "duration": duration_s(lab, finding)}
    for key in FILES:
        if isinstance(value.get(key), str):
            value[key] = _from(folder, lab.path.parent / str(value[key]))
    radio = value.get("radio")
    if isinstance(radio, dict) and isinstance(radio.get("key_file"), str):
        value["radio"] = radio | {"key_file": _from(folder, lab.path.parent / str(radio["key_file"]))}
    own = value.pop("faults", None)
    lines = [f"{key}: {json.dumps(part)}" for key, part in value.items()]
    faults = [json.dumps(each) for each in own] if isinstance(own, list) else []
    faults += [fault_line(entry) for entry in entries_of(lab, finding.harms)]
    head = f"# {finding.broken.name} at {finding.broken.at_s:.3f} s: {' '.join(finding.broken.words.split())}"
    return "\n".join([head, *lines, "faults:", *(f"  - {line}" for line in faults)]) + ("\n" if faults else " []\n")


def _from(folder: Path, file: Path) -> str:
    """Return the path of `file` relative to `folder`."""
    return os.path.relpath(file.resolve(), folder.resolve())


def budget_words(runs: int | None, time_ns: int | None) -> str:
    """Return the budget of a hunt in words."""
    parts = [] if runs is None else [f"{runs} run{'' if runs == 1 else 's'}"]
    parts += [] if time_ns is None else [f"{time_ns / NS_PER_S:g} s"]
    return " or ".join(parts)

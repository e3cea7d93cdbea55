"""The files of a run that its recording carries along, so that it can be replayed and explained by itself."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rmr.base import arena
from rmr.base.arena import Arena
from rmr.record.record_writer import RecordWriter

BYTE_CODE: Final = "program.rbc"
SOURCE: Final = "program.rmr"
ACTIONS: Final = "actions.py"
FLOOR: Final = "floor.json"
LAB: Final = "lab.yaml"
REPORT: Final = "report.json"
PATHS_NAME: Final = "paths"
"""The metadata record with the paths that attachments had as files, by name."""


def attach_files(
    writer: RecordWriter, floor: Arena, byte_code: bytes, lab: Path, program: Path, actions: Path | None
) -> None:
    """Attach the lab file, the arena, the program and the handlers of its actions; what cannot be read is left out."""
    writer.attach(BYTE_CODE, byte_code)
    attach_lab(writer, floor, lab, program, actions)


def attach_lab(writer: RecordWriter, floor: Arena, lab: Path, program: Path, actions: Path | None = None) -> None:
    """Attach the arena, the lab file, the program's source and handlers of actions: what a world by hand knows."""
    writer.attach(FLOOR, json.dumps(arena.to_data(floor)).encode())
    paths = {LAB: lab} | ({SOURCE: program} if program.suffix == ".rmr" else {})
    if actions is not None:
        paths[ACTIONS] = actions
    _attach_paths(writer, paths)


def attach_program(writer: RecordWriter, byte_code: bytes, actions: Path | None) -> None:
    """Attach what a robot's process that was started by hand knows: its program, if any, and handlers of actions."""
    if byte_code:
        writer.attach(BYTE_CODE, byte_code)
    if actions is not None:
        _attach_paths(writer, {ACTIONS: actions})


def _attach_paths(writer: RecordWriter, paths: Mapping[str, Path]) -> None:
    writer.note(PATHS_NAME, {name: str(path) for name, path in paths.items()})
    for name, path in paths.items():
        try:
            writer.attach(name, path.read_bytes())
        except OSError:
            continue

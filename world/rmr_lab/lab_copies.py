"""Copies of the provided labs: a folder of one's own with all that the lab needs.

A lab may run the program of another folder; its copy has the program beside it, and names it there.
"""

import re
from pathlib import Path

from rmr_world.document import read
from rmr_world.provided_labs import LAB_FILE, missing, provided_labs

SCHEMA_FILE = "lab.schema.json"
HEADER = f"# yaml-language-server: $schema={SCHEMA_FILE}\n"
"""The line by which editors find the schema of a YAML file."""
_PROGRAM = re.compile(r"^program:[^\n#]*", re.MULTILINE)


class CopyError(Exception):
    """Nothing is written; the message says what is wrong with what was asked for."""


def about(folder: Path) -> str:
    """Return the first line of comment in a lab's file."""
    lines = (folder / LAB_FILE).read_text(encoding="utf-8").splitlines()
    comments = [line.removeprefix("#").strip() for line in lines if line.startswith("# ") and "$schema" not in line]
    return comments[0] if comments else ""


def copy(name: str, folder: Path) -> list[Path]:
    """Copy the provided lab `name` to `folder`, which must not exist; return the files.

    Raises CopyError, or OSError when it cannot be written.
    """
    source = provided_labs().get(name)
    if source is None:
        raise CopyError(missing(Path(name)))
    refuse_existing(folder)
    folder.mkdir(parents=True)
    written = []
    for file in sorted(source.iterdir()):
        if not file.is_file():
            continue
        text = file.read_text(encoding="utf-8")
        if file.suffix == ".yaml":
            text, program = _beside(text, file)
            if program is not None and not (source / program.name).exists():
                written.append(_written(folder / program.name, program.read_text(encoding="utf-8")))
        written.append(_written(folder / file.name, text))
    written.append(write_schema(folder))
    return sorted(set(written))


def refuse_existing(folder: Path) -> None:
    """Raise CopyError if `folder` is there already."""
    if folder.exists() or folder.is_symlink():
        raise CopyError(f"{folder} is there already, and nothing is ever overwritten; name a folder that is new")


def write_schema(folder: Path) -> Path:
    """Write the schema of the lab file into `folder`, for editors; return the file."""
    import json  # noqa: PLC0415

    from rmr_world.schema import json_schema  # noqa: PLC0415 - pydantic loads only where it is needed

    return _written(folder / SCHEMA_FILE, json.dumps(json_schema(), indent=1) + "\n")


def _beside(text: str, file: Path) -> tuple[str, Path | None]:
    """Return a lab file's text with its program beside it and the header, and where the program lies now."""
    value = read(file).value
    name = value.get("program") if isinstance(value, dict) else None
    if not isinstance(name, str):
        return HEADER + text, None
    program = (file.parent / name).resolve()
    return HEADER + _PROGRAM.sub(f"program: {program.name}", text, count=1), program


def _written(file: Path, text: str) -> Path:
    file.write_text(text, encoding="utf-8")
    return file

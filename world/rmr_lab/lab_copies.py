"""Copies of the provided labs: a new folder with all files of the lab.

The program of a lab may be in another folder. The copy then holds the program itself, and its lab file names that one.
"""

import re
from pathlib import Path

from rmr.base.file_errors import naming
from rmr_world.document import read
from rmr_world.provided_labs import LAB_FILE, missing, provided_labs

SCHEMA_FILE = "lab.schema.json"
HEADER = f"# yaml-language-server: $schema={SCHEMA_FILE}\n"
"""First line of a lab file: editors find the schema of the file by it."""
_PROGRAM = re.compile(r"^program:[^\n#]*", re.MULTILINE)


class CopyError(Exception):
    """A copy was refused before anything was written; the message gives the reason."""


def about(folder: Path) -> str:
    """Return the first comment line of the lab file in `folder`, or an empty string."""
    lines = (folder / LAB_FILE).read_text(encoding="utf-8").splitlines()
    comments = [line.removeprefix("#").strip() for line in lines if line.startswith("# ") and "$schema" not in line]
    return comments[0] if comments else ""


def copy(name: str, folder: Path) -> list[Path]:
    """Copy the provided lab `name` to `folder`, which must not exist; return the files that were written.

    Raises CopyError, or OSError when a file cannot be written.
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
            text, program = _copied_lab_file(text, file)
            if program is not None and not (source / program.name).exists():
                written.append(write_file(folder / program.name, program.read_text(encoding="utf-8")))
        written.append(write_file(folder / file.name, text))
    written.append(write_schema(folder))
    return sorted(set(written))


def refuse_existing(folder: Path) -> None:
    """Raise CopyError if `folder` exists."""
    if folder.exists() or folder.is_symlink():
        raise CopyError(f"{folder} is there already, and nothing is ever overwritten; name a folder that is new")


def write_schema(folder: Path) -> Path:
    """Write the schema of the lab file into `folder`, for editors; return the file."""
    import json  # noqa: PLC0415

    from rmr_world.schema import json_schema  # noqa: PLC0415 - pydantic loads only where it is needed

    return write_file(folder / SCHEMA_FILE, json.dumps(json_schema(), indent=1) + "\n")


def _copied_lab_file(text: str, file: Path) -> tuple[str, Path | None]:
    """Return the text of the copied lab file, with the header and the bare name of its program, and the program's path.

    The path is that of the original program; None where the lab file names none.
    """
    value = read(file).value
    name = value.get("program") if isinstance(value, dict) else None
    if not isinstance(name, str):
        return HEADER + text, None
    program = (file.parent / name).resolve()
    return HEADER + _PROGRAM.sub(f"program: {program.name}", text, count=1), program


def write_file(file: Path, text: str) -> Path:
    """Write `text` to `file` in UTF-8; return `file`. Raises OSError."""
    with naming(file):
        file.write_text(text, encoding="utf-8")
    return file

"""The rows of a sweep as they come: one JSON line each in the run folder, so that a sweep that ends early loses none.

The first line says what was swept: version, lab, options, seeds, and a digest of the user's files. `--resume` goes on
only where all of it is the same, for rows of two different sweeps cannot be summed up. A last line that was cut short,
as by a killed process, is dropped.
"""

import argparse
import json
from collections.abc import Iterable
from hashlib import sha256
from os import SEEK_END
from pathlib import Path
from typing import Any, TextIO

from rmr import __version__
from rmr_sim.arguments import command_of
from rmr_sim.seed_run import Row
from rmr_world.lab import Lab

ROWS_FILE = "rows.jsonl"
NAMES = {
    "version": "version of rmr",
    "lab": "lab",
    "options": "options",
    "seeds": "seeds",
    "files": "contents of the lab, program or Python files",
}
"""What the first line holds, and how a person calls it."""


class ResumeError(Exception):
    """A sweep cannot be resumed; the message says why and what to do."""


def head(arguments: argparse.Namespace, lab: Lab, seeds: range) -> dict[str, Any]:
    """Return what is swept. Raises OSError when one of its files cannot be read."""
    files = [lab.path, lab.program, arguments.actions, arguments.events]
    digest = sha256(b"".join(sha256(file.read_bytes()).digest() for file in files if file is not None))
    return {
        "version": __version__,
        "lab": lab.name,
        "options": command_of(argparse.Namespace(**{**vars(arguments), "lab": "LAB", "strict": False})),
        "seeds": [seeds[0], seeds[-1]],
        "files": digest.hexdigest(),
    }


def seeds_of(folder: Path) -> range:
    """Return the seeds of the sweep in `folder`. Raises ResumeError."""
    first, last = _read(folder)[0]["seeds"]
    return range(first, last + 1)


def taken_up(folder: Path, wanted: dict[str, Any]) -> list[Row]:
    """Return the rows of the sweep in `folder`, which is the one that is `wanted`. Raises ResumeError."""
    found, *rows = _read(folder)
    for key, name in NAMES.items():
        if found[key] != wanted[key]:
            told = f": {found[key]} there, {wanted[key]} here" if key != "files" else " differ"
            raise ResumeError(f"{folder} cannot be resumed, for it has another sweep; {name}{told}")
    return rows


def _read(folder: Path) -> list[dict[str, Any]]:
    path = folder / ROWS_FILE
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError):
        raise ResumeError(f"{folder} is no folder of a sweep: it has no {ROWS_FILE} that can be read") from None
    whole = [line for line in lines if line.endswith("\n")]
    try:
        found = [json.loads(line) for line in whole]
        if not found or not NAMES.keys() <= found[0].keys() or any("seed" not in row for row in found[1:]):
            raise ValueError
    except (ValueError, AttributeError, TypeError):
        raise ResumeError(f"{path} does not hold the rows of a sweep; begin a new one without --resume") from None
    return found


class Rows:
    """The file of a sweep's rows. What cannot be written is told once; the rows are then the sweep's alone."""

    def __init__(self, folder: Path, first: dict[str, Any], rows: Iterable[Row]) -> None:
        """Write the file anew, with the rows that are there already. Raises OSError."""
        self._path = folder / ROWS_FILE
        partial = self._path.with_suffix(".new")
        with partial.open("w", encoding="utf-8") as file:
            for line in (first, *rows):
                _write(file, line)
        partial.replace(self._path)
        self._writable = True

    def add(self, row: Row) -> str:
        """Write a row; return what has gone wrong for the first time, in a sentence, or nothing."""
        if not self._writable:
            return ""
        try:
            with self._path.open("r+", encoding="utf-8") as file:  # opened anew, to notice that it has been removed
                file.seek(0, SEEK_END)
                _write(file, row)
        except OSError as error:
            self._writable = False
            return f"cannot write {self._path} any more: {error.strerror}; the sweep goes on and sums up at the end"
        return ""


def _write(file: TextIO, line: dict[str, Any]) -> None:
    file.write(json.dumps(line, sort_keys=True) + "\n")

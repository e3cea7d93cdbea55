"""The file of a sweep's rows: a JSON line for each run, written as soon as the run ends, so that none is lost.

The first line identifies the sweep: version, lab, options, seeds, and a digest of the user's files. `--resume` requires
all of them to be equal, since rows of different sweeps cannot be summarised together. An incomplete last line, as a
killed process leaves it, is dropped.
"""

import argparse
import json
from collections.abc import Iterable
from hashlib import sha256
from os import SEEK_END
from pathlib import Path
from typing import Any, TextIO

from rmr import __version__
from rmr.base.file_errors import naming
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
"""Key in the first line -> its name in error messages."""


class ResumeError(Exception):
    """A sweep cannot be resumed; the message gives the reason and the remedy."""


def head(arguments: argparse.Namespace, lab: Lab, seeds: range) -> dict[str, Any]:
    """Return the first line of the file, which identifies the sweep. Raises OSError for an unreadable file."""
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
    """Return the rows of the sweep in `folder`. Raises ResumeError unless its first line equals `wanted`."""
    found, *rows = _read(folder)
    for key, name in NAMES.items():
        if found[key] != wanted[key]:
            difference = f": {found[key]} there, {wanted[key]} here" if key != "files" else " differ"
            raise ResumeError(f"{folder} cannot be resumed, for it has another sweep; {name}{difference}")
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
    """The file of a sweep's rows. A write error is reported once; after it nothing is written."""

    def __init__(self, folder: Path, first: dict[str, Any], rows: Iterable[Row]) -> None:
        """Write the file with its first line and the rows of earlier runs. Raises OSError."""
        self._path = folder / ROWS_FILE
        partial = self._path.with_suffix(".new")
        with naming(self._path), partial.open("w", encoding="utf-8") as file:
            for line in (first, *rows):
                _write(file, line)
        partial.replace(self._path)
        self._writable = True

    def add(self, row: Row) -> str:
        """Write a row; return the first write error as a sentence, else an empty string."""
        if not self._writable:
            return ""
        try:
            with self._path.open("r+", encoding="utf-8") as file:  # reopened, since writes to a removed file succeed
                file.seek(0, SEEK_END)
                _write(file, row)
        except OSError as error:
            self._writable = False
            return f"cannot write {self._path} any more: {error.strerror}; the sweep goes on and sums up at the end"
        return ""


def _write(file: TextIO, line: dict[str, Any]) -> None:
    file.write(json.dumps(line, sort_keys=True) + "\n")

"""The file of a sweep's rows: a JSON line for each run, written as soon as the run ends, so that none is lost.

The first line identifies the sweep: RMR, its sources and what else computes with it, lab, options, seeds, shard, and a
digest of the user's files. `--resume` requires all of them to be equal, and `rmr sweep merge` all but the shard, since
rows of different sweeps cannot be summarised together. An incomplete last line, as a killed process leaves it, is
dropped. When all runs are over, the rows are brought into the order of their seeds.
"""

import argparse
import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from os import SEEK_END
from pathlib import Path
from typing import Any, TextIO

import rmr
import rmr_sim
import rmr_world
from rmr.base.file_errors import naming
from rmr.mind.mind_versions import digest_of
from rmr.mind.mind_versions import versions as mind_versions
from rmr_sim.arguments import command_of
from rmr_sim.run_setup import LoadedLab
from rmr_sim.seed_run import Row
from rmr_world.lab_file import files_of

ROWS_FILE = "rows.jsonl"
NEW = ".new"
"""Suffix of the file while it is written anew."""
NAMES = {
    "version": "version of rmr",
    "sources": "sources of rmr",
    "platform": "what it runs on",
    "lab": "lab",
    "options": "options",
    "seeds": "seeds",
    "shard": "shard",
    "files": "contents of the lab, program or Python files",
}
"""Key in the first line -> its name in error messages."""


class RowsError(Exception):
    """A folder's rows cannot be used; the message gives the reason and the remedy."""


@cache
def versions() -> dict[str, str]:
    """Return what a row depends on beside lab, seed and options."""
    mind = mind_versions()
    packages = [Path(module.__path__[0]) for module in (rmr, rmr_world, rmr_sim)]
    libraries = [f"{name} {version(name)}" for name in ("numpy", "pymunk")]
    runs_on = [f"{mind['system']} {mind['machine']}", mind["libc"], mind["python"], *libraries]
    return {"version": mind["rmr"], "sources": digest_of(packages), "platform": ", ".join(filter(None, runs_on))}


def head(arguments: argparse.Namespace, loaded: LoadedLab) -> dict[str, Any]:
    """Return the first line of the file, which identifies the sweep. Raises OSError for an unreadable file."""
    lab = loaded.lab
    files = [path.read_bytes() for path in (lab.path, *(file for _, file in files_of(lab)))]
    programs = [loaded.program, *(program for _, program in loaded.loads)]  # with all that they include
    contents = [*files, *(b"%x" % program.digest for program in programs)]
    named = argparse.Namespace(**{**vars(arguments), "lab": "LAB", "strict": False})
    return {
        **versions(),
        "lab": lab.name,
        "options": command_of(named),
        "seeds": [arguments.seeds[0], arguments.seeds[-1]],
        "shard": list(arguments.shard),
        "files": sha256(b"".join(sha256(each).digest() for each in contents)).hexdigest(),
        "command": command_of(arguments),
    }


def is_new(folder: Path) -> bool:
    """Return whether no sweep has begun in `folder`: it is not there, or empty but for a file not yet complete."""
    return not folder.exists() or (
        folder.is_dir() and all(each.name == Path(ROWS_FILE).with_suffix(NEW).name for each in folder.iterdir())
    )


def seeds_of(first: dict[str, Any]) -> range:
    """Return the seeds of the whole sweep with this first line."""
    least, greatest = first["seeds"]
    return range(least, greatest + 1)


def taken_up(folder: Path, wanted: dict[str, Any]) -> list[Row]:
    """Return the rows of the sweep in `folder`, by seed. Raises RowsError unless its first line equals `wanted`."""
    found, rows = read(folder)
    different = differences(found, wanted, NAMES)
    if different:
        raise RowsError(f"{folder} cannot be resumed, for it has another sweep; {different[0]}")
    known = {row["seed"]: row for row in rows}  # two that were resumed at once have written the same row twice
    return [known[seed] for seed in sorted(known)]


def differences(there: dict[str, Any], here: dict[str, Any], keys: Iterable[str]) -> list[str]:
    """Return in words which of `keys` two first lines disagree on."""
    return [
        f"{NAMES[key]} differ" if key == "files" else f"{NAMES[key]}: {there[key]} there, {here[key]} here"
        for key in keys
        if there[key] != here[key]
    ]


def read(folder: Path) -> tuple[dict[str, Any], list[Row]]:
    """Return the first line of the rows in `folder`, and the rows. Raises RowsError."""
    path = folder / ROWS_FILE
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError):
        raise RowsError(f"{folder} is no folder of a sweep: it has no {ROWS_FILE} that can be read") from None
    whole = [line for line in lines if line.endswith("\n")]
    try:
        first, *rows = [json.loads(line) for line in whole]
        if not {*NAMES, "command"} <= first.keys() or any("seed" not in row for row in rows):
            raise ValueError
    except (ValueError, AttributeError, TypeError):
        raise RowsError(f"{path} does not hold the rows of a sweep of this version; begin a new one") from None
    return first, rows


class Rows:
    """The file of a sweep's rows. A write error is reported once; after it nothing is written."""

    def __init__(self, folder: Path, first: dict[str, Any], rows: Iterable[Row]) -> None:
        """Write the file with its first line and the rows of earlier runs. Raises OSError."""
        self._path = folder / ROWS_FILE
        self._first = first
        self._replace(rows)
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

    def sort(self, rows: Sequence[Row]) -> None:
        """Bring the file into the order of `rows`, which are those of all runs; nothing is lost where that fails."""
        if not self._writable:
            return
        with suppress(OSError):
            self._replace(rows)

    def _replace(self, rows: Iterable[Row]) -> None:
        partial = self._path.with_suffix(NEW)
        with naming(self._path), partial.open("w", encoding="utf-8") as file:
            for line in (self._first, *rows):
                _write(file, line)
        partial.replace(self._path)


def _write(file: TextIO, line: dict[str, Any]) -> None:
    file.write(json.dumps(line, sort_keys=True) + "\n")

"""What other processes and other machines do with a loaded lab: one task at a time, such as the run of a seed.

A `LabTask` can be pickled with all that it needs: the lab and its compiled program, and the texts of the user's files
of actions and events. A process that gets it neither reads the lab nor compiles; a machine that gets it needs RMR
alone. Where a user's file is not what it was, or not there, it is written into a folder of its own, and what comes of
a task names it by its old name.
"""

import pickle
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from threading import Lock
from typing import Any, Generic, TypeVar
from weakref import finalize

from rmr_sim.run_setup import LoadedLab

Task = TypeVar("Task")
Outcome = TypeVar("Outcome")


ONE_AT_A_TIME = Lock()
"""Threads take turns: what a user's file of actions registers is known to the process, and threads win no time."""


class LabTask(Generic[Task, Outcome]):
    """Carries out tasks with a loaded lab: a function of a task."""

    def __init__(self, loaded: LoadedLab, perform: Callable[[LoadedLab, Task], Outcome]) -> None:
        """`perform` is a function of a module, for it is pickled by its name. Raises OSError for an unreadable file."""
        self._octets = _pickled((loaded, {path: path.read_bytes() for path in _users_files(loaded)}))
        self._perform = perform

    def __call__(self, task: Task) -> Outcome:
        """Carry out `task`."""
        with ONE_AT_A_TIME:
            here = _unpacked(self._octets)
            outcome = self._perform(here.loaded, task)
        return here.named(outcome) if here.names else outcome


class _Here:
    """A lab as this process has unpacked it."""

    def __init__(self, loaded: LoadedLab, files: dict[Path, bytes]) -> None:
        lab = loaded.lab
        self.names: dict[str, str] = {}
        """The path of a file that is written here -> the path that it had."""
        self._folder: Path | None = None
        moved = {path: self._written(path, text) for path, text in files.items() if not _is(path, text)}
        actions = moved.get(lab.actions, lab.actions) if lab.actions else None
        events = moved.get(lab.events, lab.events) if lab.events else None
        self.loaded = replace(loaded, lab=replace(lab, actions=actions, events=events))

    def _written(self, path: Path, text: bytes) -> Path:
        if self._folder is None:
            self._folder = Path(mkdtemp(prefix="rmr-lab-"))
            finalize(self, rmtree, self._folder, ignore_errors=True)
        folder = self._folder / str(len(self.names))
        folder.mkdir()
        (folder / path.name).write_bytes(text)
        self.names[str(folder / path.name)] = str(path)
        return folder / path.name

    def named(self, value: Any) -> Any:
        """Return an outcome in which the files have the names that they had."""
        if isinstance(value, str):
            for here, there in self.names.items():
                value = value.replace(here, there)
            return value
        if isinstance(value, dict):
            return {key: self.named(each) for key, each in value.items()}
        if isinstance(value, list):
            return [self.named(each) for each in value]
        if isinstance(value, tuple):
            return type(value)(*map(self.named, value)) if hasattr(value, "_fields") else tuple(map(self.named, value))
        if is_dataclass(value) and not isinstance(value, type):
            return _made(type(value), *(self.named(getattr(value, each.name)) for each in fields(value)))
        return value


def _users_files(loaded: LoadedLab) -> list[Path]:
    return [path for path in (loaded.lab.actions, loaded.lab.events) if path is not None]


def _is(path: Path, text: bytes) -> bool:
    """Return whether the file in `path` has this text."""
    try:
        return path.read_bytes() == text
    except OSError:
        return False


@lru_cache(1)
def _unpacked(octets: bytes) -> _Here:
    return _Here(*pickle.loads(octets))


class _Pickler(pickle.Pickler):
    """Takes dataclasses field by field: frozen ones that are compiled cannot be pickled otherwise."""

    def reducer_override(self, value: Any) -> Any:
        if is_dataclass(value) and not isinstance(value, type):
            return _made, (type(value), *(getattr(value, each.name) for each in fields(value)))
        return NotImplemented


def _pickled(value: object) -> bytes:
    octets = BytesIO()
    _Pickler(octets).dump(value)
    return octets.getvalue()


def _made(kind: Any, *values: object) -> Any:
    """Return an object of a dataclass with these fields."""
    made = kind.__new__(kind)  # not `object.__new__`: the class may be compiled
    for each, value in zip(fields(kind), values, strict=True):
        object.__setattr__(made, each.name, value)
    return made

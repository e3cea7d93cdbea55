"""The compiled form of the modules in which a robot spends its time, found where it belongs to these very sources.

`make fast` has mypyc make extension modules of them in ``build/compiled``; results are the same to the bit, in less
than half of the time. Each is found in place of its source as long as none of the sources has changed since; after a
change all are interpreted again. ``RMR_COMPILED`` names another folder, or none if it is empty.
"""

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

FOLDER = Path(__file__).parents[2] / "build" / "compiled"
INDEX = "index"
"""The file that tells what the folder was made of: a line for each source, with the module made of it or nothing."""


def state(source: str | Path) -> str:
    """Tell a source file from what it becomes by a change. Raises OSError if it is not there."""
    told = os.stat(source)  # of hundreds of files at each start: no Path is made of each
    return f"{told.st_mtime_ns} {told.st_size}"


class Finder:
    """Finds the compiled modules of one folder."""

    def __init__(self, folder: Path, modules: frozenset[str]) -> None:
        self.folder = folder
        self.modules = modules

    def find_spec(
        self, name: str, _: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where the compiled module `name` is; None if there is none."""
        if name not in self.modules:
            return None
        return PathFinder.find_spec(name, [str(self.folder.joinpath(*name.split(".")[:-1]))], target)


def modules_in(folder: Path) -> frozenset[str]:
    """Return the modules that `folder` holds for this Python and these sources: all or, after a change, none."""
    try:
        python, *lines = (folder / INDEX).read_text().splitlines()
        entries = [line.split("\t") for line in lines]
        if python != sys.implementation.cache_tag or any(state(path) != was for was, _, path in entries):
            return frozenset()
    except (OSError, ValueError):
        return frozenset()
    return frozenset(module for _, module, _ in entries if module)


def prefer() -> None:
    """From now on find the compiled modules first."""
    named = os.environ.get("RMR_COMPILED")
    if named == "":
        return
    folder = Path(named) if named else FOLDER
    if modules := modules_in(folder):
        sys.meta_path.insert(0, Finder(folder, modules))

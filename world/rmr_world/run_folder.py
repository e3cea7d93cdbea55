"""The folder of a run's results: ``runs/LAB-DATE-TIME/`` unless the user names one."""

from datetime import datetime
from pathlib import Path


class RunFolderError(Exception):
    """The folder cannot be used; the message says why and what to do."""


def make_run_folder(lab: str, folder: Path | None) -> Path:
    """Make and return `folder` (None: ``runs/LAB-DATE-TIME``). Raises RunFolderError unless it is new or empty."""
    try:
        if folder is None:
            return _new_folder(Path("runs"), f"{lab}-{datetime.now():%Y%m%d-%H%M%S}")
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise RunFolderError(f"{folder}: the run folder is not empty; name a new one")
    except OSError as error:
        raise RunFolderError(f"{error.filename}: {error.strerror}") from error
    return folder


def _new_folder(parent: Path, name: str) -> Path:
    """Make a folder that did not exist: two runs may begin within one second."""
    parent.mkdir(exist_ok=True)
    for number in range(1, 1000):
        path = parent / (name if number == 1 else f"{name}-{number}")
        try:
            path.mkdir()
        except FileExistsError:
            continue
        return path
    raise RunFolderError(f"{parent / name}: a thousand runs have begun in this second")

"""Loads a user's file of actions (``--actions FILE.py``)."""

import importlib.util
from pathlib import Path

from rmr.node.actions import Handler, registered


class ActionsError(Exception):
    """The file cannot be used; the message says what is wrong with it."""


def load_actions(path: Path | None) -> dict[str, Handler]:
    """Run `path` and return the handlers that it registered with `rmr.action`. Raises ActionsError."""
    if path is None:
        return {}
    before = registered()
    _run(path)
    added = {name: handler for name, handler in registered().items() if before.get(name) is not handler}
    if not added:
        raise ActionsError(f'{path}: registers no action; decorate an async function with @action("name")')
    return added


def _run(path: Path) -> None:
    """Run the file; whatever it raises is told as its mistake. Raises ActionsError."""
    try:
        spec = importlib.util.spec_from_file_location("rmr_user_actions", path) if path.is_file() else None
    except OSError as error:
        raise ActionsError(f"{path}: {error.strerror or error}") from error
    if spec is None or spec.loader is None:
        raise ActionsError(f"{path}: no such Python file")
    try:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    except SystemExit as error:
        raise ActionsError(f"{path}: calls exit({error.code or 0}) while it is loaded") from error
    except Exception as error:
        raise ActionsError(f"{path}: {type(error).__name__}: {error}") from error

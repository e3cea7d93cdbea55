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
    spec = importlib.util.spec_from_file_location("rmr_user_actions", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ActionsError(f"{path}: no such Python file")
    before = registered()
    try:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))
    except Exception as error:  # whatever the user's file raises is told as its mistake
        raise ActionsError(f"{path}: {type(error).__name__}: {error}") from error
    added = {name: handler for name, handler in registered().items() if before.get(name) is not handler}
    if not added:
        raise ActionsError(f'{path}: registers no action; decorate an async function with @action("name")')
    return added

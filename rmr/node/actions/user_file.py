"""Loads a user's Python file: one of actions (``--actions FILE.py``), or what else a host takes."""

import importlib.util
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from rmr.base.mistake import is_ctrl_c, place, words
from rmr.node.actions.dispatcher import Handler, registered


class UserFileError(Exception):
    """The file cannot be used; the message says what is wrong with it."""


class ActionsError(UserFileError):
    """The file of actions cannot be used."""


def load_actions(path: Path | None) -> dict[str, Handler]:
    """Run `path` and return the handlers that it registered with `rmr.action`. Raises ActionsError."""
    if path is None:
        return {}
    before = registered()
    try:
        run_file(path, "rmr_user_actions")
    except UserFileError as error:
        raise ActionsError(str(error)) from error
    added = {name: handler for name, handler in registered().items() if before.get(name) is not handler}
    if not added:
        raise ActionsError(f'{path}: registers no action; decorate an async function with @action("name")')
    return added


@contextmanager
def same_folder() -> Iterator[None]:
    """Come back to the present folder in the end, wherever a user's code has gone: the names of files hold on."""
    folder = os.open(os.curdir, os.O_RDONLY)
    try:
        yield
    finally:
        os.fchdir(folder)
        os.close(folder)


def run_file(path: Path, name: str) -> ModuleType:
    """Run the file as module `name`; whatever it raises is told as its mistake. Raises UserFileError.

    The present folder is the same afterwards.
    """
    try:
        spec = importlib.util.spec_from_file_location(name, path) if path.is_file() else None
    except OSError as error:
        raise UserFileError(f"{path}: {error.strerror or error}") from error
    if spec is None or spec.loader is None:
        raise UserFileError(f"{path}: no such Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        with same_folder():
            spec.loader.exec_module(module)
    except SystemExit as error:
        raise UserFileError(f"{path}: calls exit({error.code or 0}) while it is loaded") from error
    except BaseException as error:
        if is_ctrl_c(error):
            raise
        raise UserFileError(f"{place(error, str(path))}: {words(error)}") from error
    return module

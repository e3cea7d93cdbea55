"""Description of an exception in a user's Python code: its type and text, and the line in the user's own file."""

import os
import traceback

_RMR = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


_by_ctrl_c = True
"""Whether Ctrl-C raises KeyboardInterrupt, as it does unless the host of this process handles it in another way."""


def expect_ctrl_c(*, raised: bool) -> None:
    """Note whether Ctrl-C raises KeyboardInterrupt from now on: for a host that handles SIGINT."""
    global _by_ctrl_c  # noqa: PLW0603 - the handler of SIGINT is one for the process, too
    _by_ctrl_c = raised


def is_ctrl_c(error: BaseException) -> bool:
    """Return whether Ctrl-C may have raised `error`, an exception that has come out of a user's code.

    If not, the code itself has raised KeyboardInterrupt: a mistake like any other.
    """
    return _by_ctrl_c and isinstance(error, KeyboardInterrupt)


def words(error: BaseException) -> str:
    """Return the type and text of an exception, even if its `__str__` raises."""
    try:
        text = str(error)
    except Exception as worse:
        text = f"(its text cannot be had: {type(worse).__name__})"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def place(error: BaseException, file: str, otherwise: int | None = None) -> str:
    """Return `file` and the last line of it in the traceback of `error`, or the line `otherwise` if there is none."""
    path = os.path.abspath(file)  # Python makes absolute names of those of the files that it loads
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if os.path.abspath(frame.filename) == path]
    line = lines[-1] if lines else otherwise
    return file if line is None else f"{file}:{line}"


def place_in(error: BaseException, file: str) -> str:
    """Return the base name of `file` and its last line in the traceback of `error`; empty if there is none."""
    path = os.path.abspath(file)
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if _path(frame) == path]
    return f"{os.path.basename(path)}:{lines[-1]}" if file and lines else ""


def frames(error: BaseException, file: str) -> tuple[str, ...]:
    """Return the traceback of `error` from the first line in `file` on, one text for each call, the innermost last.

    Calls inside rmr are left out: they differ between its compiled and its interpreted form. File names have no
    folders, so that equal runs on two machines give equal texts. Empty if `file` is not in the traceback.
    """
    found = traceback.extract_tb(error.__traceback__)
    path = os.path.abspath(file)
    first = next((i for i, frame in enumerate(found) if _path(frame) == path), len(found))
    return tuple(
        f"{os.path.basename(frame.filename)}:{frame.lineno} in {frame.name}: {frame.line or ''}".rstrip(": ")
        for frame in found[first:]
        if _path(frame) == path or not _of_rmr(frame)
    )


def _path(frame: traceback.FrameSummary) -> str:
    return os.path.abspath(frame.filename)


def _of_rmr(frame: traceback.FrameSummary) -> bool:
    """Return whether a call is inside rmr; compiled modules name their sources relative to the project's folder."""
    return _path(frame).startswith(_RMR + os.sep) or frame.filename.startswith("rmr/")

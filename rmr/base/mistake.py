"""A mistake in a user's Python code, in words: what was raised, and where in the user's own file."""

import os
import traceback


def words(error: BaseException) -> str:
    """Return what was raised: its type and text, also where that cannot be had."""
    try:
        text = str(error)
    except Exception as worse:
        text = f"(its text cannot be had: {type(worse).__name__})"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def place(error: BaseException, file: str, otherwise: int | None = None) -> str:
    """Return `file` and the line in it that `error` came through last; `otherwise` is the line where it did not."""
    path = os.path.abspath(file)  # Python makes absolute names of those of the files that it loads
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if os.path.abspath(frame.filename) == path]
    line = lines[-1] if lines else otherwise
    return file if line is None else f"{file}:{line}"

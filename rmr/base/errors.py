"""Exceptions of the Python interface for a caller's mistake, with the messages that the commands print."""

import reprlib
from typing import Any


class Error(Exception):
    """A mistake of the caller; the message says what is wrong, where, and what to do."""


class UsageError(Error, ValueError):
    """An invalid argument, such as a missing file or a value of the wrong type."""


def require(name: str, value: object, kinds: type | tuple[type, ...], takes: str) -> None:
    """Raise UsageError unless `value`, given as the argument `name`, is one of `kinds`; `takes` describes these.

    A bool is no number here, though it is an int in Python.
    """
    if not isinstance(value, kinds) or isinstance(value, bool):
        raise UsageError(f"{name}: {takes}, not {reprlib.repr(value)}")


class ProgramError(Error):
    """The program cannot run; the message is what a person is shown, one or more lines."""


class CompileError(ProgramError):
    """The program has errors; the message is what `rmr check` prints of them."""

    def __init__(self, message: str, diagnostics: list[dict[str, Any]]) -> None:
        super().__init__(message)
        self.diagnostics = diagnostics
        """Errors and warnings as `rmr check --json` lists them."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments for unpickling: the default would drop the diagnostics."""
        return CompileError, (str(self), self.diagnostics)

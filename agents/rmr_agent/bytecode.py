"""The robot's byte-code: read, verified, and complete in its actions, before anything of it runs."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rmr.bytecode import codec
from rmr.bytecode.layout import SIZE_MAX, split
from rmr.bytecode.program import Program
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler, MissingHandlers, check_handlers
from rmr.node.actions.user_file import ActionsError, load_actions

if TYPE_CHECKING:
    from rmr.bus.signing import Trust


class RefusedError(Exception):
    """The robot cannot run this; the message says why and what to do."""


class Loaded(NamedTuple):
    """A program and its identity."""

    program: Program
    digest: int
    octets: bytes
    trust: "Trust | None" = None
    """Whose programs the robot runs, this one and those that it is loaded with; None: anybody's."""

    def distrusts(self, octets: bytes) -> str:
        """Return why the robot is not to run the byte-code in `octets`, and what to do. Raises BytecodeError."""
        return "" if self.trust is None else self.trust.problem(*split(octets))


def no_program(trust: "Trust | None" = None) -> Loaded:
    """Return what a robot has that waits for its first program: an empty one that is never started."""
    return Loaded(Program(()), 0, b"", trust)


def load_program(path: Path, trust: "Trust | None" = None) -> Loaded:
    """Return the verified program in `path`. Raises RefusedError."""
    try:
        with path.open("rb") as file:
            data = file.read(SIZE_MAX + 1)
    except OSError as error:
        raise RefusedError(f"{path}: {error.strerror or error}") from None
    try:
        loaded = Loaded(codec.decode(data), codec.digest(data), data, trust)
        if why := loaded.distrusts(data):
            raise RefusedError(f"{path}: {why}")
        return loaded
    except codec.BytecodeError as error:
        hint = " (compile it first: rmrc PROG.rmr)" if path.suffix == ".rmr" else ""
        raise RefusedError(f"{path}: {error}{hint}") from None


def load_handlers(path: Path | None) -> dict[str, Handler]:
    """Return the handlers that the user's file registers, if there is one. Raises RefusedError."""
    try:
        return load_actions(path)
    except ActionsError as error:
        raise RefusedError(str(error)) from None


def check_actions(program: Program, handlers: dict[str, Handler]) -> None:
    """Raise RefusedError if the program declares actions that nothing carries out; it names all, and where."""
    try:
        check_handlers(program, {**PROVIDED, **handlers})
    except MissingHandlers as error:
        raise RefusedError(str(error)) from None

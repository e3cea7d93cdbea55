"""Whether a robot can run a program: sound byte-code, handlers for its actions, areas that the lab has.

A robot has no lab file: it knows its arena, its finish fact and the handlers that it was started with.
"""

from collections.abc import Mapping

from rmr.analysis.area_uses import area_uses
from rmr.base.arena import Arena
from rmr.bytecode import codec
from rmr.bytecode.codec import BytecodeError
from rmr.bytecode.program import Kind, Program
from rmr.bytecode.provided import PREDICATES
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler, MissingHandlers, check_handlers
from rmr.node.config import FinishPattern


class UnfitError(ValueError):
    """The robot cannot run the program; the message says why."""


def fitting_program(
    octets: bytes,
    digest: int,
    arena: Arena,
    finish: FinishPattern | None,
    handlers: Mapping[str, Handler],
) -> Program:
    """Return the program in `octets`, which has this `digest`. Raises UnfitError."""
    try:
        found = codec.digest(octets)
        program = codec.decode(octets)
    except BytecodeError as error:
        raise UnfitError(f"the byte-code is damaged or of another version: {error}") from error
    if found != digest:
        raise UnfitError(f"the byte-code has the digest {found:08x}, not {digest:08x}: it was damaged on its way")
    try:
        check_handlers(program, {**PROVIDED, **handlers})
    except MissingHandlers as error:
        raise UnfitError(str(error)) from error
    for use in area_uses(program):
        area = arena.area(use.area)
        if area is None:
            raise UnfitError(f"area '{use.area}', used {use.where}, is not defined in this lab")
        if use.needs_queue and not area.queue:
            raise UnfitError(f"area '{use.area}', used {use.where}, has no queue in this lab")
    if finish is not None and finish[0] not in PREDICATES:
        index = program.index(finish[0])
        if index is None or program.predicates[index].kind is Kind.ACTION:
            raise UnfitError(f"it has no fact '{finish[0]}', by which this lab knows that a robot has finished")
        if len(program.predicates[index].types) != len(finish[1]):
            raise UnfitError(f"its fact '{finish[0]}', the lab's finish, has another number of arguments")
    return program

"""A lab's program, from source or byte-code, loaded and validated against the lab.

Used by the programs that start a lab: the simulator, the launcher, the world server. A robot process does not import
this module; it carries byte-code only.
"""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rmr.base.errors import CompileError
from rmr.base.errors import ProgramError as ProgramError  # noqa: PLC0414 - re-exported
from rmr.base.record import record
from rmr.base.values import Value
from rmr.bytecode import codec
from rmr.bytecode.codec import BytecodeError
from rmr.bytecode.layout import SIZE_MAX
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_file
from rmr.lang.diagnostics.render import render_text, to_json
from rmr.node.actions.built_in import PROVIDED
from rmr.node.actions.dispatcher import Handler, MissingHandlers, RobotHandle, check_handlers
from rmr.node.actions.user_file import ActionsError, load_actions
from rmr_world.finding import Finding, LabError, near_miss
from rmr_world.lab import Lab, ProgramLoad
from rmr_world.validate.pipeline import run_findings


@record
class LoadedProgram:
    """A program that is ready to run."""

    program: Program
    octets: bytes
    """Its byte-code, with the debug section."""
    digest: int
    """Identifies the program in messages between robots."""
    warnings: str
    """Warnings of the compiler, then of validation, rendered; empty when there are none."""


def load_program(path: Path, *, color: bool = False, stated: Iterable[str] = (), closed: bool = False) -> LoadedProgram:
    """Return the program in `path`, a ``.rmr`` or ``.rbc`` file. Raises ProgramError with all that is wrong.

    `stated` are predicates with facts in the lab: the compiler does not warn that nothing makes them. `closed`: no
    others come from outside.
    """
    if path.suffix == ".rbc":
        return _load_bytecode(path)
    compilation = compile_file(path, dict.fromkeys(stated, False), closed=closed)
    text = render_text(compilation.diagnostics, compilation.sources, color)
    if compilation.program is None:
        raise CompileError(text, to_json(compilation.diagnostics, compilation.sources))
    octets = codec.encode(compilation.program, debug=True)
    return LoadedProgram(compilation.program, octets, codec.digest(octets), text)


def load_lab_program(lab: Lab, *, color: bool = False) -> LoadedProgram:
    """Return the program that `lab` names. Raises LabError if there is no such file, else as `load_program`."""
    if not lab.program.exists():
        raise LabError([program_missing(lab)])
    return load_program(lab.program, color=color, stated=lab.given, closed=lab.is_closed)


def later_programs(lab: Lab, *, durable: bool) -> tuple[tuple[ProgramLoad, LoadedProgram], ...]:
    """Return the loads of `lab` with their programs. Raises ProgramError; so it does if robots are `durable`."""
    if lab.loads and durable:
        message = "loads: the state of a durable robot belongs to its program; leave out loads or --durable"
        raise ProgramError(f"{lab.path}: {message}")
    return tuple((load, load_program(load.program)) for load in lab.loads)


def program_missing(lab: Lab) -> Finding:
    """Return the error of a lab whose program file does not exist."""
    beside = sorted(path.name for path in lab.program.parent.glob("*.r[mb][rc]"))
    return lab.error(("program",), f"there is no file {lab.program}{near_miss(lab.program.name, beside)}")


def validated(lab: Lab, loaded: LoadedProgram) -> LoadedProgram:
    """Return `loaded` with the warnings of its run in `lab` added to its own. Raises LabError with all errors."""
    findings = run_findings(lab, loaded.program)
    errors = [finding for finding in findings if not finding.is_warning]
    if errors:
        raise LabError(errors)
    return replace(loaded, warnings="".join([loaded.warnings, *(f"{finding}\n" for finding in findings)]))


def _load_bytecode(path: Path) -> LoadedProgram:
    try:
        with path.open("rb") as file:
            octets = file.read(SIZE_MAX + 1)
        return LoadedProgram(codec.decode(octets), octets, codec.digest(octets), "")
    except OSError as error:
        raise ProgramError(f"{path}: {error.strerror}") from error
    except BytecodeError as error:
        raise ProgramError(f"{path}: {error}") from error


async def _at_once(_robot: RobotHandle, *_args: Value) -> None:
    """Stand for an action that the world carries out, where there is nothing outside."""


def load_handlers(program: Program, actions: Path | None, performs: Iterable[str] = ()) -> dict[str, Handler]:
    """Return the handlers in the file `actions`, and such as end at once for what the world `performs` beside them.

    Raises ProgramError if the file is wrong, or any handler of `program` is missing.
    """
    try:
        handlers = {name: Handler(name, _at_once) for name in performs} | load_actions(actions)
        check_handlers(program, {**PROVIDED, **handlers})
    except (ActionsError, MissingHandlers) as error:
        raise ProgramError(str(error)) from error
    return handlers

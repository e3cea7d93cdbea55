"""The language's commands: `rmr check`, `rmr compile` (also `rmrc`) and `rmr dis`.

They print what the compiler found and choose the exit code. The parser is imported only by those that parse.
"""

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rmr.cli import EXIT_FAILED, EXIT_INVALID, EXIT_USAGE, version_option

if TYPE_CHECKING:
    from rmr.lang.compiler import Compilation

OCTETS_MAX = 1 << 24
"""A larger byte-code file is none."""

_path = click.Path(path_type=Path)
_settings = {"help_option_names": ["-h", "--help"]}


@click.command("check", context_settings=_settings)
@click.argument("programs", metavar="PROG.rmr...", nargs=-1, required=True, type=_path)
@click.option("--json", "as_json", is_flag=True, help="Print the diagnostics as one JSON list on stdout.")
@version_option
def check(programs: tuple[Path, ...], as_json: bool) -> None:
    """Check programs and print what is wrong with them."""
    from rmr.lang.compiler import compile_file  # noqa: PLC0415

    compilations = [compile_file(path) for path in programs]
    if as_json:
        _print_json(_as_json(compilations))
    else:
        _show(compilations)
    sys.exit(_exit_code(compilations))


@click.command("compile", context_settings=_settings)
@click.argument("program", metavar="PROG.rmr", type=_path)
@click.option("-o", "--output", metavar="PROG.rbc", type=_path, help="Where to write; default beside the program.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on stdout.")
@click.option("--debug/--no-debug", default=False, show_default=True, help="Add where everything stands in the source.")
@version_option
def compile_command(program: Path, output: Path | None, as_json: bool, debug: bool) -> None:
    """Compile a program to byte-code; nothing is written if it has errors."""
    from rmr.bytecode.codec import encode  # noqa: PLC0415
    from rmr.lang.compiler import compile_file  # noqa: PLC0415

    target = output if output is not None else program.with_suffix(".rbc")
    if target == program:
        raise click.UsageError(f"the output {target} is the program itself")
    compilation = compile_file(program)
    summary: dict[str, object] = {"file": str(program), "output": None}
    code = _exit_code([compilation])
    if compilation.program is not None:
        octets = encode(compilation.program, debug=debug)
        code = _write(target, octets)
        summary |= {
            "output": str(target) if code == 0 else None,
            "octets": len(octets),
            "predicates": len(compilation.program.predicates),
            "rules": len(compilation.program.rules),
            "assertions": len(compilation.program.assertions),
        }
    if as_json:
        _print_json(summary | {"diagnostics": _as_json([compilation])})
        sys.exit(code)
    _show([compilation])
    if compilation.program is not None and code == 0:
        warnings = _count(len(compilation.diagnostics), "warning")
        parts = [_count(len(octets), "octet"), _count(len(compilation.program.predicates), "predicate")]
        parts += [_count(len(compilation.program.rules), "rule"), warnings]
        click.echo(f"{target}: {', '.join(parts)}")
    sys.exit(code)


@click.command("dis", context_settings=_settings)
@click.argument("program", metavar="PROG.rbc", type=_path)
@version_option
def dis(program: Path) -> None:
    """Print byte-code as annotated text, offsets in hex."""
    from rmr.bytecode.disassemble import disassemble  # noqa: PLC0415
    from rmr.bytecode.wire import BytecodeError  # noqa: PLC0415

    try:
        with program.open("rb") as stream:
            octets = stream.read(OCTETS_MAX + 1)
    except (OSError, ValueError) as error:
        click.echo(f"{program}: error: {_reason(error)}", err=True)
        sys.exit(EXIT_USAGE)
    try:
        if len(octets) > OCTETS_MAX:
            raise BytecodeError(f"larger than {OCTETS_MAX >> 20} MiB")
        click.echo(disassemble(octets))
    except BytecodeError as error:
        click.echo(f"{program}: error: not a valid byte-code file: {error}", err=True)
        sys.exit(EXIT_INVALID)


# ---- output


def _show(compilations: Sequence["Compilation"]) -> None:
    """Print diagnostics for people, and one line at the end, to stderr."""
    from rmr.lang.render import render_text  # noqa: PLC0415

    color = sys.stderr.isatty() and "NO_COLOR" not in os.environ
    for each in compilations:
        text = render_text(each.diagnostics, {each.source.file: each.source}, color)
        click.echo(text, nl=False, err=True, color=color)
    errors = sum(len(each.errors) for each in compilations)
    warnings = sum(len(each.diagnostics) for each in compilations) - errors
    if errors or warnings:
        click.echo(f"{_count(errors, 'error')}, {_count(warnings, 'warning')}", err=True)


def _as_json(compilations: Sequence["Compilation"]) -> list[dict[str, object]]:
    from rmr.lang.render import to_json  # noqa: PLC0415

    return [listed for each in compilations for listed in to_json(each.diagnostics, {each.source.file: each.source})]


def _print_json(value: object) -> None:
    click.echo(json.dumps(value, indent=2))


def _count(number: int, word: str) -> str:
    return f"{number} {word}" + ("" if number == 1 else "s")


def _exit_code(compilations: Sequence["Compilation"]) -> int:
    if any(each.errors and not each.unreadable for each in compilations):
        return EXIT_INVALID
    return EXIT_USAGE if any(each.unreadable for each in compilations) else 0


# ---- files


def _write(target: Path, octets: bytes) -> int:
    """Write `target` as a whole or not at all; return the exit code."""
    temporary = ""
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(octets)
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    except (OSError, ValueError) as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        click.echo(f"{target}: error: {_reason(error)}", err=True)
        return EXIT_FAILED
    return 0


def _umask() -> int:
    """Return the mask of permissions, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)

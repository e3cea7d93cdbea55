"""The command `rmr`: the language's own subcommands, and the way to the other packages' commands.

Nothing is imported before it is needed, so that help and wrong usage cost next to nothing; that is why the
imports of the compiler stand inside the functions. A subcommand of another package is a program of its own,
`rmr-X`, which stands beside the interpreter that runs this; `rmr X` becomes it.
"""
# ruff: noqa: PLC0415 - see above

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rmr import __version__

if TYPE_CHECKING:
    from rmr.lang.compiler import Compilation

EXIT_FAILED = 1
"""It ran and failed."""
EXIT_USAGE = 2
"""Wrong usage."""
EXIT_INVALID = 3
"""An invalid program, byte-code or lab file."""

BYTECODE_OCTETS_MAX = 1 << 24
"""A larger file is no byte-code."""

PROGRAMS: dict[str, str] = {
    "up": "Run a lab with one process for each robot.",
    "sim": "Run a lab deterministically, in virtual time.",
    "agent": "Run one robot.",
    "world": "Run the world server of a lab.",
}
"""The subcommands that are programs of their own, and what help says of them."""

_path = click.Path(path_type=Path)
_settings = {"help_option_names": ["-h", "--help"]}
_version = click.version_option(__version__, prog_name="rmr", message="%(prog)s %(version)s")


class Commands(click.Group):
    """A group that knows the other packages' programs as well."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names, the language's own first."""
        return [*super().list_commands(ctx), *PROGRAMS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a subcommand, or one that becomes a program."""
        return _program(cmd_name) if cmd_name in PROGRAMS else super().get_command(ctx, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the subcommand that `args` name; a misspelt one gets the nearest name as a hint."""
        known = self.list_commands(ctx)
        if args and args[0] not in known and not args[0].startswith("-"):
            from difflib import get_close_matches

            matches = get_close_matches(args[0], known, n=1)
            hint = f" Did you mean '{matches[0]}'?" if matches else ""
            ctx.fail(f"No such command '{args[0]}'.{hint}")
        return super().resolve_command(ctx, args)


def _program(name: str) -> click.Command:
    """Return the subcommand that becomes the program `rmr-NAME` and passes it all arguments."""

    def become(arguments: tuple[str, ...]) -> None:
        path = Path(sys.executable).with_name(f"rmr-{name}")
        if not path.is_file():
            click.echo(f"rmr {name}: {path} is not installed; install the package `rmr` there", err=True)
            sys.exit(EXIT_FAILED)
        sys.stdout.flush()
        try:
            os.execv(path, [str(path), *arguments])
        except OSError as error:
            click.echo(f"rmr {name}: cannot run {path}: {error.strerror}", err=True)
            sys.exit(EXIT_FAILED)

    return click.Command(
        name,
        callback=become,
        params=[click.Argument(["arguments"], nargs=-1, type=click.UNPROCESSED)],
        help=PROGRAMS[name],
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False},
    )


@click.command(cls=Commands, context_settings=_settings)
@_version
def main() -> None:
    """One logic program for a whole ensemble of robots, with deadlines that hold."""


def compile_main() -> None:
    """Run `rmrc`, which is `rmr compile`."""
    compile_program.main(prog_name="rmrc")


@main.command("check", context_settings=_settings)
@click.argument("programs", metavar="PROG.rmr...", nargs=-1, required=True, type=_path)
@click.option("--json", "as_json", is_flag=True, help="Print the diagnostics as one JSON list on stdout.")
@_version
def check(programs: tuple[Path, ...], as_json: bool) -> None:
    """Check programs and print what is wrong with them."""
    from rmr.lang.compiler import compile_file

    compilations = [compile_file(path) for path in programs]
    if as_json:
        _print_json(_as_json(compilations))
    else:
        _show(compilations)
    sys.exit(_exit_code(compilations))


@main.command("compile", context_settings=_settings, short_help="Compile a program to byte-code.")
@click.argument("program", metavar="PROG.rmr", type=_path)
@click.option("-o", "--output", metavar="PROG.rbc", type=_path, help="Where to write; default: beside the program.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on stdout.")
@click.option("--debug/--no-debug", default=False, show_default=True, help="Add where everything stands in the source.")
@_version
def compile_program(program: Path, output: Path | None, as_json: bool, debug: bool) -> None:
    """Compile a program to byte-code; nothing is written if it has errors."""
    from rmr.bytecode.codec import encode
    from rmr.lang.compiler import compile_file

    target = output if output is not None else _beside(program)
    if _same(target, program):
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
            "warnings": len(compilation.diagnostics),
        }
    if as_json:
        _print_json(summary | {"diagnostics": _as_json([compilation])})
    else:
        _show([compilation])
    if compilation.program is not None and code == 0 and not as_json:
        words = ("octets", "predicates", "rules", "warnings")
        click.echo(f"{target}: " + ", ".join(_count(summary[word], word) for word in words))
    sys.exit(code)


@main.command("dis", context_settings=_settings)
@click.argument("program", metavar="PROG.rbc", type=_path)
@_version
def disassemble_program(program: Path) -> None:
    """Print byte-code as annotated text, offsets in hex."""
    from rmr.bytecode.disassemble import disassemble
    from rmr.bytecode.wire import BytecodeError

    try:
        with program.open("rb") as stream:
            octets = stream.read(BYTECODE_OCTETS_MAX + 1)
    except (OSError, ValueError) as error:
        click.echo(f"{program}: error: {_reason(error)}", err=True)
        sys.exit(EXIT_USAGE)
    try:
        if len(octets) > BYTECODE_OCTETS_MAX:
            raise BytecodeError(f"larger than {BYTECODE_OCTETS_MAX >> 20} MiB")
        text = disassemble(octets)
    except BytecodeError as error:
        click.echo(f"{program}: error: this is no valid byte-code: {error}", err=True)
        sys.exit(EXIT_INVALID)
    click.echo(text.rstrip("\n"))


# ---- output


def _show(compilations: Sequence["Compilation"]) -> None:
    """Print diagnostics for people, and their number, to stderr."""
    from rmr.lang.render import render_text

    color = sys.stderr.isatty() and "NO_COLOR" not in os.environ
    for each in compilations:
        text = render_text(each.diagnostics, {each.source.file: each.source}, color)
        click.echo(text, nl=False, err=True, color=color)
    errors = sum(len(each.errors) for each in compilations)
    warnings = sum(len(each.diagnostics) for each in compilations) - errors
    if errors or warnings:
        click.echo(f"{_count(errors, 'errors')}, {_count(warnings, 'warnings')}", err=True)


def _as_json(compilations: Sequence["Compilation"]) -> list[dict[str, object]]:
    from rmr.lang.render import to_json

    return [listed for each in compilations for listed in to_json(each.diagnostics, {each.source.file: each.source})]


def _print_json(value: object) -> None:
    click.echo(json.dumps(value, indent=2))


def _count(number: object, words: str) -> str:
    return f"{number} {words}" if number != 1 else f"1 {words[:-1]}"


def _exit_code(compilations: Sequence["Compilation"]) -> int:
    if any(each.errors and not each.unreadable for each in compilations):
        return EXIT_INVALID
    return EXIT_USAGE if any(each.unreadable for each in compilations) else 0


# ---- files


def _beside(program: Path) -> Path:
    return program.with_suffix(".rbc") if program.name else program


def _same(one: Path, other: Path) -> bool:
    try:
        return one == other or one.samefile(other)
    except (OSError, ValueError):
        return False


def _write(target: Path, octets: bytes) -> int:
    """Write `target` as a whole or not at all; return the exit code."""
    temporary = ""
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=".rmr-", dir=target.parent)
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

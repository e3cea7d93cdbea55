"""`rmr dis`: byte-code as annotated text."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from pathlib import Path

import click

from rmr.commands.common import EXIT_INVALID, EXIT_USAGE, PATH, SETTINGS, VERSION, reason


@click.command("dis", context_settings=SETTINGS)
@click.argument("program", metavar="PROG.rbc", type=PATH)
@VERSION
def command(program: Path) -> None:
    """Print byte-code as annotated text, offsets in hex."""
    from rmr.bytecode.disassemble import disassemble
    from rmr.bytecode.layout import SIZE_MAX
    from rmr.bytecode.octets import BytecodeError

    try:
        with program.open("rb") as stream:
            octets = stream.read(SIZE_MAX + 1)
    except (OSError, ValueError) as error:
        click.echo(f"{program}: error: {reason(error)}", err=True)
        sys.exit(EXIT_USAGE)
    try:
        text = disassemble(octets)
    except BytecodeError as error:
        click.echo(f"{program}: error: this is no valid byte-code: {error}", err=True)
        sys.exit(EXIT_INVALID)
    click.echo(text.rstrip("\n"))

"""`rmr dis`: byte-code as annotated text."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from pathlib import Path

import click

from rmr.commands.common import EXIT_INVALID, EXIT_USAGE, PATH, SETTINGS, VERSION, reason

BYTECODE_OCTETS_MAX = 1 << 24
"""A larger file is no byte-code."""


@click.command("dis", context_settings=SETTINGS)
@click.argument("program", metavar="PROG.rbc", type=PATH)
@VERSION
def command(program: Path) -> None:
    """Print byte-code as annotated text, offsets in hex."""
    from rmr.bytecode.disassemble import disassemble
    from rmr.bytecode.wire import BytecodeError

    try:
        with program.open("rb") as stream:
            octets = stream.read(BYTECODE_OCTETS_MAX + 1)
    except (OSError, ValueError) as error:
        click.echo(f"{program}: error: {reason(error)}", err=True)
        sys.exit(EXIT_USAGE)
    try:
        if len(octets) > BYTECODE_OCTETS_MAX:
            raise BytecodeError(f"larger than {BYTECODE_OCTETS_MAX >> 20} MiB")
        text = disassemble(octets)
    except BytecodeError as error:
        click.echo(f"{program}: error: this is no valid byte-code: {error}", err=True)
        sys.exit(EXIT_INVALID)
    click.echo(text.rstrip("\n"))

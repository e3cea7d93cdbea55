"""`rmr dis`: byte-code as annotated text."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from pathlib import Path

from rmr.commands.common import reason
from rmr.entry import ExitCode
from rmr.entry.command_line import Command, Parser


def _declare(parser: Parser) -> None:
    parser.positional("program", "PROG.rbc")


def _disassemble(program: Path) -> int:
    """Print a byte-code file as text; return the exit code."""
    from rmr.bytecode.disassemble import disassemble
    from rmr.bytecode.layout import SIZE_MAX
    from rmr.bytecode.octets import BytecodeError

    try:
        with program.open("rb") as stream:
            octets = stream.read(SIZE_MAX + 1)
    except (OSError, ValueError) as error:
        print(f"{program}: error: {reason(error)}", file=sys.stderr)
        return ExitCode.USAGE
    try:
        text = disassemble(octets)
    except BytecodeError as error:
        print(f"{program}: error: this is no valid byte-code: {error}", file=sys.stderr)
        return ExitCode.INVALID
    print(text.rstrip("\n"))
    return ExitCode.OK


command = Command("Print byte-code as annotated text, offsets in hex.", _declare, _disassemble)

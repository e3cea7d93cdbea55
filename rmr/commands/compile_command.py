"""`rmr compile`, also `rmrc`: source in, byte-code out."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from pathlib import Path

from rmr.base.printable import counted
from rmr.commands import diagnosed
from rmr.commands.common import write
from rmr.entry import ExitCode, print_json
from rmr.entry.command_line import Command, CommandLineError, Parser


def _declare(parser: Parser) -> None:
    parser.positional("program", "PROG.rmr")
    parser.option("-o", "--output", metavar="PROG.rbc", read=Path, help="Where to write; default: beside the program.")
    parser.flag("--json", dest="as_json", help="Print the result as JSON on stdout.")
    parser.flag("--strip", help="Leave out where everything stands in the source.")


def _compile(program: Path, output: Path | None, as_json: bool, strip: bool) -> int:
    """Compile a program; return the exit code."""
    from rmr.bytecode.codec import BytecodeError, encode
    from rmr.lang.compiler import compile_file

    target = output if output is not None else _beside(program)
    if _same(target, program):
        raise CommandLineError(f"the output {target} is the program itself")
    compilation = compile_file(program)
    summary: dict[str, object] = {"file": str(program), "output": None}
    code = diagnosed.exit_code([compilation])
    if compilation.program is not None:
        try:
            octets = encode(compilation.program, debug=not strip)
        except BytecodeError as error:
            print(f"{program}: error: {error}", file=sys.stderr)
            return ExitCode.INVALID
        code = write(target, octets)
        summary |= {
            "output": str(target) if code == 0 else None,
            "octets": len(octets),
            "predicates": len(compilation.program.predicates),
            "rules": len(compilation.program.rules),
            "assertions": len(compilation.program.assertions),
            "warnings": len(compilation.diagnostics),
        }
    if as_json:
        print_json(summary | {"diagnostics": diagnosed.as_json([compilation])})
    else:
        diagnosed.show([compilation])
    if compilation.program is not None and code == 0 and not as_json:
        words = ("octets", "predicates", "rules", "warnings")
        print(f"{target}: " + ", ".join(counted(summary[word], word.removesuffix("s")) for word in words))
    return code


command = Command("Compile a program to byte-code; nothing is written if it has errors.", _declare, _compile)


def _beside(program: Path) -> Path:
    return program.with_suffix(".rbc") if program.name else program


def _same(one: Path, other: Path) -> bool:
    try:
        return one == other or one.samefile(other)
    except (OSError, ValueError):
        return False

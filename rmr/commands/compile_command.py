"""`rmr compile`, also `rmrc`: source in, byte-code out."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from pathlib import Path

import click

from rmr.commands import diagnosed
from rmr.commands.common import PATH, SETTINGS, VERSION, counted, print_json, write
from rmr.entry import ExitCode


@click.command("compile", context_settings=SETTINGS, short_help="Compile a program to byte-code.")
@click.argument("program", metavar="PROG.rmr", type=PATH)
@click.option("-o", "--output", metavar="PROG.rbc", type=PATH, help="Where to write; default: beside the program.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on stdout.")
@click.option("--strip", is_flag=True, help="Leave out where everything stands in the source.")
@VERSION
def command(program: Path, output: Path | None, as_json: bool, strip: bool) -> None:
    """Compile a program to byte-code; nothing is written if it has errors."""
    from rmr.bytecode.codec import BytecodeError, encode
    from rmr.lang.compiler import compile_file

    target = output if output is not None else _beside(program)
    if _same(target, program):
        raise click.UsageError(f"the output {target} is the program itself")
    compilation = compile_file(program)
    summary: dict[str, object] = {"file": str(program), "output": None}
    code = diagnosed.exit_code([compilation])
    if compilation.program is not None:
        try:
            octets = encode(compilation.program, debug=not strip)
        except BytecodeError as error:
            click.echo(f"{program}: error: {error}", err=True)
            sys.exit(ExitCode.INVALID)
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
        click.echo(f"{target}: " + ", ".join(counted(summary[word], word) for word in words))
    sys.exit(code)


def _beside(program: Path) -> Path:
    return program.with_suffix(".rbc") if program.name else program


def _same(one: Path, other: Path) -> bool:
    try:
        return one == other or one.samefile(other)
    except (OSError, ValueError):
        return False

"""`rmr check`: diagnostics only."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys
from pathlib import Path

import click

from rmr.commands import diagnosed
from rmr.commands.common import PATH, SETTINGS, VERSION, print_json


@click.command("check", context_settings=SETTINGS)
@click.argument("programs", metavar="PROG.rmr...", nargs=-1, required=True, type=PATH)
@click.option("--json", "as_json", is_flag=True, help="Print the diagnostics as one JSON list on stdout.")
@VERSION
def command(programs: tuple[Path, ...], as_json: bool) -> None:
    """Check programs and print what is wrong with them."""
    from rmr.lang.compiler import compile_file

    compilations = [compile_file(path) for path in programs]
    if as_json:
        print_json(diagnosed.as_json(compilations))
    else:
        diagnosed.show(compilations)
    sys.exit(diagnosed.exit_code(compilations))

"""The commands `rmr lab` and `rmr new`: their options alone, so that `--help` costs little."""
# ruff: noqa: PLC0415 - what does the work loads when it is asked for

import json
import os
import sys
from pathlib import Path

import click

from rmr import __version__
from rmr.entry import ExitCode
from rmr_world.provided_labs import missing, provided_labs, resolve

SETTINGS = {"help_option_names": ["-h", "--help"]}
PATH = click.Path(path_type=Path)


def _existing(ctx: click.Context, param: click.Parameter, paths: tuple[Path, ...]) -> tuple[Path, ...]:
    """Return `paths` if each is there, or is the name of a provided lab."""
    for path in paths:
        if not resolve(path).exists():
            raise click.BadParameter(missing(path), ctx, param)
    return paths


@click.group(context_settings=SETTINGS)
@click.version_option(__version__, prog_name="rmr lab", message="%(prog)s %(version)s")
def command() -> None:
    """Check, draw, list and copy labs; print the schema of the lab file."""


@command.command("check", context_settings=SETTINGS, short_help="Check labs and their programs; draw them.")
@click.argument("paths", metavar="LAB...", nargs=-1, required=True, type=PATH, callback=_existing)
@click.option("--json", "as_json", is_flag=True, help="Print the findings as one JSON list on stdout.")
@click.option("--svg", metavar="FILE", type=PATH, help="Draw the lab: floor, areas, robots and their ways.")
def check(paths: tuple[Path, ...], as_json: bool, svg: Path | None) -> None:
    """Check LAB, a lab.yaml, its folder or a provided lab, and all that is judged before it runs.

    That is the lab file, its program, whether both fit, deadlines, ways, turns, and the files of actions and events.
    A program, PROG.rmr, is checked by itself.
    """
    from rmr_lab.checking import perform

    if svg is not None and len(paths) != 1:
        raise click.UsageError("--svg draws one lab: name one")
    if svg is not None and paths[0].suffix == ".rmr":
        raise click.UsageError("--svg draws a lab: name a lab file or its folder, not a program")
    sys.exit(perform(paths, as_json=as_json, svg=svg))


@command.command("schema", context_settings=SETTINGS, short_help="Print the JSON Schema of the lab file.")
@click.option("-o", "--output", metavar="FILE", type=PATH, help="Write it to FILE instead.")
def schema(output: Path | None) -> None:
    """Print the JSON Schema (2020-12) of the lab file, for editors.

    A lab file that begins with `# yaml-language-server: $schema=FILE` is completed and checked by them as it is
    written.
    """
    from rmr_world.schema import json_schema

    text = json.dumps(json_schema(), indent=2) + "\n"
    if output is None:
        click.echo(text, nl=False)
    else:
        _write(output, text)


@command.command("list", context_settings=SETTINGS, short_help="List the provided labs.")
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON on stdout.")
def list_(as_json: bool) -> None:
    """List the labs that come with RMR: each runs by its name, in every folder, as in `rmr up corridor`."""
    from rmr_lab.provide import about

    rows = [{"name": name, "about": about(folder), "folder": str(folder)} for name, folder in provided_labs().items()]
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    width = max((len(row["name"]) for row in rows), default=0)
    click.echo("".join(f"{row['name'].ljust(width)}  {row['about']}\n" for row in rows), nl=False)


@command.command("copy", context_settings=SETTINGS, short_help="Copy a provided lab into a folder of your own.")
@click.argument("name", metavar="NAME")
@click.argument("folder", metavar="[DIR]", type=PATH, required=False)
def copy(name: str, folder: Path | None) -> None:
    """Copy the provided lab NAME, with its program, to DIR, which must not exist yet (default: NAME)."""
    from rmr_lab.provide import CopyError
    from rmr_lab.provide import copy as copied

    target = Path(name) if folder is None else folder
    try:
        files = copied(name, target)
    except CopyError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        click.echo(f"rmr lab copy: {error.filename or target}: {error.strerror}", err=True)
        sys.exit(ExitCode.USAGE)
    _tell_written(target, files)


@click.command("new", context_settings=SETTINGS)
@click.argument("name", metavar="NAME", type=PATH)
@click.option("--from", "origin", metavar="LAB", help="Begin with the files of a provided lab (rmr lab list).")
@click.version_option(__version__, prog_name="rmr new", message="%(prog)s %(version)s")
def new(name: Path, origin: str | None) -> None:
    """Write a lab of your own into the folder NAME, which must not exist yet: it runs at once.

    It holds the lab file, a program, an action in Python, a test, and a README that says what to do with them.
    """
    from rmr_lab.provide import CopyError
    from rmr_lab.scaffold import write_lab

    try:
        files = write_lab(name, origin)
    except CopyError as error:
        raise click.UsageError(str(error)) from None
    except OSError as error:
        click.echo(f"rmr new: {error.filename or name}: {error.strerror}", err=True)
        sys.exit(ExitCode.USAGE)
    _tell_written(name, files)


def _tell_written(folder: Path, files: list[Path]) -> None:
    for file in files:
        click.echo(os.fspath(file))
    click.echo(f"now: rmr check {folder} && rmr sim {folder} && rmr up {folder}", err=True)


def _write(file: Path, text: str) -> None:
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        click.echo(f"{file}: {error.strerror}", err=True)
        sys.exit(ExitCode.USAGE)

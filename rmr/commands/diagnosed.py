"""What the subcommands that compile say about programs: diagnostics for people or as JSON, and the exit code."""
# ruff: noqa: PLC0415 - the compiler is imported when there is something to say

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from rmr.commands.common import EXIT_INVALID, EXIT_USAGE, counted

if TYPE_CHECKING:
    from rmr.lang.compiler import Compilation


def show(compilations: Sequence["Compilation"]) -> None:
    """Print diagnostics for people, and their number, to stderr."""
    from rmr.lang.render import render_text

    color = sys.stderr.isatty() and "NO_COLOR" not in os.environ
    for each in compilations:
        text = render_text(each.diagnostics, {each.source.file: each.source}, color)
        click.echo(text, nl=False, err=True, color=color)
    errors = sum(len(each.errors) for each in compilations)
    warnings = sum(len(each.diagnostics) for each in compilations) - errors
    if errors or warnings:
        click.echo(f"{counted(errors, 'errors')}, {counted(warnings, 'warnings')}", err=True)


def as_json(compilations: Sequence["Compilation"]) -> list[dict[str, object]]:
    """Return the diagnostics as values for JSON."""
    from rmr.lang.render import to_json

    return [listed for each in compilations for listed in to_json(each.diagnostics, {each.source.file: each.source})]


def exit_code(compilations: Sequence["Compilation"]) -> int:
    """Return 0, or the code for the worst that is wrong."""
    if any(each.errors and not each.unreadable for each in compilations):
        return EXIT_INVALID
    return EXIT_USAGE if any(each.unreadable for each in compilations) else 0

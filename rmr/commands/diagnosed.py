"""Output of the subcommands that read programs: diagnostics for people or as JSON, and the exit code."""
# ruff: noqa: PLC0415 - the compiler is imported when there is something to say

import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rmr.base.printable import counted
from rmr.entry import ExitCode
from rmr.entry.terminal import has_colour

if TYPE_CHECKING:
    from rmr.lang.compiler import Compilation
    from rmr.lang.diagnostics.diagnostic import Diagnostic
    from rmr.lang.read.source_text import SourceText

Found = tuple[Sequence["Diagnostic"], Mapping[str, "SourceText"]]
"""The diagnostics of one program, and the sources of its files by name."""


def show(compilations: Sequence["Compilation"]) -> None:
    """Print diagnostics for people, and their number, to stderr."""
    show_found([(each.diagnostics, each.sources) for each in compilations])


def show_found(found: Sequence[Found]) -> None:
    """Print diagnostics for people, their number and where to read on, to stderr."""
    every = [each for diagnostics, _ in found for each in diagnostics]
    if not every:
        return
    from rmr.lang.diagnostics.diagnostic import Severity
    from rmr.lang.diagnostics.render import render_text

    color = has_colour(sys.stderr)
    for diagnostics, sources in found:
        print(render_text(diagnostics, sources, color), end="", file=sys.stderr)
    errors = [each for each in every if each.severity is Severity.ERROR]
    print(f"{counted(len(errors), 'error')}, {counted(len(every) - len(errors), 'warning')}", file=sys.stderr)
    print(f"for more: rmr explain {(errors or every)[0].code}", file=sys.stderr)


def as_json(compilations: Sequence["Compilation"]) -> list[dict[str, object]]:
    """Return the diagnostics as values for JSON."""
    from rmr.lang.diagnostics.render import to_json

    return [listed for each in compilations for listed in to_json(each.diagnostics, each.sources)]


def exit_code(compilations: Sequence["Compilation"]) -> int:
    """Return 0, or the exit code of the most severe error."""
    if any(each.errors and not each.unreadable for each in compilations):
        return ExitCode.INVALID
    return ExitCode.USAGE if any(each.unreadable for each in compilations) else 0

"""`rmr fmt`: programs in canonical layout, in place.

A file is replaced as a whole, behind its symbolic link if it is one, or not touched: neither if it has that layout
already nor if it has syntax errors. `-` is a filter from stdin to stdout.
"""
# ruff: noqa: PLC0415 - see rmr.commands

import stat
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rmr.base.printable import counted
from rmr.commands.common import (
    print_octets,
    write,
)
from rmr.commands.diagnosed import show_found
from rmr.entry import ExitCode, print_json
from rmr.entry.command_line import Command, CommandLineError, Parser

if TYPE_CHECKING:
    from rmr.lang.diagnostics.diagnostic import Diagnostic
    from rmr.lang.read.source_text import SourceText

STDIN = Path("-")


@dataclass(frozen=True, slots=True)
class _File:
    """A program's text and its canonical form, or the diagnostics that prevent it."""

    path: Path
    source: "SourceText"
    text: str
    wrong: "list[Diagnostic]"
    code: int

    @property
    def changes(self) -> bool:
        """Whether the layout is not the canonical one."""
        return self.text != self.source.text


def _declare(parser: Parser) -> None:
    parser.positional("programs", "PROG.rmr", count="+", usage="PROG.rmr...")
    parser.flag("--check", help="Write nothing; list the files that would change, and exit with 1 if any.")
    parser.flag("--diff", help="As --check, but print the changes.")
    parser.flag("--json", dest="as_json", help="Print which files change as one JSON document on stdout.")


def _format(programs: list[Path], check: bool, diff: bool, as_json: bool) -> int:
    """Format programs, or show what would change; return the exit code."""
    keeps = check or diff
    if STDIN in programs and len(programs) > 1:
        raise CommandLineError("`-` stands alone")
    if STDIN in programs and as_json and not keeps:
        raise CommandLineError("the program goes to stdout: `-` and --json need --check")
    files = [_formatted(path) for path in programs]
    show_found([(each.wrong, {each.source.file: each.source}) for each in files])
    code = max(each.code for each in files)
    changed = [each for each in files if each.changes]
    if keeps:
        code = code or (ExitCode.FAILED if changed else 0)
    elif STDIN in programs:
        print_octets(files[0].text.encode() if not files[0].wrong else b"")
    else:
        code = max([code, *(_replace(each) for each in changed)])
    if as_json:
        print_json({"files": [{"file": each.source.file, "changed": each.changes} for each in files]})
    elif diff:
        print_octets("".join(_difference(each) for each in changed).encode())
    elif check:
        print("".join(f"{each.source.file}\n" for each in changed), end="")
    elif STDIN not in programs:
        print(f"{counted(len(changed), 'file')} of {len(files)} formatted", file=sys.stderr)
    return code


ABOUT = "Bring programs into canonical layout, in place; comments are kept. `-` reads stdin and writes stdout."

command = Command(ABOUT, _declare, _format)


def _formatted(path: Path) -> _File:
    from rmr.lang.diagnostics.diagnostic import Diagnostic, Diagnostics
    from rmr.lang.format import format_source
    from rmr.lang.read.source_text import SourceError, SourceText, Span

    name = "<stdin>" if path == STDIN else str(path)
    try:
        source = _read(path, name)
    except SourceError as error:
        wrong = [Diagnostic("E003", str(error), Span(name, 0, 0), error.hint)]
        return _File(path, SourceText(name, ""), "", wrong, ExitCode.USAGE if error.usage else ExitCode.INVALID)
    found = Diagnostics()
    text = format_source(source, found)
    if text is None:
        return _File(path, source, source.text, found.in_order(), ExitCode.INVALID)
    return _File(path, source, text, [], 0)


def _read(path: Path, name: str) -> "SourceText":
    from rmr.lang.read.source_text import SOURCE_OCTETS_MAX, read_source, to_source

    return read_source(path) if path != STDIN else to_source(name, sys.stdin.buffer.read(SOURCE_OCTETS_MAX + 1))


def _replace(file: _File) -> int:
    """Write the new text; return the exit code."""
    target = file.path.resolve()
    if not target.is_file():
        print(f"{file.path}: error: no regular file; `-` reads from a pipe", file=sys.stderr)
        return ExitCode.USAGE
    return write(target, file.text.encode(), stat.S_IMODE(target.stat().st_mode))


def _difference(file: _File) -> str:
    from difflib import unified_diff

    name = file.source.file
    lines = unified_diff(_lines(file.source.text), _lines(file.text), name, name)
    return "".join(line if line.endswith("\n") else line + "\n\\ No newline at end of file\n" for line in lines)


def _lines(text: str) -> list[str]:
    return [line + "\n" for line in text.split("\n")[:-1]] + [line for line in text.split("\n")[-1:] if line]

"""`rmr man`: a manual page for each command, made of what the command says of itself with `--help`."""

import io
import os
import re
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout, suppress
from importlib import import_module
from pathlib import Path

from rmr import __version__
from rmr.base.printable import counted
from rmr.commands.common import reason
from rmr.entry import ExitCode
from rmr.entry.command_line import Command, Parser, Runnable

SCRIPTS = {"rmr-agent": "rmr_agent.main", "rmr-world": "rmr_world.main"}
"""The other programs -> the module of each, whose `command` makes the command; by name, as in `subcommands`."""


def _declare(parser: Parser) -> None:
    parser.positional("folder", "DIR", help="Where to write them; it is made if it does not exist.")


def _write(folder: Path) -> int:
    """Write the pages; return the exit code."""
    try:
        pages = write_pages(folder)
    except OSError as error:
        print(f"rmr man: {error.filename or folder}: {reason(error)}", file=sys.stderr)
        return ExitCode.USAGE
    print(f"{counted(len(pages), 'page')} in {folder}")
    return ExitCode.OK


def write_pages(folder: Path) -> list[Path]:
    """Write a page for each command into `folder` and return the files. Raises OSError. A wheel brings them, too."""
    pages = {folder / f"{name.replace(' ', '-')}.1": page(name, *parts_of(text)) for name, text in helps()}
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in pages.items():
        file.write_text(text, encoding="utf-8")
    return list(pages)


def helps() -> Iterator[tuple[str, str]]:
    """Yield each command, such as "rmr lab list", with what it says with `--help`; the site has that, too."""
    from rmr.commands.compile_command import command as rmrc  # noqa: PLC0415 - see rmr.commands
    from rmr.commands.subcommands import command as rmr  # noqa: PLC0415

    os.environ["COLUMNS"] = "100"  # as wide as help gets; man fills lines anew
    programs: dict[str, Runnable] = {"rmr": rmr, "rmrc": rmrc}
    programs |= {name: import_module(module).command() for name, module in SCRIPTS.items()}
    for name, command in programs.items():
        yield from _helps(command, name, [])


def parts_of(text: str) -> tuple[str, list[str]]:
    """Return the usage line of a help text and its other parts, which empty lines separate."""
    usage, *parts = text.split("\n\n")
    return usage, parts


def _helps(command: Runnable, name: str, words: list[str]) -> Iterator[tuple[str, str]]:
    """Yield those of `command` with `words` before its own, and of its subcommands."""
    told = io.StringIO()
    with redirect_stdout(told), suppress(SystemExit):
        command.main([*words, "--help"], name)
    yield " ".join([name, *words]), told.getvalue().strip()
    usage, parts = parts_of(told.getvalue().strip())
    if usage.endswith("COMMAND ..."):
        options = next(number for number, part in enumerate(parts) if part.startswith("options:"))
        for word in re.findall(r"^  (\S+)  ", "\n".join(parts[options + 1 :]), re.MULTILINE):
            yield from _helps(command, name, [*words, word])


def page(name: str, usage: str, parts: list[str]) -> str:
    """Return a manual page in roff: of a usage line, and the parts of a help text, which empty lines separate."""
    about, *others = parts
    summary = " ".join(about.split()).partition(". ")[0].rstrip(".:")
    lines = [
        f'.TH "{name.replace(" ", "-").upper()}" 1 "" "rmr-robots {__version__}"',
        ".SH NAME",
        f"{_plain(name.replace(' ', '-'))} \\- {_plain(summary)}",
        ".SH SYNOPSIS",
        _plain(usage.removeprefix("usage: ")),
        ".SH DESCRIPTION",
    ]
    for part in [about, *others]:
        if heading := re.match(r"(\S.*):\n(?=  )", part):
            lines.append(f'.SH "{heading[1].upper()}"')
            part = part[heading.end() :]  # noqa: PLW2901
        laid_out = part.startswith("  ") or "\n  " in part
        lines += [
            ".PP",
            *([".nf"] if laid_out else []),
            *map(_plain, part.splitlines()),
            *([".fi"] if laid_out else []),
        ]
    return "\n".join(lines) + "\n"


def _plain(text: str) -> str:
    """Return a line of text such that roff prints it as it is."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-").replace("'", "\\(aq").replace("`", "\\(ga")
    return rf"\&{escaped}" if escaped.startswith(".") else escaped


command = Command(
    """\
Write a manual page for each command into DIR: rmr.1, rmr-sim.1, rmr-lab-list.1 and so on.

They are what --help says. `rmr man ~/.local/share/man/man1` puts them where `man rmr-sim` finds them.""",
    _declare,
    _write,
)

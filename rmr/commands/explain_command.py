"""`rmr explain`: the page of a diagnostic code, or the list of all codes."""
# ruff: noqa: PLC0415 - see rmr.commands

import os
import sys

from rmr.entry import print_json
from rmr.entry.command_line import Command, CommandLineError, Parser, did_you_mean

COLUMNS_MAX = 100
"""Widest text, in columns: longer lines are hard to read even on a wide terminal."""


def _declare(parser: Parser) -> None:
    parser.positional("code", "CODE", read=str, count="?", usage="[CODE]")
    parser.flag("--json", dest="as_json", help="Print the page, or the list of codes, as JSON on stdout.")


def _explain(code: str | None, as_json: bool) -> None:
    """Print the page of a code, or the list of codes."""
    from rmr.lang.diagnostics.diagnostic import CODES
    from rmr.lang.pages import page

    if code is None:
        if as_json:
            print_json({"codes": [_entry(each) for each in CODES]})
        else:
            print("".join(f"{each}  {title}\n" for each, title in CODES.items()), end="")
        return
    known = _known(code)
    if as_json:
        print_json(_entry(known) | {"page": page(known)})
    else:
        _show(page(known))


ABOUT = "Explain the error or warning CODE, such as E012; without CODE, list all of them."

command = Command(ABOUT, _declare, _explain)


def _entry(code: str) -> dict[str, object]:
    from rmr.lang.diagnostics.diagnostic import CODES

    return {"code": code, "severity": "error" if code.startswith("E") else "warning", "title": CODES[code]}


def _known(code: str) -> str:
    """Return the code that equals `code` regardless of case; raise CommandLineError if there is none."""
    from rmr.lang.diagnostics.diagnostic import CODES

    meant = code.upper()
    if meant not in CODES:
        hint = did_you_mean(meant, CODES) or "; `rmr explain` lists all codes"
        raise CommandLineError(f"there is no code {code}{hint}")
    return meant


def _show(text: str) -> None:
    from rmr.lang.pages import plain, without_links

    if not sys.stdout.isatty():
        print(plain(text), end="")
        return
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(no_color="NO_COLOR" in os.environ)
    width = min(console.width, COLUMNS_MAX)
    console.print(Markdown(without_links(text), code_theme="ansi_dark"), width=width)

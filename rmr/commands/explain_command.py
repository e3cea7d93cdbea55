"""`rmr explain`: the page of a diagnostic code, or the list of all codes."""
# ruff: noqa: PLC0415 - see rmr.commands

import sys

from rmr.entry import print_json
from rmr.entry.command_line import Command, CommandLineError, Parser, did_you_mean


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
    from rmr.base.printable import Paint
    from rmr.entry.terminal import has_colour, text_columns
    from rmr.lang.pages import laid_out, plain

    on_terminal = sys.stdout.isatty()
    print(laid_out(text, text_columns(), Paint(has_colour(sys.stdout))) if on_terminal else plain(text), end="")

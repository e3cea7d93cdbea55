"""`rmr explain`: the page of a diagnostic code, or the list of all codes."""
# ruff: noqa: PLC0415 - see rmr.commands

import os
import sys

import click

from rmr.commands.common import SETTINGS, VERSION, print_json

COLUMNS_MAX = 100
"""Longer lines are hard to read, however wide the terminal is."""


@click.command("explain", context_settings=SETTINGS, short_help="Explain an error or a warning.")
@click.argument("code", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print the page, or the list of codes, as JSON on stdout.")
@VERSION
def command(code: str | None, as_json: bool) -> None:
    """Explain the error or warning CODE, such as E012; without CODE, list all of them."""
    from rmr.lang.diagnostics.diagnostic import CODES
    from rmr.lang.pages import page

    if code is None:
        if as_json:
            print_json([_entry(each) for each in CODES])
        else:
            click.echo("".join(f"{each}  {title}\n" for each, title in CODES.items()), nl=False)
        return
    known = _known(code)
    if as_json:
        print_json(_entry(known) | {"page": page(known)})
    else:
        _show(page(known))


def _entry(code: str) -> dict[str, object]:
    from rmr.lang.diagnostics.diagnostic import CODES

    return {"code": code, "severity": "error" if code.startswith("E") else "warning", "title": CODES[code]}


def _known(code: str) -> str:
    """Return the code that `code` means, in whatever letters; raise UsageError if there is none."""
    from difflib import get_close_matches

    from rmr.lang.diagnostics.diagnostic import CODES

    meant = code.upper()
    if meant not in CODES:
        near = get_close_matches(meant, CODES, n=1)
        hint = f"Did you mean {near[0]}?" if near else "`rmr explain` lists all codes."
        raise click.UsageError(f"There is no code {code}. {hint}")
    return meant


def _show(text: str) -> None:
    from rmr.lang.pages import plain, without_links

    if not sys.stdout.isatty():
        click.echo(plain(text), nl=False)
        return
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(no_color="NO_COLOR" in os.environ)
    width = min(console.width, COLUMNS_MAX)
    console.print(Markdown(without_links(text), code_theme="ansi_dark"), width=width)

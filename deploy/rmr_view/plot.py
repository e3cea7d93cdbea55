"""The program `rmr-plot`: its options; `plot_command` does the work."""
# ruff: noqa: PLC0415 - see rmr.entry

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rmr.entry import run

if TYPE_CHECKING:
    from rmr.entry.command_line import Command, Parser

DATA = Path("docs") / "evaluation"
"""Where the data of figures lie by default."""


def main(words: Sequence[str] | None = None) -> int:
    """Run the command; return its exit code."""
    return run("rmr plot", lambda: command().main(words, "rmr plot"))


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command("Draw figures of experiments as SVG.", _declare, _plot)


def _declare(parser: "Parser") -> None:
    parser.positional(
        "names",
        "NAME",
        read=str,
        count="*",
        usage="[NAME...]",
        help="a figure; without any, the known ones are listed",
    )
    parser.flag("--all", dest="every", help="every figure that there are data for")
    parser.option("--data", read=Path, default=DATA, metavar="DIR", help="the data")
    parser.option("-o", "--output", read=Path, metavar="DIR", help="for the figures (default: beside the data)")


def _plot(**options: Any) -> int:
    """Draw figures; return the exit code."""
    from rmr_view.plot_command import perform

    return perform(**options)


if __name__ == "__main__":
    sys.exit(main())

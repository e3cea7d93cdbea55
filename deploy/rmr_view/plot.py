"""The command `rmr plot`: its options; `plot_command` does the work."""
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


def main(words: Sequence[str] | None = None, name: str = "rmr plot") -> int:
    """Run the command `name`; return its exit code."""
    return run(name, lambda: command().main(words, name))


def command() -> "Command":
    """Return the command."""
    from rmr.entry.command_line import Command

    return Command("Draw pictures of a run, or figures of experiments, as SVG.", _declare, _plot)


def _declare(parser: "Parser") -> None:
    from rmr.entry.command_line import real

    parser.positional(
        "names",
        "NAME|RUN",
        read=str,
        count="*",
        usage="[NAME...|RUN]",
        help="a figure, or a run: its folder or a recording (.mcap); without any, the known figures are listed",
    )
    parser.flag("--all", dest="every", help="every figure that there are data for")
    parser.option("--data", read=Path, default=DATA, metavar="DIR", help="the data")
    parser.option(
        "-o", "--output", read=Path, metavar="DIR", help="for the pictures (default: beside the data, or in RUN)"
    )
    parser.option("--animate", read=Path, metavar="FILE", help="write RUN as an animation, FILE.svg or FILE.gif")
    parser.option(
        "--speed", read=real(0.01, 1000), metavar="X", help="lab time over time of --animate (default: 15 s at most)"
    )


def _plot(**options: Any) -> int:
    """Draw figures or pictures of a run; return the exit code."""
    from rmr_view.plot_command import perform

    return perform(**options)


if __name__ == "__main__":
    sys.exit(main())

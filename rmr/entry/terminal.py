"""What programs need of a terminal: whether it has colours, its size, and lines that are redrawn in place.

A terminal with `TERM=dumb` takes text alone, so it is treated as a file. `NO_COLOR` (https://no-color.org) takes away
colours. `rmr.base.printable` has the texts: styles, and how many columns they take.
"""

import os
import sys
from collections.abc import Sequence
from typing import Any, TextIO


def moves_cursor(stream: TextIO) -> bool:
    """Return whether `stream` is a terminal on which lines can be drawn again."""
    return stream.isatty() and os.environ.get("TERM") != "dumb"


def has_colour(stream: TextIO) -> bool:
    """Return whether `stream` is a terminal with colours, whose user wants them."""
    return moves_cursor(stream) and not os.environ.get("NO_COLOR")


def size(stream: TextIO) -> tuple[int, int]:
    """Return the columns and the rows of a terminal; 80 and 24 where they are not known."""
    try:
        found = os.get_terminal_size(stream.fileno())
    except (OSError, ValueError):
        return 80, 24
    return found.columns or 80, found.lines or 24


def text_columns() -> int:
    """Return how wide a text is on standard output: as COLUMNS says, else as the terminal is, and 100 at most.

    Longer lines are hard to read. `shutil` says it, too, and would bring along all that it archives with.
    """
    told = os.environ.get("COLUMNS", "")
    return min(int(told) if told.isdecimal() and int(told) > 0 else size(sys.stdout)[0], 100)


class LiveLines:
    """Lines at the foot of a terminal, redrawn in place while the program goes on.

    Each takes one row: it is cut to the width, and the last row says how many lines the terminal has no row for. The
    cursor is hidden. What is printed meanwhile goes above. An error of the terminal is ignored: whoever shows how far
    something is does not end because nobody sees it.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._lines: Sequence[str] = ()
        self._rows = 0
        """Those that are drawn."""
        self._begun = ""
        self._replaced: dict[str, TextIO] = {}

    def __enter__(self) -> "LiveLines":
        return self.begin()

    def __exit__(self, *_: object) -> None:
        self.close()

    def __getattr__(self, name: str) -> Any:
        """As standard output or standard error it has what they have."""
        return getattr(self._stream, name)

    def begin(self) -> "LiveLines":
        """Take the place of standard output and standard error, where they are terminals."""
        self._replaced = {name: getattr(sys, name) for name in ("stdout", "stderr") if getattr(sys, name).isatty()}
        for name in self._replaced:
            setattr(sys, name, self)
        return self

    def show(self, lines: Sequence[str]) -> None:
        """Draw `lines`, which may have styles, in place of those before."""
        self._lines = lines
        self._draw()

    def write(self, text: str) -> int:
        """Write `text` above the lines, each line once it is whole."""
        whole, feed, self._begun = (self._begun + text).rpartition("\n")
        if feed:
            self._draw(whole + feed)
        return len(text)

    def close(self) -> None:
        """Take the lines away, and show the cursor."""
        for name, stream in self._replaced.items():
            setattr(sys, name, stream)
        self._replaced = {}
        self._lines = ()
        self._draw(self._begun)
        self._begun = ""

    def _draw(self, above: str = "") -> None:
        from rmr.base.printable import cut  # noqa: PLC0415 - help needs a width alone

        columns, rows = size(self._stream)
        lines = list(self._lines)
        if len(lines) > rows:
            lines[rows - 1 :] = [f"... and {len(lines) - rows + 1} more"]
        # One column stays free: some terminals go to the next row as soon as the last column is written.
        drawn = "\n".join(cut(line.replace("\n", " "), columns - 1) for line in lines)
        up = f"\x1b[{self._rows - 1}A" if self._rows > 1 else ""
        away = f"\r{up}\x1b[J" if self._rows else ""
        cursor = "\x1b[?25l" if lines else "\x1b[?25h" if self._rows else ""
        self._rows = len(lines)
        try:
            self._stream.write(f"{away}{above}{cursor}{drawn}")
            self._stream.flush()
        except OSError:
            pass

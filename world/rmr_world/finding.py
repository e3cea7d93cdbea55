"""Findings: the one type of every error and warning about a lab, with its place in a file.

A finding is data; `str` gives the line that `rmr sim`, `rmr up` and `rmr world` print. An error keeps a lab from
running. A warning names something that can hardly be intended; the run goes on.
"""

from dataclasses import dataclass

from rmr.base.errors import Error

END_LINE = 1 << 30
"""Line of a finding that is printed after all others and has no place in the file."""

FilePath = tuple[str | int, ...]
"""Place of a value in a document: keys and indices (from 0) from the root."""


@dataclass(frozen=True, slots=True, order=True)
class Finding:
    """One error or warning, ordered by its place."""

    file: str
    line: int
    """From 1; 0 when the file could not be read at all, END_LINE for its end."""
    column: int
    """From 1."""
    path: str
    """Keys and indices (from 0) joined by points, for example ``robots.1.colour``; may be empty."""
    message: str
    is_warning: bool = False

    @property
    def severity(self) -> str:
        """``error`` or ``warning``."""
        return "warning" if self.is_warning else "error"

    @property
    def has_place(self) -> bool:
        """Whether `line` and `column` name a place in the file."""
        return 0 < self.line < END_LINE

    @property
    def where(self) -> str:
        """The file, with line and column if the finding has a place."""
        return f"{self.file}:{self.line}:{self.column}" if self.has_place else self.file

    def __str__(self) -> str:
        message = f"warning: {self.message}" if self.is_warning else self.message
        return f"{self.where}: {self.path}: {message}" if self.path else f"{self.where}: {message}"


class LabError(Error):
    """A lab cannot be used; `problems` holds all of its errors, in the order of the file."""

    def __init__(self, problems: list[Finding]) -> None:
        self.problems = sorted(problems)
        super().__init__(self.render())

    def render(self) -> str:
        """Return one line for each problem."""
        return "\n".join(map(str, self.problems))


# ---- the known word that a wrong one may stand for


def near_miss(word: str, known: list[str]) -> str:
    """Return ``; did you mean 'x'?`` for the known word nearest to `word`; empty if none is near."""
    from difflib import get_close_matches  # noqa: PLC0415 - most labs have no misspelling

    matches = get_close_matches(word, known, n=1, cutoff=0.6)
    return f"; did you mean '{matches[0]}'?" if matches else ""

"""Source texts and places in them.

A place is a span of character offsets; lines and columns are computed on demand, for diagnostics. Every defect of a
file is a SourceError, which the caller turns into a diagnostic.
"""

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

from rmr.base.record import record

SOURCE_OCTETS_MAX = 1 << 22
"""Largest source file in octets: far above handwritten programs, and refused before it costs time and memory."""


@record
class Span:
    """The characters ``start`` (included) to ``end`` (excluded) of a file."""

    file: str
    start: int
    end: int

    def to(self, other: "Span") -> "Span":
        """Return the span from the start of this one to the end of `other`, in the same file."""
        return Span(self.file, self.start, other.end)


@dataclass(frozen=True, slots=True)
class SourceText:
    """The text of a file, with an index of its lines."""

    file: str
    text: str
    _starts: list[int] = field(default_factory=list, init=False, repr=False, compare=False)

    @property
    def starts(self) -> list[int]:
        """The offset of each line's first character, computed on first use."""
        if not self._starts:
            self._starts.append(0)
            self._starts.extend(match.end() for match in re.finditer("\n", self.text))
        return self._starts

    def position(self, offset: int) -> tuple[int, int]:
        """Return line and column of `offset`, both from 1, in characters."""
        line = bisect_right(self.starts, offset)
        return line, offset - self.starts[line - 1] + 1

    def line(self, number: int) -> str:
        """Return line `number` (from 1) without its end."""
        start = self.starts[number - 1]
        end = self.starts[number] - 1 if number < len(self.starts) else len(self.text)
        return self.text[start:end].rstrip("\r")


class SourceError(Exception):
    """The file is no source text; `usage`: the path is wrong, not the contents."""

    def __init__(self, message: str, *, hint: str | None = None, usage: bool = False) -> None:
        super().__init__(message)
        self.hint = hint
        self.usage = usage


def read_source(path: Path) -> SourceText:
    """Read `path`; raise SourceError when it is missing, no file, too large or not UTF-8."""
    try:
        with path.open("rb") as stream:
            octets = stream.read(SOURCE_OCTETS_MAX + 1)
    except FileNotFoundError:
        raise SourceError("no such file", usage=True) from None
    except IsADirectoryError:
        raise SourceError("this is a directory, not a program", usage=True) from None
    except (OSError, ValueError) as error:
        raise SourceError(f"cannot read it: {getattr(error, 'strerror', None) or error}", usage=True) from None
    return to_source(str(path), octets)


def to_source(file: str, octets: bytes) -> SourceText:
    """Return the text decoded from `octets`; raise SourceError when they are too many, byte-code or not UTF-8."""
    if len(octets) > SOURCE_OCTETS_MAX:
        raise SourceError(f"the file is larger than {SOURCE_OCTETS_MAX >> 20} MiB")
    if octets.startswith(b"RMR\x1a"):
        raise SourceError("this is byte-code, not source", hint="`rmr dis` shows byte-code as text")
    try:
        return SourceText(file, octets.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise SourceError(f"not UTF-8 at octet {error.start}", hint="save it as UTF-8") from None

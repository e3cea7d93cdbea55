"""Source excerpts for a terminal: lines with a place underlined.

So that the marks are aligned with the text, unprintable characters are replaced, a tab is one space, and a wide
character (East Asian Width W or F) takes two columns. A long line is cut to the part around the place, a long range to
its first lines and the last.
"""

from collections.abc import Callable, Iterator

from rmr.lang.read.source_text import SourceText, Span

LINE_SHOWN_MAX = 200
"""Largest number of characters shown of a line."""

LINES_SHOWN_MAX = 5
"""Largest number of lines shown of one place."""

GAP = "  ... |"
"""The line in place of omitted ones."""


def excerpt(source: SourceText, span: Span, underlined: Callable[[int], str]) -> list[str]:
    """Return the lines of a place, each with a line of marks below; `underlined` returns marks of a given width."""
    shown: list[str] = []
    previous = None
    for number in _numbers(source, span):
        if previous is not None and number != previous + 1:
            shown.append(GAP)
        shown += _line(source, number, span, underlined)
        previous = number
    return shown


def _numbers(source: SourceText, span: Span) -> list[int]:
    first, _ = source.position(span.start)
    last, _ = source.position(max(span.start, span.end - 1))
    if last - first < LINES_SHOWN_MAX:
        return list(range(first, last + 1))
    return [*range(first, first + LINES_SHOWN_MAX - 1), last]


def _line(source: SourceText, number: int, span: Span, underlined: Callable[[int], str]) -> Iterator[str]:
    """Yield a line and the marks below it, none below a blank line."""
    line = source.line(number)
    offset = source.starts[number - 1]
    start = span.start - offset if span.start >= offset else len(line) - len(line.lstrip())
    end = max(start, min(len(line), span.end - offset))
    first = max(0, start - LINE_SHOWN_MAX // 2) if len(line) > LINE_SHOWN_MAX else 0
    last = first + LINE_SHOWN_MAX
    before, inside, after = map(visible, (line[first:start], line[start : min(end, last)], line[end:last]))
    gutter = f"{number:>5} | "
    yield gutter + before + inside + after
    if inside or span.start >= offset:
        yield " " * (len(gutter) - 2) + "| " + " " * _width(before) + underlined(max(1, _width(inside)))


def visible(text: str) -> str:
    """Return `text` with control characters replaced; white space becomes a space."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else " " if each in "\t\n\r" else "\ufffd" for each in text)


def _width(text: str) -> int:
    """Return the width of `text` in columns."""
    if text.isascii():
        return len(text)
    from unicodedata import combining, east_asian_width  # noqa: PLC0415 - few sources need its tables

    return sum(0 if combining(each) else 2 if east_asian_width(each) in "WF" else 1 for each in text)

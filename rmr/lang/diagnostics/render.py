"""Diagnostics as text for people and as values for programs.

An excerpt of the source shows lines with a place underlined. So that the marks are aligned with the text, unprintable
characters are replaced, a tab is one space, and a wide character (East Asian Width W or F) takes two columns. A long
line is cut to the part around the place, a long range to its first lines and the last.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping

from rmr.base.printable import Paint, columns_of
from rmr.lang.diagnostics.diagnostic import Diagnostic, Severity
from rmr.lang.read.source_text import SourceText, Span

LINE_SHOWN_MAX = 200
"""Largest number of characters shown of a line."""

LINES_SHOWN_MAX = 5
"""Largest number of lines shown of one place."""

GAP = "  ... |"
"""The line in place of omitted ones."""


def render_text(diagnostics: Iterable[Diagnostic], sources: Mapping[str, SourceText], color: bool) -> str:
    """Return `diagnostics` for a terminal: place, code and message, the line, the place underlined, the hint.

    `sources` are the texts by file name; without one the place is shown as the file alone.
    """
    return "".join(_one(each, sources, Paint(color)) for each in diagnostics)


def to_json(diagnostics: Iterable[Diagnostic], sources: Mapping[str, SourceText]) -> list[dict[str, object]]:
    """Return `diagnostics` as values for JSON; lines and columns count from 1, the end is behind the last character."""
    return [
        {
            **_extent(each.span, sources),
            "severity": each.severity.value,
            "code": each.code,
            "message": each.message,
            "hint": each.hint,
            "fix": None if each.fix is None else {**_extent(each.fix.span, sources), "text": each.fix.text},
        }
        for each in diagnostics
    ]


def _extent(span: Span, sources: Mapping[str, SourceText]) -> dict[str, object]:
    source = sources.get(span.file)
    line, column = source.position(span.start) if source is not None else (1, 1)
    end_line, end_column = source.position(span.end) if source is not None else (1, 1)
    return {"file": span.file, "line": line, "column": column, "end_line": end_line, "end_column": end_column}


def _one(each: Diagnostic, sources: Mapping[str, SourceText], paint: Paint) -> str:
    style = "red" if each.severity is Severity.ERROR else "yellow"
    head = paint(f"bold {style}", f"{each.severity.value}[{each.code}]")
    lines = [f"{_place(each.span, sources)}: {head}: {visible(each.message)}"]
    lines += _excerpt(each.span, sources, lambda width: paint(style, "^" * width))
    for note in each.notes:
        lines.append(f"{_place(note.span, sources)}: {paint('bold blue', 'note')}: {visible(note.message)}")
        lines += _excerpt(note.span, sources, lambda width: paint("blue", "-" * width))
    if each.hint:
        lines.append(f"  {paint('bold', 'hint')}: {visible(each.hint)}")
    return "\n".join(lines) + "\n"


def _place(span: Span, sources: Mapping[str, SourceText]) -> str:
    source = sources.get(span.file)
    if source is None or not source.text:
        return f"{visible(span.file)}:1:1"
    line, column = source.position(span.start)
    return f"{visible(span.file)}:{line}:{column}"


def _excerpt(span: Span, sources: Mapping[str, SourceText], underlined: Callable[[int], str]) -> list[str]:
    """Return the lines of a place, each with a line of marks below; none without its source.

    `underlined` returns marks of a given width.
    """
    source = sources.get(span.file)
    if source is None or not source.text:
        return []
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
        yield " " * (len(gutter) - 2) + "| " + " " * columns_of(before) + underlined(max(1, columns_of(inside)))


def visible(text: str) -> str:
    """Return `text` with control characters replaced; white space becomes a space."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else " " if each in "\t\n\r" else "\ufffd" for each in text)

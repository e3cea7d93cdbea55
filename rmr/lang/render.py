"""Diagnostics as text for people and as JSON for programs."""

import json
import unicodedata
from collections.abc import Iterable, Mapping

from rmr.lang.diagnostic import Diagnostic, Severity
from rmr.lang.source import Source, Span

LINE_SHOWN_MAX = 200
"""Characters of a source line that are shown; the part around the place is cut out of a longer one."""

_BOLD, _RED, _YELLOW, _BLUE, _RESET = "\x1b[1m", "\x1b[31m", "\x1b[33m", "\x1b[34m", "\x1b[0m"


def render_text(diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source], color: bool) -> str:
    """Return `diagnostics` for a terminal: place, code and message, the line, the place underlined, the hint.

    `sources` are the texts by file name; without one the place is shown as the file alone.
    """
    return "".join(_one(each, sources, _Paint(color)) for each in diagnostics)


def render_json(diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source]) -> str:
    """Return `diagnostics` as a JSON list; lines and columns count from 1, the end is behind the last character."""
    return json.dumps(to_json(diagnostics, sources), indent=2, ensure_ascii=False)


def to_json(diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source]) -> list[dict[str, object]]:
    """Return what `render_json` writes, as values."""
    listed: list[dict[str, object]] = []
    for each in diagnostics:
        source = sources.get(each.span.file)
        line, column = source.position(each.span.start) if source is not None else (1, 1)
        end_line, end_column = source.position(each.span.end) if source is not None else (1, 1)
        listed.append(
            {
                "file": each.span.file,
                "line": line,
                "column": column,
                "end_line": end_line,
                "end_column": end_column,
                "severity": each.severity.value,
                "code": each.code,
                "message": each.message,
                "hint": each.hint,
            }
        )
    return listed


class _Paint:
    """Colours, or none."""

    def __init__(self, color: bool) -> None:
        self._color = color

    def __call__(self, style: str, text: str) -> str:
        return f"{style}{text}{_RESET}" if self._color else text


def _one(each: Diagnostic, sources: Mapping[str, Source], paint: _Paint) -> str:
    style = _RED if each.severity is Severity.ERROR else _YELLOW
    head = paint(_BOLD + style, f"{each.severity.value}[{each.code}]")
    lines = [f"{_place(each.span, sources)}: {head}: {_visible(each.message)}"]
    lines += _excerpt(each.span, sources, "^", paint, style)
    for note in each.notes:
        lines.append(f"{_place(note.span, sources)}: {paint(_BOLD + _BLUE, 'note')}: {_visible(note.message)}")
        lines += _excerpt(note.span, sources, "-", paint, _BLUE)
    if each.hint:
        lines.append(f"  {paint(_BOLD, 'hint')}: {_visible(each.hint)}")
    return "\n".join(lines) + "\n"


def _place(span: Span, sources: Mapping[str, Source]) -> str:
    source = sources.get(span.file)
    if source is None or not source.text:
        return f"{_visible(span.file)}:1:1"
    line, column = source.position(span.start)
    return f"{_visible(span.file)}:{line}:{column}"


def _excerpt(span: Span, sources: Mapping[str, Source], mark: str, paint: _Paint, style: str) -> list[str]:
    """Return the first line of the place, and a line that underlines it."""
    source = sources.get(span.file)
    if source is None or not source.text:
        return []
    number, column = source.position(span.start)
    line = source.line(number)
    start = column - 1
    end = min(len(line), max(start + 1, start + span.end - span.start))
    first = max(0, start - LINE_SHOWN_MAX // 2) if len(line) > LINE_SHOWN_MAX else 0
    last = first + LINE_SHOWN_MAX
    gutter = f"{number:>5} | "
    before, inside, after = line[first:start], line[start : min(end, last)], line[min(end, last) : last]
    shown = _visible(before) + _visible(inside) + _visible(after)
    under = " " * _width(_visible(before)) + paint(style, mark * max(1, _width(_visible(inside))))
    return [gutter + shown, " " * (len(gutter) - 2) + "| " + under]


def _visible(text: str) -> str:
    """Return `text` without characters that would move the cursor or control a terminal; a tab is a space."""
    return "".join(each if each.isprintable() else " " if each in "\t\n\r" else "\ufffd" for each in text)


def _width(text: str) -> int:
    return sum(
        0 if unicodedata.combining(each) else 2 if unicodedata.east_asian_width(each) in "WF" else 1 for each in text
    )

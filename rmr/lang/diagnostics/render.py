"""Diagnostics as text for people and as values for programs."""

from collections.abc import Callable, Iterable, Mapping

from rmr.lang.diagnostics.diagnostic import Diagnostic, Severity
from rmr.lang.diagnostics.excerpt import excerpt, visible
from rmr.lang.read.source_text import SourceText, Span

_BOLD = "\x1b[1m"
_RED = "\x1b[31m"
_YELLOW = "\x1b[33m"
_BLUE = "\x1b[34m"
_RESET = "\x1b[0m"


def render_text(diagnostics: Iterable[Diagnostic], sources: Mapping[str, SourceText], color: bool) -> str:
    """Return `diagnostics` for a terminal: place, code and message, the line, the place underlined, the hint.

    `sources` are the texts by file name; without one the place is shown as the file alone.
    """
    return "".join(_one(each, sources, _Paint(color)) for each in diagnostics)


def to_json(diagnostics: Iterable[Diagnostic], sources: Mapping[str, SourceText]) -> list[dict[str, object]]:
    """Return `diagnostics` as values for JSON; lines and columns count from 1, the end is behind the last character."""
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


def _one(each: Diagnostic, sources: Mapping[str, SourceText], paint: _Paint) -> str:
    style = _RED if each.severity is Severity.ERROR else _YELLOW
    head = paint(_BOLD + style, f"{each.severity.value}[{each.code}]")
    lines = [f"{_place(each.span, sources)}: {head}: {visible(each.message)}"]
    lines += _excerpt(each.span, sources, lambda width: paint(style, "^" * width))
    for note in each.notes:
        lines.append(f"{_place(note.span, sources)}: {paint(_BOLD + _BLUE, 'note')}: {visible(note.message)}")
        lines += _excerpt(note.span, sources, lambda width: paint(_BLUE, "-" * width))
    if each.hint:
        lines.append(f"  {paint(_BOLD, 'hint')}: {visible(each.hint)}")
    return "\n".join(lines) + "\n"


def _excerpt(span: Span, sources: Mapping[str, SourceText], underlined: Callable[[int], str]) -> list[str]:
    source = sources.get(span.file)
    return [] if source is None or not source.text else excerpt(source, span, underlined)


def _place(span: Span, sources: Mapping[str, SourceText]) -> str:
    source = sources.get(span.file)
    if source is None or not source.text:
        return f"{visible(span.file)}:1:1"
    line, column = source.position(span.start)
    return f"{visible(span.file)}:{line}:{column}"

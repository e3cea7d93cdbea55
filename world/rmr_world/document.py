"""YAML text as plain values that remember where they stood.

A lab file is written by hand, so every complaint must name its line. PyYAML's constructor forgets positions,
so this module walks the parser's events itself and returns a tree of `Node`: a scalar, a list of nodes or an
ordered mapping, each with its line and column. What it accepts is YAML 1.2's core schema without surprises:
`no` and `1:30` are strings, a repeated key is an error, aliases and tags (with which a small file becomes a
huge or an active one) are refused, and size and depth are bounded. All mistakes that the parser survives are
collected; it stops at the first syntax error, as YAML gives no way to go on.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from rmr.base.errors import Error
from rmr_world.validate.schema_hints import yaml_advice

FILE_OCTETS_MAX = 256 * 1024
"""Far above any lab written by hand; PyYAML reads about 100 kB a second, so this bounds the time too."""
DEPTH_MAX = 16
"""A lab file is five levels deep; deeper nesting would only exhaust the stack."""

END_LINE = 1 << 30
"""The line of a problem that belongs after all others and nowhere in the file."""

Scalar = str | int | float | bool | None
Plain = Scalar | list["Plain"] | dict[str, "Plain"]
Path_ = tuple[str | int, ...]
"""Where a value stands in the document: keys and indices (from 0) from the root."""


@dataclass(frozen=True, slots=True, order=True)
class Problem:
    """One mistake in a lab file, sorted by where it stands."""

    file: str
    line: int
    """From 1; 0 when the file could not be read at all, END_LINE after its end."""
    column: int
    """From 1."""
    path: str
    """Keys and indices (from 0) joined by points, for example ``robots.1.colour``; may be empty."""
    message: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}" if 0 < self.line < END_LINE else self.file
        return f"{where}: {self.path}: {self.message}" if self.path else f"{where}: {self.message}"


class LabError(Error):
    """A lab file cannot be used; `problems` holds everything that is wrong with it."""

    def __init__(self, problems: list[Problem]) -> None:
        self.problems = sorted(problems)
        super().__init__(self.render())

    def render(self) -> str:
        """Return one line per problem, in the order of the file."""
        return "\n".join(map(str, self.problems))


@dataclass(slots=True)
class Document:
    """A parsed file: its value, and where each part of it stands."""

    file: str
    value: Plain = None
    places: dict[Path_, tuple[int, int]] = field(default_factory=dict)
    """Line and column, from 1, of each value."""
    keys: dict[Path_, tuple[int, int]] = field(default_factory=dict)
    """Line and column of the key that a value stands under."""
    problems: list[Problem] = field(default_factory=list)

    def problem(self, path: Path_, message: str, *, key: bool = False) -> Problem:
        """Return a `Problem` at `path`, or at the nearest enclosing part that stands in the file."""
        table = self.keys if key else self.places
        known = path
        while known not in table and known:
            known, table = known[:-1], self.places
        line, column = table.get(known, (1, 1))
        return Problem(self.file, line, column, ".".join(map(str, path)), message)


def read(path: Path) -> Document:
    """Return the document in `path`. Raises LabError when it cannot be read or is not YAML."""
    try:
        with path.open("rb") as stream:
            data = stream.read(FILE_OCTETS_MAX + 1)
    except OSError as error:
        raise LabError([Problem(str(path), 0, 0, "", f"cannot be read: {error.strerror or error}")]) from None
    if len(data) > FILE_OCTETS_MAX:
        raise LabError([Problem(str(path), 0, 0, "", f"is larger than {FILE_OCTETS_MAX // 1024} KiB")])
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - data.rfind(b"\n", 0, error.start)
        raise LabError([Problem(str(path), line, column, "", "is not UTF-8")]) from None
    return parse(text, str(path))


def parse(text: str, file: str) -> Document:
    """Return the document written in `text`. Raises LabError where it is not YAML, or is empty."""
    document = Document(file)
    try:
        _Reader(yaml.parse(text, Loader=yaml.SafeLoader), document).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        message = " ".join(filter(None, (error.context, error.problem)))
        raise LabError(
            [*document.problems, Problem(file, line, column, "", f"not YAML: {message}{yaml_advice(message)}")]
        ) from None
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        problem = Problem(file, line, column, "", f"character U+{ord(text[error.position]):04X} is not allowed in YAML")
        raise LabError([problem]) from None
    return document


_INT = re.compile(r"[-+]?[0-9]{1,18}")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]{1,3})?")
_WORDS: dict[str, Scalar] = {"": None, "~": None, "null": None, "true": True, "false": False}


def _scalar(text: str) -> Scalar:
    """Return what a plain (unquoted) scalar means in YAML 1.2's core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INT.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) and len(text) < 64 else text


def _at(event: yaml.Event) -> tuple[int, int]:
    assert event.start_mark is not None  # PyYAML's own parser marks every event
    return event.start_mark.line + 1, event.start_mark.column + 1


class _Reader:
    """Turns the parser's events into plain values, noting places and mistakes in the document."""

    def __init__(self, events: Iterator[yaml.Event], document: Document) -> None:
        self._events = events
        self._document = document

    def document(self) -> None:
        """Read the one document of the stream."""
        next(self._events)  # the stream's start
        first = next(self._events)
        if isinstance(first, yaml.StreamEndEvent):
            raise LabError([Problem(self._document.file, 1, 1, "", "is empty")])
        self._document.value = self._value(next(self._events), ())
        next(self._events)  # the document's end
        second = next(self._events)
        if isinstance(second, yaml.DocumentStartEvent):
            self._complain(second, (), "holds a second document")

    def _complain(self, event: yaml.Event, path: Path_, message: str) -> None:
        line, column = _at(event)
        self._document.problems.append(Problem(self._document.file, line, column, ".".join(map(str, path)), message))

    def _value(self, event: yaml.Event, path: Path_) -> Plain:
        if isinstance(event, yaml.AliasEvent):
            self._complain(event, path, f"aliases (*{event.anchor}) are not allowed here; write the value out")
            return None
        if len(path) > DEPTH_MAX:
            line, column = _at(event)
            raise LabError([Problem(self._document.file, line, column, "", "is nested too deeply")])
        self._document.places[path] = _at(event)
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag not in {None, "!"}:
            self._complain(event, path, f"tags ({event.tag}) are not allowed here{_tag_advice(event.tag)}")
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(path)
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(path)
        assert isinstance(event, yaml.ScalarEvent)
        return _scalar(event.value) if event.style is None else str(event.value)

    def _sequence(self, path: Path_) -> list[Plain]:
        items: list[Plain] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._value(event, (*path, len(items))))
        return items

    def _mapping(self, path: Path_) -> dict[str, Plain]:
        items: dict[str, Plain] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key = self._key(event, path)
            inner = (*path, key)
            repeated = key in items
            if repeated:
                line = self._document.keys[inner][0]
                self._complain(event, inner, f"repeated key; it stands in line {line} already")
            else:
                self._document.keys[inner] = _at(event)
            value = self._value(next(self._events), inner if not repeated else (*path, f"{key} (repeated)"))
            if not repeated:
                items[key] = value
        return items

    def _key(self, event: yaml.Event, path: Path_) -> str:
        if isinstance(event, yaml.ScalarEvent):
            return str(event.value)
        self._complain(event, path, "a key must be a word")
        self._value(event, (*path, "(key)"))
        return "(key)"


def _tag_advice(tag: str) -> str:
    """Return what whoever wrote text that begins with ! has to do; nothing for other tags."""
    return "; put text that begins with ! in quotation marks" if re.match(r"!\w", tag) else ""

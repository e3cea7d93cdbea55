"""YAML text as plain values, with the line and column of each value and key.

A lab file is written by hand, so every error message must name its line. PyYAML's constructor discards positions, so
this module reads the parser's events itself. It accepts the core schema of YAML 1.2, restricted: `no` and `1:30` are
strings, a repeated key is an error, aliases and tags are refused (they turn a small file into a huge or an active
one), and size and depth are bounded. All errors after which the parser can continue are collected. Reading stops at
the first syntax error, as YAML defines no recovery.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from rmr_world.finding import FilePath, Finding, LabError

FILE_OCTETS_MAX = 256 * 1024
"""Size limit of a lab file, far above any written by hand. PyYAML reads about 100 kB/s, so it bounds the time too."""
DEPTH_MAX = 16
"""Limit of nesting; a lab file has five levels. Deeper nesting would exhaust the stack of the recursive reader."""

Scalar = str | int | float | bool | None
Plain = Scalar | list["Plain"] | dict[str, "Plain"]


@dataclass(slots=True)
class Document:
    """A parsed file: its value and the positions of its parts."""

    file: str
    value: Plain = None
    places: dict[FilePath, tuple[int, int]] = field(default_factory=dict)
    """Line and column, from 1, of each value."""
    keys: dict[FilePath, tuple[int, int]] = field(default_factory=dict)
    """Line and column, from 1, of the key of each value."""
    errors: list[Finding] = field(default_factory=list)

    def finding(self, path: FilePath, message: str, *, key: bool = False) -> Finding:
        """Return a finding at `path`, or at the nearest enclosing part that the file has; `key`: at the key."""
        table = self.keys if key else self.places
        known = path
        while known not in table and known:
            known = known[:-1]
            table = self.places
        line, column = table.get(known, (1, 1))
        return Finding(self.file, line, column, ".".join(map(str, path)), message)


def read(path: Path) -> Document:
    """Return the document in `path`. Raises LabError when it cannot be read or is not YAML."""
    try:
        with path.open("rb") as stream:
            data = stream.read(FILE_OCTETS_MAX + 1)
    except OSError as error:
        raise LabError([Finding(str(path), 0, 0, "", f"cannot be read: {error.strerror or error}")]) from None
    if len(data) > FILE_OCTETS_MAX:
        raise LabError([Finding(str(path), 0, 0, "", f"is larger than {FILE_OCTETS_MAX // 1024} KiB")])
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        column = error.start - data.rfind(b"\n", 0, error.start)
        raise LabError([Finding(str(path), line, column, "", "is not UTF-8")]) from None
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
            [*document.errors, Finding(file, line, column, "", f"not YAML: {message}{_yaml_advice(message)}")]
        ) from None
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        line = before.count("\n") + 1
        column = len(before) - before.rfind("\n")
        message = f"character U+{ord(text[error.position]):04X} is not allowed in YAML"
        raise LabError([Finding(file, line, column, "", message)]) from None
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
    """Turns the parser's events into plain values; records positions and errors in the document."""

    def __init__(self, events: Iterator[yaml.Event], document: Document) -> None:
        self._events = events
        self._document = document

    def document(self) -> None:
        """Read the one document of the stream."""
        next(self._events)  # the stream's start
        first = next(self._events)
        if isinstance(first, yaml.StreamEndEvent):
            raise LabError([Finding(self._document.file, 1, 1, "", "is empty")])
        self._document.value = self._value(next(self._events), ())
        next(self._events)  # the document's end
        second = next(self._events)
        if isinstance(second, yaml.DocumentStartEvent):
            self._report(second, (), "holds a second document")

    def _report(self, event: yaml.Event, path: FilePath, message: str) -> None:
        line, column = _at(event)
        self._document.errors.append(Finding(self._document.file, line, column, ".".join(map(str, path)), message))

    def _value(self, event: yaml.Event, path: FilePath) -> Plain:
        if isinstance(event, yaml.AliasEvent):
            self._report(event, path, f"aliases (*{event.anchor}) are not allowed here; write the value out")
            return None
        if len(path) > DEPTH_MAX:
            line, column = _at(event)
            raise LabError([Finding(self._document.file, line, column, "", "is nested too deeply")])
        self._document.places[path] = _at(event)
        if isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent) and event.tag not in {None, "!"}:
            self._report(event, path, f"tags ({event.tag}) are not allowed here{_tag_advice(event.tag)}")
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(path)
        if isinstance(event, yaml.MappingStartEvent):
            return self._mapping(path)
        assert isinstance(event, yaml.ScalarEvent)
        return _scalar(event.value) if event.style is None else str(event.value)

    def _sequence(self, path: FilePath) -> list[Plain]:
        items: list[Plain] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._value(event, (*path, len(items))))
        return items

    def _mapping(self, path: FilePath) -> dict[str, Plain]:
        items: dict[str, Plain] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            key = self._key(event, path)
            inner = (*path, key)
            repeated = key in items
            if repeated:
                line = self._document.keys[inner][0]
                self._report(event, inner, f"repeated key; it stands in line {line} already")
            else:
                self._document.keys[inner] = _at(event)
            value = self._value(next(self._events), inner if not repeated else (*path, f"{key} (repeated)"))
            if not repeated:
                items[key] = value
        return items

    def _key(self, event: yaml.Event, path: FilePath) -> str:
        if isinstance(event, yaml.ScalarEvent):
            return str(event.value)
        self._report(event, path, "a key must be a word")
        self._value(event, (*path, "(key)"))
        return "(key)"


def _tag_advice(tag: str) -> str:
    """Return the hint for a tag that was probably meant as text beginning with `!`; empty for other tags."""
    return "; put text that begins with ! in quotation marks" if re.match(r"!\w", tag) else ""


_YAML: tuple[tuple[str, str], ...] = (
    ("character '@'", "put text that begins with @ in quotation marks; an id is a plain number"),
    ("character '\\t'", "indent with spaces, not with tabs"),
    ("could not find expected ':'", "between a key and its value stand a colon and a space"),
    ("mapping values are not allowed here", "a second colon stands in this line, or the line is indented too far"),
    ("but found '-'", "a list's items and a mapping's keys do not mix: indent alike, or close the bracket above"),
    ("found unexpected end of stream", "a quotation mark is never closed"),
    ("but got", "a bracket above is never closed, or a comma is missing"),
)
"""Phrase in a message of the YAML parser, and the usual cause as a hint."""


def _yaml_advice(message: str) -> str:
    """Return the hint for a message of the YAML parser; empty if none is known."""
    return next((f"; {words}" for said, words in _YAML if said in message), "")

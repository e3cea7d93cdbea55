"""The programs that an editor has open: texts, positions in them, and the compilation of each.

An editor holds the texts of open files; they stand for what is on disk, also where another file includes them. A *root*
is an open file that no other root includes: it is compiled as `rmr check` does. What is said about a file comes from
the roots that contain it, so a part of a program is judged within the program as long as the editor has that open.

Compiling takes up to a tenth of a second, so it is a job for another thread: `Programs.job` takes a copy of the texts,
`CompileJob.run` compiles what has changed, and `Programs.take` refuses the results if the texts have changed meanwhile.

Positions of the protocol are lines, and units of the encoding that client and server have agreed on; places of the
compiler are offsets in characters. A line ends with a line feed, a carriage return or both.
"""

import re
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from rmr.lang.compiler import Compilation, compile_text
from rmr.lang.diagnostics.diagnostic import Diagnostic
from rmr.lang.read.include import Editing, identity_of
from rmr.lang.read.kept_items import KeptItems
from rmr.lang.read.source_text import SOURCE_OCTETS_MAX, SourceText, Span
from rmr_editor.symbols import SymbolIndex

UNITS = {"utf-8": ("utf-8", 1), "utf-16": ("utf-16-le", 2), "utf-32": ("utf-32-le", 4)}
"""Position encoding -> Python's codec, and the octets of a unit."""

_LINE_END = re.compile(r"\r\n|\r|\n")
_LONE_SURROGATE = re.compile("[\ud800-\udfff]")


class Lines:
    """Positions in a text: lines and units from 0, as the protocol counts them."""

    def __init__(self, text: str, encoding: str) -> None:
        self.text = text
        self._codec, self._octets = UNITS[encoding]
        ends = list(_LINE_END.finditer(text))
        self._starts = [0, *(each.end() for each in ends)]
        self._stops = [*(each.start() for each in ends), len(text)]

    def offset(self, line: int, unit: int) -> int:
        """Return the offset of a position; beyond the end of its line that end, beyond the last line the text's."""
        if line >= len(self._starts):
            return len(self.text)
        start = self._starts[line]
        words = self.text[start : self._stops[line]]
        if words.isascii():
            return start + min(unit, len(words))
        octets = words.encode(self._codec)[: unit * self._octets]
        return start + len(octets.decode(self._codec, "ignore"))  # within a character: its beginning

    def position(self, offset: int) -> tuple[int, int]:
        """Return line and unit of an offset; within a line end the end of the line."""
        line = bisect_right(self._starts, offset) - 1
        words = self.text[self._starts[line] : min(offset, self._stops[line])]
        return line, len(words) if words.isascii() else len(words.encode(self._codec)) // self._octets


@lru_cache(maxsize=16)
def lines_of(text: str, encoding: str) -> Lines:
    """Return the lines of a text."""
    return Lines(text, encoding)


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a text: what stands between two positions is replaced; all of it if there are none."""

    text: str
    start: tuple[int, int] | None = None
    end: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class Buffer:
    """A text that the editor holds."""

    uri: str
    file: str
    """Its name in diagnostics: the path of the file, or the URI of what has none."""
    identity: Path
    """The resolved path, by which an include finds it."""
    text: str
    version: int | None


@dataclass(frozen=True, slots=True)
class CompileJob:
    """The compilations that are out of date, with the texts as they were when it was made."""

    generation: int
    texts: Mapping[Path, Buffer]
    """The open files, those first that were opened first."""
    kept: Mapping[Path, Compilation]
    """Compilations of roots that nothing has changed."""
    parsed: dict[str, KeptItems]
    """Items of the last versions of texts, by the names of the files."""

    def run(self) -> dict[Path, Compilation]:
        """Return the compilations of all roots."""
        found = dict(self.kept)
        editing = Editing({identity: each.text for identity, each in self.texts.items()}, self.parsed)
        for identity, each in self.texts.items():
            if identity not in found and not any(identity in included_by(root) for root in found.values()):
                found[identity] = compiled(each, editing)
        order = list(self.texts)
        for identity in order:
            # Of two that include each other the one that was opened first is the root.
            others = [found[each] for each in order if each in found and each != identity]
            if identity in found and any(identity in included_by(root) for root in others):
                del found[identity]
        return found


def compiled(buffer: Buffer, editing: Editing) -> Compilation:
    """Compile a text that the editor holds, as `rmr check` compiles a file."""
    source = SourceText(buffer.file, buffer.text)
    if len(buffer.text) > SOURCE_OCTETS_MAX:
        message = f"the file is larger than {SOURCE_OCTETS_MAX >> 20} MiB"
        return Compilation(source, None, [Diagnostic("E003", message, Span(buffer.file, 0, 0))])
    return compile_text(source, editing=editing)


def included_by(root: Compilation) -> frozenset[Path]:
    """Return the files that a program includes, without its first one."""
    return frozenset(identity_of(each.file) for each in root.included)


@dataclass(slots=True)
class Programs:
    """The open files of one editor."""

    encoding: str = "utf-16"
    generation: int = 0
    """Number of changes so far."""
    _buffers: dict[str, Buffer] = field(default_factory=dict)
    _roots: dict[Path, Compilation] = field(default_factory=dict)
    _changed: set[Path] | None = field(default_factory=set)
    """Files that have changed since their compilation; None: any may have."""
    _taken: int = 0
    """The generation of the compilations."""
    _parsed: dict[str, KeptItems] = field(default_factory=dict)
    _indexes: list[SymbolIndex] = field(default_factory=list)
    """Those of the compilations that have been asked for."""

    # ---- texts

    def open(self, uri: str, file: str, text: str, version: int | None) -> None:
        """Hold a text from now on."""
        self._hold(Buffer(uri, file, identity_of(file), _repaired(text), version))

    def change(self, uri: str, version: int | None, changes: Iterable[Change]) -> bool:
        """Change a text, one change after the other; return False if it is not open."""
        buffer = self._buffers.get(uri)
        if buffer is None:
            return False
        text = buffer.text
        for change in changes:
            lines = lines_of(text, self.encoding)
            start = 0 if change.start is None else lines.offset(*change.start)
            end = len(text) if change.end is None else max(start, lines.offset(*change.end))
            text = text[:start] + _repaired(change.text) + text[end:]
        self._hold(replace(buffer, text=text, version=version))
        return True

    def close(self, uri: str) -> None:
        """Hold a text no longer: what is on disk counts again."""
        buffer = self._buffers.pop(uri, None)
        if buffer is not None:
            self._note(buffer.identity)

    def on_disk(self) -> None:
        """Take note that files have changed on disk."""
        self.generation += 1
        self._changed = None

    def _hold(self, buffer: Buffer) -> None:
        self._buffers[buffer.uri] = buffer
        self._note(buffer.identity)

    def _note(self, identity: Path) -> None:
        self.generation += 1
        if self._changed is not None:
            self._changed.add(identity)

    def buffer(self, uri: str) -> Buffer | None:
        """Return an open text."""
        return self._buffers.get(uri)

    def uri(self, file: str) -> str:
        """Return the URI of a file of a program: the editor's own, if it has it open."""
        identity = identity_of(file)
        own = next((each.uri for each in self._buffers.values() if each.identity == identity), None)
        return own or identity.as_uri()

    # ---- compilations

    @property
    def settled(self) -> bool:
        """Whether all compilations are those of the texts."""
        return self._taken == self.generation

    def job(self) -> CompileJob:
        """Return what is to be compiled."""
        texts = {each.identity: each for each in self._buffers.values()}
        kept = {identity: root for identity, root in self._roots.items() if identity in texts and self._is_kept(root)}
        return CompileJob(self.generation, texts, kept, self._parsed)

    def _is_kept(self, root: Compilation) -> bool:
        # A file that could not be included may be there by now.
        incomplete = any(each.code == "E003" for each in root.diagnostics)
        if self._changed is None or incomplete:
            return False
        return identity_of(root.source.file) not in self._changed and not included_by(root) & self._changed

    def take(self, job: CompileJob, roots: dict[Path, Compilation]) -> bool:
        """Take the results of a job; return False if the texts have changed since it was made."""
        if job.generation != self.generation:
            return False
        self._roots = roots
        self._indexes = []
        files = {file for root in roots.values() for file in root.sources}
        self._parsed = {file: kept for file, kept in self._parsed.items() if file in files}
        self._changed = set()
        self._taken = job.generation
        return True

    def of(self, uri: str) -> list[tuple[Compilation, SourceText]]:
        """Return the programs that contain an open text, each with the source that it has there."""
        buffer = self._buffers.get(uri)
        if buffer is None:
            return []
        sources = [(root, source) for root in self._roots.values() for source in root.sources.values()]
        return [(root, source) for root, source in sources if identity_of(source.file) == buffer.identity]

    def index(self, program: Compilation) -> SymbolIndex:
        """Return the symbols of one of the programs."""
        found = next((each for each in self._indexes if each.program is program), None)
        if found is None:
            found = SymbolIndex(program)
            self._indexes.append(found)
        return found

    def diagnostics(self) -> dict[str, list[tuple[Diagnostic, Compilation]]]:
        """Return what is to be said about each file, by URI: all open ones, and others if there is something."""
        found: dict[str, dict[Diagnostic, Compilation]] = {uri: {} for uri in self._buffers}
        uris: dict[str, str] = {}
        for root in self._roots.values():
            for each in root.diagnostics:
                file = each.span.file
                if file not in uris:
                    uris[file] = self.uri(file)
                found.setdefault(uris[file], {}).setdefault(each, root)
        return {uri: list(each.items()) for uri, each in found.items()}

    def range(self, span: Span, program: Compilation) -> Iterator[tuple[int, int]]:
        """Yield the positions of the start and of the end of a span; those of the text's start if it has no text."""
        source = program.sources.get(span.file)
        lines = lines_of("" if source is None else source.text, self.encoding)
        yield lines.position(min(span.start, len(lines.text)))
        yield lines.position(min(span.end, len(lines.text)))


def _repaired(text: str) -> str:
    """Return a text with a replacement for half characters, which only a broken client sends."""
    return _LONE_SURROGATE.sub("\ufffd", text) if not text.isascii() else text

"""A program of several files: the items of a file stand in the place of its `include`.

A path is relative to the file that includes. Each file counts once, by what it is and not by how it is spelt; the
second time it is no more than a remark. Files that include each other in a circle are an error that shows the way
round. What is wrong with an included file is reported at the place that includes it, and its syntax errors in it.
"""

import os
import stat
from dataclasses import dataclass, field
from pathlib import Path

from rmr.lang.analyse.names import meant
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics
from rmr.lang.read.parser import ITEMS_MAX, parse
from rmr.lang.read.source_text import SOURCE_OCTETS_MAX, SourceError, SourceText, read_source
from rmr.lang.read.syntax import IncludeItem, Item, ModuleNode

FILES_MAX = 1000
"""Files of one program: more are generated, or a mistake."""

DEPTH_MAX = 32
"""Files within files; also what the compiler's own stack has to hold."""

CHARACTERS_MAX = 4 * SOURCE_OCTETS_MAX
"""Of all files together."""


@dataclass(slots=True)
class Loader:
    """Reads a program's files and puts them together."""

    found: Diagnostics
    sources: dict[str, SourceText] = field(default_factory=dict)
    """By the name that diagnostics use, in the order in which they were read."""
    incomplete: bool = False
    """A file could not be read to its end: what it declares is not known."""
    _open: dict[Path, IncludeItem | None] = field(default_factory=dict)
    """The files that are being read, each with the item that includes it; the program's first file has none."""
    _read: set[Path] = field(default_factory=set)
    _broken: set[str] = field(default_factory=set)
    _characters: int = 0
    _count: int = 0
    """Of items."""
    _refused: set[str] = field(default_factory=set)
    """Bounds that have been exceeded, each reported once."""

    def module(self, source: SourceText) -> ModuleNode:
        """Return the items of `source` and of all that it includes."""
        items = self._items(source, _identity(source.file), None)
        return ModuleNode(tuple(items), frozenset(self._broken))

    def _items(self, source: SourceText, identity: Path, by: IncludeItem | None) -> list[Item]:
        self.sources[source.file] = source
        self._open[identity] = by
        self._read.add(identity)
        self._characters += len(source.text)
        module = parse(source, self.found)
        self._broken |= module.broken
        self._count += len(module.items)
        self.incomplete |= not module.complete
        items: list[Item] = []
        for item in module.items:
            items += self._included(item, source) if isinstance(item, IncludeItem) else [item]
        del self._open[identity]
        return items

    def _included(self, item: IncludeItem, source: SourceText) -> list[Item]:
        name = _name(item.path, source.file)
        identity = _identity(name)
        if identity in self._open:
            self._report_circle(item, identity)
        elif identity not in self._read and self._has_room(item):
            included = self._source(item, name)
            if included is not None:
                return self._items(included, identity, item)
        return []

    def _has_room(self, item: IncludeItem) -> bool:
        excess = None
        if len(self.sources) >= FILES_MAX:
            excess = f"{FILES_MAX} files"
        elif len(self._open) >= DEPTH_MAX:
            excess = f"{DEPTH_MAX} files within each other"
        elif self._characters > CHARACTERS_MAX:
            excess = f"{CHARACTERS_MAX >> 20} million characters"
        elif self._count > ITEMS_MAX:
            excess = f"{ITEMS_MAX} items"
        if excess is None:
            return True
        if excess not in self._refused:
            self.found.report("E008", f"the program has more than {excess}", item.span)
        self._refused.add(excess)
        self.incomplete = True
        return False

    def _source(self, item: IncludeItem, name: str) -> SourceText | None:
        try:
            if _is_endless(name):
                raise SourceError("this is a pipe or a device, no file")
            return read_source(Path(name))
        except SourceError as error:
            hint = error.hint or _alike(name)
            self.found.report("E003", f"cannot include `{item.path}`: {error}", item.span, hint=hint)
            self.incomplete = True
            return None

    def _report_circle(self, item: IncludeItem, identity: Path) -> None:
        """Report an include that leads back to a file that is being read, with every step of the way."""
        way = list(self._open.items())
        start = next(index for index, (path, _) in enumerate(way) if path == identity)
        steps = [each for _, each in way[start + 1 :] if each is not None]
        notes = tuple(DiagnosticNote(each.span, f"includes `{each.path}`") for each in steps)
        files = [*(each.span.file for each in steps), item.span.file]
        chain = " -> ".join([*files, files[0]])
        self.found.report("E009", f"the file includes itself: {chain}", item.span, hint="drop one of them", notes=notes)


def _name(path: str, includer: str) -> str:
    """Return what a file is called that `includer` includes: as short as it can be said from where that is named."""
    joined = os.path.join(os.path.dirname(includer), path)
    short = os.path.normpath(joined)
    return short if _identity(short) == _identity(joined) else joined


def _identity(name: str) -> Path:
    """Return what a file is, however it is spelt."""
    try:
        return Path(name).resolve()
    except (OSError, ValueError, RuntimeError):
        return Path(name)


def _is_endless(name: str) -> bool:
    """Whether reading it may wait for ever; what is not there is found out by reading."""
    try:
        mode = os.stat(name).st_mode
    except (OSError, ValueError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def _alike(name: str) -> str | None:
    """Return the hint for a path that may be misspelt."""
    try:
        beside = sorted(each for each in os.listdir(os.path.dirname(name) or ".") if each.endswith(".rmr"))
    except (OSError, ValueError):
        return None
    return meant(os.path.basename(name), beside)

"""Includes: the items of a file replace the `include` that names it.

A path is relative to the including file; `std/NAME.rmr` that is not there is a file of the library, which comes with
RMR. Each file is read once, identified by its resolved path; a second include has
no effect. A cycle of includes is an error that lists its steps. A file that cannot be read is reported at the
`include`; its syntax errors are reported in the file.
"""

import os
import re
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rmr.lang.analyse.names import meant
from rmr.lang.diagnostics.diagnostic import DiagnosticNote, Diagnostics
from rmr.lang.read.kept_items import KeptItems
from rmr.lang.read.parser import ITEMS_MAX, parse
from rmr.lang.read.source_text import SOURCE_OCTETS_MAX, SourceError, SourceText, read_source
from rmr.lang.read.syntax import IncludeItem, Item, ModuleNode

FILES_MAX = 1000
"""Bound on the files of one program; more of them are generated, or a mistake."""

DEPTH_MAX = 32
"""Nesting of includes, which bounds the recursion of the loader."""

CHARACTERS_MAX = 4 * SOURCE_OCTETS_MAX
"""Characters of all files of one program together."""

LIBRARY = Path(__file__).resolve().parents[1] / "std"
"""The folder of the files of the library."""


@dataclass(frozen=True, slots=True)
class Editing:
    """What an editor brings to a program that it has compiled at each change."""

    unsaved: Mapping[Path, str]
    """Texts that it holds, by the resolved paths of the files: what is on disk is older."""
    kept: dict[str, KeptItems] = field(default_factory=dict)
    """What was parsed, by the names of the files."""

    def kept_of(self, file: str) -> KeptItems:
        """Return what was parsed of a file."""
        return self.kept.setdefault(file, KeptItems())


@dataclass(slots=True)
class Loader:
    """Reads a program's files and puts them together."""

    found: Diagnostics
    editing: Editing | None = None
    sources: dict[str, SourceText] = field(default_factory=dict)
    """Texts by the file names that diagnostics use, in reading order."""
    incomplete: bool = False
    """True if a file was not read to its end, so that declarations may be missing."""
    _open: dict[Path, IncludeItem | None] = field(default_factory=dict)
    """The chain of open files, each with the item that includes it; None for the program's first file."""
    _read: set[Path] = field(default_factory=set)
    _broken: set[str] = field(default_factory=set)
    _characters: int = 0
    _count: int = 0
    """Number of items read so far."""
    _refused: set[str] = field(default_factory=set)
    """Exceeded bounds, each reported once."""

    def module(self, source: SourceText) -> ModuleNode:
        """Return the items of `source` and of all that it includes."""
        items = self._items(source, identity_of(source.file), None)
        return ModuleNode(tuple(items), frozenset(self._broken))

    def _items(self, source: SourceText, identity: Path, by: IncludeItem | None) -> list[Item]:
        self.sources[source.file] = source
        self._open[identity] = by
        self._read.add(identity)
        self._characters += len(source.text)
        module = parse(source, self.found, None if self.editing is None else self.editing.kept_of(source.file))
        self._broken |= module.broken
        self._count += len(module.items)
        self.incomplete |= not module.complete
        items: list[Item] = []
        for item in module.items:
            items += self._included(item, source) if isinstance(item, IncludeItem) else [item]
        del self._open[identity]
        return items

    def _included(self, item: IncludeItem, source: SourceText) -> list[Item]:
        name = included_name(item.path, source.file)
        identity = identity_of(name)
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
        text = None if self.editing is None else self.editing.unsaved.get(identity_of(name))
        if text is not None:
            return SourceText(name, text)
        try:
            if _is_endless(name):
                raise SourceError("this is a pipe or a device, no file")
            return read_source(Path(name))
        except SourceError as error:
            hint = _alike_in_library(item.path) if in_library(name) else error.hint or _alike(name)
            self.found.report("E003", f"cannot include `{item.path}`: {error}", item.span, hint=hint)
            self.incomplete = True
            return None

    def _report_circle(self, item: IncludeItem, identity: Path) -> None:
        """Report an include of an open file, with every step of the cycle."""
        way = list(self._open.items())
        start = next(index for index, (path, _) in enumerate(way) if path == identity)
        steps = [each for _, each in way[start + 1 :] if each is not None]
        notes = tuple(DiagnosticNote(each.span, f"includes `{each.path}`") for each in steps)
        files = [*(each.span.file for each in steps), item.span.file]
        chain = " -> ".join([*files, files[0]])
        self.found.report("E009", f"the file includes itself: {chain}", item.span, hint="drop one of them", notes=notes)


def included_name(path: str, includer: str) -> str:
    """Return the name of an included file: relative to the includer's name, and normalised if that is the same file.

    A file beside the includer comes before one of the library, so that a copy of a library file can be changed.
    """
    joined = os.path.join(os.path.dirname(includer), path)
    if re.fullmatch(r"std/\w+\.rmr", path) and not os.path.lexists(joined):
        return str(LIBRARY / path.removeprefix("std/"))
    short = os.path.normpath(joined)
    return short if identity_of(short) == identity_of(joined) else joined


def identity_of(name: str) -> Path:
    """Return the resolved path of a file; the path itself if it cannot be resolved."""
    try:
        return Path(name).resolve()
    except (OSError, ValueError, RuntimeError):
        return Path(name)


def in_library(name: str) -> bool:
    """Return whether the name of a file, as diagnostics use it, is that of a file of the library."""
    return Path(name).parent == LIBRARY or identity_of(name).parent == LIBRARY


def library_files() -> list[str]:
    """Return the files of the library as an `include` names them, sorted."""
    return sorted(f"std/{each.name}" for each in LIBRARY.glob("*.rmr"))


def short_name(name: str) -> str:
    """Return the name of a file for byte-code: that of a library file does not depend on where RMR is installed."""
    return f"std/{os.path.basename(name)}" if os.path.dirname(name) == str(LIBRARY) else name


def _is_endless(name: str) -> bool:
    """Whether reading may block (a pipe or a device); False for a missing file, which reading will report."""

    try:
        mode = os.stat(name).st_mode
    except (OSError, ValueError):
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def _alike_in_library(path: str) -> str:
    """Return the hint for a file that is neither beside the includer nor in the library."""
    files = library_files()
    hint = meant(path, files)
    return f"{'the' if hint is None else f'{hint} The'} library has {', '.join(files)}"


def _alike(name: str) -> str | None:
    """Return the hint for a path that may be misspelt."""
    try:
        beside = sorted(each for each in os.listdir(os.path.dirname(name) or ".") if each.endswith(".rmr"))
    except (OSError, ValueError):
        return None
    hint = meant(os.path.basename(name), beside)
    return None if hint is None else str(hint)

"""The tree as the architecture tests see it: modules, what they import, and the tracked files.

Everything is read with `ast`, nothing is imported, so that imports inside functions count as well. Each file is read
and parsed once in a process, when a test asks for it and not while tests are collected. One test therefore goes over
all modules and names those that break its rule (`offenders`).
"""

import ast
import gc
import subprocess
import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PACKAGES = [ROOT / folder for folder in PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]]
SCRIPTS: dict[str, str] = PROJECT["project"]["scripts"]
MODULES_MIN = 100
"""A rule that finds fewer modules to examine has lost sight of the tree."""


@dataclass(frozen=True)
class Module:
    """One source file."""

    name: str
    path: Path
    tree: ast.Module

    @property
    def part(self) -> str:
        """Return the part of the house it belongs to: `rmr.vm`, `rmr.cli`, `rmr_agent`, ..."""
        words = self.name.split(".")
        return ".".join(words[:2]) if words[0] == "rmr" else words[0]

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """Return every node of its tree."""
        return tuple(ast.walk(self.tree))

    @cached_property
    def imports(self) -> tuple[str, ...]:
        """Return the full name of everything imported anywhere in it, in source order."""
        return tuple(name for node in self.nodes for name in self._imported(node))

    def _imported(self, node: ast.AST) -> Iterator[str]:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = self._absolute(node)
            yield from (f"{base}.{alias.name}" for alias in node.names)

    def _absolute(self, node: ast.ImportFrom) -> str:
        if not node.level:
            return node.module or ""
        package = self.name.split(".")
        if self.path.name != "__init__.py":
            package = package[:-1]
        package = package[: len(package) - node.level + 1]
        return ".".join([*package, *([node.module] if node.module else [])])


@cache
def modules() -> tuple[Module, ...]:
    """Return every module of the distribution, sorted by name."""
    found = []
    gc.disable()  # all of half a million objects are kept; looking for garbage among them takes twice the parsing
    for package in PACKAGES:
        for path in package.rglob("*.py"):
            words = path.relative_to(package.parent).with_suffix("").parts
            name = ".".join(words[:-1] if words[-1] == "__init__" else words)
            found.append(Module(name, path, ast.parse(path.read_text(), str(path))))
    gc.freeze()
    gc.enable()
    return tuple(sorted(found, key=lambda module: module.name))


@cache
def module_names() -> frozenset[str]:
    """Return the names of all modules of the distribution."""
    return frozenset(module.name for module in modules())


def offenders(found: Callable[[Module], object], among: Iterable[Module] | None = None) -> dict[str, object]:
    """Return what `found` finds in each module in which it finds anything, by the module's name."""
    examined = modules() if among is None else tuple(among)
    assert len(examined) > MODULES_MIN
    return {module.name: what for module in examined if (what := found(module))}


@cache
def own_module(imported: str) -> str | None:
    """Return the module of this distribution that `imported` (module or module.name) comes from, or None."""
    words = imported.split(".")
    for length in range(len(words), 0, -1):
        if (name := ".".join(words[:length])) in module_names():
            return name
    return None


def reachable(start: str) -> dict[str, str]:
    """Return everything that `start` imports, directly or not: name -> the module that imports it."""
    by_name = {module.name: module for module in modules()}
    seen: dict[str, str] = {}
    todo = [start]
    while todo:
        importer = by_name[todo.pop()]
        for imported in importer.imports:
            own = own_module(imported)
            for name in _with_parents(own or imported):
                if name not in seen:
                    seen[name] = importer.name
                    todo.extend([name] if own else [])
    return seen


def _with_parents(name: str) -> list[str]:
    words = name.split(".")
    return [".".join(words[: length + 1]) for length in range(len(words))]


@cache
def tracked_text() -> list[tuple[str, str]]:
    """Return (path, text) of every tracked text file; skips the test outside a git work tree."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("not a git work tree")
    files = []
    for name in listing.stdout.decode().split("\0"):
        path = ROOT / name
        if not name or not path.is_file():
            continue
        try:
            files.append((name, path.read_text()))
        except UnicodeDecodeError:
            continue
    return files

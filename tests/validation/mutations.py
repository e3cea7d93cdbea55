"""Rules broken on purpose: a check that does not fail when its rule is broken is worse than none.

Each mutation (mutations.toml) replaces a piece of the radio's source text, which must stand there exactly as often as
it says, so that none can come to nothing unseen. `broken` imports `rmr.radio` and the checks anew with the changed
text, in this process, and puts everything back afterwards. What is missed then has noticed. The reduced families are
used, in which every check is met as long as no rule is broken (test_validation.py).
"""

import importlib
import re
import sys
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, NamedTuple

from verdicts import MISSED, SHOWN

RELOADED = ("probe", "constants", "curves", "overlaps", "judged", "experiments", "reduced")
"""The modules of checks, which have to import the broken radio."""

Noticed = tuple[str, str, str]
"""Family, row and quantity of a check that failed."""


class Edit(NamedTuple):
    """A piece of one module's source and what stands there instead."""

    module: str
    """Below `rmr.radio`."""
    old: str
    new: str
    times: int = 1


class Mutation(NamedTuple):
    """One broken rule."""

    rule: str
    edits: Sequence[Edit]
    families: Sequence[str] = ()
    """The families that are run with it; none: all."""


def _read(file: Path) -> tuple[Mutation, ...]:
    found = tomllib.loads(file.read_text("utf-8"))["mutation"]
    return tuple(
        Mutation(each["rule"], [Edit(**edit) for edit in each["edit"]], each.get("families", ())) for each in found
    )


MUTATIONS = _read(Path(__file__).with_suffix(".toml"))
NAMES = tuple(mutation.rule for mutation in MUTATIONS)


class _Loader(SourceFileLoader):
    """Loads a module with its source changed."""

    def __init__(self, name: str, path: str, edits: Sequence[Edit]) -> None:
        super().__init__(name, path)
        self._edits = edits

    def get_code(self, fullname: str) -> CodeType:
        text = self.get_data(self.path).decode()
        for edit in self._edits:
            found = text.count(edit.old)
            assert found == edit.times, f"{fullname} has {found} times {edit.old!r}: the mutation is out of date"
            text = text.replace(edit.old, edit.new)
        return compile(text, self.path, "exec", dont_inherit=True)


class _Finder(MetaPathFinder):
    """Finds the modules that a mutation changes."""

    def __init__(self, edits: Sequence[Edit]) -> None:
        self._edits: dict[str, list[Edit]] = {}
        for edit in edits:
            self._edits.setdefault(f"rmr.radio.{edit.module}", []).append(edit)

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if fullname not in self._edits:
            return None
        found = PathFinder.find_spec(fullname, path, target)
        assert found is not None, f"no module {fullname}"
        assert found.origin is not None, f"no source of {fullname}"
        loader = _Loader(fullname, found.origin, self._edits[fullname])
        return spec_from_file_location(
            fullname, found.origin, loader=loader, submodule_search_locations=found.submodule_search_locations
        )


@contextmanager
def broken(mutation: Mutation) -> Iterator[ModuleType]:
    """Give the module `reduced`, with everything that it imports of the radio imported anew and broken."""
    import rmr.radio

    kept = {name: module for name, module in sys.modules.items() if _is_fresh(name)}
    finder = _Finder(mutation.edits)
    for name in kept:
        del sys.modules[name]
    sys.meta_path.insert(0, finder)
    try:
        yield importlib.import_module("reduced")
        used = {f"rmr.radio.{edit.module}" for edit in mutation.edits}
        assert used <= sys.modules.keys(), f"not used at all: {used - sys.modules.keys()}"
    finally:
        sys.meta_path.remove(finder)
        for name in [name for name in sys.modules if _is_fresh(name)]:
            del sys.modules[name]
        sys.modules.update(kept)
        sys.modules["rmr"].radio = rmr.radio = kept["rmr.radio"]  # type: ignore[attr-defined]


def _is_fresh(name: str) -> bool:
    return name in RELOADED or name == "rmr.radio" or name.startswith("rmr.radio.")


def of(rule: str) -> Mutation:
    """Return the mutation that breaks a rule."""
    return next(each for each in MUTATIONS if each.rule == rule)


def noticed(rule: str, families: Sequence[str] = ()) -> list[Noticed]:
    """Return the checks that fail when a rule is broken: of some families, or of those that the mutation names."""
    mutation = of(rule)
    found: list[Noticed] = []
    with broken(mutation) as reduced:
        for family in families or mutation.families or reduced.FAMILIES:
            try:
                checks = list(reduced.FAMILIES[family]())
            except (ArithmeticError, AssertionError, LookupError, ValueError) as error:
                # An experiment that cannot even be run to its end has noticed as well.
                found.append((family, "all", f"{type(error).__name__}: {error}"))
                continue
            found += [(family, check.row, check.quantity) for check in checks if check.verdict == MISSED]
    return found


def guarded() -> list[tuple[str, str]]:
    """Return what each family judges: (family, kind of quantity)."""
    families = importlib.import_module("reduced").FAMILIES
    judged = [(name, check) for name, family in families.items() for check in family() if check.verdict != SHOWN]
    return list(dict.fromkeys((name, kind(check.quantity)) for name, check in judged))


def kind(quantity: str) -> str:
    """Return a quantity without the numbers that tell one check of a family from the next."""
    return re.sub(r"(?<![\w-])-?\d+(\.\d+)?", "#", quantity)

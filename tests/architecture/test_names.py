"""A name stands for one thing: no two modules have one file name, no two public classes one name.

Of two that would, the second gets a qualifier that says what it is. Names of packages (`__init__`) and of entry points
(`main`) are free.
"""

import ast
import re
from collections import defaultdict

import pytest
from source_tree import Module, modules

# fmt: off
AWAITED_MODULES = {
    "api", "arena", "assertions", "build", "check", "checks", "columnar", "columns", "constants", "deadlines",
    "deliveries", "derive", "doubts", "ether", "events", "expressions", "facts", "fault", "faults", "functions",
    "goals", "group", "heads", "layout", "line", "lines", "options", "parts", "perform", "plan", "program",
    "provided", "ranges", "reach", "record", "report", "robot", "rules", "running", "search", "source",
    "straight", "up", "values", "watch", "wire", "words", "workers",
}
# fmt: on
"""File names that still stand twice. The aim is an empty set."""

# fmt: off
AWAITED_CLASSES = {
    "Aggregate", "Assertion", "Assertions", "Cell", "Comprehension", "Constant", "Deliveries", "Derivation",
    "Derived", "Document", "Engine", "Ether", "Event", "Fact", "Family", "Floor", "Gate", "Goals", "Grid",
    "Held", "Job", "Kind", "Known", "Layout", "Level", "Line", "Loaded", "Match", "Module", "Names", "Note",
    "Order", "Outcome", "Part", "Phase", "Place", "Plan", "Problem", "Progress", "Reach", "Reached",
    "RefusedError", "Role", "Row", "Rule", "Rules", "Run", "Scene", "Scope", "Slots", "Source", "Spoken",
    "Steps", "Strategy", "Table", "Verdict", "Watch", "Way", "Word",
}
# fmt: on
"""Names of public classes that still stand twice. The aim is an empty set."""


def public_classes(module: Module) -> list[str]:
    """Return the classes of a module that others may import."""
    classes = [node.name for node in module.tree.body if isinstance(node, ast.ClassDef)]
    return [name for name in classes if not name.startswith("_")]


def twice(names: list[tuple[str, str]]) -> dict[str, list[str]]:
    """Return name -> modules of those (name, module) whose name stands in more than one module."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    for name, module in names:
        found[name].append(module)
    return {name: where for name, where in found.items() if len(where) > 1}


def test_no_two_modules_have_one_file_name():
    names = [(m.path.stem, m.name) for m in modules() if m.path.stem not in ("__init__", "main")]
    assert {name: where for name, where in twice(names).items() if name not in AWAITED_MODULES} == {}


def test_no_two_public_classes_have_one_name():
    names = [(name, module.name) for module in modules() for name in public_classes(module)]
    assert {name: where for name, where in twice(names).items() if name not in AWAITED_CLASSES} == {}


@pytest.mark.parametrize("module", modules(), ids=lambda module: module.name)
def test_module_names_are_lower_case_words_parted_by_underscores(module):
    assert re.fullmatch(r"(__)?[a-z0-9]+(_[a-z0-9]+)*(__)?", module.path.stem)

"""A name stands for one thing: no two modules have one file name, no two public classes one name.

Of two that would, the second gets a qualifier that says what it is. Names of packages (`__init__`) and of entry points
(`main`) are free.
"""

import ast
import re
from collections import defaultdict

from source_tree import Module, modules, offenders


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
    assert twice(names) == {}


def test_no_two_public_classes_have_one_name():
    names = [(name, module.name) for module in modules() for name in public_classes(module)]
    assert twice(names) == {}


def test_module_names_are_lower_case_words_parted_by_underscores():
    words = re.compile(r"(__)?[a-z0-9]+(_[a-z0-9]+)*(__)?")
    assert offenders(lambda module: not words.fullmatch(module.path.stem)) == {}

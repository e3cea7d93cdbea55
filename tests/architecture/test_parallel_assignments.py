"""One assignment to a line: `a, b = x, y` with unrelated targets hides two statements in one.

Allowed is what needs to happen at once: a swap, or any statement in which a value reads a target
(`last, self._last = self._last, sample`). Unpacking one value (`x, y = point`) is no parallel assignment.
"""

import ast
from collections import Counter

import pytest
from source_tree import Module, modules

PER_1000_LINES_MAX = 1.0
"""Bound of every part; a part of less than a thousand lines may have one."""


def part_of(module: Module) -> str:
    """Return the part, or the package of `rmr.node` that is counted for itself."""
    words = module.name.split(".")
    own = words[:2] == ["rmr", "node"] and words[2:3] in (["crossing"], ["motion"])
    return ".".join(words[:3]) if own else module.part


def places_read(tree: ast.AST) -> set[str]:
    """Return the variables, attributes and items that an expression reads."""
    places = (ast.Name, ast.Attribute, ast.Subscript)
    return {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, places)}


def parallel_assignments(tree: ast.AST) -> list[int]:
    """Return the lines of assignments of several values to as many unrelated targets."""
    lines = []
    for node in ast.walk(tree):
        if not (isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple)):
            continue
        read = set().union(*map(places_read, node.value.elts))
        targets = [target for target in node.targets if isinstance(target, ast.Tuple)]
        if any(not read & {ast.unparse(place) for place in target.elts} for target in targets):
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("a, b = 1, 2", 1),
        ("self.x, self.y = x, y", 1),
        ("a, b = b, a", 0),
        ("last, self.last = self.last, sample", 0),
        ("x, y = point", 0),
        ("a = 1, 2", 0),
    ],
)
def test_an_assignment_of_unrelated_targets_is_counted_and_a_swap_is_not(source, count):
    assert len(parallel_assignments(ast.parse(source))) == count


def test_parallel_assignments_are_rarer_than_one_in_a_thousand_lines():
    lines: Counter[str] = Counter()
    found: Counter[str] = Counter()
    for module in modules():
        lines[part_of(module)] += len(module.path.read_text().splitlines())
        found[part_of(module)] += len(parallel_assignments(module.tree))
    most = {part: max(int(PER_1000_LINES_MAX * count / 1000), 1) for part, count in lines.items()}
    assert {part: count for part, count in found.items() if count > most[part]} == {}

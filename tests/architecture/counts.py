"""The size of the tree in numbers: then, now, and where it is to go.

    python tests/architecture/counts.py [--land]

Counted are the sources of the distribution, without tests, as `source_tree` reads them, and the words of the pages.
`make lint` prints the table and is red where a count is worse than it is landed in `landed_counts.json`; `--land` lands
what is there now.

Some facts had several forms, each with a parallel hierarchy. `FORMS` names a class or function of each form: a form
counts as long as its name is defined anywhere, and the table names those that are left. A new form of such a fact, or
another name of an old one, gets its row there in the same commit.

Not counted are mutable fields that several classes write: who writes a field is found by types and not by names, and a
count that takes every `x.field = ...` for the same field is wrong both ways.
"""

import argparse
import ast
import json
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from source_tree import ROOT, SCRIPTS, Module, modules, own_module

LANDED: Final = Path(__file__).with_name("landed_counts.json")
SMALL_LINES: Final = 100
"""A module of so many lines at most, with one importer, is seldom a room of its own: it belongs to its importer."""
SMALL: Final = f"small ones of these, up to {SMALL_LINES} lines"

FORMS: Final[Mapping[str, Mapping[str, str]]] = {
    "forms of a neighbour": {
        "Hello": "as it was said",
        "Peer": "as it is remembered",
        "LostRobot": "as it was heard last",
        "SeenBody": "as it is seen",
        "_Sighting": "as it was seen last",
        "ReportedState": "as it is said to drive",
        "Heard": "as the order has it",
        "Standing": "as the order has it where it stands",
        "DrivingBody": "as the shield had it",
        "_Course": "as the law of ways has it, in place of DrivingBody",
        "TakenDisc": "as the shield has it where it stands",
    },
    "histories": {
        "MindIndex": "records of a robot's replay: `rmr why`, the page, and with RobotHistory `--missed`",
        "ActionSpan": "spans of a robot's replay, which `--missed` had for itself",
        "MindTwin": "a robot's replay for the page",
        "TurnIntervals": "turns from the trace, with RunHistory",
        "RunView": "what checkers know of a run",
    },
    "ways to carry state": {
        "RobotServices.take_over": "listed by hand, part by part: a program is loaded",
        "GraphWalk": "a walk of all objects by reflection: a snapshot",
    },
}
"""Fact -> a name that is defined in each form of it -> what the form is."""
BEGUN_AND_GOAL: Final = {"forms of a neighbour": (10, 2), "histories": (5, 1), "ways to carry state": (2, 1)}
"""Fact -> how many forms it had, and is to have."""


@dataclass(frozen=True)
class Row:
    """One number of the table."""

    name: str
    begun: int
    """At a660ee7f, where the count began."""
    now: int
    goal: int | None = None
    names: tuple[str, ...] = ()
    """What was counted, where it has names."""
    held: bool = True
    """It must not grow."""


@dataclass(frozen=True)
class Share:
    """A part of the source lines; there is no worse and no better."""

    name: str
    begun: float
    now: float


@dataclass(frozen=True)
class Lines:
    """The lines of one module."""

    all: int
    docstrings: int
    comments: int
    """Those that hold nothing else."""
    code: int
    """The others that are not blank."""


def lines_of(text: str, tree: ast.Module) -> Lines:
    """Return the lines of a source by what they hold."""
    docstrings: set[int] = set()
    strings: set[int] = set()  # what looks like a comment or a blank line there is text
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docstrings.update(_span(node))
        elif isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str)):
            strings.update(_span(node))
    comments = blank = 0
    lines = text.splitlines()
    for number, line in enumerate(lines, 1):
        if number not in docstrings and number not in strings:
            comments += line.lstrip().startswith("#")
            blank += not line.strip()
    return Lines(len(lines), len(docstrings), comments, len(lines) - len(docstrings) - comments - blank)


def _span(node: ast.expr | ast.stmt) -> range:
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


def constants_of(tree: ast.Module) -> list[str]:
    """Return the names in capitals that a module assigns, `Final` or not; those of a tuple of targets are none."""
    targets: list[ast.expr] = []
    for node in tree.body:
        if isinstance(node, ast.Assign):
            targets += node.targets
        elif isinstance(node, ast.AnnAssign):
            targets.append(node.target)
    return [target.id for target in targets if isinstance(target, ast.Name) and target.id.isupper()]


def defined_in(tree: ast.Module) -> Iterator[str]:
    """Yield the classes and functions of a module, methods as `Class.method`."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.name
        if isinstance(node, ast.ClassDef):
            yield from (f"{node.name}.{each.name}" for each in node.body if isinstance(each, ast.FunctionDef))


def importers(among: Iterable[Module]) -> dict[str, set[str]]:
    """Return module -> the other modules that import it, also inside functions."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for module in among:
        for own in set(map(own_module, module.imports)) - {None, module.name}:
            found[own or ""].add(module.name)
    return dict(found)


def pages() -> list[Path]:
    """Return the pages that a reader has: README and docs, without the decisions, which are kept as they were taken."""
    docs = ROOT / "docs"
    return [ROOT / "README.md", *sorted(page for page in docs.rglob("*.md") if page.parent != docs / "decisions")]


def words_of(text: str) -> int:
    """Return the words of a page as `wc -w` counts them, code and tables with the rest."""
    return len(text.split())


def counted() -> tuple[list[Row], list[Share]]:
    """Return the numbers of this tree."""
    tree = modules()
    lines = {module.name: lines_of(module.path.read_text(), module.tree) for module in tree}
    total = sum(each.all for each in lines.values())
    one = [name for name, by in importers(tree).items() if len(by) == 1]
    packages = {module.name for module in tree if module.path.name == "__init__.py"}
    small = sorted(name for name in one if lines[name].all <= SMALL_LINES and name not in packages)
    defined = {name for module in tree for name in defined_in(module.tree)}
    rows = [
        Row("modules", 699, len(tree), 480),
        Row("constants", 1973, sum(len(constants_of(module.tree)) for module in tree), 1300),
        Row("source lines", 102_847, total, 92_000),
        Row("modules with one importer", 190, len(one), held=False),  # a large one may well be a room of its own
        Row(SMALL, 82, len(small), names=tuple(small)),
        Row("words of the pages", 136_797, sum(words_of(page.read_text("utf-8")) for page in pages()), 90_000),
        Row("console scripts", 14, len(SCRIPTS), 4),
    ]
    for fact, forms in FORMS.items():
        left = tuple(name for name in forms if name in defined)
        begun, goal = BEGUN_AND_GOAL[fact]
        rows.append(Row(fact, begun, len(left), goal, left))
    shares = [
        Share("code", 0.686, sum(each.code for each in lines.values()) / total),
        Share("docstrings", 0.147, sum(each.docstrings for each in lines.values()) / total),
        Share("comments", 0.007, sum(each.comments for each in lines.values()) / total),
    ]
    return rows, shares


def table(rows: Iterable[Row], shares: Iterable[Share]) -> Iterator[str]:
    """Yield the lines of the table."""
    yield f"{'':<36}{'a660ee7f':>10}{'now':>10}{'goal':>10}"
    for row in rows:
        yield f"{row.name:<36}{row.begun:>10,}{row.now:>10,}{'' if row.goal is None else f'{row.goal:,}':>10}".rstrip()
        if row.goal is not None and row.names:
            yield f"    {', '.join(row.names)}"
    for share in shares:
        yield f"{f'{share.name}, share of the lines':<36}{share.begun:>10.1%}{share.now:>10.1%}"


def worse(rows: Iterable[Row], landed: Mapping[str, int]) -> list[str]:
    """Return what is worse than it is landed, each with what to do."""
    return [
        f"{row.name}: {row.now:,}, landed are {landed[row.name]:,}. Take the growth back (CONTRIBUTING.md, The counts),"
        " or land it with `python tests/architecture/counts.py --land` and give the reason in the commit."
        for row in rows
        if row.held and row.now > landed[row.name]
    ]


def read_landed() -> dict[str, int]:
    """Return the landed count of each row that is held."""
    landed: dict[str, int] = json.loads(LANDED.read_text())
    return landed


def main() -> int:
    """Print the table; exit code 1 where a count is worse than it is landed."""
    parser = argparse.ArgumentParser(description="Count the tree beside its goals and the landed counts.")
    parser.add_argument("--land", action="store_true", help=f"write {LANDED.name}")
    parser.add_argument("--small", action="store_true", help="name the small modules with one importer")
    options = parser.parse_args()
    rows, shares = counted()
    print("\n".join(table(rows, shares)))
    if options.small:
        print(*(name for row in rows if row.name == SMALL for name in row.names), sep="\n")
    if options.land:
        LANDED.write_text(json.dumps({row.name: row.now for row in rows if row.held}, indent=2) + "\n")
        return 0
    found = worse(rows, read_landed())
    for line in found:
        print(f"worse: {line}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())

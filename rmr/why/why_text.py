"""Explanations as text, a tree with one item on a line, and as a graph in the DOT language of Graphviz."""

from collections.abc import Iterator

from rmr.why.rule_words import seconds_text
from rmr.why.why_tree import AbsenceAnswer, AbsenceNode, WhyAnswer, WhyNode


def why_text(answer: WhyAnswer) -> str:
    """Return an answer as text with line ends."""
    blocks = ["\n".join(_lines(tree, "", "")) for tree in answer.trees]
    if answer.notes:
        blocks.append("\n".join(answer.notes))
    return "\n\n".join(blocks) + "\n"


def _lines(node: WhyNode, first: str, rest: str) -> Iterator[str]:
    """Yield the lines of a tree, the first one behind `first`, the others behind `rest`."""
    yield first + _line(node)
    count = len(node.children)
    for place, child in enumerate(node.children):
        last = place == count - 1 and not node.omitted
        yield from _lines(child, rest + ("└─ " if last else "├─ "), rest + ("   " if last else "│  "))
    if node.omitted:
        yield f"{rest}└─ and {node.omitted} more facts"


def _line(node: WhyNode) -> str:
    what = f"{node.kind} {node.text}" if node.kind in ("action", "message") else node.text
    line = f"{what}  {seconds_text(node.at)}  {node.words}"
    if node.role == "consumed":
        line += " (consumed)"
    if node.above:
        line += "  (shown above)"
    elif node.cut:
        line += f"  ... {node.number}"
    return line


def absence_text(answer: AbsenceAnswer) -> str:
    """Return an answer to a question why not as text with line ends."""
    blocks = ["\n".join(_reasons(tree, "", "")) for tree in answer.trees]
    if answer.notes:
        blocks.append("\n".join(answer.notes))
    return "\n\n".join(blocks) + "\n"


def _reasons(node: AbsenceNode, first: str, rest: str) -> Iterator[str]:
    yield first + node.text
    for place, child in enumerate(node.children):
        last = place == len(node.children) - 1
        yield from _reasons(child, rest + ("└─ " if last else "├─ "), rest + ("   " if last else "│  "))


# -- as a graph: an item is a box, an arrow leads to what rests on it -------------------------------------------------

SHAPES = {"fact": "box", "action": "cds", "message": "note", "goal": "ellipse"}
"""Shapes of nodes by the kind of the item."""


def why_dot(answer: WhyAnswer) -> str:
    """Return an answer as a graph; an item that several others rest on stands in it once."""
    lines = [f"digraph why {{\n  label={_quoted(answer.question)};\n  rankdir=BT;\n  node [fontsize=10];"]
    lines += dict.fromkeys(line for tree in answer.trees for line in _boxes(tree))
    return "\n".join([*lines, "}\n"])


def _boxes(node: WhyNode) -> Iterator[str]:
    name = _name(node)
    if not node.above:
        label = _quoted(f"{node.text}\n{seconds_text(node.at)}\n{node.words}")
        dashed = ", style=dashed" if node.cut else ""
        yield f"  {name} [shape={SHAPES[node.kind]}, label={label}{dashed}];"
    for child in node.children:
        yield from _boxes(child)
        role = f" [label={_quoted(child.role)}]" if child.role == "consumed" else ""
        yield f"  {_name(child)} -> {name}{role};"


def _name(node: WhyNode) -> str:
    return _quoted(node.number if "." in node.number else f"{node.robot}.{node.number}")


def absence_dot(answer: AbsenceAnswer) -> str:
    """Return an answer to a question why not as a graph: an arrow leads from a reason to what it explains."""
    lines = [f"digraph why {{\n  label={_quoted(answer.question)};\n  rankdir=BT;\n  node [shape=box, fontsize=10];"]
    for number, tree in enumerate(answer.trees):
        lines += _reason_boxes(tree, f"r{number}")
    return "\n".join([*lines, "}\n"])


def _reason_boxes(node: AbsenceNode, name: str) -> Iterator[str]:
    yield f"  {name} [label={_quoted(node.text)}];"
    for number, child in enumerate(node.children):
        yield from _reason_boxes(child, f"{name}_{number}")
        yield f"  {name}_{number} -> {name};"


def _quoted(text: str) -> str:
    text = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{text}"'

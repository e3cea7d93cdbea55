"""Explanations as a graph in the DOT language of Graphviz: an item is a box, an arrow leads to what rests on it."""

from collections.abc import Iterator

from rmr.why.absence_tree import AbsenceAnswer, AbsenceNode
from rmr.why.rule_words import seconds_text
from rmr.why.why_answer import WhyAnswer
from rmr.why.why_tree import WhyNode

SHAPES = {"fact": "box", "action": "cds", "message": "note", "goal": "ellipse"}
"""Shapes of nodes by the kind of the item."""


def why_dot(answer: WhyAnswer) -> str:
    """Return an answer as a graph; an item that several others rest on stands in it once."""
    lines = [f"digraph why {{\n  label={_quoted(answer.question)};\n  rankdir=BT;\n  node [fontsize=10];"]
    lines += dict.fromkeys(line for tree in answer.trees for line in _nodes(tree))
    return "\n".join([*lines, "}\n"])


def _nodes(node: WhyNode) -> Iterator[str]:
    name = _name(node)
    if not node.above:
        label = _quoted(f"{node.text}\n{seconds_text(node.at)}\n{node.words}")
        dashed = ", style=dashed" if node.cut else ""
        yield f"  {name} [shape={SHAPES[node.kind]}, label={label}{dashed}];"
    for child in node.children:
        yield from _nodes(child)
        role = f" [label={_quoted(child.role)}]" if child.role == "consumed" else ""
        yield f"  {_name(child)} -> {name}{role};"


def _name(node: WhyNode) -> str:
    return _quoted(node.number if "." in node.number else f"{node.robot}.{node.number}")


def absence_dot(answer: AbsenceAnswer) -> str:
    """Return an answer to a question why not as a graph: an arrow leads from a reason to what it explains."""
    lines = [f"digraph why {{\n  label={_quoted(answer.question)};\n  rankdir=BT;\n  node [shape=box, fontsize=10];"]
    for number, tree in enumerate(answer.trees):
        lines += _reasons(tree, f"r{number}")
    return "\n".join([*lines, "}\n"])


def _reasons(node: AbsenceNode, name: str) -> Iterator[str]:
    yield f"  {name} [label={_quoted(node.text)}];"
    for number, child in enumerate(node.children):
        yield from _reasons(child, f"{name}_{number}")
        yield f"  {name}_{number} -> {name};"


def _quoted(text: str) -> str:
    text = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{text}"'

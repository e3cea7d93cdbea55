"""Explanations as text: a tree with one item on a line."""

from collections.abc import Iterator

from rmr.why.absence_tree import AbsenceAnswer, AbsenceNode
from rmr.why.rule_words import seconds_text
from rmr.why.why_answer import WhyAnswer
from rmr.why.why_tree import WhyNode


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

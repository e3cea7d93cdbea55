"""JSON laid out for people: what fits on a line stays on it, what does not has an item a line, indented.

It is JSON all the same, and the same on a terminal as in a file.
"""

import json
from typing import Any

WIDTH = 100
"""Columns of a line; a text that is longer by itself stands on a line of its own."""


def laid_out(value: Any, column: int = 0, indent: int = 0) -> str:
    """Return `value` as JSON whose first line begins at `column` of a line that is indented by `indent`."""
    flat = json.dumps(value)
    if column + len(flat) <= WIDTH or not isinstance(value, dict | list) or not value:
        return flat
    inner = indent + 2
    if isinstance(value, dict):
        items = [_entry(key, each, inner) for key, each in value.items()]
        opening, closing = "{}"
    else:
        items = [laid_out(each, inner, inner) for each in value]
        opening, closing = "[]"
    pad = "\n" + " " * inner
    return f"{opening}{pad}{(',' + pad).join(items)}\n{' ' * indent}{closing}"


def _entry(key: str, value: Any, indent: int) -> str:
    name = f"{json.dumps(key)}: "
    return name + laid_out(value, indent + len(name), indent)

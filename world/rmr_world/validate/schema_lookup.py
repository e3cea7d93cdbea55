"""Look-ups in the JSON Schema of a lab file: the keys and the lengths that it allows at a place of a document."""

from collections.abc import Iterator
from typing import Any


def schema_items(schema: dict[str, Any], path: tuple[str | int, ...]) -> str:
    """Return how many items the list at `path` of a JSON Schema has, for example `` of 2``, or nothing."""
    node = schema
    for part in path:
        node = _inner(schema, node, part)
    counts = [len(option["prefixItems"]) for option in _options(schema, node) if "prefixItems" in option]
    return f" of {counts[0]}" if counts else ""


def schema_keys(schema: dict[str, Any], path: tuple[str | int, ...]) -> list[str]:
    """Return the keys that a JSON Schema allows at `path`, in its order."""
    node = schema
    for part in path:
        node = _inner(schema, node, part)
    return [key for option in _options(schema, node) for key in option.get("properties", {})]


def _options(schema: dict[str, Any], node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield `node` and its alternatives with references resolved."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rsplit("/", 1)[1]]
    yield node
    for option in (*node.get("anyOf", ()), *node.get("allOf", ())):
        yield from _options(schema, option)


def _inner(schema: dict[str, Any], node: dict[str, Any], part: str | int) -> dict[str, Any]:
    """Return the schema of `part` of `node`, or an empty one."""
    for option in _options(schema, node):
        if isinstance(part, int) and isinstance(option.get("items"), dict):
            return dict(option["items"])
        if part in option.get("properties", {}):
            return dict(option["properties"][part])
        if isinstance(part, str) and option.get("patternProperties"):
            return dict(next(iter(option["patternProperties"].values())))
    return {}

"""Phase 1, schema: each key of a document by itself (types, units, unknown and missing keys).

A part that breaks the schema becomes an error and is removed, so that the later phases can check the rest. As little
as possible is removed: of a list or a mapping only the bad item. A required section that is missing or wrong is
replaced by a stand-in; findings about a stand-in are suppressed (`SchemaResult.items`, `SchemaResult.cut`).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from rmr_world.document import Document
from rmr_world.finding import END_LINE, FilePath, Finding, LabError, near_miss
from rmr_world.schema import (
    HOST_ADDRESS,
    HOST_NAME,
    LAB_NAME,
    MESSAGE,
    NAME,
    NAMESPACE,
    PYTHON_FILE,
    TOPIC,
    HostsFile,
    LabFile,
    json_schema,
)

_ITEMISED = {"robots", "obstacles", "areas", "faults", "facts", "bodies"}
"""Sections from which a bad item is removed alone; of any other section all is removed."""
_STAND_INS: Mapping[str, Any] = {
    "lab": "x",
    "program": "x.rmr",
    "arena": {"size": [1000.0, 1000.0], "cell": 10.0},
    "robots": [{"id": 0, "pose": [500.0, 500.0, 0.0]}],
}
"""Values for required sections that are wrong or missing."""
ERRORS_MAX = 200
"""Errors of the schema that are listed one by one; a file that is no lab file at all would give thousands."""
_SPELT: Mapping[str, str] = {
    LAB_NAME: "should be small letters, digits, _ and -, a letter first",
    NAME: "should be letters, digits and _, a small letter first",
    PYTHON_FILE: "should be a Python file, FILE.py",
    NAMESPACE: "should be a namespace of ROS 2 such as /robot_{id}: a / before each name of letters, digits and _",
    HOST_NAME: "should be small letters, digits and -, neither first nor last a -",
    HOST_ADDRESS: "should be the name or the IP address of a host, without protocol and port",
    MESSAGE: "should be a type of messages such as sensor_msgs/BatteryState",
    TOPIC: "should be a topic of ROS 2 such as odom or /robot_{id}/odom: names of letters, digits and _",
}
"""Patterns of the schema, and the words for each in an error message."""


@dataclass(slots=True)
class SchemaResult:
    """The part of a document that conforms to the schema, and the errors of the rest."""

    spec: LabFile
    errors: list[Finding]
    cut: set[str] = field(default_factory=set)
    """Sections from which something was removed."""
    kept: dict[str, list[int]] = field(default_factory=dict)
    """For each list that lost items: the indices, in the file, of the items that are left."""

    def items(self, name: str) -> list[tuple[int, Any]]:
        """Return the items of a list section with their indices in the file."""
        section = getattr(self.spec, name)
        return list(zip(self.kept.get(name, range(len(section))), section, strict=False))


def check_schema(document: Document) -> SchemaResult:
    """Check the document key by key. Raises LabError when it is no mapping at all."""
    found = list(document.errors)
    if not isinstance(document.value, dict):
        message = "should be a mapping with the keys lab, program, arena and robots"
        raise LabError([*found, document.finding((), message)])
    data: dict[str, Any] = dict(document.value)
    try:
        return SchemaResult(LabFile.model_validate(data), found)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    found += _of_schema(document, json_schema(), errors)
    kept = _prune(data, [item["loc"] for item in errors])
    cut = {str(item["loc"][0]) for item in errors}
    return SchemaResult(LabFile.model_validate(data), found, cut, kept)


def check_hosts_schema(document: Document) -> HostsFile:
    """Return the hosts of a document that has nothing else. Raises LabError with all errors of its keys."""
    if not isinstance(document.value, dict):
        raise LabError([*document.errors, document.finding((), "should be a mapping with the key hosts")])
    try:
        return HostsFile.model_validate(document.value)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    raise LabError([*document.errors, *_of_schema(document, HostsFile.model_json_schema(), errors)])


def _of_schema(document: Document, schema: dict[str, Any], errors: list[ErrorDetails]) -> list[Finding]:
    """Return the errors of pydantic in this project's words, as many as are listed."""
    unread = {each.path for each in document.errors}  # the YAML reader has reported these places already
    of_schema = [_finding(document, schema, item) for item in errors[:ERRORS_MAX]]
    found = [each for each in of_schema if each.path not in unread and "(key)" not in each.path]
    if len(errors) > ERRORS_MAX:
        found.append(Finding(document.file, END_LINE, 1, "", f"and {len(errors) - ERRORS_MAX} more mistakes"))
    return found


def _finding(document: Document, schema: dict[str, Any], error: ErrorDetails) -> Finding:
    """Return an error of pydantic in this project's words."""
    path: FilePath = tuple(part for part in error["loc"] if part not in ("[key]", "(text)", "(topic)"))
    kind = error["type"]
    message = error["msg"]
    if kind == "extra_forbidden":
        known = schema_keys(schema, path[:-1])
        free = [key for key in known if (*path[:-1], key) not in document.keys]
        near = near_miss(str(path[-1]), free) or "; known are " + ", ".join(known)
        return document.finding(path, f"unknown key{near}", key=True)
    if kind == "missing":
        return document.finding(path, "is missing" + hint(path, kind, None))
    message = message.removeprefix("Value error, ").replace(" after validation", "")
    if kind in {"model_type", "dict_type"}:
        keys = schema_keys(schema, path)
        message = "should be a mapping" + (f" with the keys {', '.join(keys)}" if keys else "")
    elif kind in {"tuple_type", "list_type"}:
        message = "should be a list" + schema_items(schema, path)
    elif kind == "string_pattern_mismatch":
        message = _SPELT[error["ctx"]["pattern"]]
    for phrase in ("Input", "String", "Tuple", "List"):
        message = message.removeprefix(phrase + " ")
    given = error["input"]
    if isinstance(given, str | int | float) or given is None:
        message += f", not {'null' if given is None else repr(given)[:60]}"
    if path[0] == "robots" and path[-1] == "id" and isinstance(given, str) and not given.isdigit():
        message += "; several robots are given by ids and grid"
    message += hint(path, kind, given)
    return document.finding(path, message, key="[key]" in error["loc"])


def _prune(data: dict[str, Any], locations: list[tuple[int | str, ...]]) -> dict[str, list[int]]:
    """Remove the values at `locations` from `data` and put stand-ins for required sections.

    Returns the indices of the items that are left in lists that lost some.
    """
    kept: dict[str, list[int]] = {}
    inner: dict[str, list[int | str]] = {}
    for location in locations:
        inner.setdefault(str(location[0]), []).extend(location[1:2])
    whole_sections = {location[0] for location in locations if len(location) == 1}
    for name, bad in inner.items():
        whole = name in whole_sections
        section = data.pop(name, None)
        if name in _ITEMISED and not whole and isinstance(section, list):
            out = set(bad)
            kept[name] = [i for i in range(len(section)) if i not in out]
            data[name] = [section[i] for i in kept[name]]
        elif name in _ITEMISED and not whole and isinstance(section, dict):
            data[name] = {key: item for key, item in section.items() if key not in bad}
        if name in _STAND_INS and not data.get(name):
            data[name] = _STAND_INS[name]
            kept[name] = []  # a stand-in is not checked
    return kept


# ---- look-ups in the JSON Schema: the keys and the lengths that it allows at a place of a document


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


# ---- hints of the schema phase: what to write instead, appended to the message of an error
#
# A hint depends on the place of the error and on the value found there. A message without a hint is complete.

_SHAPES: Mapping[str, str] = {
    "size": "[width, height]",
    "box": "[x0, y0, x1, y1]",
    "circle": "[x, y, radius]",
    "pose": "[x, y, heading]",
    "link": "[robot, robot]",
    "step": "[dx, dy]",
    "polygon": "[[x, y], [x, y], [x, y]]",
    "slots": "[[x, y], [x, y]]",
    "path": "[[x, y], [x, y]]",
    "beacons": "[[x, y], [x, y]]",
    "robots": "[{id: 1, pose: [0.2, 0.2, 0deg]}]",
    "obstacles": "[{box: [x0, y0, x1, y1]}]",
    "facts": '["due(@1, 25)"]',
    "faults": "[{from: 3s, to: 6s, loss: 0.5}]",
}
"""Notation of a list by the key that holds it; a list of two under any other key is a point."""
_MEASURE = re.compile(r"[-+]?[0-9.]+ *(?P<unit>[A-Za-z/%]+)")


def hint(path: FilePath, kind: str, given: object) -> str:
    """Return what to write at `path` in place of `given`; `kind` is pydantic's type of error. Empty if none fits."""
    key = str(path[-1]) if path else ""
    if kind in {"tuple_type", "list_type", "too_long"}:
        return _shape(path)
    if kind == "missing" and isinstance(path[-1], int):
        return _shape(path[:-1])
    if kind in {"int_type", "float_type", "int_parsing", "float_parsing"} and isinstance(given, str):
        return _number(path, key, given)
    if kind == "string_type":
        return '; a fact is text: "due(@1, 25)"' if path[0] == "facts" else "; write text"
    passage = path == ("bottleneck",) or (len(path) == 2 and path[0] == "passages")
    if passage and kind in {"model_type", "dict_type"}:
        return "; name an area, or {mouths: [west, east]}"
    return ""


def _shape(path: FilePath) -> str:
    """Return the notation of the list at `path`."""
    key = path[-1] if path else ""
    shape = _SHAPES.get(str(key)) if isinstance(key, str) else None
    if shape is None and path and (isinstance(key, int) or key in {"at", "from", "to"}):
        shape = "[x, y]"
    return "" if shape is None else f"; write {shape}"


def _number(path: FilePath, key: str, given: str) -> str:
    try:
        float(given)
    except ValueError:
        pass
    else:
        return "; leave out the quotation marks"
    if _MEASURE.fullmatch(given.strip()) is None:
        return ""
    if key in {"loss", "dropout"}:
        return "; a share is a number from 0 to 1"
    if path[0] in {"arena", "areas", "obstacles", "robots", "robot", "localisation"}:
        return "; metres, and metres per second, stand without a unit"
    return "; write the number without a unit"

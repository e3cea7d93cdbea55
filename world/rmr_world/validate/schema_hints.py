"""What a person who writes a lab file for the first time is told to write instead: the second half of a complaint.

Keyed by where the mistake stands and by what stands there. A complaint without advice is complete as it is.
"""

import re
from collections.abc import Mapping

Path_ = tuple[str | int, ...]
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
"""What a list looks like, by its key; a list of two that is not named is a point."""
_MEASURE = re.compile(r"[-+]?[0-9.]+ *(?P<unit>[A-Za-z/%]+)")
_SHARES = {"loss", "dropout"}


def advice(path: Path_, kind: str, given: object) -> str:
    """Return what to write at `path` in place of `given`, of which pydantic says that it is no `kind`; or nothing."""
    key = str(path[-1]) if path else ""
    if kind in {"tuple_type", "list_type", "too_long"}:
        return _shape(path)
    if kind == "missing" and isinstance(path[-1], int):
        return _shape(path[:-1])
    if kind in {"int_type", "float_type", "int_parsing", "float_parsing"} and isinstance(given, str):
        return _number(path, key, given)
    if kind == "string_type":
        return '; a fact is text: "due(@1, 25)"' if path[0] == "facts" else "; write text"
    if path == ("bottleneck",) and kind in {"model_type", "dict_type"}:
        return "; name an area, or {mouths: [west, east]}"
    return ""


def _shape(path: Path_) -> str:
    """Return what the list at `path` looks like."""
    key = path[-1] if path else ""
    shape = _SHAPES.get(str(key)) if isinstance(key, str) else None
    if shape is None and path and (isinstance(key, int) or key in {"at", "from", "to"}):
        shape = "[x, y]"
    return "" if shape is None else f"; write {shape}"


def _number(path: Path_, key: str, given: str) -> str:
    try:
        float(given)
    except ValueError:
        pass
    else:
        return "; leave out the quotation marks"
    if _MEASURE.fullmatch(given.strip()) is None:
        return ""
    if key in _SHARES:
        return "; a share is a number from 0 to 1"
    if path[0] in {"arena", "areas", "obstacles", "robots", "robot", "localisation"}:
        return "; metres, and metres per second, stand without a unit"
    return "; write the number without a unit"


_YAML: tuple[tuple[str, str], ...] = (
    ("character '@'", "put text that begins with @ in quotation marks; an id is a plain number"),
    ("character '\\t'", "indent with spaces, not with tabs"),
    ("could not find expected ':'", "between a key and its value stand a colon and a space"),
    ("mapping values are not allowed here", "a second colon stands in this line, or the line is indented too far"),
    ("but found '-'", "a list's items and a mapping's keys do not mix: indent alike, or close the bracket above"),
    ("found unexpected end of stream", "a quotation mark is never closed"),
    ("but got", "a bracket above is never closed, or a comma is missing"),
)
"""What usually is wrong, by what the YAML parser says."""


def yaml_advice(message: str) -> str:
    """Return what usually is wrong where the YAML parser says `message`; or nothing."""
    return next((f"; {words}" for said, words in _YAML if said in message), "")

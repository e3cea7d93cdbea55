"""Hints of the schema phase: what to write instead, appended to the message of an error.

A hint depends on the place of the error and on the value found there. A message without a hint is complete.
"""

import re
from collections.abc import Mapping

from rmr_world.finding import FilePath

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
_SHARES = {"loss", "dropout"}


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
    if key in _SHARES:
        return "; a share is a number from 0 to 1"
    if path[0] in {"arena", "areas", "obstacles", "robots", "robot", "localisation"}:
        return "; metres, and metres per second, stand without a unit"
    return "; write the number without a unit"

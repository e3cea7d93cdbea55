"""What the schema leaves of a document: each part that it refuses is told and cut out, so that the rest can be judged.

As little as possible is cut: of a list or a mapping the bad item alone. What a lab cannot be without is replaced by a
stand-in, which nobody judges.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from rmr_world.document import END_LINE, Document, LabError, Path_, Problem
from rmr_world.schema import LAB_NAME, NAME, PYTHON_FILE, LabFile, json_schema, near_miss
from rmr_world.validate.schema_hints import advice
from rmr_world.validate.schema_lookup import schema_items, schema_keys

_ITEMISED = {"robots", "obstacles", "areas", "faults", "facts"}
"""Sections of which a bad item is cut out alone."""
_STAND_INS: Mapping[str, Any] = {
    "lab": "x",
    "program": "x.rmr",
    "arena": {"size": [1000.0, 1000.0], "cell": 10.0},
    "robots": [{"id": 0, "pose": [500.0, 500.0, 0.0]}],
}
"""For required sections that are wrong or missing, so that the rest can be judged."""
PROBLEMS_MAX = 200
"""Mistakes of the schema that are told one by one: a file that is something else would tell thousands."""
_SPELT: Mapping[str, str] = {
    LAB_NAME: "should be small letters, digits, _ and -, a letter first",
    NAME: "should be letters, digits and _, a small letter first",
    PYTHON_FILE: "should be a Python file, FILE.py",
}
"""What the schema's patterns ask for, in words."""


@dataclass(slots=True)
class Accepted:
    """What the schema leaves of a document."""

    spec: LabFile
    problems: list[Problem]
    cut: set[str] = field(default_factory=set)
    """Sections from which something was cut out."""
    kept: dict[str, list[int]] = field(default_factory=dict)
    """For each list that lost items: the indices, in the file, of those that are left."""

    def items(self, name: str) -> list[tuple[int, Any]]:
        """Return the items of a list section with their indices in the file."""
        section = getattr(self.spec, name)
        return list(zip(self.kept.get(name, range(len(section))), section, strict=False))


def accepted(document: Document) -> Accepted:
    """Judge the document key by key."""
    problems = list(document.problems)
    if not isinstance(document.value, dict):
        message = "should be a mapping with the keys lab, program, arena and robots"
        raise LabError([*problems, document.problem((), message)])
    data: dict[str, Any] = dict(document.value)
    try:
        return Accepted(LabFile.model_validate(data), problems)
    except ValidationError as error:
        errors = error.errors(include_url=False)
    schema = json_schema()
    unread = {problem.path for problem in problems}
    found = [_problem(document, schema, item) for item in errors[:PROBLEMS_MAX]]
    problems += [problem for problem in found if problem.path not in unread and "(key)" not in problem.path]
    if len(errors) > PROBLEMS_MAX:
        problems.append(Problem(document.file, END_LINE, 1, "", f"and {len(errors) - PROBLEMS_MAX} more mistakes"))
    kept = _prune(data, [item["loc"] for item in errors])
    cut = {str(item["loc"][0]) for item in errors}
    return Accepted(LabFile.model_validate(data), problems, cut, kept)


def _problem(document: Document, schema: dict[str, Any], error: ErrorDetails) -> Problem:
    """Return one of pydantic's findings in this project's words."""
    path: Path_ = tuple(part for part in error["loc"] if part != "[key]")
    kind, message = error["type"], error["msg"]
    if kind == "extra_forbidden":
        known = schema_keys(schema, path[:-1])
        free = [key for key in known if (*path[:-1], key) not in document.keys]
        hint = near_miss(str(path[-1]), free) or "; known are " + ", ".join(known)
        return document.problem(path, f"unknown key{hint}", key=True)
    if kind == "missing":
        return document.problem(path, "is missing" + advice(path, kind, None))
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
    message += advice(path, kind, given)
    return document.problem(path, message, key="[key]" in error["loc"])


def _prune(data: dict[str, Any], locations: list[tuple[int | str, ...]]) -> dict[str, list[int]]:
    """Cut what stands at `locations` out of `data`, as little as possible; put stand-ins for what must be there.

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
            kept[name] = []  # nobody judges a stand-in
    return kept

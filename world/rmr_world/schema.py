"""The shape of a lab file: which keys there are, their types, units and defaults.

These models say everything that can be judged key by key; what relates several keys (a robot inside an
obstacle, an area that is not defined) is `checks`' business. The JSON Schema that editors use comes from the
same models. Types are strict: ``"3.0"`` is no number and ``true`` no integer, because a lab file that is
silently misread costs an afternoon.
"""

import difflib
import math
import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, Strict, WithJsonSchema, model_validator

from rmr.base.time import NS_PER_MS, NS_PER_S
from rmr.base.values import ROBOT_ID_MAX

LAB_NAME = r"^[a-z][a-z0-9_-]{0,63}$"
NAME = r"^[a-z][A-Za-z0-9_]*$"
ROBOTS_MAX = 1000
"""What one world and one radio can carry; a slip of the pen in a grid must not make a million."""
ARENA_M_MAX = 1000.0
CELLS_MAX = 250_000
"""Of the planning grid."""

_DURATION = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*(ms|s|min)")
_UNIT_NS = {"ms": NS_PER_MS, "s": NS_PER_S, "min": 60 * NS_PER_S}
_ANGLE = re.compile(r"(-?[0-9]+(?:\.[0-9]+)?)\s*(deg|rad)")
_DURATION_S_MAX = 1e6


def _duration(value: object) -> int:
    """Return nanoseconds for ``120s``, ``500ms``, ``1.5min`` or a number of seconds."""
    if isinstance(value, str) and (match := _DURATION.fullmatch(value)):
        ns = float(match[1]) * _UNIT_NS[match[2]]
    elif isinstance(value, int | float) and not isinstance(value, bool) and value >= 0:
        ns = value * NS_PER_S
    else:
        raise ValueError("should be a duration such as 120s, 500ms or 1.5min")
    if not ns <= _DURATION_S_MAX * NS_PER_S:
        raise ValueError(f"should be at most {_DURATION_S_MAX:.0f} s")
    return round(ns)


def _angle(value: object) -> float:
    """Return radians for ``90deg``, ``1.57rad`` or a number of radians."""
    if isinstance(value, str) and (match := _ANGLE.fullmatch(value)):
        return math.radians(float(match[1])) if match[2] == "deg" else float(match[1])
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise ValueError("should be an angle such as 90deg, or a number of radians")


def _ids(value: object) -> list[int]:
    """Return the ids of ``2-3``, ``0-5,9``, ``4`` or ``[2, 3]``."""
    if isinstance(value, int) and not isinstance(value, bool):
        value = [value]
    if isinstance(value, str) and re.fullmatch(r"\d{1,6}(-\d{1,6})?(\s*,\s*\d{1,6}(-\d{1,6})?)*", value):
        value = [i for part in value.split(",") for i in _span(part.strip())]
    if not isinstance(value, list) or not value or not all(type(i) is int for i in value):
        raise ValueError("should be ids such as 2-3 or 0-5,9")
    if any(not 0 <= i <= ROBOT_ID_MAX for i in value):
        raise ValueError(f"ids should be from 0 to {ROBOT_ID_MAX}")
    return value


def _span(part: str) -> range:
    first, _, last = part.partition("-")
    span = range(int(first), int(last or first) + 1)
    if not span or len(span) > ROBOTS_MAX:
        raise ValueError(f"{part} should name 1 to {ROBOTS_MAX} robots, the lesser id first")
    return span


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Integer = Annotated[int, Strict()]
Positive = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
Fraction = Annotated[float, Strict(), Field(ge=0, le=1)]
Length = Annotated[float, Strict(), Field(gt=0, le=ARENA_M_MAX)]
XY = tuple[Number, Number]
Box = tuple[Number, Number, Number, Number]
RobotId = Annotated[int, Strict(), Field(ge=0, le=ROBOT_ID_MAX)]
DurationNs = Annotated[
    int,
    BeforeValidator(_duration),
    WithJsonSchema(
        {"anyOf": [{"type": "number", "minimum": 0}, {"type": "string", "pattern": "^[0-9.]+ *(ms|s|min)$"}]}
    ),
]
Angle = Annotated[
    float,
    BeforeValidator(_angle),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": "^-?[0-9.]+ *(deg|rad)$"}]}),
]
Ids = Annotated[
    list[int],
    BeforeValidator(_ids),
    WithJsonSchema(
        {"anyOf": [{"type": "integer"}, {"type": "string"}, {"type": "array", "items": {"type": "integer"}}]}
    ),
]


class _Strict(BaseModel):
    """Unknown keys are errors; values are what they say."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=False)


def _one_of(model: BaseModel, *names: str) -> None:
    """Raise ValueError unless exactly one of the fields `names` is given."""
    given = [name for name in names if getattr(model, name) is not None]
    if len(given) != 1:
        listed = ", ".join(names)
        raise ValueError(f"should have exactly one of {listed}" + (f", not {' and '.join(given)}" if given else ""))


class ArenaSpec(_Strict):
    """The floor."""

    size: tuple[Length, Length] = Field(description="Width and height, metres.")
    cell: Positive = Field(0.05, description="Edge of a cell of the planning grid, metres.")

    @model_validator(mode="after")
    def _bounded(self) -> "ArenaSpec":
        if self.cell > min(self.size):
            raise ValueError("cell should be smaller than the arena")
        if self.size[0] / self.cell * self.size[1] / self.cell > CELLS_MAX:
            raise ValueError(f"cell makes more than {CELLS_MAX} cells of this arena")
        return self


class ObstacleSpec(_Strict):
    """One of: a box (x0, y0, x1, y1), a circle (x, y, radius), a convex polygon."""

    box: Box | None = None
    circle: tuple[Number, Number, Positive] | None = None
    polygon: Annotated[list[XY], Field(min_length=3, max_length=64)] | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> "ObstacleSpec":
        _one_of(self, "box", "circle", "polygon")
        return self


class QueueSpec(_Strict):
    """Where robots wait for the area: the first at the path's beginning, each next one `spacing` further."""

    path: Annotated[list[XY], Field(min_length=2, max_length=64)]
    spacing: Positive = Field(description="Metres along the path.")


class LineSpec(_Strict):
    """Places evenly spaced from one point to another, both included."""

    from_: XY = Field(alias="from")
    to: XY
    count: Annotated[int, Strict(), Field(ge=2, le=ROBOTS_MAX)]


class AreaSpec(_Strict):
    """A named place: one of `at`, `slots`, `line` or `box`."""

    at: XY | None = None
    slots: Annotated[list[XY], Field(min_length=1, max_length=ROBOTS_MAX)] | None = None
    line: LineSpec | None = None
    box: Box | None = None
    queue: QueueSpec | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> "AreaSpec":
        _one_of(self, "at", "slots", "line", "box")
        return self


class GridSpec(_Strict):
    """Starts in rows of `columns`: x grows by step[0] within a row, y by step[1] from row to row."""

    from_: XY = Field(alias="from")
    step: XY
    columns: Annotated[int, Strict(), Field(ge=1, le=ROBOTS_MAX)]
    facing: Angle = 0.0


class RobotSpec(_Strict):
    """One robot (`id` and `pose`) or several (`ids` and `grid`)."""

    id: RobotId | None = None
    pose: tuple[Number, Number, Angle] | None = Field(None, description="x, y in metres and heading.")
    ids: Ids | None = None
    grid: GridSpec | None = None

    @model_validator(mode="after")
    def _one_or_several(self) -> "RobotSpec":
        given = {name for name in ("id", "pose", "ids", "grid") if getattr(self, name) is not None}
        if given not in ({"id", "pose"}, {"ids", "grid"}):
            raise ValueError("should have id and pose, or ids and grid")
        return self


class ViewSpec(_Strict):
    """The field of view."""

    angle: Angle = math.radians(60)
    depth: Positive = 0.25

    @model_validator(mode="after")
    def _angle_fits(self) -> "ViewSpec":
        if not 0 < self.angle <= math.tau + 1e-9:
            raise ValueError("angle should be above 0 and at most 360deg")
        return self


class ShapeSpec(_Strict):
    """What all robots have in common."""

    radius: Positive = 0.07
    speed: Positive = 0.2
    turn: Angle = math.pi
    view: ViewSpec = ViewSpec()

    @model_validator(mode="after")
    def _turns(self) -> "ShapeSpec":
        if self.turn <= 0:
            raise ValueError("turn should be above 0")
        return self


class RadioSpec(_Strict):
    """The emulated IEEE 802.15.4 radio."""

    tx_power_dbm: Annotated[float, Strict(), Field(ge=-60, le=30)] = 0.0
    sensitivity_dbm: Annotated[float, Strict(), Field(ge=-150, le=0)] = -85.0
    exponent: Annotated[float, Strict(), Field(ge=1, le=8)] = 3.0
    loss: Fraction = 0.0
    interference: Literal["capture_3db", "awgn"] = "capture_3db"
    seed: Integer | None = None


class LocalisationSpec(_Strict):
    """The ultrasonic localisation service."""

    beacons: (
        Annotated[list[XY], Field(max_length=16, description="By default the two lower corners of the arena.")] | None
    ) = None
    rate: Annotated[float, Strict(), Field(gt=0, le=60, description="Pulses of each beacon per second.")] = 10.0
    sigma: Annotated[float, Strict(), Field(ge=0, le=10, description="Noise of a range, metres.")] = 0.005
    dropout: Fraction = 0.0


class FaultSpec(_Strict):
    """One of: kill or restart at an instant; loss, partition or stall over a span of time."""

    at: DurationNs | None = None
    from_: DurationNs | None = Field(None, alias="from")
    to: DurationNs | None = None
    kill: RobotId | None = None
    restart: RobotId | None = None
    loss: Fraction | None = None
    partition: Annotated[list[Annotated[list[RobotId], Field(min_length=1)]], Field(min_length=2)] | None = None
    stall: RobotId | None = None

    @model_validator(mode="after")
    def _timed(self) -> "FaultSpec":
        _one_of(self, "kill", "restart", "loss", "partition", "stall")
        instant = self.kill is not None or self.restart is not None
        times = (self.at is not None, self.from_ is not None, self.to is not None)
        if times != (instant, not instant, not instant):
            raise ValueError("kill and restart need at; loss, partition and stall need from and to")
        if self.from_ is not None and self.to is not None and self.from_ >= self.to:
            raise ValueError("should begin before it ends")
        return self


class LabFile(_Strict):
    """A whole lab file."""

    lab: Annotated[str, Field(pattern=LAB_NAME)] = Field(description="Key prefix on the bus.")
    program: Annotated[str, Field(min_length=1)] = Field(description="Source or .rbc, relative to this file.")
    seed: Integer = 0
    duration: Annotated[DurationNs, Field(gt=0)] = 120 * NS_PER_S
    finish: str | None = Field(None, description="A fact that every robot holds in the end: at(R, exit).")
    arena: ArenaSpec
    obstacles: list[ObstacleSpec] = []
    areas: dict[Annotated[str, Field(pattern=NAME)], AreaSpec] = {}
    bottleneck: str | None = None
    robots: Annotated[list[RobotSpec], Field(min_length=1)]
    facts: list[str] = []
    robot: ShapeSpec = ShapeSpec()
    radio: RadioSpec = RadioSpec()
    localisation: LocalisationSpec = LocalisationSpec()
    faults: list[FaultSpec] = []


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a lab file."""
    return LabFile.model_json_schema()


def near_miss(word: str, known: list[str]) -> str:
    """Return ``; did you mean 'x'?`` for the known word nearest to `word`, or nothing."""
    matches = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f"; did you mean '{matches[0]}'?" if matches else ""


def schema_items(schema: dict[str, Any], path: tuple[str | int, ...]) -> str:
    """Return how many items the list at `path` of a JSON Schema has, for example `` of 2``, or nothing."""
    node = schema
    for part in path:
        node = _inner(schema, node, part)
    counts = [len(option["prefixItems"]) for option in _options(schema, node) if "prefixItems" in option]
    return f" of {counts[0]}" if counts else ""


def schema_keys(schema: dict[str, Any], path: tuple[str | int, ...]) -> list[str]:
    """Return the keys that a JSON Schema knows at `path`, in its own order."""
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

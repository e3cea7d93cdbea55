"""The schema of a lab file: its keys, their types, units and defaults.

These models hold every rule about a single key. Rules about several keys (a robot inside an obstacle, an area that is
not defined) are in `rmr_world.validate`. The JSON Schema for editors is made from the same models. Types are strict:
``"3.0"`` is no number and ``true`` no integer, so that no lab file is silently misread.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import pydantic
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Strict,
    Tag,
    WithJsonSchema,
    model_validator,
)

from rmr.base.direction import ENDS_MAX
from rmr.base.time import NS_PER_S, tick_start
from rmr.base.values import ROBOT_ID_MAX
from rmr.radio.links import DISTURBANCES_MAX, GROUPS_MAX
from rmr.radio.phy import Bursts
from rmr.radio.settings import SETTINGS, Setting
from rmr_world.quorum import ALL, QUORUM_SCHEMA, Quorum, quorum_value
from rmr_world.units import PASSAGES_MAX, ROBOTS_MAX, angle, duration, ids, ids_or_all

LAB_NAME = r"^[a-z][a-z0-9_-]{0,63}$"
NAME = r"^[a-z][A-Za-z0-9_]*$"
NAMESPACE = r"^(/|(/([A-Za-z_]|\{id\})([A-Za-z0-9_]|\{id\})*)+)$"
MESSAGE = r"^[a-z][a-z0-9_]*/((msg|srv)/)?[A-Z][A-Za-z0-9]*$"
TOPIC = r"^/?([A-Za-z_]|\{id\})([A-Za-z0-9_]|\{id\})*(/([A-Za-z_]|\{id\})([A-Za-z0-9_]|\{id\})*)*$"
HOST_NAME = r"^[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?$"
HOST_ADDRESS = r"^([A-Za-z0-9_]([A-Za-z0-9_.-]{0,252}[A-Za-z0-9_])?|[0-9A-Fa-f:.]*:[0-9A-Fa-f:.]*)$"
ARENA_M_MAX = 1000.0
RADIUS_M_MIN = 0.001
"""Least radius of a hull, metres. The moment of inertia of a hull of some nanometres is rounded to zero."""
SPEED_MAX = 10.0
"""Greatest speed, m/s. It covers 0.17 m in a tick, more than a hull; faster bodies would pass through one another."""
CELLS_MAX = 250_000
"""Bound of the cells of the planning grid."""
ATTENUATION_DB_MAX = 300.0
"""Greatest attenuation, dB, above the link budget of any radio; to silence a link, cut it."""
HARMS = ("loss", "attenuation_db", "cut")
"""Keys of the effects on one link or on all links; an entry has exactly one of them."""
TICK = tick_start(1)
"""Length of a tick, ns: a node that is called once in each is not slow."""


def _cut(value: object) -> bool:
    if value is not True:
        raise ValueError("should be true; a link that is not to be cut is left out")
    return value


Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Seed = Annotated[int, Strict(), Field(ge=0)]
"""Seed of a run; at most `SEED_MAX`, for integers in a lab file have no more digits."""
Positive = Annotated[float, Strict(), Field(gt=0, allow_inf_nan=False)]
Fraction = Annotated[float, Strict(), Field(ge=0, le=1)]
Length = Annotated[float, Strict(), Field(gt=0, le=ARENA_M_MAX)]
XY = tuple[Number, Number]
Box = tuple[Number, Number, Number, Number]
RobotId = Annotated[int, Strict(), Field(ge=0, le=ROBOT_ID_MAX)]
DurationNs = Annotated[
    int,
    BeforeValidator(duration),
    WithJsonSchema(
        {"anyOf": [{"type": "number", "minimum": 0}, {"type": "string", "pattern": "^[0-9.]+ *(ms|s|min)$"}]}
    ),
]
Angle = Annotated[
    float,
    BeforeValidator(angle),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": "^-?[0-9.]+ *(deg|rad)$"}]}),
]
Ids = Annotated[
    list[int],
    BeforeValidator(ids),
    WithJsonSchema(
        {"anyOf": [{"type": "integer"}, {"type": "string"}, {"type": "array", "items": {"type": "integer"}}]}
    ),
]
IdsOrAll = Annotated[
    list[int],
    BeforeValidator(ids_or_all),
    WithJsonSchema(
        {"anyOf": [{"type": "integer"}, {"type": "string"}, {"type": "array", "items": {"type": "integer"}}]}
    ),
]
PYTHON_FILE = r"^.+\.py$"
PythonFile = Annotated[str, Field(pattern=PYTHON_FILE)]
Link = tuple[RobotId, RobotId]
Topic = Annotated[str, Field(pattern=TOPIC)]
Flag = Annotated[bool, Strict()]
Groups = Annotated[list[Ids], Field(min_length=2, max_length=GROUPS_MAX)]
Attenuation = Annotated[float, Strict(), Field(ge=0, le=ATTENUATION_DB_MAX)]
Cut = Annotated[Literal[True], BeforeValidator(_cut)]


class _Strict(BaseModel):
    """Base of all models: unknown keys are errors, values are immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=False)


def _one_of(model: BaseModel, *names: str) -> None:
    """Raise ValueError unless exactly one of the fields `names` is given."""
    given = [name for name in names if getattr(model, name) is not None]
    if len(given) != 1:
        listed = ", ".join(names)
        raise ValueError(f"should have exactly one of {listed}" + (f", not {' and '.join(given)}" if given else ""))


class ArenaSpec(_Strict):
    """The floor."""

    size: tuple[Length, Length]
    cell: Positive = 0.05

    @model_validator(mode="after")
    def _bounded(self) -> "ArenaSpec":
        if self.cell > min(self.size):
            raise ValueError("cell should be smaller than the arena")
        if self.size[0] / self.cell * self.size[1] / self.cell > CELLS_MAX:
            raise ValueError(f"cell makes more than {CELLS_MAX} cells of this arena")
        return self


class ObstacleSpec(_Strict):
    """One of: a box (x0, y0, x1, y1), a circle (x, y, radius), a polygon."""

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
    spacing: Positive


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


class PassageSpec(_Strict):
    """What robots pass in turns: the area at its entry, or those at its ends where they come from several."""

    mouths: Annotated[list[str], Field(min_length=1, max_length=ENDS_MAX)]

    @model_validator(mode="before")
    @classmethod
    def _by_its_entry(cls, value: object) -> object:
        if isinstance(value, str):
            return {"mouths": [value]}
        if isinstance(value, dict) and isinstance(value.get("mouths"), list) and len(value["mouths"]) == 1:
            (mouth,) = value["mouths"]
            raise ValueError(f"mouths should name two areas; for one entry write its name alone: {mouth}")
        return value


class StationSpec(_Strict):
    """An area that a robot holds from before it drives in until it has left."""

    capacity: Annotated[int, Strict(), Field(ge=1, le=ROBOTS_MAX)] | None = None


def stations_value(value: object) -> object:
    """Return the stations by name, where the file lists names alone."""
    if isinstance(value, str):
        raise ValueError(f"should be a list of areas: [{value}]")
    if isinstance(value, list) and all(isinstance(name, str) for name in value):
        twice = next((name for k, name in enumerate(value) if name in value[:k]), None)
        if twice is not None:
            raise ValueError(f"names '{twice}' twice")
        return {name: {} for name in value}
    return value


STATIONS_SCHEMA: Final = {
    "anyOf": [
        {"type": "array", "items": {"type": "string"}, "uniqueItems": True},
        {
            "type": "object",
            "patternProperties": {
                NAME: {
                    "type": "object",
                    "properties": {"capacity": {"type": "integer", "minimum": 1, "maximum": ROBOTS_MAX}},
                    "additionalProperties": False,
                }
            },
            "additionalProperties": False,
        },
    ]
}


class GridSpec(_Strict):
    """Starts in rows of `columns`: x grows by step[0] within a row, y by step[1] from row to row."""

    from_: XY = Field(alias="from")
    step: XY
    columns: Annotated[int, Strict(), Field(ge=1, le=ROBOTS_MAX)]
    facing: Angle = 0.0


class RobotSpec(_Strict):
    """One robot (`id` and `pose`) or several (`ids` and `grid`)."""

    id: RobotId | None = None
    pose: tuple[Number, Number, Angle] | None = None
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
    depth: Positive | None = None
    """Metres; None: what robots of this radius and speed need."""

    @model_validator(mode="after")
    def _angle_fits(self) -> "ViewSpec":
        if not 0 < self.angle <= math.tau + 1e-9:
            raise ValueError("angle should be above 0 and at most 360deg")
        return self


class ShapeSpec(_Strict):
    """What all robots have in common."""

    radius: Annotated[float, Strict(), Field(ge=RADIUS_M_MIN, le=ARENA_M_MAX)] = 0.07
    speed: Annotated[float, Strict(), Field(gt=0, le=SPEED_MAX)] = 0.2
    turn: Angle = math.pi
    view: ViewSpec = ViewSpec()

    @model_validator(mode="after")
    def _turns(self) -> "ShapeSpec":
        if self.turn <= 0:
            raise ValueError("turn should be above 0")
        return self


class BurstsSpec(_Strict):
    """Bursts of losses: each link is good for a while, then bad (Gilbert and Elliott)."""

    good: DurationNs
    bad: DurationNs
    loss: Fraction = 1.0

    @model_validator(mode="after")
    def _possible(self) -> "BurstsSpec":
        Bursts(self.good, self.bad, self.loss)
        return self


class LinkSpec(_Strict):
    """How the link between two robots is worse than distance makes it: one of `loss`, `attenuation_db`, `cut`."""

    link: Link
    one_way: Flag = False
    loss: Fraction | None = None
    attenuation_db: Attenuation | None = None
    cut: Cut | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> "LinkSpec":
        _one_of(self, *HARMS)
        return self


def _type_of(setting: Setting) -> Any:
    """Return the type of the value that a lab file gives to a setting of the radio."""
    if setting.limits is not None:
        return Annotated[float, Strict(), Field(ge=setting.limits[0], le=setting.limits[1])]
    return Literal[setting.choices] if setting.choices else BurstsSpec | None


_RADIO_KEYS: dict[str, Any] = {each.name: (_type_of(each), each.default) for each in SETTINGS}
_RadioModel = pydantic.create_model("_RadioModel", __base__=_Strict, **_RADIO_KEYS)
"""The keys of `radio` that are settings of the model (`rmr.radio.settings`)."""


class RadioSpec(_RadioModel, _Strict):  # type: ignore[valid-type, misc]
    """The emulated IEEE 802.15.4 radio."""

    seed: Seed | None = None
    security: Literal["none", "enc-mic-32", "enc-mic-64", "enc-mic-128"] | None = None
    key_file: Annotated[str, Field(min_length=1)] | None = None
    links: Annotated[list[LinkSpec], Field(max_length=DISTURBANCES_MAX)] = []
    partition: Groups | None = None

    @model_validator(mode="after")
    def _key_used(self) -> "RadioSpec":
        if self.security == "none" and self.key_file is not None:
            raise ValueError("security none uses no key: remove security, or key_file")
        return self


class BusSpec(_Strict):
    """The bus between the processes of `rmr up`, or of a lab that is started by hand."""

    security: Literal["secret", "mtls"] = "secret"


class HostSpec(_Strict):
    """The share of one host, where the processes of a lab are spread over several."""

    address: Annotated[str, Field(pattern=HOST_ADDRESS)] | None = None
    port: Annotated[int, Strict(), Field(ge=1, le=65535)] | None = None
    world: Flag = False
    router: Flag | None = None
    robots: Ids | None = None


Hosts = dict[Annotated[str, Field(pattern=HOST_NAME)], HostSpec]


class HostsFile(_Strict):
    """The hosts of a lab in a file of their own."""

    hosts: Annotated[Hosts, Field(min_length=1)]


class LocalisationSpec(_Strict):
    """The ultrasonic localisation service."""

    beacons: Annotated[list[XY], Field(max_length=16)] | None = None
    rate: Annotated[float, Strict(), Field(gt=0, le=60)] = 10.0
    sigma: Annotated[float, Strict(), Field(ge=0, le=10)] = 0.005
    dropout: Fraction = 0.0


class Ros2Spec(_Strict):
    """A body that is a robot of ROS 2: where its topics are, and what its localisation is worth.

    `{id}` in a name stands for the robot's id. A name with a leading / is that of the topic, any other one is within
    the namespace.
    """

    namespace: Annotated[str, Field(pattern=NAMESPACE)]
    odom: Topic = "odom"
    cmd_vel: Topic = "cmd_vel"
    pose: Topic = "amcl_pose"
    scan: Topic | None = None
    scan_at: tuple[Number, Number, Angle] = (0.0, 0.0, 0.0)
    navigate: Topic | None = None
    sigma: Annotated[float, Strict(), Field(gt=0, le=10)] = 0.03
    heading_sigma: Annotated[Angle, Field(gt=0, le=math.pi)] = math.radians(3)
    origin: tuple[Number, Number, Angle] = (0.0, 0.0, 0.0)


class TopicFactSpec(_Strict):
    """A sensed fact that holds with the newest message of a topic of ROS 2, read every so often.

    In place of a value it has the path of a field of the message.
    """

    topic: Topic
    type: Annotated[str, Field(pattern=MESSAGE)]
    fact: str
    every: Annotated[DurationNs, Field(gt=0)] = NS_PER_S


def _fact_kind(item: Any) -> str:
    """Return the tag of an item of `facts`; one that has no key of a topic's is a fact without quotation marks."""
    is_topic = isinstance(item, TopicFactSpec) or (isinstance(item, dict) and item.keys() & TopicFactSpec.model_fields)
    return "(topic)" if is_topic else "(text)"


FactItem = Annotated[
    Annotated[str, Tag("(text)")] | Annotated[TopicFactSpec, Tag("(topic)")],
    Discriminator(_fact_kind),
    WithJsonSchema({"anyOf": [{"type": "string"}, TopicFactSpec.model_json_schema()]}),
]


class RosActionSpec(_Strict):
    """An action that calls a service of ROS 2, or publishes a message.

    In place of an argument it has the path of the field that gets it.
    """

    action: str
    topic: Topic | None = None
    service: Topic | None = None
    type: Annotated[str, Field(pattern=MESSAGE)]
    fields: dict[str, Annotated[bool, Strict()] | Annotated[int, Strict()] | Number | str] = {}
    within: Annotated[DurationNs, Field(gt=0)] = 5 * NS_PER_S

    @model_validator(mode="after")
    def _published_or_called(self) -> "RosActionSpec":
        _one_of(self, "topic", "service")
        return self


def _is_list(value: Any) -> str:
    """Return the tag of `actions`: a file, or a list; of an item of that list likewise."""
    return "(topic)" if isinstance(value, list | dict | RosActionSpec) else "(text)"


ActionItem = Annotated[
    Annotated[PythonFile, Tag("(text)")] | Annotated[RosActionSpec, Tag("(topic)")], Discriminator(_is_list)
]
ActionsValue = Annotated[
    Annotated[PythonFile, Tag("(text)")] | Annotated[list[ActionItem], Tag("(topic)")],
    Discriminator(_is_list),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string", "pattern": PYTHON_FILE},
                {
                    "type": "array",
                    "items": {"anyOf": [{"type": "string", "pattern": PYTHON_FILE}, RosActionSpec.model_json_schema()]},
                },
            ]
        }
    ),
]


class BodySpec(_Strict):
    """What the bodies of some robots are, or of all."""

    robots: IdsOrAll = []
    ros2: Ros2Spec


def bodies_value(value: object) -> object:
    """Return the bodies that are not simulated, where the file has the word for all."""
    if value == "simulated":
        return []
    if not isinstance(value, list):
        raise ValueError("should be simulated, or a list: [{robots: 4-6, ros2: {namespace: '/robot_{id}'}}]")
    return value


BODIES_SCHEMA: Final = {
    "anyOf": [
        {"const": "simulated"},
        {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {
                    "robots": {
                        "anyOf": [
                            {"type": "integer"},
                            {"type": "string"},
                            {"type": "array", "items": {"type": "integer"}},
                        ]
                    },
                    "ros2": Ros2Spec.model_json_schema(),
                },
                "required": ["ros2"],
                "additionalProperties": False,
            },
        },
    ]
}


class FaultSpec(_Strict):
    """What goes wrong: a robot is killed or restarted at an instant, or something holds over a span of time.

    `every` belongs to `slow`: how often the robot's mind is called.
    `loss`, `attenuation_db` and `cut` concern one link if `link` names it, else the whole radio.
    """

    at: DurationNs | None = None
    from_: DurationNs | None = Field(None, alias="from")
    to: DurationNs | None = None
    kill: RobotId | None = None
    restart: RobotId | None = None
    loss: Fraction | None = None
    attenuation_db: Attenuation | None = None
    cut: Cut | None = None
    link: Link | None = None
    one_way: Flag = False
    partition: Groups | None = None
    mute: RobotId | None = None
    deaf: RobotId | None = None
    stall: RobotId | None = None
    slow: RobotId | None = None
    every: DurationNs | None = None
    outage: IdsOrAll | None = None

    @model_validator(mode="after")
    def _timed(self) -> "FaultSpec":
        _one_of(self, "kill", "restart", *HARMS, "partition", "mute", "deaf", "stall", "slow", "outage")
        instant = self.kill is not None or self.restart is not None
        times = (self.at is not None, self.from_ is not None, self.to is not None)
        if times != (instant, not instant, not instant):
            raise ValueError("kill and restart need at; all others need from and to")
        if self.from_ is not None and self.to is not None and self.from_ >= self.to:
            raise ValueError("should begin before it ends")
        return self

    @model_validator(mode="after")
    def _says_how_slow(self) -> "FaultSpec":
        if (self.slow is None) != (self.every is None):
            raise ValueError("slow and every belong together: slow: 2, every: 100ms")
        if self.every is not None and self.every <= TICK:
            raise ValueError("every should be longer than a tick, which takes 16.7 ms")
        return self

    @model_validator(mode="after")
    def _concerns_a_link(self) -> "FaultSpec":
        if self.link is not None and all(getattr(self, harm) is None for harm in HARMS):
            raise ValueError(f"link goes with {', '.join(HARMS[:-1])} or {HARMS[-1]}")
        if self.one_way and self.link is None and self.partition is None:
            raise ValueError("one_way needs link or partition")
        return self


class LoadSpec(_Strict):
    """A new program that the robots get while they run (rmr sim)."""

    at: DurationNs
    program: Annotated[str, Field(min_length=1)]
    robots: Ids | None = None


PassageValue = Annotated[
    PassageSpec,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string"},
                {
                    "type": "object",
                    "properties": {
                        "mouths": {"type": "array", "items": {"type": "string"}, "minItems": 2, "maxItems": ENDS_MAX}
                    },
                    "required": ["mouths"],
                    "additionalProperties": False,
                },
            ]
        }
    ),
]


class LabFile(_Strict):
    """A whole lab file."""

    lab: Annotated[str, Field(pattern=LAB_NAME)]
    program: Annotated[str, Field(min_length=1)]
    actions: ActionsValue | None = None
    events: PythonFile | None = None
    seed: Seed = 0
    duration: Annotated[DurationNs, Field(gt=0)] = 120 * NS_PER_S
    finish: str | None = None
    quorum: Annotated[Quorum, BeforeValidator(quorum_value), WithJsonSchema(QUORUM_SCHEMA)] = ALL
    arena: ArenaSpec
    map: Annotated[str, Field(min_length=1)] | None = None
    obstacles: list[ObstacleSpec] = []
    areas: dict[Annotated[str, Field(pattern=NAME)], AreaSpec] = {}
    bottleneck: PassageValue | None = None
    passages: (
        Annotated[dict[Annotated[str, Field(pattern=NAME)], PassageValue], Field(max_length=PASSAGES_MAX)] | None
    ) = None
    stations: Annotated[dict[str, StationSpec], BeforeValidator(stations_value), WithJsonSchema(STATIONS_SCHEMA)] = {}
    robots: Annotated[list[RobotSpec], Field(min_length=1)]
    facts: list[FactItem] = []
    robot: ShapeSpec = ShapeSpec()
    radio: RadioSpec = RadioSpec()
    bus: BusSpec = BusSpec()
    hosts: Hosts = {}
    localisation: LocalisationSpec = LocalisationSpec()
    bodies: Annotated[list[BodySpec], BeforeValidator(bodies_value), WithJsonSchema(BODIES_SCHEMA)] = []
    faults: list[FaultSpec] = []
    loads: list[LoadSpec] = []


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a lab file, with the words of `lab_keys.md` as descriptions, for editors."""
    schema = LabFile.model_json_schema()
    text = Path(__file__).with_name("lab_keys.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)` \|[^|]*\| (.*) \|$", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text), re.MULTILINE)
    _describe(schema, schema, "", dict(rows))
    return schema


def _describe(schema: dict[str, Any], node: dict[str, Any], path: str, words: Mapping[str, str]) -> None:
    """Describe all keys below `node`, which is at `path` as `lab_keys.md` writes it."""
    if "$ref" in node:
        node = schema["$defs"][node["$ref"].rsplit("/", 1)[1]]
    for option in node.get("anyOf", []):
        _describe(schema, option, path, words)
    for key, inner in node.get("properties", {}).items():
        here = f"{path}.{key}" if path else key
        inner["description"] = words[here]
        _describe(schema, inner, here, words)
    if isinstance(node.get("items"), dict):
        _describe(schema, node["items"], f"{path}[]", words)
    for inner in (node.get("additionalProperties"), *node.get("patternProperties", {}).values()):
        if isinstance(inner, dict):
            _describe(schema, inner, f"{path}.NAME", words)

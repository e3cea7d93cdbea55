"""Facts from topics: the newest message of a topic becomes a sensed fact of a robot, read every so often.

Types of messages and fields are looked up before the lab begins; what does not fit is an error there. Later nothing
stops a lab: a topic that nobody publishes, or with another type, is named once, and a value that its argument does not
take leaves the fact as it was. Nothing here imports rclpy; the node is handed in, and its thread only keeps messages.
"""

import logging
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib import import_module
from typing import Any, Final

from rmr.base.time import NS_PER_S, Duration, Instant, seconds
from rmr.base.values import INT_MAX, ROBOT_ID_MAX, Robot, Symbol, Value

Args = tuple[Value, ...]

EXAMPLES: Final[Mapping[str, Any]] = {"boolean": True, "string": "a", "float": 0.5, "double": 0.5}
"""A value of each type of fields; all others are whole numbers."""

log = logging.getLogger("rmr")


class TopicFactError(ValueError):
    """A fact cannot be had as the lab says; the message says where and why."""


@dataclass(frozen=True, slots=True)
class TopicReading:
    """One fact of one robot."""

    item: int
    """Of its entry under `facts` in the lab file."""
    robot: int
    topic: str
    """From the root."""
    type: str
    name: str
    """The predicate."""
    args: Args
    """Without the owner; symbols are paths of fields."""
    types: tuple[str, ...]
    """Of the arguments, as the program has them."""
    every: Duration

    def of(self, message: Any) -> Args | None:
        """Return the arguments by a message; None if it holds what one of them does not take."""
        found = [
            taken(_at(message, arg), kind) if isinstance(arg, Symbol) else arg
            for arg, kind in zip(self.args, self.types, strict=True)
        ]
        return None if None in found else tuple(value for value in found if value is not None)


def _at(message: Any, path: str) -> Any:
    for name in path.split("."):
        message = getattr(message, name)
    return message


def taken(value: Any, kind: str) -> Value | None:
    """Return what an argument of type `kind` takes of a field; None: nothing."""
    if isinstance(value, bool) or kind == "bool":
        return value if isinstance(value, bool) and kind in ("bool", "open") else None
    if isinstance(value, str):
        if kind == "symbol":
            return Symbol(value) if re.fullmatch(r"[a-z][A-Za-z0-9_]{0,63}", value) else None
        return value if kind in ("string", "open") else None
    if not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > INT_MAX:
        return None
    if kind == "float":
        return float(value)
    if kind == "robot":
        return Robot(value) if isinstance(value, int) and 0 <= value <= ROBOT_ID_MAX else None
    return value if kind == "open" or (kind == "int" and isinstance(value, int)) else None


def message_class(name: str, part: str = "msg") -> Any:
    """Return the class of messages called `package/Name`; `part` srv: of services. Raises TopicFactError."""
    package, *_, name = name.split("/")
    what = {"msg": "messages", "srv": "services"}.get(part, "actions")
    try:
        module = import_module(f"{package}.{part}")
    except ImportError:
        raise TopicFactError(f"the {what} of {package} are not installed here") from None
    found = getattr(module, name, None)
    if found is None:
        near = get_close_matches(name, [each for each in vars(module) if each[:1].isupper()], 1)
        raise TopicFactError(f"{package} has no {what} {name}{f'; did you mean {near[0]}?' if near else ''}")
    return found


def check(reading: TopicReading, kind: Any) -> None:
    """Raise TopicFactError if messages of the class `kind` lack a field, or an argument does not take it."""
    for position, (arg, wanted) in enumerate(zip(reading.args, reading.types, strict=True), start=2):
        if not isinstance(arg, Symbol):
            continue
        found = field_type(reading.type, kind, arg)
        if taken(EXAMPLES.get(re.sub(r"[0-9]+$|<[0-9]+>$", "", found), 1), wanted) is None:
            raise TopicFactError(
                f"argument {position} of '{reading.name}' is a {wanted}, and the field {arg} a {found}"
            )


def field_type(type_name: str, kind: Any, path: str) -> str:
    """Return the type of the field at `path` of the messages `kind`. Raises TopicFactError."""
    found = type_name
    for name in path.split("."):
        fields: Mapping[str, str] = kind.get_fields_and_field_types() if kind is not None else {}
        if name not in fields:
            near = get_close_matches(name, fields, 1)
            known = f"; did you mean {near[0]}?" if near else f"; it has {', '.join(fields)}" if fields else ""
            raise TopicFactError(f"{found} has no field {name}{known}")
        found = fields[name]
        if "[" in found or found.startswith("sequence"):
            raise TopicFactError(f"the field {path} is a list ({found}); name a field of one value")
        kind = message_class(found) if "/" in found else None
    if kind is not None:
        fields = kind.get_fields_and_field_types()
        raise TopicFactError(
            f"the field {path} is a {found}; name a field of it: {', '.join(f'{path}.{n}' for n in fields)}"
        )
    return found


class FactTopics:
    """The readings of a lab. Raises TopicFactError, a line for each that is wrong."""

    def __init__(self, node: Any, readings: Sequence[TopicReading], quality: Callable[[Sequence[Any]], Any]) -> None:
        """`quality` returns the quality of service that goes with the publishers of a topic."""
        self._node = node
        self._readings = readings
        self._quality = quality
        self._kinds: dict[str, Any] = {}
        self._check()
        self._newest: dict[str, Any] = {}
        """The newest message of each topic; rclpy's thread writes it."""
        self._awaited = dict.fromkeys(each.topic for each in readings)
        """Topics without a subscription."""
        self._said: set[str] = set()
        self._begun: Instant | None = None
        self._read: dict[TopicReading, Instant] = {}
        self._held: dict[TopicReading, Args] = {}
        self._changed: dict[int, Instant] = {}
        """When each robot is to be told all of its facts."""

    def _check(self) -> None:
        wrong: dict[str, None] = {}
        for each in self._readings:
            try:
                kind = message_class(each.type)
                check(each, kind)
                if self._kinds.setdefault(each.topic, kind) is not kind:
                    raise TopicFactError(f"{each.topic} has another type in an entry before")
            except TopicFactError as error:
                wrong[f"facts.{each.item}: {error}"] = None
        if wrong:
            raise TopicFactError("\n".join(wrong))

    def look(self, clock: Instant) -> None:
        """Subscribe to the topics that are there; name those that are wrong, or not there after a while, once."""
        self._begun = clock if self._begun is None else self._begun
        for each in self._readings:
            if each.topic not in self._awaited:
                continue
            infos = self._node.get_publishers_info_by_topic(each.topic)
            others = sorted({info.topic_type for info in infos} - {full_name(each.type)})
            if infos and not others:
                del self._awaited[each.topic]
                put = _Putter(self._newest, each.topic)
                self._node.create_subscription(self._kinds[each.topic], each.topic, put, self._quality(infos))
            elif others:
                self._say(
                    f"{each.topic} has the type {' and '.join(others)}, and the lab says {full_name(each.type)}", each
                )
            elif clock - self._begun > seconds(5.0):
                self._say(
                    f"nobody publishes {each.topic} ({full_name(each.type)}): no {each.name} comes from there", each
                )

    def _say(self, what: str, reading: TopicReading) -> None:
        if what not in self._said:
            self._said.add(what)
            log.warning("robot %d: %s", reading.robot, what)

    def step(self, clock: Instant) -> None:
        """Read the messages that are due."""
        for each in self._readings:
            if clock < self._read.get(each, 0) or each.topic not in self._newest:
                continue
            args = each.of(self._newest[each.topic])
            self._read[each] = clock + each.every
            if args is None:
                self._say(f"{each.topic} has a value that '{each.name}' does not take", each)
            elif self._held.get(each) != args:
                self._held[each] = args
                self._changed[each.robot] = clock

    def touch(self, robot: int, clock: Instant) -> None:
        """Let `robot` be told all of its facts at once."""
        self._changed[robot] = clock

    def told(self, robot: int, clock: Instant) -> tuple[tuple[str, Args], ...] | None:
        """Return all facts of `robot` when they have changed, and each second: samples get lost, and minds restart."""
        if clock < self._changed.get(robot, clock + 1):
            return None
        self._changed[robot] = clock + NS_PER_S
        return tuple((each.name, args) for each, args in self._held.items() if each.robot == robot)


class _Putter:
    """Keeps the newest message of a topic."""

    def __init__(self, newest: dict[str, Any], topic: str) -> None:
        self._newest = newest
        self._topic = topic

    def __call__(self, message: Any) -> None:
        self._newest[self._topic] = message


def full_name(type_name: str, part: str = "msg") -> str:
    """Return the name of a type as the graph has it."""
    package, *_, name = type_name.split("/")
    return f"{package}/{part}/{name}"

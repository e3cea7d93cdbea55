"""The channels of a recording, one row each: topic, schema, encoding, and what a message means.

Messages of the channels with a schema of Foxglove are valid under its full JSON schema (folder `foxglove`), so that
Foxglove and Lichtblick show them. The others have schemas of their own, given here by their properties.
"""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple

FOXGLOVE: Final = "foxglove."
"""Prefix of the names of schemas that are files of the folder `foxglove`."""

_NUMBER: Final = {"type": "number"}
_WHOLE: Final = {"type": "integer"}
_TEXT: Final = {"type": "string"}
_PERHAPS_NUMBER: Final = {"type": ["number", "null"]}
_PERHAPS_WHOLE: Final = {"type": ["integer", "null"]}


class RecordChannel(NamedTuple):
    """One channel."""

    topic: str
    schema: str
    encoding: str
    """``json`` or ``msgpack``."""
    written_by: str
    """The processes that write it; a simulated run writes all channels itself."""
    content: str
    properties: Mapping[str, Any] | None = None
    """Properties of the message by name, as JSON schemas; None where `schema` is one of Foxglove."""
    optional: frozenset[str] = frozenset()
    """Properties that a message may lack."""


CHANNELS: Final = (
    RecordChannel(
        "/tf",
        "foxglove.FrameTransforms",
        "json",
        "world",
        "true pose of every robot, 10 times a second: frame `robot/3` in `map`; once a second while none moves",
    ),
    RecordChannel(
        "/tf_estimates",
        "foxglove.FrameTransforms",
        "json",
        "robot",
        "pose that a robot believes to have, when it has changed, at most 10 times a second: frame `robot/3/estimate`",
    ),
    RecordChannel(
        "/scene",
        "foxglove.SceneUpdate",
        "json",
        "world",
        "obstacles, areas and beacons in `map`, and each robot's body and view in its own frame; once",
    ),
    RecordChannel("/floor", "foxglove.Grid", "json", "world", "occupied cells of the arena; once"),
    RecordChannel("/log", "foxglove.Log", "json", "all", "lines of the logs; `name` is the process"),
    RecordChannel(
        "/trace",
        "rmr.Trace",
        "json",
        "robot",
        "entries of the trace, as they are (docs/trace.md)",
        {"t": _NUMBER, "robot": _WHOLE, "what": _TEXT},
    ),
    RecordChannel(
        "/routes",
        "rmr.Route",
        "json",
        "robot",
        "route that a robot has planned, in metres, when it changes; without points when it has none any more",
        {
            "robot": _WHOLE,
            "points": {"type": "array", "items": {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2}},
        },
    ),
    RecordChannel(
        "/frames",
        "rmr.Frame",
        "json",
        "robot",
        "one transmission of a robot's radio, when it is over; with its last attempt the request's outcome",
        {
            "source": _WHOLE,
            "destination": _PERHAPS_WHOLE,
            "kind": _TEXT,
            "octets": _WHOLE,
            "handle": _PERHAPS_WHOLE,
            "asked_s": _PERHAPS_NUMBER,
            "start_s": _PERHAPS_NUMBER,
            "end_s": _PERHAPS_NUMBER,
            "attempt": _WHOLE,
            "outcome": {"type": ["string", "null"]},
        },
    ),
    RecordChannel(
        "/faults",
        "rmr.Fault",
        "json",
        "world, launcher",
        "a fault or a disturbance of the radio, when it becomes known: an entry as in a lab file (docs/labs.md); with "
        "`stop` or `die` in place of `kill` where a robot was stopped in order, or its process died by itself",
        {"fault": {"type": "object"}},
    ),
    RecordChannel(
        "/status",
        "rmr.Status",
        "json",
        "robot",
        "state of a robot, when it has changed, at most once a second: what it does, events that it leads, frames "
        "that wait for the channel",
        {
            "robot": _WHOLE,
            "progress": _TEXT,
            "finished": {"type": "boolean"},
            "leads": {"type": "array"},
            "queue": _WHOLE,
        },
    ),
    RecordChannel(
        "/mind",
        "rmr.Mind",
        "msgpack",
        "robot",
        "inputs of a robot's mind and digests of its outputs, about a second of them: robot, incarnation, log",
    ),
)
"""All channels."""

BY_TOPIC: Final[Mapping[str, RecordChannel]] = {channel.topic: channel for channel in CHANNELS}
"""The channels by topic."""


@cache
def schema_of(topic: str) -> tuple[str, bytes]:
    """Return encoding and octets of the schema of a channel; both are empty for one that is not JSON."""
    channel = BY_TOPIC[topic]
    if channel.schema.startswith(FOXGLOVE):
        file = Path(__file__).with_name("foxglove") / f"{channel.schema.removeprefix(FOXGLOVE)}.json"
        return "jsonschema", file.read_bytes()
    if channel.properties is None:
        return "", b""
    required = [name for name in channel.properties if name not in channel.optional]
    schema = {"title": channel.schema, "type": "object", "properties": channel.properties, "required": required}
    return "jsonschema", json.dumps(schema).encode()

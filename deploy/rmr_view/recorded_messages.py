"""From messages of a recording to the history of the page: one function per channel.

| channel | becomes |
|---|---|
| `/tf`, `/tf_estimates` | poses, estimates |
| `/trace`, `/frames`, `/log`, `/routes` | entries with `t` |
| `/status` | the newest state of each robot |
| `/faults` | faults of the timeline |
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from rmr.base.time import Instant, in_seconds
from rmr.record.foxglove_messages import heading_of
from rmr.record.recording import Message
from rmr_view.run_history import RunHistory, Triple

LEVELS = ("", "debug", "info", "warning", "error", "critical")
"""Names of the levels of foxglove.Log, by number."""
FAULT_KEYS = {"killed": "kill", "restarted": "restart", "stalled": "stall", "slowed": "slow", "silenced": "outage"}
"""The trace's word for a fault of a robot -> the key of a lab file's entry."""

Data = Mapping[str, Any]


def take(history: RunHistory, topic: str, at: Instant, data: Data) -> None:
    """Put one message into the history. A message of another form than rmr's is left out."""
    function = _BY_TOPIC.get(topic)
    if function is not None:
        try:
            function(history, in_seconds(at), data)
        except (KeyError, TypeError, ValueError, AttributeError):
            history.malformed += 1


def take_into_timeline(history: RunHistory, at: Instant, data: Data) -> None:
    """Put an entry of the trace into the timeline alone."""
    try:
        history.add_trace([entry_of("/trace", at, data)])
    except (KeyError, TypeError, ValueError):
        history.malformed += 1


def entries_of(topic: str, messages: Iterable[Message]) -> Iterator[dict[str, Any]]:
    """Yield messages as entries; those of another form than rmr's are left out."""
    for message in messages:
        with suppress(KeyError, TypeError, ValueError):
            yield entry_of(topic, message.at, message.data)


def entry_of(topic: str, at: Instant, data: Data) -> dict[str, Any]:
    """Return a message of `/trace`, `/frames`, `/log` or `/routes` as an entry with `t`. Raises KeyError."""
    t = round(in_seconds(at), 6)
    if topic == "/log":
        level = data["level"]
        name = LEVELS[level] if 0 <= level < len(LEVELS) else ""
        return {"t": t, "level": name, "name": data["name"], "message": data["message"]}
    if topic == "/frames" and data.get("start_s") is not None:
        t = data["start_s"]
    return {**data, "t": t}


def poses_of(data: Data) -> dict[int, Triple]:
    """Return the poses of FrameTransforms by robot; those of other frames are left out."""
    found: dict[int, Triple] = {}
    for each in data["transforms"]:
        words = each["child_frame_id"].split("/")
        if words[0] == "robot" and words[1].isdecimal():
            at = each["translation"]
            found[int(words[1])] = (float(at["x"]), float(at["y"]), heading_of(each["rotation"]))
    return found


def fault_of(fault: Data) -> dict[str, Any]:
    """Return a fault in the form of a lab file's entry."""
    known = {FAULT_KEYS.get(key, key): value for key, value in fault.items()}
    if "to" in known and "at" in known:
        known["from"] = known.pop("at")
    return known


def _tf(history: RunHistory, t: float, data: Data) -> None:
    history.add_poses(t, poses_of(data))


def _estimates(history: RunHistory, t: float, data: Data) -> None:
    for robot, pose in poses_of(data).items():
        history.add_estimate(t, robot, pose)


def _entries(kind: str) -> Callable[[RunHistory, float, Data], None]:
    def function(history: RunHistory, t: float, data: Data) -> None:
        history.add_entries(kind, [entry_of(f"/{kind}", round(t * 1e9), data)])

    return function


def _status(history: RunHistory, t: float, data: Data) -> None:
    history.add_status(t, data["robot"], dict(data))


def _fault(history: RunHistory, t: float, data: Data) -> None:
    """Take in a fault, or the end of all those that were added: those of the lab are told at 0 s and stay."""
    if "clear" in data["fault"]:
        history.end_faults(t)
    else:
        history.add_fault(fault_of(data["fault"]), given=t <= 0.0)


_BY_TOPIC: dict[str, Callable[[RunHistory, float, Data], None]] = {
    "/tf": _tf,
    "/tf_estimates": _estimates,
    "/trace": _entries("trace"),
    "/frames": _entries("frames"),
    "/log": _entries("log"),
    "/routes": _entries("routes"),
    "/status": _status,
    "/faults": _fault,
}
"""The channels that the page shows."""

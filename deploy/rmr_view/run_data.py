"""What the pictures of a run show, read from its recording once, from begin to end.

The recording may be gigabytes long, so poses are thinned out and frames are summed up while they are read.
"""

import json
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, pairwise
from typing import Any, TypeVar

from rmr.base.arena import from_data, to_data
from rmr.base.time import in_seconds
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import Message, Recording
from rmr_view.turn_intervals import TurnIntervals

POSES_MAX = 6_000
"""Poses kept of each robot; of more every second one is dropped, and so on."""
BINS_MAX = 240
"""Bins that a picture has room for; of more, two and two become one."""
LOSSES = ("no_ack", "access_failure")
"""Outcomes of a frame that was given up."""

Sum = TypeVar("Sum", int, float)

ACK = "ack"
"""Kind of an acknowledgement; its attempt is that of the frame that it acknowledges."""


class RadioLoad:
    """The load of the radio over time: airtime by kind of frame, repeats, losses, summed up per bin of time."""

    def __init__(self) -> None:
        self.bin_s = 0.5
        """Width of a bin, seconds."""
        self.airtime: dict[str, dict[int, float]] = {}
        """Seconds on the air, by kind of frame and bin."""
        self.counts: dict[str, dict[int, int]] = {"repeats": {}, **{outcome: {} for outcome in LOSSES}}
        """Repeats, and frames given up, by bin."""
        self.frames = 0

    def add(self, at_s: float, frame: Mapping[str, Any]) -> None:
        """Take in a message of the channel `/frames`; without `start_s` the frame never went on the air."""
        begin = frame["start_s"]
        place = self._bin(at_s if begin is None else begin)
        if begin is not None:
            on_air = self.airtime.setdefault(frame["kind"], {})
            on_air[place] = on_air.get(place, 0.0) + max(0.0, (frame["end_s"] or begin) - begin)
            self.frames += 1
            if frame["attempt"] > 0 and frame["kind"] != ACK:
                self._count("repeats", place)
        if frame["outcome"] in LOSSES:
            self._count(frame["outcome"], place)

    @property
    def bins(self) -> int:
        """Number of bins up to the last one in use."""
        used = [*chain.from_iterable(self.airtime.values()), *chain.from_iterable(self.counts.values())]
        return max(used, default=-1) + 1

    def _count(self, what: str, place: int) -> None:
        self.counts[what][place] = self.counts[what].get(place, 0) + 1

    def _bin(self, at_s: float) -> int:
        while (place := int(max(0.0, at_s) / self.bin_s)) >= BINS_MAX:
            self.bin_s *= 2.0
            self.airtime = {kind: _halved(sums) for kind, sums in self.airtime.items()}
            self.counts = {what: _halved(sums) for what, sums in self.counts.items()}
        return place


def _halved(sums: dict[int, Sum]) -> dict[int, Sum]:
    found: dict[int, Sum] = {}
    for place, value in sums.items():
        found[place // 2] = found.get(place // 2, 0) + value
    return found


class Track:
    """Where one robot was: columns of seconds, metres, metres and radians."""

    def __init__(self) -> None:
        self.t = array("d")
        self.x = array("d")
        self.y = array("d")
        self.heading = array("d")
        self._stride = 1
        self._seen = 0

    def add(self, t: float, x: float, y: float, heading: float) -> None:
        """Append a pose."""
        self._seen += 1
        if (self._seen - 1) % self._stride:
            return
        for column, value in zip(self._columns(), (t, x, y, heading), strict=True):
            column.append(value)
        if len(self.t) > POSES_MAX:
            self._stride *= 2
            for column in self._columns():
                column[:] = column[::2]

    def _columns(self) -> tuple["array[float]", ...]:
        return self.t, self.x, self.y, self.heading

    def __len__(self) -> int:
        return len(self.t)


@dataclass(slots=True)
class RunData:
    """What is drawn of a run."""

    lab: str
    mode: str
    seed: int
    floor: Mapping[str, Any]
    """The arena, as `rmr.base.arena.to_data` returns it."""
    robots: tuple[int, ...] = ()
    end_s: float = 0.0
    """The last instant of the recording."""
    tracks: dict[int, Track] = field(default_factory=dict)
    timeline: dict[str, Any] = field(default_factory=dict)
    """Turns, deadlines, leaders and faults: see `rmr_view.turn_intervals`."""
    radio: RadioLoad = field(default_factory=RadioLoad)
    unreadable: dict[str, int] = field(default_factory=dict)
    """Number of messages that were left out, for they are none of their channel, by channel."""

    @property
    def jobs(self) -> list[dict[str, Any]]:
        """All deadlines of all robots, with the key `robot`, by deadline."""
        every = [{"robot": lane["robot"], **job} for lane in self.timeline["lanes"] for job in lane["deadlines"]]
        return sorted(every, key=lambda job: (job["deadline_s"], job["robot"]))

    @property
    def problems(self) -> list[str]:
        """Sentences on what was left out."""
        return [f"{count} messages of {topic} are damaged and left out" for topic, count in self.unreadable.items()]

    @property
    def title(self) -> str:
        """The run in a few words."""
        how = "simulated" if self.mode == "simulated" else "processes"
        return f"{self.lab}: {len(self.robots)} robots, {how}, seed {self.seed}"


def run_data(recording: Recording) -> RunData:
    """Return what is drawn of a run. Raises RecordingError when the recording holds no floor."""
    floor = recording.attachment("floor.json")
    if floor is None:
        raise RecordingError("the recording holds no floor (floor.json): the file of the world is missing, or damaged")
    try:
        arena = from_data(json.loads(floor))
        if not (arena.width > 0.0 and arena.height > 0.0 and math.isfinite(arena.width + arena.height)):
            raise ValueError("it has no size")
        plain = to_data(arena)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise RecordingError(f"the floor in the recording (floor.json) is damaged: {error}") from error
    about = recording.about
    data = RunData(about.lab, about.mode, about.seed, plain, about.roster)
    return read_run(data, recording.messages(("/tf", "/trace", "/frames", "/faults")))


def read_run(data: RunData, messages: Iterable[Message]) -> RunData:
    """Fill `data`, which has lab, floor and roster, from the messages of its recording; return it."""
    turns = TurnIntervals(data.robots)
    last = 0
    for message in messages:
        last = max(last, message.at)
        try:
            _take(data, turns, message)
        except (KeyError, TypeError, ValueError, AttributeError):
            data.unreadable[message.topic] = data.unreadable.get(message.topic, 0) + 1
    data.end_s = in_seconds(last)
    data.timeline = turns.timeline(data.end_s)
    data.robots = tuple(lane["robot"] for lane in data.timeline["lanes"])
    return data


def _take(data: RunData, turns: TurnIntervals, message: Message) -> None:
    """Take in one message. Raises KeyError, TypeError, ValueError or AttributeError for a damaged one."""
    if message.topic == "/tf":
        for robot, *pose in list(poses(message.data)):
            if not all(map(math.isfinite, pose)):
                raise ValueError("a pose is no place")
            data.tracks.setdefault(robot, Track()).add(in_seconds(message.at), *pose)
    elif message.topic == "/trace":
        turns.add(message.data)
    elif message.topic == "/frames":
        data.radio.add(in_seconds(message.at), message.data)
    elif message.topic == "/faults":
        turns.add_fault(message.data["fault"])


def poses(transforms: Mapping[str, Any]) -> Iterator[tuple[int, float, float, float]]:
    """Yield robot, x, y and heading of each robot in a message of `/tf`."""
    for each in transforms["transforms"]:
        kind, _, robot = each["child_frame_id"].partition("/")
        if kind == "robot" and robot.isdigit():
            where = each["translation"]
            turned = each["rotation"]
            yield int(robot), where["x"], where["y"], 2.0 * math.atan2(turned["z"], turned["w"])


def thinned(times: Sequence[float], columns: Sequence[Sequence[float]], within: float) -> list[int]:
    """Return the indices of the samples to keep, so that interpolation in time misses no sample by more than `within`.

    A sample is one value of each column; what it is missed by is the Euclidean distance (the recursive division of
    Ramer, Douglas and Peucker, over time).
    """
    if not times:
        return []
    kept = {0, len(times) - 1}
    spans = [(0, len(times) - 1)]
    while spans:
        first, last = spans.pop()
        worst = max(range(first + 1, last), key=lambda k: _missed(times, columns, first, last, k), default=None)
        if worst is not None and _missed(times, columns, first, last, worst) > within:
            kept.add(worst)
            spans += [(first, worst), (worst, last)]
    return sorted(kept)


def _missed(times: Sequence[float], columns: Sequence[Sequence[float]], first: int, last: int, k: int) -> float:
    span = times[last] - times[first]
    share = (times[k] - times[first]) / span if span > 0.0 else 0.0
    return math.hypot(*(c[first] + share * (c[last] - c[first]) - c[k] for c in columns))


def unwrapped(angles: Sequence[float]) -> list[float]:
    """Return angles, radians, without jumps of a full turn between neighbours."""
    turned = list(angles[:1])
    for before, after in pairwise(angles):
        turned.append(turned[-1] + math.remainder(after - before, math.tau))
    return turned

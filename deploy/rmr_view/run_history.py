"""What the server keeps of a run: poses, entries of trace, radio and logs, and the timeline. Bounded in memory.

One thread adds and another one reads, so every access holds the lock. Poses are thinned out and entries dropped from
the oldest on when there are too many; an `EntryLog` numbers its entries, so that a reader notices what it has missed.
"""

from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from math import isnan, nan
from threading import Lock
from typing import Any

from rmr_view.turn_intervals import TurnIntervals

SAMPLES_MAX = 36_000
"""Samples of each robot's track: one hour at 10 Hz. Every second sample of the older half goes when there are more."""
GAP_S = 0.05
"""Least distance of a late sample from those before and after it: half of the period of samples."""
POINTS_MAX = 60_000
"""Poses in one answer, over all robots: about 1.5 MB of JSON. Of more, every n-th sample is sent."""
KEPT_MAX = 200_000
"""Entries of one kind: some 100 MB. The oldest half goes when there are more."""

STATUSES_MAX = 10_000
"""States, and routes, of each robot that are kept at most; the oldest half goes when there are more."""
KINDS = ("trace", "frames", "log", "routes")
"""Kinds of entries."""

Triple = tuple[float, float, float]
"""x and y in metres, heading in radians."""


class EntryLog:
    """Numbered entries, each a dict with `t`."""

    def __init__(self, most: int = KEPT_MAX) -> None:
        self._most = most
        self._entries: list[dict[str, Any]] = []
        self.dropped = 0
        """Number of entries dropped, which is the number of the first that is kept."""

    @property
    def count(self) -> int:
        """Number of entries so far, those dropped included."""
        return self.dropped + len(self._entries)

    def add(self, entries: Iterable[dict[str, Any]]) -> None:
        """Append entries."""
        self._entries.extend(entries)
        if len(self._entries) > self._most:
            drop = len(self._entries) - self._most // 2
            del self._entries[:drop]
            self.dropped += drop

    def since(self, number: int) -> list[dict[str, Any]]:
        """Return the entries from `number` on that are kept."""
        return self._entries[max(0, number - self.dropped) :]

    def between(self, begin: float, end: float, most: int) -> list[dict[str, Any]]:
        """Return the first `most` entries with t in [begin, end], by time."""
        found = [entry for entry in self._entries if begin <= entry["t"] <= end]
        found.sort(key=lambda entry: float(entry["t"]))
        return found[:most]


class PoseTracks:
    """Poses of all robots over time."""

    def __init__(self, robots: Sequence[int]) -> None:
        self.robots = tuple(robots)
        self._t = array("d")
        self._columns = {robot: (array("f"), array("f"), array("f")) for robot in robots}

    @property
    def end(self) -> float:
        """Instant of the newest sample; negative if there is none."""
        return self._t[-1] if self._t else -1.0

    def add(self, t: float, poses: Mapping[int, Triple]) -> None:
        """Add a sample of those robots whose pose is known, unless there is one at about that instant."""
        if t <= self.end:
            self._fill(t, poses)
            return
        self._t.append(t)
        for robot, columns in self._columns.items():
            for column, value in zip(columns, poses.get(robot, (nan, nan, nan)), strict=True):
                column.append(value)
        if len(self._t) > SAMPLES_MAX:
            self._thin()

    def _fill(self, t: float, poses: Mapping[int, Triple]) -> None:
        """Insert a sample that has come late into a gap."""
        index = bisect_left(self._t, t)
        after = self._t[index] - t
        before = t - self._t[index - 1] if index else GAP_S
        if min(after, before) < GAP_S:
            return
        self._t.insert(index, t)
        for robot, columns in self._columns.items():
            for column, value in zip(columns, poses.get(robot, (nan, nan, nan)), strict=True):
                column.insert(index, value)

    def _thin(self) -> None:
        half = len(self._t) // 2
        for column in (self._t, *(column for columns in self._columns.values() for column in columns)):
            column[:half] = column[:half:2]

    def between(self, begin: float, end: float, step: int) -> dict[str, Any]:
        """Return every `step`-th sample with t in [begin, end], as the answer to `/api/poses`."""
        first = bisect_left(self._t, begin)
        last = bisect_right(self._t, end)
        return {
            "t": [round(t, 3) for t in self._t[first:last:step]],
            "robots": {
                str(robot): {
                    name: [None if isnan(value) else round(value, 4) for value in column[first:last:step]]
                    for name, column in zip(("x", "y", "heading"), columns, strict=True)
                }
                for robot, columns in self._columns.items()
            },
        }

    def samples(self, begin: float, end: float) -> int:
        """Return the number of samples with t in [begin, end]."""
        return max(0, bisect_right(self._t, end) - bisect_left(self._t, begin))

    def at(self, robot: int, t: float) -> Triple | None:
        """Return the newest known pose of `robot` at `t`."""
        index = bisect_right(self._t, t) - 1
        if index < 0 or robot not in self._columns:
            return None
        x, y, heading = (column[index] for column in self._columns[robot])
        return None if isnan(x) else (round(x, 4), round(y, 4), round(heading, 4))


class RunHistory:
    """All that is kept of one run."""

    def __init__(self, robots: Sequence[int]) -> None:
        self._lock = Lock()
        self.robots = tuple(robots)
        self._truth = PoseTracks(robots)
        self._estimates = {robot: PoseTracks([robot]) for robot in robots}
        self._logs = {kind: EntryLog() for kind in KINDS}
        self._routes: dict[int, list[dict[str, Any]]] = {}
        self._statuses: dict[int, list[tuple[float, dict[str, Any]]]] = {}
        self.malformed = 0
        """Number of messages of a recording that are none of rmr's."""
        self._timeline = TurnIntervals(robots)
        self._given_faults = 0
        self._newest: tuple[float, dict[int, Triple]] = (-1.0, {})
        self._guessed: dict[int, Triple] = {}

    # --- adding ---

    def add_poses(self, t: float, poses: Mapping[int, Triple]) -> None:
        """Take in where the robots are."""
        with self._lock:
            self._truth.add(t, poses)
            if t > self._newest[0]:
                self._newest = (t, self._newest[1] | dict(poses))

    def set_newest(self, t: float, poses: Mapping[int, Triple]) -> None:
        """Take in where the robots are, for those that follow alone: the track does not grow."""
        with self._lock:
            self._newest = (t, dict(poses))

    def add_estimate(self, t: float, robot: int, pose: Triple) -> None:
        """Take in where a robot takes itself to be."""
        with self._lock:
            if robot in self._estimates:
                self._estimates[robot].add(t, {robot: pose})
                self._guessed[robot] = pose

    def add_entries(self, kind: str, entries: Sequence[dict[str, Any]]) -> None:
        """Take in entries of `kind`: trace, frames or log."""
        with self._lock:
            self._logs[kind].add(entries)
            if kind == "trace":
                self._add_to_timeline(entries)
            elif kind == "routes":
                for entry in entries:
                    _append(self._routes.setdefault(entry["robot"], []), entry)

    def add_trace(self, entries: Sequence[dict[str, Any]]) -> None:
        """Take in entries of the trace for the timeline alone."""
        with self._lock:
            self._add_to_timeline(entries)

    def _add_to_timeline(self, entries: Sequence[dict[str, Any]]) -> None:
        for entry in entries:
            if entry["robot"] in self.robots:
                self._timeline.add(entry)

    def add_status(self, t: float, robot: int, status: dict[str, Any]) -> None:
        """Take in the state of a robot."""
        with self._lock:
            _append(self._statuses.setdefault(robot, []), (t, status))

    def add_fault(self, fault: dict[str, Any], given: bool = False) -> None:
        """Take in a fault as the report lists it; `given` by the lab. Those come first."""
        with self._lock:
            self._given_faults += given
            self._timeline.add_fault(fault)

    def end_faults(self, t: float) -> None:
        """End the disturbances of the radio at `t`, but for those given by the lab."""
        with self._lock:
            self._timeline.end_faults(t, self._given_faults)

    # --- reading ---

    @property
    def newest(self) -> tuple[float, dict[int, Triple], dict[int, Triple]]:
        """The newest instant with poses, and the newest poses and estimates."""
        with self._lock:
            return (*self._newest, dict(self._guessed))

    def pose(self, robot: int, t: float) -> tuple[Triple | None, Triple | None]:
        """Return where `robot` was at `t`, and where it took itself to be."""
        with self._lock:
            tracks = self._estimates.get(robot)
            return self._truth.at(robot, t), None if tracks is None else tracks.at(robot, t)

    def route(self, robot: int, t: float) -> list[list[float]] | None:
        """Return the points of the route that `robot` followed at `t`; None if there was none."""
        with self._lock:
            routes = self._routes.get(robot, [])
            index = bisect_right(routes, t, key=lambda entry: float(entry["t"])) - 1
            return routes[index]["points"] or None if index >= 0 else None

    def robot(self, robot: int, t: float) -> dict[str, Any]:
        """Return what is known of a robot at `t`, seconds, without its mind: route, poses, status."""
        truth, estimate = self.pose(robot, t)
        known = {"robot": robot, "t": t, "route": self.route(robot, t), "pose": truth, "estimate": estimate}
        return known | self.status(robot, t)

    def status(self, robot: int, t: float) -> dict[str, Any]:
        """Return the state of `robot` at `t`; empty if it is unknown."""
        with self._lock:
            statuses = self._statuses.get(robot, [])
            index = bisect_right(statuses, t, key=lambda pair: pair[0]) - 1
            return statuses[index][1] if index >= 0 else {}

    def poses(self, begin: float, end: float) -> dict[str, Any]:
        """Return the answer to `/api/poses`: `POINTS_MAX` poses at most; `step` is 1 if no sample was left out."""
        with self._lock:
            points = self._truth.samples(begin, end) * max(1, len(self.robots))
            step = max(1, -(-points // POINTS_MAX))
            answer = self._truth.between(begin, end, step)
            estimates = {}
            for robot, tracks in self._estimates.items():
                part = tracks.between(begin, end, step)
                estimates[str(robot)] = {"t": part["t"], **part["robots"][str(robot)]}
            return {**answer, "estimates": estimates, "step": step}

    def timeline(self, now: float) -> dict[str, Any]:
        """Return the answer to `/api/timeline`; intervals under way end at `now`."""
        with self._lock:
            return self._timeline.timeline(now)

    def count(self, kind: str) -> int:
        """Return the number of entries of `kind` so far."""
        with self._lock:
            return self._logs[kind].count

    def since(self, kind: str, number: int) -> list[dict[str, Any]]:
        """Return the entries of `kind` from `number` on."""
        with self._lock:
            return self._logs[kind].since(number)

    def between(self, kind: str, begin: float, end: float, most: int) -> list[dict[str, Any]]:
        """Return the first `most` entries of `kind` with t in [begin, end], by time."""
        with self._lock:
            return self._logs[kind].between(begin, end, most)

    def dropped(self, kind: str) -> int:
        """Return the number of entries of `kind` that are no longer kept."""
        with self._lock:
            return self._logs[kind].dropped


def _append(entries: list[Any], entry: Any) -> None:
    entries.append(entry)
    if len(entries) > STATUSES_MAX:
        del entries[: STATUSES_MAX // 2]

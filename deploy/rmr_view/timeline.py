"""The timeline of a run, from its trace: a lane per robot, jobs and deadlines, leaders, schedules, faults.

    trace         interval that begins    interval that ends
    asks          asking                  any
    slotted       waiting                 asking
    slot_lost     asking                  waiting
    entered       inside                  asking, waiting
    left          none                    inside

Faults add intervals of their own: dead from `kill` to `restart`, stalled for a time. The death of a robot ends its
crossing. The trace names a crossing's event only from `entered` on, so the intervals of one crossing get their event
when it is known. An entry `leads` names no event either: it is that of the leader's own crossing around that instant.
"""

from collections.abc import Sequence
from typing import Any

KEPT_MAX = 20_000
"""Intervals of one lane, and schedules: more cannot be shown. The oldest go first."""

BEGINS = {"asks": "asking", "slotted": "waiting", "slot_lost": "asking", "entered": "inside"}
"""Word of the trace -> the kind of interval that begins."""


class Lane:
    """One robot's intervals and jobs."""

    def __init__(self) -> None:
        self.intervals: list[dict[str, Any]] = []
        self.deadlines: list[dict[str, Any]] = []
        self.down: list[dict[str, Any]] = []
        """When the robot was dead or stalled."""
        self._crossing: list[dict[str, Any]] = []
        """The intervals of the crossing under way."""

    def begin(self, t: float, kind: str, event: str | None) -> None:
        """Begin an interval; the one under way ends."""
        present = self._open()
        if present is not None and present["kind"] == kind == "waiting":
            return  # a slot that was moved
        self.end(t)
        interval = {"kind": kind, "begin_s": t, "end_s": None, "event": event}
        self.intervals.append(interval)
        self._crossing.append(interval)
        if event is not None:
            for each in self._crossing:
                each["event"] = event
        if len(self.intervals) > KEPT_MAX:
            del self.intervals[: KEPT_MAX // 2]

    def end(self, t: float) -> None:
        """End the interval under way, if there is one."""
        present = self._open()
        if present is not None:
            present["end_s"] = t
            if present["kind"] == "inside":
                self._crossing = []

    def _open(self) -> dict[str, Any] | None:
        return self.intervals[-1] if self.intervals and self.intervals[-1]["end_s"] is None else None

    def fall(self, t: float, end_s: float | None, kind: str) -> None:
        """The robot is dead or stalled from `t` on."""
        if kind == "dead":
            self.end(t)
            self._crossing = []
        self.down.append({"kind": kind, "begin_s": t, "end_s": end_s, "event": None})

    def rise(self, t: float) -> None:
        """The robot lives again."""
        for one in self.down:
            if one["kind"] == "dead" and one["end_s"] is None:
                one["end_s"] = t

    def job(self, t: float, entry: dict[str, Any]) -> None:
        """Take in the start, the finish or the miss of a job."""
        job = entry["job"]
        if entry["what"] == "job_started":
            deadline = {"job": job, "begin_s": t, "deadline_s": entry["deadline_s"], "finish_s": None, "met": None}
            self.deadlines.append(deadline)
            del self.deadlines[:-KEPT_MAX]
            return
        found = next((one for one in reversed(self.deadlines) if one["job"] == job and one["finish_s"] is None), None)
        if found is None:
            return
        if entry["what"] == "deadline_missed":
            found["met"] = False
        else:
            found["finish_s"] = t
            if found["met"] is None:
                found["met"] = t <= found["deadline_s"]

    def event_at(self, t: float) -> str | None:
        """Return the event of the crossing under way at `t`, or else of the next or the last one."""
        known = [one for one in self.intervals if one["event"] is not None]
        later = (one["event"] for one in known if one["end_s"] is None or one["end_s"] >= t)
        return next(later, known[-1]["event"] if known else None)


class Timeline:
    """All lanes, and what concerns all robots."""

    def __init__(self) -> None:
        self._lanes: dict[int, Lane] = {}
        self._leaders: list[dict[str, Any]] = []
        self._schedules: list[dict[str, Any]] = []
        self._seen: set[tuple[int, int, tuple[int, ...]]] = set()
        self._faults: list[dict[str, Any]] = []

    def take(self, entry: dict[str, Any]) -> None:
        """Take in an entry of the trace."""
        what = entry["what"]
        t = float(entry["t"])
        lane = self._lanes.setdefault(entry["robot"], Lane())
        if what in BEGINS:
            lane.begin(t, BEGINS[what], entry.get("event"))
        elif what == "left":
            lane.end(t)
        elif what in {"job_started", "job_finished", "deadline_missed"}:
            lane.job(t, entry)
        elif what == "leads":
            self._leaders.append({"robot": entry["robot"], "term": entry["term"], "begin_s": t})
            del self._leaders[:-KEPT_MAX]
        elif what == "scheduled":
            self._schedule(t, entry)

    def _schedule(self, t: float, entry: dict[str, Any]) -> None:
        """Keep a schedule where it is heard of first."""
        key = (entry["leader"], entry["term"], tuple(entry["order"]))
        if key in self._seen:
            return
        self._seen.add(key)
        self._schedules.append({"t_s": t, "leader": key[0], "term": key[1], "order": list(key[2])})
        if len(self._schedules) > KEPT_MAX:
            del self._schedules[: KEPT_MAX // 2]

    def add_fault(self, fault: dict[str, Any]) -> None:
        """Take in a fault, in the form of a lab file's entry: `{"at": 5.0, "kill": 3}`."""
        self._faults.append(fault)
        if "kill" in fault:
            self._lanes.setdefault(fault["kill"], Lane()).fall(fault["at"], None, "dead")
        elif "restart" in fault:
            self._lanes.setdefault(fault["restart"], Lane()).rise(fault["at"])
        elif "stall" in fault:
            self._lanes.setdefault(fault["stall"], Lane()).fall(fault["from"], fault.get("to"), "stalled")

    def as_data(self, robots: Sequence[int], now: float) -> dict[str, Any]:
        """Return the answer to `/api/timeline`."""
        empty = Lane()
        lanes = [(robot, self._lanes.get(robot, empty)) for robot in robots]
        return {
            "lanes": [
                {
                    "robot": robot,
                    "intervals": [
                        one if one["end_s"] is not None else {**one, "end_s": max(now, one["begin_s"]), "open": True}
                        for one in (*lane.intervals, *lane.down)
                    ],
                    "deadlines": lane.deadlines,
                }
                for robot, lane in lanes
            ],
            "leaders": self._reigns(now),
            "schedules": [{**one, "event": self._event(one["leader"], one["t_s"])} for one in self._schedules],
            "faults": self._faults,
        }

    def _event(self, robot: int, t: float) -> str | None:
        lane = self._lanes.get(robot)
        return None if lane is None else lane.event_at(t)

    def _reigns(self, now: float) -> list[dict[str, Any]]:
        """Return who led which event from when to when: until the next leader, or the leader's death."""
        reigns: list[dict[str, Any]] = []
        present: dict[str | None, dict[str, Any]] = {}
        for one in self._leaders:
            event = self._event(one["robot"], one["begin_s"])
            if event in present:
                present[event]["end_s"] = min(present[event]["end_s"], one["begin_s"])
            reign = {**one, "event": event, "end_s": self._death(one["robot"], one["begin_s"], now)}
            present[event] = reign
            reigns.append(reign)
        return reigns

    def _death(self, robot: int, since: float, now: float) -> float:
        lane = self._lanes[robot]
        deaths = [one["begin_s"] for one in lane.down if one["kind"] == "dead" and one["begin_s"] >= since]
        return min(deaths, default=max(now, since))

"""Turns of robots as intervals: what each robot did about its turn, and when, from the entries of the trace.

Values in, values out: `TurnIntervals` takes the entries of the trace (docs/trace.md) and of the faults, in order of
time, and returns lanes of intervals, deadlines, terms of leaders and schedules. It can be asked at any instant, so it
serves a run under way, too; whatever is open then ends at the instant asked for.

| kind | from | to |
|---|---|---|
| asking | `asks`, `slot_lost` | `slotted`, `entered` |
| waiting | `slotted` | the claim for this slot begins |
| claiming | `CLAIM_S` before the slot begins, or when the slot is assigned if that is later | `entered`, `slot_lost` |
| inside | `entered` | `left` |
| stalled | a fault `stall`; lies over the other kinds | its end |
| dead | the robot was killed, or has died | it was restarted |
| stopped | the robot was stopped in order | it was restarted |

Each kind also ends with `withdrawn`. A robot may have several turns at a time, of different events: one at a passage,
say, while it has its place in a station. Their intervals overlap.

Actions are intervals of their own, from `action` to `action_ended`: a lane shows those that begin outside of turns.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any, ClassVar

from rmr.base.time import in_seconds
from rmr.bus.keys import WORLD
from rmr.coord.timing import ClaimTiming

CLAIM_S = in_seconds(ClaimTiming().quiet + ClaimTiming().ahead)
"""A robot begins to claim so long before its slot begins, seconds."""

GONE = {"killed": "dead", "kill": "dead", "die": "dead", "stopped": "stopped", "stop": "stopped"}
"""Words for the end of a robot's process, of a fault or the trace -> kind of the time from then on."""


ACTIONS_MAX = 2000
"""Bound of the actions of a lane, the newest: more are closer together than a page has pixels."""

Record = dict[str, Any]
"""An interval, a deadline, a leader's term or a schedule, with the keys of `TurnIntervals.timeline`."""


@dataclass(slots=True)
class _Turn:
    """What a robot does about one event."""

    event: str | None
    """None: of a recording in which requests did not name it yet."""
    kind: str
    """Asking, waiting or inside."""
    since: float
    slot_s: float = 0.0
    """While waiting: when the slot begins."""
    claim_from: float = 0.0
    """While waiting: when the claim for this slot begins."""

    def closed(self, end: float) -> list[Record]:
        """Return the turn as intervals that end at `end`: a wait that became a claim is two."""
        split = self.claim_from if self.kind == "waiting" else end
        parts = [(self.kind, self.since, min(split, end)), ("claiming", max(split, self.since), end)]
        return [_interval(kind, begin, until, self.event) for kind, begin, until in parts if until > begin]


@dataclass(slots=True)
class _Lane:
    """One robot."""

    intervals: list[Record] = field(default_factory=list)
    deadlines: list[Record] = field(default_factory=list)
    actions: deque[Record] = field(default_factory=lambda: deque(maxlen=ACTIONS_MAX))
    """Those that have begun; `end_s` is None while one is under way."""
    turns: dict[str | None, _Turn] = field(default_factory=dict)
    """Its present turns by event."""
    gone: str = ""
    """Dead or stopped, if there is no process."""
    gone_since: float = 0.0

    def kind(self, event: str | None) -> str:
        """Return what the robot does about `event`; empty: nothing."""
        turn = self.turns.get(event)
        return "" if turn is None else turn.kind

    def enter(self, event: str | None, kind: str, now: float) -> None:
        """Close the interval of `event`, and begin one of `kind` if that is not empty."""
        self.live(now)
        turn = self.turns.pop(event, None) or self.turns.pop(None, None)
        if turn is not None:
            turn.event = event
            self.intervals += turn.closed(now)
        if kind:
            self.turns[event] = _Turn(event, kind, now)

    def die(self, kind: str, now: float) -> None:
        """Close all intervals: the process has ended."""
        for turn in self.turns.values():
            self.intervals += turn.closed(now)
        self.turns.clear()
        for begun in self.actions:
            if begun["end_s"] is None:
                begun["end_s"] = now
        self.gone = kind
        self.gone_since = now

    def live(self, now: float) -> None:
        """Note that there is a process."""
        if self.gone:
            self.intervals.append(_interval(self.gone, self.gone_since, now))
            self.gone = ""

    def present(self, end: float) -> list[Record]:
        """Return what is open as intervals that end at `end`."""
        gone = [_interval(self.gone, self.gone_since, end)] if self.gone else []
        return gone + [interval for turn in self.turns.values() for interval in turn.closed(end)]


def _interval(kind: str, begin: float, end: float, event: str | None = None) -> Record:
    return {"kind": kind, "begin_s": begin, "end_s": end, "event": event}


class TurnIntervals:
    """The timeline of a run."""

    def __init__(self, robots: Iterable[int] = (), claim_s: float = CLAIM_S) -> None:
        """`robots` are those that have a lane even if nothing is known of them."""
        self._claim_s = claim_s
        self._lanes = {robot: _Lane() for robot in robots}
        self._leaders: list[Record] = []
        self._schedules: list[Record] = []
        self._faults: list[Record] = []
        self._known: set[tuple[str | None, int, int, tuple[int, ...]]] = set()

    def add(self, entry: Mapping[str, Any]) -> None:
        """Take in an entry of the trace; those of no concern are ignored."""
        take = self._WORDS.get(entry["what"])
        if take is None:
            return
        lane = self._lane(entry["robot"])
        now = float(entry["t"])
        # The end of a process is dated by the lab time that its launcher heard last, 0.1 s old at most where the world
        # is on time: entries of the trace until so long after it are of the process that has ended.
        if entry["what"] == "fault" or not lane.gone or now > lane.gone_since + 0.25:
            take(self, lane, now, entry)

    def add_fault(self, fault: Mapping[str, Any]) -> None:
        """Take in a fault as reports have it: `{"at": 5.0, "kill": 3}`, `{"from": 2.0, "to": 3.0, "stall": 2}`."""
        times = {key: float(fault[key]) for key in ("at", "from", "to") if key in fault}
        self._faults.append({**fault, **times})
        end = next((word for word in GONE if word in fault), None)
        if fault.get(end or "restart") == WORLD:
            return  # it has no lane
        if end is not None:
            self._end(self._lane(fault[end]), times["at"], GONE[end])
        elif "restart" in fault:
            self._lane(fault["restart"]).live(times["at"])
        elif "stall" in fault:
            stalled = _interval("stalled", times["from"], times.get("to", math.inf))
            self._lane(fault["stall"]).intervals.append(stalled)

    def end_faults(self, now: float, keep: int) -> None:
        """End the disturbances of the radio at `now`, but for the first `keep` faults: those of the lab."""
        for fault in self._faults[keep:]:
            if "from" in fault and not fault.keys() & {"stall", "slow", "outage"} and fault.get("to", inf) > now:
                fault["to"] = max(now, fault["from"])

    def timeline(self, end_s: float) -> dict[str, Any]:
        """Return lanes, leaders, schedules and faults as values for JSON; what is open ends at `end_s`."""
        return {
            "lanes": [self._shown(robot, self._lanes[robot], end_s) for robot in sorted(self._lanes)],
            "leaders": [{**each, "end_s": end_s if each["end_s"] is None else each["end_s"]} for each in self._leaders],
            "schedules": [dict(each) for each in self._schedules],
            "faults": [dict(each) for each in self._faults],
        }

    def _shown(self, robot: int, lane: _Lane, end_s: float) -> Record:
        found = (*lane.intervals, *lane.present(end_s))
        intervals = [{**each, "end_s": min(each["end_s"], end_s)} for each in found]
        ordered = sorted(intervals, key=lambda each: (each["begin_s"], each["end_s"], each["kind"]))
        actions = [{**each, "end_s": end_s if each["end_s"] is None else each["end_s"]} for each in lane.actions]
        deadlines = [dict(each) for each in lane.deadlines]
        return {"robot": robot, "intervals": ordered, "actions": actions, "deadlines": deadlines}

    def _lane(self, robot: int) -> _Lane:
        return self._lanes.setdefault(robot, _Lane())

    # -- entries of the trace, by their word -----------------------------------------------------------------------

    def _asks(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        event = entry.get("event")
        if lane.kind(event) != "asking":
            lane.enter(event, "asking", now)

    def _slotted(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        event = entry.get("event")
        slot_s = float(entry["start_s"])
        turn = lane.turns.get(event)
        waits = turn is not None and turn.kind == "waiting"
        if turn is not None and waits and slot_s == turn.slot_s:
            return  # only its rank has changed: a claim goes on
        if turn is None or not waits or turn.claim_from < now:
            lane.enter(event, "waiting", now)
            turn = lane.turns[event]
        turn.slot_s = slot_s
        turn.claim_from = max(now, round(slot_s - self._claim_s, 6))

    def _slot_lost(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        lane.enter(entry["event"], "asking", now)

    def _entered(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        lane.enter(entry["event"], "inside", now)

    def _over(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        lane.enter(entry["event"], "", now)

    def _job_started(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        before = _newest(lane, entry["job"])
        if before is not None and before["finish_s"] is None and before["met"] is None:
            lane.deadlines.remove(before)  # started anew, with a new deadline
        job = {"job": entry["job"], "begin_s": now, "deadline_s": entry["deadline_s"], "finish_s": None, "met": None}
        lane.deadlines.append(job)

    def _job_finished(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        job = _newest(lane, entry["job"])
        if job is not None and job["finish_s"] is None:
            job["finish_s"] = now
            job["met"] = job["met"] is None

    def _deadline_missed(self, lane: _Lane, _now: float, entry: Mapping[str, Any]) -> None:
        job = _newest(lane, entry["job"])
        if job is not None and job["finish_s"] is None:
            job["met"] = False

    def _leads(self, _lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        event = entry.get("event")
        self._follow(entry["robot"], now, event)
        self._leaders.append(
            {"event": event, "robot": entry["robot"], "term": entry["term"], "begin_s": now, "end_s": None}
        )

    def _scheduled(self, _lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        event = entry.get("event")
        leader = entry["leader"]
        if entry["robot"] != leader:
            self._follow(entry["robot"], now, event)
        known = (event, leader, entry["term"], tuple(entry["order"]))
        if entry["robot"] != leader and known in self._known:
            return  # an order that the leader itself has told; what followers hear later may be older than its newest
        self._known.add(known)
        words = {"leader": leader, "term": entry["term"], "order": list(entry["order"])}
        self._schedules.append({"t_s": now, "event": event, **words})

    def _action(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        lane.actions.append({"action": entry["action"], "begin_s": now, "end_s": None, "failure": None})

    def _action_ended(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        for begun in lane.actions:
            if begun["action"] == entry["action"] and begun["end_s"] is None:
                begun |= {"end_s": now, "failure": entry["failure"]}
                return

    def _fault(self, lane: _Lane, now: float, entry: Mapping[str, Any]) -> None:
        if entry["fault"] in GONE:
            self._end(lane, now, GONE[entry["fault"]])
        elif entry["fault"] == "restarted":
            lane.live(now)

    _WORDS: ClassVar[dict[str, Callable[["TurnIntervals", _Lane, float, Mapping[str, Any]], None]]] = {
        "asks": _asks,
        "slotted": _slotted,
        "slot_lost": _slot_lost,
        "entered": _entered,
        "left": _over,
        "withdrawn": _over,
        "job_started": _job_started,
        "job_finished": _job_finished,
        "deadline_missed": _deadline_missed,
        "leads": _leads,
        "scheduled": _scheduled,
        "action": _action,
        "action_ended": _action_ended,
        "fault": _fault,
    }
    """Words of the trace that concern the timeline."""

    # -- shared -----------------------------------------------------------------------------------------------------

    def _follow(self, robot: int, now: float, event: str | None) -> None:
        """End what `robot` leads of `event`: it has heard of another leader, or leads another term."""
        for term in self._leaders:
            if term["robot"] == robot and term["end_s"] is None and term["event"] == event:
                term["end_s"] = now

    def _end(self, lane: _Lane, now: float, kind: str) -> None:
        if lane.gone:
            return
        lane.die(kind, now)
        robot = next(robot for robot, each in self._lanes.items() if each is lane)
        for term in self._leaders:
            if term["robot"] == robot and term["end_s"] is None:
                term["end_s"] = now


def _newest(lane: _Lane, job: str) -> Record | None:
    return next((each for each in reversed(lane.deadlines) if each["job"] == job), None)

"""A simulated run as the page's server would answer for it: poses, trace, frames, facts at any instant."""

from bisect import bisect_right
from pathlib import Path
from typing import Any

from rmr.base.arena import to_data
from rmr.base.time import NEVER, Instant, in_seconds
from rmr.node.trace import TraceLevel
from rmr.radio.air import ACK_ATTEMPT, Announcement
from rmr.radio.frame import BROADCAST, DataFrame, FrameError, decode
from rmr_sim.fault_record import FaultRecord
from rmr_sim.run_setup import Options, load, report_of

POSE_EVERY_S = 0.1


class CapturedRun:
    """All that the page asks for, of one simulated run."""

    def __init__(self, path: Path, seed: int | None = None, **options: Any) -> None:
        loaded = load(path, Options(**options))
        self.simulation = simulation = loaded.simulation(seed, TraceLevel.FACTS)
        self.robots = list(simulation.lab.roster)
        self.program = loaded.program
        self.t: list[float] = []
        self.poses: dict[int, dict[str, list[float]]] = {r: {"x": [], "y": [], "heading": []} for r in self.robots}
        self.estimates: dict[int, dict[str, list[float]]] = {
            r: {"t": [], "x": [], "y": [], "heading": []} for r in self.robots
        }
        self.routes: list[dict[str, Any]] = []
        self.frames: list[dict[str, Any]] = []
        self._routes_now: dict[int, Any] = {}
        self._open: dict[int, dict[str, Any]] = {}
        simulation.observers.append(self._observe)
        simulation.ether.on_air = self._on_air
        self.finished = simulation.run()
        self.report = report_of(simulation, self.finished)
        self.trace = simulation.trace()
        self.end_s = in_seconds(simulation.now)

    def _observe(self, now: Instant) -> None:
        t = round(in_seconds(now), 6)
        if self.t and t - self.t[-1] < POSE_EVERY_S - 0.001:
            return
        self.t.append(t)
        for robot in self.simulation.robots:
            pose = self.simulation.world.pose(robot.robot)
            _add(self.poses[robot.robot], pose)
            estimate = robot.node.services.pose
            if estimate is not None:
                self.estimates[robot.robot]["t"].append(t)
                _add(self.estimates[robot.robot], estimate)
            route = robot.node.services.motion.route
            if route is not self._routes_now.get(robot.robot):
                self._routes_now[robot.robot] = route
                points = [] if route is None else [[round(x, 3), round(y, 3)] for x, y in route.points]
                self.routes.append({"t": t, "robot": robot.robot, "points": points})

    def _on_air(self, said: Announcement) -> None:
        if said.attempt & ACK_ATTEMPT:
            for frame in self._open.values():
                if frame["sequence"] == said.sequence and frame["destination"] == said.source:
                    frame["outcome"] = "ok"
            return
        try:
            frame = decode(said.psdu)
        except FrameError:
            return
        if not isinstance(frame, DataFrame):
            return
        everybody = frame.destination == BROADCAST
        entry = {
            "source": said.source,
            "destination": None if everybody else frame.destination,
            "kind": "hello" if everybody else "fact",
            "octets": len(said.psdu),
            "handle": said.sequence,
            "sequence": said.sequence,
            "asked_s": in_seconds(said.start) - 0.003,
            "start_s": in_seconds(said.start),
            "end_s": in_seconds(said.end),
            "attempt": said.attempt,
            "outcome": "broadcast" if everybody else "no_ack",
        }
        self._open[said.source] = entry
        self.frames.append(entry)

    def timeline(self) -> dict[str, Any]:
        """Return the answer of /api/timeline."""
        lanes = {r: {"robot": r, "intervals": [], "deadlines": []} for r in self.robots}
        now: dict[int, tuple[str, float, str | None]] = {}
        leaders: list[dict[str, Any]] = []
        schedules: list[dict[str, Any]] = []

        def switch(robot: int, kind: str | None, t: float, event: str | None = None) -> None:
            if robot in now:
                old, begin, about = now.pop(robot)
                interval = {"kind": old, "begin_s": begin, "end_s": t, "event": about}
                lanes[robot]["intervals"].append(interval)
            if kind is not None:
                now[robot] = (kind, t, event)

        for entry in self.trace:
            robot, what, t = entry["robot"], entry["what"], entry["t"]
            state = now.get(robot, (None,))[0]
            if what == "asks":
                switch(robot, "asking", t)
            elif what == "slotted" and state not in ("waiting", "inside"):
                switch(robot, "waiting", t)
            elif what == "entered":
                switch(robot, "inside", t, entry["event"])
            elif what == "left":
                switch(robot, None, t)
            elif what == "leads":
                if leaders:
                    leaders[-1]["end_s"] = t
                leaders.append({"event": "", "robot": robot, "term": entry["term"], "begin_s": t, "end_s": self.end_s})
            elif what == "scheduled":
                schedules.append({"t_s": t, "event": "", **{k: entry[k] for k in ("leader", "term", "order")}})
        for robot in self.robots:
            switch(robot, None, self.end_s)
            lanes[robot]["deadlines"] = [
                {"job": one["job"], "begin_s": one["start_s"], "deadline_s": one["deadline_s"],
                 "finish_s": one["finish_s"], "met": one["met"]}
                for one in self.report["robots"][str(robot)]["assertions"]
            ]  # fmt: skip
        faults = [
            {"from": in_seconds(f.at), **({"to": in_seconds(f.until)} if f.until < NEVER else {}), f.fault: f.robot}
            for f in self.simulation.fault_records
            if isinstance(f, FaultRecord)
        ]
        return {"lanes": list(lanes.values()), "leaders": leaders, "schedules": schedules, "faults": faults}

    def robot(self, robot: int, t: float) -> dict[str, Any]:
        """Return the answer of /api/robot/ROBOT."""
        facts: dict[str, int] = {}
        fired, actions, achieved = [], [], []
        for entry in self.trace:
            if entry["t"] > t or entry["robot"] != robot:
                continue
            what = entry["what"]
            if what == "inserted":
                facts[entry["fact"]] = facts.get(entry["fact"], 0) + 1
            elif what == "removed":
                facts[entry["fact"]] -= 1
            elif what == "fired":
                fired.append({"t": entry["t"], "rule": entry["rule"]})
            elif what == "action":
                actions.append({"t": entry["t"], "action": entry["action"]})
            elif what == "achieved":
                achieved.append([entry["goal"], entry["t"]])
        route = next((e["points"] for e in reversed(self.routes) if e["robot"] == robot and e["t"] <= t), [])
        at = max(0, bisect_right(self.t, t) - 1)
        pose = {k: v[at] for k, v in self.poses[robot].items()}
        return {
            "robot": robot, "t": t, "facts": sorted(f for f, n in facts.items() if n > 0),
            "goals": {"achieved": achieved, "open": []}, "fired": fired[-50:], "actions": actions, "route": route,
            "pose": pose, "estimate": pose, "outgoing": [],
        }  # fmt: skip

    def run(self, **changes: Any) -> dict[str, Any]:
        """Return the answer of /api/run."""
        lab = self.simulation.lab
        source = Path(lab.program).read_text() if str(lab.program).endswith(".rmr") else None
        return {
            "lab": lab.name, "mode": "simulated", "live": False, "control": False, "seed": self.simulation.seed,
            "begin_s": 0.0, "end_s": self.end_s, "robots": self.robots, "floor": to_data(lab.arena),
            "program": source and {"name": Path(lab.program).name, "source": source}, "problems": [], "versions": {},
        } | changes  # fmt: skip


def _add(columns: dict[str, list[float]], pose: Any) -> None:
    x, y, heading = pose.x, pose.y, pose.theta
    columns["x"].append(round(x, 4))
    columns["y"].append(round(y, 4))
    columns["heading"].append(round(heading, 4))

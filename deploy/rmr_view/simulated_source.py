"""The source of a simulated run in this process: its time can be steered, and the slider goes back over what has been.

The run's own thread calls `_after_tick`; the server's thread reads the history, and asks the run by `RunPacer.call`.
Facts at an earlier instant are folded from the trace, which is kept at the level FACTS.
"""

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from math import inf
from typing import Any

from rmr.base.arena import to_data
from rmr.base.geometry import Pose
from rmr.base.time import NEVER, NS_PER_S, Instant, in_seconds, seconds
from rmr.bytecode.hidden_words import HEARD_ENDS
from rmr.bytecode.program import Kind
from rmr.radio.links import Disturbance
from rmr.record.record_writer import RecordWriter
from rmr_sim.event import FaultRecord
from rmr_sim.simulation import Simulation
from rmr_view.followed_minds import sensed_facts
from rmr_view.mind_worker import MindWorker
from rmr_view.recorded_messages import FAULT_KEYS, take
from rmr_view.run_history import RunHistory, Triple
from rmr_view.run_pacer import RunPacer
from rmr_view.run_source import ENTRIES_MAX, RequestRefusedError, RunClock, WhyOptions
from rmr_world.faults import fault_entry

POSE_PERIOD = NS_PER_S // 10
"""Period of the samples of a track, in lab time."""
FIRED_MAX = 50
"""Firings, actions and achieved goals that are listed at most, the newest."""


class SimulatedSource:
    """One simulated run."""

    def __init__(
        self,
        simulation: Simulation,
        pacer: RunPacer,
        program: Mapping[str, str | None],
        control: bool,
        writer: RecordWriter | None,
    ) -> None:
        """`program` is its name and source; `control` says whether faults may be added; `writer` is its recording."""
        self._simulation = simulation
        self._pacer = pacer
        self._program = program
        self._control = control
        predicates = simulation.robots[0].node.machine.program.predicates
        self._sensed = {each.name for each in predicates if each.provided or each.kind is Kind.SENSED}
        self._writer = writer
        self._minds = None if writer is None else MindWorker(writer.path)
        if writer is not None:
            writer.tap(frozenset({"/frames", "/log", "/routes", "/status"}), self._recorded)
        self._report: Mapping[str, Any] | None = None
        self._over = False
        self._entries = 0
        self._faults = 0
        self._sampled: Instant = -POSE_PERIOD
        self._shown = 0.0
        self.history = RunHistory(simulation.lab.roster)
        simulation.checkers.append(self._after_tick)

    # --- in the run's thread ---

    def _after_tick(self, now: Instant) -> None:
        self._note(now)
        self._pacer.tick()

    def _note(self, now: Instant) -> None:
        simulation = self._simulation
        t = in_seconds(now)
        if now >= self._sampled + POSE_PERIOD:
            self._sampled = now
            self.history.add_poses(t, self._poses())
            for robot, pose in self._estimates().items():
                self.history.add_estimate(t, robot, pose)
        elif time.monotonic() >= self._shown + 0.04 or not self._pacer.running:
            self._shown = time.monotonic()
            self.history.set_newest(t, self._poses())
        if news := simulation.new_entries(self._entries):
            self._entries += len(news)
            self.history.add_entries("trace", news)
        for record in simulation.fault_records[self._faults :]:
            self._faults += 1
            self.history.add_fault(_entry(record), given=record in simulation.lab.disturbances)

    def _show_present(self) -> None:
        """Show the tick at which lab time stands: not every tick is shown while it goes on."""
        self.history.set_newest(in_seconds(self._simulation.now), self._poses())

    def _recorded(self, topic: str, at: Instant, message: Mapping[str, Any]) -> None:
        """Take a message of the recording, for what only that knows: frames, logs, routes, states."""
        take(self.history, topic, at, message)

    def _poses(self) -> dict[int, Triple]:
        pose = self._simulation.world.pose
        return {robot: _triple(pose(robot)) for robot in self.history.robots}

    def _estimates(self) -> dict[int, Triple]:
        known = {robot.robot: robot.node.driver for robot in self._simulation.robots if robot.alive}
        poses = {robot: driver.localiser.pose for robot, driver in known.items() if driver is not None}
        return {robot: _triple(pose) for robot, pose in poses.items() if pose is not None}

    def over(self, report: Mapping[str, Any]) -> None:
        """Take note that the run has ended."""
        self._note(self._simulation.now)
        self._over = True
        self._report = report
        self._pacer.stop()

    # --- in the server's thread ---

    @property
    def clock(self) -> RunClock:
        """Where lab time stands."""
        t = max(0.0, self.history.newest[0])
        return RunClock(t, t, self._pacer.running and not self._over, self._pacer.speed)

    @property
    def live(self) -> bool:
        """Whether the run goes on."""
        return not self._over

    @property
    def report(self) -> Mapping[str, Any] | None:
        """The report, once the run is over."""
        return self._report

    def about(self) -> dict[str, Any]:
        """Return the answer to `/api/run`."""
        lab = self._simulation.lab
        return {
            "lab": lab.name,
            "mode": "simulated",
            "live": not self._over,
            "control": self._control and not self._over,
            "steer": not self._over,
            "seed": self._simulation.seed,
            "begin_s": 0.0,
            "end_s": self.clock.end_s,
            "duration_s": in_seconds(lab.duration),
            "finish": lab.finish,
            "robots": list(lab.roster),
            "floor": to_data(lab.arena),
            "program": dict(self._program),
            "problems": [],
        }

    async def start(self) -> None:
        """Do nothing: the run's thread adds what is new."""

    async def refresh(self) -> None:
        """Do nothing, as above."""

    async def entries(self, kind: str, begin: float, end: float) -> list[dict[str, Any]]:
        """Return entries of the history."""
        return await asyncio.to_thread(self.history.between, kind, begin, end, ENTRIES_MAX + 1)

    async def robot(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what a robot knew and did at `t`; route, open goals and queue are known of the present alone."""
        now = self.clock.t
        if t is not None and t < now - 0.1:  # what is younger than this is asked of the robot itself
            return await self._past(robot, t)
        found = await self._folded(robot, now)
        present: dict[str, Any] = await self._ask(lambda: self._present(robot))
        return found | present

    async def _past(self, robot: int, t: float) -> dict[str, Any]:
        truth, estimate = self.history.pose(robot, t)
        route = self.history.route(robot, t)
        known = {"robot": robot, "t": t, "route": route, "pose": truth, "estimate": estimate}
        if self._minds is None or not self.history.dropped("trace"):
            return await self._folded(robot, t) | known
        await self._flush()  # the trace is not whole any more: replay the recording
        return await self._minds.state(robot, t) | known

    async def _folded(self, robot: int, t: float) -> dict[str, Any]:
        trace = await asyncio.to_thread(self.history.between, "trace", 0.0, t, 1 << 60)
        return await asyncio.to_thread(robot_at, trace, robot, t, self._sensed)

    async def _flush(self) -> None:
        """Put what is recorded so far into the file."""
        if self._writer is not None and not self._over:
            await self._ask(self._writer.flush)

    async def _ask(self, question: Callable[[], Any]) -> Any:
        """Return the answer of the run, between two ticks; of a run that is over nothing changes any more."""
        if self._over:
            return question()
        try:
            return await asyncio.wait_for(asyncio.wrap_future(self._pacer.call(question)), 10.0)
        except TimeoutError:
            raise RequestRefusedError("the run takes more than 10 s for one tick: ask again", 503) from None
        except LookupError as error:
            if self._over:
                return question()
            raise RequestRefusedError(str(error), 409) from None
        except ValueError as error:
            raise RequestRefusedError(str(error), 409) from None

    def _present(self, robot: int) -> dict[str, Any]:
        simulated = next(one for one in self._simulation.robots if one.robot == robot)
        node = simulated.node
        driver = node.driver
        route = None if driver is None else driver.navigator.route
        pose = None if driver is None else driver.localiser.pose
        return {
            "robot": robot,
            "t": in_seconds(self._simulation.now),
            "alive": simulated.alive,
            "facts": node.machine.facts(),
            "sensed": sensed_facts(node.machine),
            "goals": node.machine.goals(),
            "route": None if route is None else [list(point) for point in route.points[:200]],
            "pose": tuple(self._simulation.world.pose(robot)),
            "estimate": None if pose is None else tuple(pose),
        }

    async def why(self, robot: int, fact: str, t: float | None, options: WhyOptions) -> dict[str, Any]:
        """Return the explanation of a fact, from the recording so far: up to about a second ago."""
        if self._minds is None:
            raise RequestRefusedError("an explanation needs the recording: start the run without --no-record", 501)
        await self._flush()
        return await self._minds.why(robot, fact, t, options)

    async def missed(self, robot: int) -> dict[str, Any]:
        """Return what the time of missed deadlines went into, from the recording so far."""
        if self._minds is None:
            raise RequestRefusedError("an explanation needs the recording: start the run without --no-record", 501)
        await self._flush()
        return await self._minds.missed(robot)

    async def step(self, robot: int, at: int, commands: str) -> dict[str, Any]:
        """Return where commands lead among the stops of a robot."""
        if self._minds is None:
            raise RequestRefusedError("stepping needs the recording: start the run without --no-record", 501)
        await self._flush()
        return await self._minds.step(robot, at, commands)

    async def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Steer time at once; add a fault between two ticks."""
        pacer = self._pacer
        match order["do"]:
            case "pause":
                pacer.pause()
                await self._ask(self._show_present)
            case "resume":
                pacer.resume()
            case "step":
                pacer.step()
            case "speed":
                pacer.set_speed(order["speed"])
            case _:
                await self._ask(lambda: self._fault(order))
        return {"done": order["do"], "clock": self.clock.message()}

    def _fault(self, order: Mapping[str, Any]) -> None:
        simulation = self._simulation
        now = simulation.now
        until = now + seconds(order["for_s"]) if "for_s" in order else NEVER
        match order["do"]:
            case "kill":
                if simulation.is_dead(order["robot"]):
                    raise ValueError(f"robot {order['robot']} is dead already")
                simulation.kill(order["robot"])
            case "restart":
                simulation.restart(order["robot"])
            case "stall":
                simulation.stall(order["robot"], until)
            case "partition":
                groups = tuple(map(tuple, order["groups"]))
                simulation.disturb(Disturbance(now, until, groups, attenuation_db=inf))
            case "loss":
                simulation.disturb(Disturbance(now, until, loss=order["loss"]))
            case "clear":
                simulation.end_disturbances()
                if self._writer is not None:
                    self._writer.write("/faults", now, {"fault": {"clear": "all"}})
                self.history.end_faults(in_seconds(now))
            case unknown:
                raise ValueError(f"no run has an order {unknown}")

    async def close(self) -> None:
        """Let the run go on without waiting."""
        self._pacer.stop()
        if self._minds is not None:
            self._minds.close()


def _triple(pose: Pose) -> Triple:
    return pose.x, pose.y, pose.theta


def _entry(record: FaultRecord | Disturbance) -> dict[str, Any]:
    """Return a fault in the form of a lab file's entry."""
    if isinstance(record, Disturbance):
        return fault_entry(record)
    key = FAULT_KEYS[record.fault]
    if record.until >= NEVER:
        return {"at": in_seconds(record.at), key: record.robot}
    return {"from": in_seconds(record.at), "to": in_seconds(record.until), key: record.robot}


# --- facts at an earlier instant


def robot_at(entries: Iterable[dict[str, Any]], robot: int, t: float, sensed: Collection[str] = ()) -> dict[str, Any]:
    """Return facts, achieved goals, firings and actions of `robot` at `t`, from the entries of a trace.

    `sensed` are the names of the predicates that robots state by themselves.
    """
    facts: Counter[str] = Counter()
    fired: list[dict[str, Any]] = []
    achieved: list[list[Any]] = []
    actions: list[dict[str, Any]] = []
    for entry in entries:
        if entry["robot"] != robot or entry["t"] > t:
            continue
        what = entry["what"]
        if what == "inserted":
            facts[entry["fact"]] += 1
        elif what == "removed":
            facts[entry["fact"]] -= 1
        elif what == "fired":
            fired.append({"t": entry["t"], "rule": entry["rule"]})
        elif what == "achieved":
            achieved.append([entry["goal"], entry["t"]])
        elif what == "action":
            actions.append({"begin_s": entry["t"], "action": entry["action"], "end_s": None, "failure": None})
        elif what == "action_ended":
            _end_action(actions, entry)
        elif what == "fault" and entry["fault"] == "restarted":
            facts.clear()
    held = sorted(fact for fact, count in facts.items() for _ in range(count))
    return {
        "facts": [fact for fact in held if not _is_sensed(fact, sensed)],
        "sensed": [fact for fact in held if _is_sensed(fact, sensed)],
        "goals": {"achieved": achieved[-FIRED_MAX:], "open": None},
        "fired": fired[-FIRED_MAX:],
        "actions": actions[-FIRED_MAX:],
    }


def _is_sensed(fact: str, sensed: Collection[str]) -> bool:
    """Return whether a text is of a fact that the robot states by itself, or of what it has heard of a neighbour's."""
    return fact.partition("(")[0] in sensed if fact.endswith(")") else fact.endswith(HEARD_ENDS)


def _end_action(actions: list[dict[str, Any]], entry: dict[str, Any]) -> None:
    for action in reversed(actions):
        if action["action"] == entry["action"] and action["end_s"] is None:
            action["end_s"] = entry["t"]
            action["failure"] = entry["failure"]
            return

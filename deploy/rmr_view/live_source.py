"""The source of a lab that runs as processes: the bus for what is happening now, the run's files for what has been.

The bus tells poses, ten times a second. The recording that the processes write, and which they flush once a second,
tells the rest: estimates, trace, frames, logs, faults. After the end of the run the page goes on with what it has.
"""

import asyncio
import json
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

from rmr.base.arena import to_data
from rmr.base.time import NEVER, in_seconds, seconds
from rmr.bus import wire
from rmr.bus.certificates import read_credentials
from rmr.bus.endpoint import BusError
from rmr.bus.keys import ROBOT_ROLE, Keys, last_id
from rmr.bus.session import Bus, open_when_there
from rmr.radio.links import Disturbance
from rmr.record.mcap_scan import RecordingError
from rmr.record.recording import GrowingRecording, part_files
from rmr_deploy.active_runs import endpoint_of, lab_of_run, secret_of, under_way
from rmr_deploy.disturb import ask_world
from rmr_deploy.run_choice import FleetError
from rmr_deploy.run_requests import RequestError, put_request
from rmr_view.control_order import AT_ROBOTS
from rmr_view.mind_worker import MindWorker
from rmr_view.recorded_messages import take
from rmr_view.run_history import RunHistory
from rmr_view.run_source import ENTRIES_MAX, RequestRefusedError, RunClock, WhyOptions, program_of
from rmr_world.lab import Lab
from rmr_world.lab_file import load_lab
from rmr_world.run_report import REPORT_FILE

ABSENT_S = 2.5
"""A robot that has been absent for so long has not left in order at the end of the run."""
NOT_RECORDED = (
    "this run is not recorded (--no-record): only poses are shown; "
    "trace, radio, logs, facts and explanations are missing"
)


def lab_in(folder: Path) -> Lab | None:
    """Return the lab of the run in `folder`, with its seed and robots; None if no processes ran there.

    Raises LabError, OSError.
    """
    told = lab_of_run(folder)
    if not isinstance(told.get("file"), str):
        return None
    lab = load_lab(Path(told["file"]))
    return replace(lab.with_robots(int(told["robots"])), seed=int(told["seed"]))


class LiveSource:
    """One run of processes."""

    def __init__(self, folder: Path, lab: Lab, control: bool) -> None:
        self._folder = folder
        self._lab = lab
        self._control = control
        self._keys = Keys(lab.name)
        self._program = program_of(lab.program)
        self._bus: Bus | None = None
        self._opening: asyncio.Task[None] | None = None
        self._problems: list[str] = []
        self._live = True
        self._report: Mapping[str, Any] | None = None
        self._looked = 0.0
        self._clock = "waiting"
        self._dead: set[int] = set()
        self._vanished: dict[int, tuple[float, float]] = {}
        """Robots whose liveliness token has gone: lab time, and the monotonic clock, at which it went."""
        self._leaving: set[int] = set()
        """Robots that have said that they end in order."""
        self._growing: GrowingRecording | None = None
        self._unread: str | None = None
        """Why the recording cannot be read, yet."""
        self._unrecorded = False
        """Whether lab time goes on and no process has begun a recording."""
        self._minds = MindWorker(folder)
        self.history = RunHistory(lab.roster)

    # --- the bus ---

    async def start(self) -> None:
        """Begin to follow the run."""
        self._opening = asyncio.create_task(self._open())

    async def _open(self) -> None:
        endpoint = endpoint_of(self._folder)
        secret = secret_of(self._folder)
        if endpoint is None:
            return
        try:
            known = read_credentials(secret)
            self._bus = await open_when_there(wire.OPERATOR_ID, endpoint, lambda: None, known)
        except BusError as error:
            self._problems.append(f"no live data: {error}")
            return
        self._bus.subscribe(self._keys.truth, self._truth)
        self._bus.subscribe(self._keys.statuses, self._status, whole=True)
        self._bus.watch_alive(self._keys.alive(ROBOT_ROLE, "*"), self._alive)

    def _truth(self, _key: str, message: wire.Envelope) -> None:
        body = message.body
        if isinstance(body, wire.Truth):
            self._clock = "running" if body.stamp > 0 else "waiting"
            poses = {robot: (x, y, heading) for robot, x, y, heading, _driven in body.robots}
            self.history.add_poses(max(0.0, in_seconds(body.stamp)), poses)

    def _status(self, _key: str, message: wire.Envelope) -> None:
        body = message.body
        if isinstance(body, wire.Status) and body.final and body.state == "stopped":
            self._leaving.add(message.sender)

    def _alive(self, key: str, alive: bool) -> None:
        """Note that the process of a robot has ended, or that another one has taken its place."""
        robot = last_id(key)
        if robot is None or self._bus is None or not (self._bus.connected and self._clock == "running"):
            return
        if not alive:
            self._vanished[robot] = (self.clock.t, time.monotonic())
            return
        if robot in self._vanished:
            self._show_death(robot)
        if robot in self._dead:
            self._dead.discard(robot)
            self._mark(self.clock.t, robot, "restarted")

    def _show_deaths(self) -> None:
        """Show as dead the robots that have been absent for a while in which lab time went on.

        At the end of a run they leave in order; lab time stands then.
        """
        late = time.monotonic() - ABSENT_S
        now = self.clock.t
        for robot in [robot for robot, (t, since) in self._vanished.items() if since < late and now > t + ABSENT_S]:
            self._show_death(robot)

    def _show_death(self, robot: int) -> None:
        t, _ = self._vanished.pop(robot)
        self._dead.add(robot)
        self._mark(t, robot, "stopped" if robot in self._leaving else "killed")
        self._leaving.discard(robot)

    def _mark(self, t: float, robot: int, fault: str) -> None:
        self.history.add_trace([{"t": t, "robot": robot, "what": "fault", "fault": fault}])

    # --- the files ---

    async def refresh(self) -> None:
        """Read what the run's files have got; take note of its end."""
        now = time.monotonic()
        if not self._live or now < self._looked + 0.5:  # period with which the run's files are looked at
            return
        self._looked = now
        ended = not await asyncio.to_thread(under_way, self._folder)
        await asyncio.to_thread(self._read)
        if ended:
            await self._end()
        else:
            self._show_deaths()

    def _read(self) -> None:
        try:
            if self._growing is None:
                running = self._clock == "running"  # a process begins its recording before lab time runs
                self._unrecorded = not part_files(self._folder) and (running or not self._live)
                if not part_files(self._folder):
                    return
                self._growing = GrowingRecording(self._folder)
            for message in self._growing.news():
                take(self.history, message.topic, message.at, message.data)
        except (RecordingError, OSError) as error:
            self._unread = str(error)
        else:
            self._unread = None

    async def _end(self) -> None:
        self._live = False
        with suppress(OSError, ValueError):
            self._report = json.loads(await asyncio.to_thread((self._folder / REPORT_FILE).read_text))
        self._leave()

    def _leave(self) -> None:
        if self._opening is not None:
            self._opening.cancel()
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    async def close(self) -> None:
        """Leave the bus, and close the files."""
        self._leave()
        self._minds.close()
        if self._growing is not None:
            self._growing.close()

    # --- what there is to see ---

    @property
    def live(self) -> bool:
        """Whether the run goes on."""
        return self._live

    @property
    def clock(self) -> RunClock:
        """Where lab time stands."""
        t = max(0.0, self.history.newest[0])
        return RunClock(t, t, self._live and self._clock == "running", None)

    @property
    def report(self) -> Mapping[str, Any] | None:
        """The report, once the run is over and has one."""
        return self._report

    def about(self) -> dict[str, Any]:
        """Return the answer to `/api/run`."""
        lab = self._lab
        return {
            "lab": lab.name,
            "mode": "processes",
            "live": self._live,
            "control": self._control and self._live,
            "steer": False,
            "seed": lab.seed,
            "begin_s": 0.0,
            "end_s": self.clock.end_s,
            "duration_s": in_seconds(lab.duration),
            "finish": lab.finish,
            "robots": list(lab.roster),
            "floor": to_data(lab.arena),
            "program": self._program,
            "problems": self._all_problems(),
        }

    def _all_problems(self) -> list[str]:
        unrecorded = self._growing is None and (self._unrecorded or not self._live)
        unread = [self._unread] if self._unread else []
        return [*self._problems, *unread, *([NOT_RECORDED] if unrecorded else [])]

    async def entries(self, kind: str, begin: float, end: float) -> list[dict[str, Any]]:
        """Return entries of the history."""
        return await asyncio.to_thread(self.history.between, kind, begin, end, ENTRIES_MAX + 1)

    async def robot(self, robot: int, t: float | None) -> dict[str, Any]:
        """Return what a robot knew and did at `t`, from the replay of its mind so far."""
        at = self.clock.t if t is None else t
        found = await self._minds.state(robot, t)
        return found | self.history.robot(robot, at)

    async def why(self, robot: int, fact: str, t: float | None, options: WhyOptions) -> dict[str, Any]:
        """Return the explanation of a fact."""
        return await self._minds.why(robot, fact, t, options)

    async def missed(self, robot: int) -> dict[str, Any]:
        """Return what the time of missed deadlines went into, from the recording so far."""
        return await self._minds.missed(robot)

    async def step(self, robot: int, at: int, commands: str) -> dict[str, Any]:
        """Return where commands lead among the stops of a robot."""
        return await self._minds.step(robot, at, commands)

    # --- orders ---

    async def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Put a fault of the radio to the world, one of a process to the launcher."""
        if order["do"] in AT_ROBOTS:
            try:
                await put_request(self._folder, order)
            except RequestError as error:
                raise RequestRefusedError(str(error), 409) from None
            self.history.add_fault(self._fault_entry(order))
        else:
            await self._disturb(order)
        return {"done": order["do"]}

    def _fault_entry(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Return an order as the timeline lists it: the launcher records it at the end of the run."""
        now = round(self.clock.t, 3)
        if order["do"] == "stall":
            return {"from": now, "to": round(now + order["for_s"], 3), "stall": order["robot"]}
        return {"at": now, order["do"]: order["robot"]}

    async def _disturb(self, order: Mapping[str, Any]) -> None:
        if self._bus is None:
            raise RequestRefusedError("the world of this run does not answer", 503)
        question = wire.AskDisturbances(*disturbance_of(order))
        try:
            told = await ask_world(self._bus, self._keys, question, endpoint_of(self._folder) or "")
        except FleetError as error:
            raise RequestRefusedError(str(error), 503) from None
        if told.refused:
            raise RequestRefusedError(told.refused, 409)


def disturbance_of(order: Mapping[str, Any]) -> tuple[str, Disturbance | None]:
    """Return a fault of the radio as the world's wish, one of `wire.WISHES`, and what to add."""
    if order["do"] == "clear":
        return "clear", None
    until = seconds(order["for_s"]) if "for_s" in order else NEVER
    if order["do"] == "loss":
        return "add", Disturbance(0, until, loss=order["loss"])
    return "add", Disturbance(0, until, tuple(map(tuple, order["groups"])), attenuation_db=inf)

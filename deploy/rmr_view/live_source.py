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
from rmr.bus.endpoint import BusError
from rmr.bus.keys import Keys
from rmr.bus.secret import read_secret
from rmr.bus.session import Bus, open_when_there
from rmr.radio.links import Disturbance
from rmr_deploy.active_runs import endpoint_of, lab_of_run, secret_of, under_way
from rmr_deploy.disturb import FaultError, ask_world
from rmr_deploy.run_requests import RequestError, put_request
from rmr_view.control_order import AT_ROBOTS
from rmr_view.program_text import program_of
from rmr_view.run_history import RunHistory
from rmr_view.run_source import ENTRIES_MAX, RefusedError, RunClock
from rmr_world.lab import Lab
from rmr_world.lab_file import load_lab
from rmr_world.run_report import REPORT_FILE

LIVES_S = 0.5
"""Period with which the run's files are looked at."""


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
            known = None if secret is None else read_secret(secret)
            self._bus = await open_when_there(wire.OPERATOR_ID, endpoint, lambda: None, known)
        except BusError as error:
            self._problems.append(f"no live data: {error}")
            return
        self._bus.subscribe(self._keys.truth, self._truth)

    def _truth(self, _key: str, message: wire.Envelope) -> None:
        body = message.body
        if isinstance(body, wire.Truth):
            self._clock = "running" if body.stamp > 0 else "waiting"
            poses = {robot: (x, y, heading) for robot, x, y, heading, _driven in body.robots}
            self.history.add_poses(max(0.0, in_seconds(body.stamp)), poses)

    async def refresh(self) -> None:
        """Read what the run's files have got; take note of its end."""
        now = time.monotonic()
        if not self._live or now < self._looked + LIVES_S:
            return
        self._looked = now
        if not await asyncio.to_thread(under_way, self._folder):
            await self._end()

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
        """Leave the bus."""
        self._leave()

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
            "problems": list(self._problems),
        }

    async def entries(self, kind: str, begin: float, end: float) -> list[dict[str, Any]]:
        """Return entries of the history."""
        return await asyncio.to_thread(self.history.between, kind, begin, end, ENTRIES_MAX + 1)

    async def robot(self, robot: int, t: float | None) -> dict[str, Any]:  # noqa: ARG002
        """Return what a robot knew and did at `t`."""
        raise RefusedError("this run is not recorded", 501)

    async def why(self, robot: int, fact: str, t: float | None) -> dict[str, Any]:  # noqa: ARG002
        """Return the explanation of a fact."""
        raise RefusedError("this run is not recorded", 501)

    # --- orders ---

    async def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Put a fault of the radio to the world, one of a process to the launcher."""
        if order["do"] in AT_ROBOTS:
            try:
                await put_request(self._folder, order)
            except RequestError as error:
                raise RefusedError(str(error), 409) from None
        else:
            await self._disturb(order)
        return {"done": order["do"]}

    async def _disturb(self, order: Mapping[str, Any]) -> None:
        if self._bus is None:
            raise RefusedError("the world of this run does not answer", 503)
        question = wire.AskDisturbances(*disturbance_of(order))
        try:
            told = await ask_world(self._bus, self._keys, question, endpoint_of(self._folder) or "")
        except FaultError as error:
            raise RefusedError(str(error), 503) from None
        if told.refused:
            raise RefusedError(told.refused, 409)


def disturbance_of(order: Mapping[str, Any]) -> tuple[str, Disturbance | None]:
    """Return a fault of the radio as the world's wish, one of `wire.WISHES`, and what to add."""
    if order["do"] == "clear":
        return "clear", None
    until = seconds(order["for_s"]) if "for_s" in order else NEVER
    if order["do"] == "loss":
        return "add", Disturbance(0, until, loss=order["loss"])
    return "add", Disturbance(0, until, tuple(map(tuple, order["groups"])), attenuation_db=inf)

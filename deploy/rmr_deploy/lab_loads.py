"""The `loads` of a lab file, as `rmr up` performs them on processes: a robot distributes each over the robots' radio.

`rmr sim` begins a load at its exact instant; here the launcher does so when it hears that lab time has passed it. The
entries are those of the simulator's report.
"""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

from rmr.base.time import in_seconds
from rmr.bus.keys import Keys
from rmr_deploy.disturb import WorldAddress
from rmr_deploy.event_log import EventLog
from rmr_deploy.load_run import Outcome, distribute, lines
from rmr_deploy.preparation import RunPlan
from rmr_deploy.run_choice import FleetError
from rmr_world.lab import ProgramLoad
from rmr_world.lab_program import LoadedProgram

LOOK_S: Final = 0.05
"""Period with which the launcher looks whether a load is due."""
CUT_OFF: Final = "the run was over before it was decided"


class LabLoads:
    """The loads of one run."""

    def __init__(self, plan: RunPlan, endpoint: str, events: EventLog, say: Callable[[str], None]) -> None:
        """`say` tells a person what became of a load."""
        self._plan = plan
        self._place = WorldAddress(endpoint, plan.secret)
        self._events = events
        self._say = say
        self.entries: list[dict[str, Any]] = []
        """Those that have begun, as they stand in the report."""

    async def perform(self) -> None:
        """Perform each load when it is due, until this is cancelled: one that is under way then stays undecided."""
        async with asyncio.TaskGroup() as under_way:
            for load, program in sorted(self._plan.loads, key=lambda each: each[0].at):
                while (now_s := self._events.now_s()) is None or now_s < in_seconds(load.at):
                    await asyncio.sleep(LOOK_S)
                begun: dict[str, Any] = {"begin_s": round(now_s, 3), "file": load.program.name}
                entry = {**begun, "switched": None, "problem": CUT_OFF}
                self.entries.append(entry)
                under_way.create_task(self._perform(entry, load, program))

    async def _perform(self, entry: dict[str, Any], load: ProgramLoad, program: LoadedProgram) -> None:
        lab = self._plan.lab
        try:
            outcome = await distribute(self._place, Keys(lab.name), program, load.robots or None, via="radio")
            told = "\n".join(lines(outcome))
        except FleetError as error:
            outcome = _failed(program, load.robots or lab.roster, str(error))
            told = f"no robot gets it: {error}"
        del entry["problem"]
        entry |= outcome
        self._say(f"the lab file: load {load.program.name}: {told}")
        self._events.note("load", f"load {load.program.name}: {told.splitlines()[0]}", load=entry)


def _failed(program: LoadedProgram, robots: Sequence[int], why: str) -> Outcome:
    """Return the outcome of a load that no robot has begun to distribute."""
    told = {str(robot): {"ready": False, "problem": why} for robot in robots}
    return {"program": f"{program.digest:08x}", "switched": False, "at_s": None, "robots": told}


@contextmanager
def performed_loads(
    plan: RunPlan, endpoint: str, events: EventLog, say: Callable[[str], None]
) -> Iterator[list[dict[str, Any]]]:
    """Perform the loads of a run while the block runs; the value is the list of their entries, which grows."""
    loads = LabLoads(plan, endpoint, events, say)
    task = asyncio.create_task(loads.perform())
    try:
        yield loads.entries
    finally:
        task.cancel()

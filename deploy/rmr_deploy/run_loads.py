"""What `rmr up` loads onto its robots by itself: the `loads` of the lab file, and with `--watch` what is saved.

A robot distributes a load of the lab file over the robots' radio. `rmr sim` begins it at its exact instant; here the
launcher does so when it hears that lab time has passed it. The entries are those of the simulator's report.

With `--watch` the program is compiled when a source in its folder is saved. A program with errors is shown and not
loaded; neither is one that compiles to what runs already. A save during a load is taken up after it.
"""

import asyncio
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from rmr.base.errors import ProgramError
from rmr.base.time import in_seconds
from rmr.bus.keys import Keys
from rmr_deploy.disturb import WorldAddress
from rmr_deploy.event_log import EventLog
from rmr_deploy.load_run import Outcome, distribute, lines
from rmr_deploy.preparation import RunPlan
from rmr_deploy.run_choice import FleetError
from rmr_world.finding import LabError
from rmr_world.lab import ProgramLoad
from rmr_world.lab_program import LoadedProgram, load_program

CUT_OFF: Final = "the run was over before it was decided"


Stamps = dict[Path, tuple[int, int]]

# --- the loads of the lab file


class LabLoads:
    """The loads of one run."""

    def __init__(self, plan: RunPlan, endpoint: str, events: EventLog, say: Callable[[str], None]) -> None:
        """`say` tells a person what became of a load."""
        self._plan = plan
        self._place = WorldAddress(endpoint, plan.credentials)
        self._events = events
        self._say = say
        self.entries: list[dict[str, Any]] = []
        """Those that have begun, as they stand in the report."""

    async def perform(self) -> None:
        """Perform each load when it is due, until this is cancelled: one that is under way then stays undecided."""
        async with asyncio.TaskGroup() as under_way:
            for load, program in sorted(self._plan.loads, key=lambda each: each[0].at):
                while (now_s := self._events.now_s()) is None or now_s < in_seconds(load.at):
                    await asyncio.sleep(0.05)  # period with which the launcher looks whether a load is due
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


# --- rmr up --watch


def stamps_of(program: Path) -> Stamps:
    """Return when each source beside `program`, which may be included by it, was written, and its size."""
    found: Stamps = {}
    for path in sorted(program.parent.glob(f"*{program.suffix}")):
        try:
            stat = path.stat()
        except OSError:  # an editor replaces it at this moment
            continue
        found[path] = (stat.st_mtime_ns, stat.st_size)
    return found


@contextmanager
def watched(plan: RunPlan, endpoint: str, say: Callable[[str], None]) -> Iterator[None]:
    """Watch the program while the block runs, if the options say so."""
    if not plan.options.watch:
        yield
        return
    task = asyncio.create_task(ProgramWatch(plan, endpoint, say).watch())
    try:
        yield
    finally:
        task.cancel()


class ProgramWatch:
    """Looks at the sources of one run."""

    def __init__(self, plan: RunPlan, endpoint: str, say: Callable[[str], None]) -> None:
        self._plan = plan
        self._place = WorldAddress(endpoint, plan.credentials)
        self._say = say
        self._seen = stamps_of(plan.lab.program)
        self._running = plan.program.digest

    async def watch(self) -> None:
        """Load what is saved, until this is cancelled."""
        program = self._plan.lab.program
        self._say(f"watching {program.parent} for changes of the program")
        while True:
            # Period with which the sources are looked at: a person does not notice it, and it costs a call for each
            # file.
            await asyncio.sleep(0.3)
            stamps = stamps_of(program)
            if stamps != self._seen and program in stamps:
                self._seen = stamps
                await self._saved(program)

    async def _saved(self, program: Path) -> None:
        try:
            loaded = await asyncio.to_thread(load_program, program)
            if loaded.digest == self._running:
                self._say(f"{program.name} compiles to the program that runs")
                return
            outcome = await distribute(self._place, Keys(self._plan.lab.name), loaded, None)
        except (ProgramError, LabError, FleetError) as error:
            self._say(f"{program.name} is not loaded: {str(error).rstrip()}")
            return
        if outcome["switched"]:
            self._running = loaded.digest
        self._say("\n".join(lines(outcome)))

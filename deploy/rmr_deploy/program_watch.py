"""`rmr up --watch`: compiles the program when a source in its folder is saved, and loads it onto the running robots.

A program with errors is shown and not loaded; neither is one that compiles to what runs already. A save during a load
is taken up after it.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from rmr.base.errors import ProgramError
from rmr.bus.keys import Keys
from rmr_deploy.disturb import WorldAddress
from rmr_deploy.load_run import distribute, lines
from rmr_deploy.preparation import RunPlan
from rmr_deploy.run_choice import FleetError
from rmr_world.finding import LabError
from rmr_world.lab_program import load_program

LOOK_S: Final = 0.3
"""Period with which the sources are looked at: a person does not notice it, and it costs a call for each file."""

Stamps = dict[Path, tuple[int, int]]


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
        self._place = WorldAddress(endpoint, plan.secret)
        self._say = say
        self._seen = stamps_of(plan.lab.program)
        self._running = plan.program.digest

    async def watch(self) -> None:
        """Load what is saved, until this is cancelled."""
        program = self._plan.lab.program
        self._say(f"watching {program.parent} for changes of the program")
        while True:
            await asyncio.sleep(LOOK_S)
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

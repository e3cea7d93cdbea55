"""The end of a run: whether it is reached, which robots finished and what became of the others, and what is left to do.

When the last process has ended, the run folder is swept.
"""

import asyncio
import time
from collections.abc import Callable, Container, Mapping, Sequence
from contextlib import suppress

from rmr.base.time import in_seconds
from rmr_deploy.event_log import EventLog
from rmr_deploy.preparation import RunPlan
from rmr_deploy.process_group import Child, ProcessGroup, said
from rmr_deploy.run_requests import end_requests
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world.lab import Lab
from rmr_world.quorum import Fate, absence, by_fate, is_met

POLL_S = 0.05
"""Period with which a claim about the end is looked at."""


def judged_end(lab: Lab, monitor: StatusMonitor, absent: Mapping[int, Fate]) -> tuple[bool, str]:
    """Return whether the run has finished, and why it is over; the reason is empty while it goes on.

    `absent` are the robots that hold no finish fact any more: those that neither run nor are about to be started again.
    """
    living = [robot for robot in lab.roster if robot not in absent]
    holding = [robot for robot in living if monitor.finished((robot,))]
    met = is_met(lab.quorum, lab.roster, list(absent), holding)
    if lab.finish and (met or len(holding) == len(living)):
        return met, who_finished(lab, holding, absent, met=met)
    if monitor.now >= lab.duration:
        return not lab.finish and not absent, f"the lab's duration of {in_seconds(lab.duration):g} s has passed"
    return False, ""


async def patiently(claim: Callable[[], bool], limit_s: float) -> None:
    """Wait until `claim` holds, `limit_s` at most."""
    end = time.monotonic() + limit_s
    while not claim() and time.monotonic() < end:
        await asyncio.sleep(POLL_S)


async def end_processes(processes: ProcessGroup, children: Sequence[Child], *, asked: bool) -> list[str]:
    """End those of `children` that have not exited; return who did not although `asked` to, in sentences."""
    late = [child.name for child in children if child.exit_code() is None]
    stubborn = [child.name for child in await processes.stop(children)]
    told = [f"{', '.join(late)} did not leave when asked and got SIGTERM"] if late and asked else []
    return [*told, *([f"{', '.join(stubborn)} did not leave at SIGTERM and got SIGKILL"] if stubborn else [])]


def unready(monitor: StatusMonitor | None, roster: Sequence[int]) -> list[str]:
    """Return who keeps a run from beginning."""
    if monitor is None:
        return ["the world does not answer"]
    return [f"robot {robot}" for robot in roster if not monitor.ready((robot,))]


def who_finished(lab: Lab, holding: Sequence[int], absent: Mapping[int, Fate], *, met: bool) -> str:
    """Return why the run is over: which robots hold the finish fact, and what became of those that are `absent`."""
    if isinstance(lab.quorum, int):
        who = f"{len(holding)} robots hold" if len(holding) != 1 else "1 robot holds"
        short = "" if met else f", {lab.quorum} should"
        return f"{who} the finish fact{short}" + (f"; {absence(absent)}" if absent else "")
    if absent:
        return f"every robot that lives holds the finish fact; {absence(absent)}"
    return "every robot holds the finish fact"


def who_ended(fates: Mapping[str, Fate]) -> str:
    """Return ``robot-1 died, robot-2 was stopped`` for the processes of a run that cannot go on without them."""
    return ", ".join(f"{', '.join(names)} {verb}" for names, verb in by_fate(fates))


def who_came_back(fates: Mapping[str, Fate]) -> str:
    """Return a clause for each fate of processes in whose place another one was started; empty if there are none."""
    clauses = (f"{', '.join(names)} {verb}" for names, verb in by_fate(fates))
    return "".join(f"; {clause} on the way and came back" for clause in clauses)


def sweep(
    plan: RunPlan,
    processes: ProcessGroup,
    died: Container[str],
    monitor: StatusMonitor | None,
    events: EventLog,
    say: Callable[[str], None],
) -> None:
    """Sweep the run folder after the last process has ended, and say what is wrong with it.

    Errors of processes that exited in order are shown; their plain output is removed, for their logs hold it, too.
    """
    for child in processes.children:
        if child.name not in died:
            for line in said(child.output):
                say(f"{child.name}: {line}")
            with suppress(OSError):
                child.output.unlink()
    end_requests(plan.folder)
    if not plan.logs.is_dir():
        say(f"{plan.folder} was removed during the run: its logs and compiled program are lost")
    elif events.failure:
        say(f"the log of events is cut short: {events.failure}")
    for name, why in monitor.cut_logs() if monitor is not None else ():
        say(f"the log of {name} is cut short: {why}")

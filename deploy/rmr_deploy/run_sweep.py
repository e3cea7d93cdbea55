"""What is done in the run folder after the last process has ended."""

from collections.abc import Callable, Container
from contextlib import suppress

from rmr_deploy.event_log import EventLog
from rmr_deploy.preparation import RunPlan
from rmr_deploy.process_group import ProcessGroup, said
from rmr_deploy.run_requests import end_requests
from rmr_deploy.status_monitor import StatusMonitor


def sweep(
    plan: RunPlan,
    processes: ProcessGroup,
    died: Container[str],
    monitor: StatusMonitor | None,
    events: EventLog,
    say: Callable[[str], None],
) -> None:
    """Show the errors of processes that exited in order; remove their plain output, which their logs hold, too."""
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

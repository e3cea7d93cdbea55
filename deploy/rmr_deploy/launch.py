"""One run from its first process to its last: start, wait until all are ready, watch, stop in order.

    starting -> running -> stopping -> over
        any of them ends early when a process dies, time is up, or a person says so

- *Start.* The world is the router and starts first. Robots are started at once and connect when it listens, so that
  the start takes as long as its slowest process. The lab clock begins when every robot is ready
  (``rmr-world --when-ready``).
- *End.* A run is over when every robot holds the finish fact, when the lab's duration has passed, or when a process
  has died. Robots stop before the world, which tells the final state last.
- ``--keep-going``: a run goes on without a robot that died. A person may start that robot again by hand: from its
  liveliness token on it counts like any other, but its process is not a child of the launcher, which cannot end it.

Every wait is bounded by a named constant.
"""

import asyncio
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from rmr.base.ids import spelled
from rmr.bus.endpoint import BusError
from rmr.entry import ExitCode
from rmr_deploy.active_runs import write_processes
from rmr_deploy.page_start import PageStart, open_page
from rmr_deploy.preparation import RunPlan, free_port
from rmr_deploy.process_faults import ProcessFaults
from rmr_deploy.process_group import Child, ProcessGroup, exit_report, how, said
from rmr_deploy.run_requests import end_requests, serve_requests
from rmr_deploy.screen import RobotLine, Screen
from rmr_deploy.status_monitor import StatusMonitor

POLL_S = 0.05
"""Period with which the states of processes are polled: the exit of one is reported within this time."""

READY_S_MAX = 30.0
"""Limit of the start: six robots take five seconds on an idle machine, several times that on a loaded one."""

SILENCE_S_MAX = 10.0
"""Wall time beyond the lab's duration after which a run is aborted whose lab clock does not advance."""

FINAL_S_MAX = 2.0
"""Limit for the last status of a process after it was asked to stop."""

LEAVE_S_MAX = 1.5
"""Limit for a process to exit by itself after its last status; then it gets SIGTERM."""

DRAW_S = 0.2
"""Period with which the robots' lines on the screen are redrawn."""


@dataclass(slots=True)
class RunOutcome:
    """What came of a run."""

    finished: bool = False
    """Every robot of the lab held the finish fact (or the lab asks for none and its duration has passed)."""
    reason: str = ""
    """Why the run ended, for people."""
    interrupted: bool = False
    hurried: bool = False
    """Interrupted twice: everything was killed at once."""
    invalid: bool = False
    """A process refused the program or the lab."""
    died: dict[str, int] = field(default_factory=dict)
    """Exit codes of the processes that ended before their time, by name."""
    ready_s: float | None = None
    """Wall time from the start of the first process until all were ready."""
    wall_s: float = 0.0
    """Wall time of the whole run."""
    faults: list[dict[str, Any]] = field(default_factory=list)
    """Faults of processes on request, in the form of a lab file's entries."""
    report_error: str | None = None
    """Why the report could not be written."""
    recording: list[str] = field(default_factory=list)
    """What is missing in the recording, in sentences."""


class LabRun:
    """A run in progress."""

    def __init__(self, plan: RunPlan, screen: Screen) -> None:
        self.plan = plan
        self.outcome = RunOutcome()
        self.monitor: StatusMonitor | None = None
        self._screen = screen
        self._page: PageStart | None = None
        self._processes = ProcessGroup()
        self._world: Child | None = None
        self._robots: dict[int, Child] = {}
        self.faults = ProcessFaults(
            self._robots, self._start_again, lambda: self.monitor.now_s if self.monitor else 0.0
        )
        self.outcome.faults = self.faults.entries
        self._returned: set[int] = set()
        """Robots whose process died and whose place a process that was started by hand has taken."""
        self._limit_s = plan.options.timeout_s or READY_S_MAX + plan.duration_s + SILENCE_S_MAX
        self._began = time.monotonic()
        self._drawn = 0.0

    async def go(self) -> RunOutcome:
        """Run to the end; whatever happens, no process is left behind. Raises OSError if one cannot be started."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._interrupt, number.name)
        try:
            self._page = open_page(self.plan, self._screen.say)
            self._start()
            await self._attend()
            await self._stop()
        finally:
            self._screen.close()
            if self._page is not None:
                self._page.close()
            self._processes.kill()
            if self.monitor is not None:
                self.monitor.close()
            self.plan.secret.unlink(missing_ok=True)
            self.outcome.wall_s = time.monotonic() - self._began
        self._sweep()
        return self.outcome

    def _interrupt(self, signal_name: str) -> None:
        """Stop in order at the first request, at once at the second."""
        if self.outcome.interrupted:
            self.outcome.hurried = True
            self._processes.kill()
            return
        self.outcome.interrupted = True
        self._screen.say(
            "stopping; once more to stop at once" if signal_name == "SIGINT" else f"stopping: {signal_name}"
        )

    # --- start ---------------------------------------------------------------------------------------------

    def _start(self) -> None:
        plan = self.plan
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._endpoint = endpoint
        self._world = self._child("world", "world", world_command(plan, endpoint))
        for robots in plan.process_robots:
            ids = spelled(robots)
            child = self._child(f"robot-{ids}", f"robots-{ids}", agent_command(plan, robots, endpoint))
            self._robots |= dict.fromkeys(robots, child)
        pids = {child.name: child.pid for child in self._processes.children}
        lab = {"file": str(plan.lab.path.resolve()), "robots": len(plan.lab.robots), "seed": plan.lab.seed}
        write_processes(plan.folder, endpoint, pids, lab)

    def _start_again(self, robot: int, name: str) -> Child:
        part = name.replace("robot-", "robots-", 1)
        child = self._child(name, part, agent_command(self.plan, (robot,), self._endpoint), threaded=True)
        self._screen.say(f"robot {robot} is started again, pid {child.pid}")
        return child

    def _child(self, name: str, part: str, command: Sequence[str], *, threaded: bool = False) -> Child:
        log = self.plan.logs / f"{name}.jsonl"
        recording = self.plan.part(part)
        options = ["--log", str(log), *([] if recording is None else ["--record", str(recording)])]
        return self._processes.start(name, [*command, *options], log.with_suffix(".out"), threaded=threaded)

    # --- watch ---------------------------------------------------------------------------------------------

    async def _attend(self) -> None:
        """Return when the run is over; `outcome` says why."""
        opening = asyncio.create_task(StatusMonitor.of(self.plan.lab.name, self._endpoint, self.plan.secret))
        try:
            await self._until(opening.done)
        finally:
            if opening.done() and not opening.cancelled():
                self._take_monitor(opening)
            opening.cancel()
        if self.outcome.reason or self.monitor is None:
            return
        monitor = self.monitor
        roster = self.plan.lab.roster
        await self._until(lambda: monitor.ready(roster))
        if not self.outcome.reason:
            self.outcome.ready_s = time.monotonic() - self._began
            self._screen.say(f"{len(roster)} robots ready after {self.outcome.ready_s:.1f} s")
            await self._until(self._finished)

    def _take_monitor(self, opened: asyncio.Task[StatusMonitor]) -> None:
        """Take the launcher's session on the bus, or the reason for which the router refused it."""
        try:
            self.monitor = opened.result()
        except BusError as error:
            self.outcome.reason = self.outcome.reason or str(error)

    def _finished(self) -> bool:
        """Whether the run has reached its end in good order."""
        monitor = self.monitor
        lab = self.plan.lab
        outcome = self.outcome
        assert monitor is not None
        living = self._living()
        absent = sorted(set(lab.roster) - set(living))
        if lab.finish and monitor.finished(living):
            outcome.finished = not absent
            outcome.reason = "every robot holds the finish fact"
            if absent:
                outcome.reason = f"every robot that lives holds the finish fact; {_names(absent)} died"
        elif monitor.now >= lab.duration:
            outcome.finished = not lab.finish and not absent
            outcome.reason = f"the lab's duration of {self.plan.duration_s:g} s has passed"
        if outcome.finished and outcome.died:
            outcome.reason += f"; {', '.join(outcome.died)} died on the way and was started again"
        return bool(outcome.reason)

    def _living(self) -> tuple[int, ...]:
        return tuple(robot for robot in self._robots if self._lives(robot))

    def _lives(self, robot: int) -> bool:
        return robot in self._returned or self._robots[robot].name not in self.outcome.died

    async def _until(self, claim: Callable[[], bool]) -> None:
        """Wait until `claim` holds, or the run must end: `outcome.reason` is then set."""
        while not claim():
            self._check_processes()
            if self.outcome.reason:
                break
            self._draw()
            await asyncio.sleep(POLL_S)
        self._draw(now=True)

    def _check_processes(self) -> None:
        """Set the reason to end the run early, if there is one: an exit, an interruption, a limit."""
        elapsed_s = time.monotonic() - self._began
        serve_requests(self.plan.folder, self.faults.perform)
        self.faults.resume()
        self._report_exits()
        self._note_returned()
        if self.outcome.reason:
            return
        if self.outcome.interrupted:
            self.outcome.reason = "interrupted"
        elif self.outcome.ready_s is None and elapsed_s > READY_S_MAX:
            self.outcome.reason = f"not ready within {READY_S_MAX:g} s: {', '.join(self._unready())}"
        elif elapsed_s > self._limit_s:
            self.outcome.reason = f"not finished within {self._limit_s:g} s of wall time"

    def _unready(self) -> list[str]:
        monitor = self.monitor
        if monitor is None:
            return ["the world does not answer"]
        return [f"robot {robot}" for robot in self.plan.lab.roster if not monitor.ready((robot,))]

    def _report_exits(self) -> None:
        """Show an exit report of each process that has ended since the last poll; end the run unless it goes on."""
        news = [child for child in self._processes.dead() if child.name not in self.outcome.died]
        for child in news:
            code = child.exit_code()
            assert code is not None
            self.outcome.died[child.name] = code
            self.outcome.invalid |= code == ExitCode.INVALID
            self._screen.say(exit_report(child))
            if self.monitor is not None:
                for robot in self._robots_of(child):
                    self.monitor.retire(robot)
        on_purpose = self.plan.options.keep_going or all(child.name in self.faults.killed for child in news)
        if news and not (on_purpose and self._can_go_on()):
            self.outcome.reason = f"{', '.join(self.outcome.died)} died"

    def _note_returned(self) -> None:
        """Note the robots that were started again by hand, and those of them that have left."""
        monitor = self.monitor
        if monitor is None:
            return
        for robot, child in self._robots.items():
            here = child.name in self.outcome.died and robot in monitor.present
            if here and robot not in self._returned:
                self._returned.add(robot)
                self._screen.say(f"robot {robot} is back: another process has taken its place")
            elif robot in self._returned and not here:
                self._returned.discard(robot)
                monitor.retire(robot)
                self._screen.say(f"robot {robot} has left again")

    def _robots_of(self, child: Child) -> list[int]:
        return [robot for robot, one in self._robots.items() if one is child]

    def _can_go_on(self) -> bool:
        return self.outcome.ready_s is not None and "world" not in self.outcome.died and bool(self._living())

    def _draw(self, *, now: bool = False) -> None:
        if not now and time.monotonic() < self._drawn + DRAW_S:
            return
        self._drawn = time.monotonic()
        monitor = self.monitor
        roster = self.plan.lab.roster
        lab_s = monitor.now_s if monitor is not None and monitor.running(roster) else None
        self._screen.show(lab_s, [self._line(robot) for robot in roster])

    def _line(self, robot: int) -> RobotLine:
        if not self._lives(robot):
            return RobotLine(robot, "died", how(self._robots[robot].exit_code()))
        return RobotLine(robot, *(("starting", "") if self.monitor is None else self.monitor.line(robot)))

    # --- stop ----------------------------------------------------------------------------------------------

    async def _stop(self) -> None:
        """Stop the robots, then the world: ask each, wait for its last status, then send signals."""
        self.faults.resume(everything=True)
        monitor = self.monitor
        robots = list({child.name: child for child in self._robots.values()}.values())
        if monitor is not None and not self._gone(self._world):  # without the router no message arrives
            for robot in self.plan.lab.roster:
                monitor.ask_to_stop(robot, self.outcome.reason)
            await self._patiently(lambda: all(self._is_final(robot) for robot in self._robots))
            self._report_silent()
            await self._processes.left(robots, LEAVE_S_MAX)
        await self._end(robots, asked=not self._gone(self._world))
        assert self._world is not None
        if monitor is not None:
            monitor.ask_world_to_stop(self.outcome.reason)
            await self._patiently(
                lambda: (monitor.truth is not None and monitor.truth.final) or self._gone(self._world)
            )
            await self._processes.left([self._world], LEAVE_S_MAX)
        await self._end([self._world], asked=monitor is not None)

    async def _end(self, children: Sequence[Child], *, asked: bool) -> None:
        """End the processes that have not exited by themselves; report those that did not although `asked` to."""
        late = [child.name for child in children if child.exit_code() is None]
        stubborn = [child.name for child in await self._processes.stop(children)]
        if late and asked and not self.outcome.hurried:
            self._screen.say(f"{', '.join(late)} did not leave when asked and got SIGTERM")
        if stubborn and not self.outcome.hurried:
            self._screen.say(f"{', '.join(stubborn)} did not leave at SIGTERM and got SIGKILL")

    def _is_final(self, robot: int) -> bool:
        if self.monitor is not None and self.monitor.final(robot):
            return True
        return self._gone(self._robots[robot]) and robot not in self._returned

    def _report_silent(self) -> None:
        """Name the robots whose last status did not come: the report holds their status before it."""
        silent = [robot for robot in self._robots if not self._is_final(robot)]
        if silent and not self.outcome.hurried:
            self._screen.say(
                f"{_names(silent)} did not tell the end within {FINAL_S_MAX:g} s: the report has what was told before"
            )

    @staticmethod
    def _gone(child: Child | None) -> bool:
        return child is None or child.exit_code() is not None

    @staticmethod
    async def _patiently(claim: Callable[[], bool]) -> None:
        end = time.monotonic() + FINAL_S_MAX
        while not claim() and time.monotonic() < end:
            await asyncio.sleep(POLL_S)

    def _sweep(self) -> None:
        """Show the errors of processes that exited in order; remove their plain output, which their logs hold, too."""
        for child in self._processes.children:
            if child.name not in self.outcome.died:
                for line in said(child.output):
                    self._screen.say(f"{child.name}: {line}")
                with suppress(OSError):
                    child.output.unlink()
        end_requests(self.plan.folder)
        if not self.plan.logs.is_dir():
            self._screen.say(f"{self.plan.folder} was removed during the run: its logs and compiled program are lost")
        for name, why in self.monitor.cut_logs() if self.monitor is not None else ():
            self._screen.say(f"the log of {name} is cut short: {why}")


def _names(robots: Sequence[int]) -> str:
    """Return ``robot 1`` or ``robots 1-3`` for use in a sentence."""
    return f"robot{'s' if len(robots) > 1 else ''} {spelled(robots)}"


def world_command(plan: RunPlan, endpoint: str) -> list[str]:
    """Return the command that starts the world."""
    lab = plan.lab
    options = ["--listen", endpoint, "--seed", str(lab.seed), "--robots", str(len(lab.robots)), "--when-ready"]
    return [*python("rmr_world.main"), "--config", str(lab.path), *options, "--secret", str(plan.secret)]


def agent_command(plan: RunPlan, robots: Sequence[int], endpoint: str) -> list[str]:
    """Return the command that starts the process of the robots `robots`."""
    actions = ["--actions", str(plan.options.actions)] if plan.options.actions else []
    key = ["--radio-key", str(plan.lab.key_file)] if plan.lab.key_file else []
    options = ["--id", spelled(robots), "--connect", endpoint, "--lab", plan.lab.name, *actions, *key]
    return [*python("rmr_agent.main"), *options, "--secret", str(plan.secret), str(plan.byte_code)]


def python(module: str) -> list[str]:
    """Return the command that runs `module` with this interpreter; -P: without the current folder in its path."""
    return [sys.executable, "-P", "-m", module]

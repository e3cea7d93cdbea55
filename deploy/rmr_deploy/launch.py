"""One run from its first process to its last: start, wait until all are ready, watch, stop in order.

    starting -> running -> stopping -> over
        any of them ends early when a process dies, time is up, or a person says so

- *Start.* The world starts first, which on one machine is the router. Robots are started at once and connect when it
  listens, so that the start takes as long as its slowest process. The lab clock begins when every robot is ready
  (``rmr-world --when-ready``).
- *End.* A run is over when the robots of the lab's quorum hold the finish fact, when the lab's duration has passed, or
  when a process has died. Robots stop before the world, which tells the final state last.
- ``--durable``: a world that dies is started again and goes on from its state. Everything waits for it meanwhile; the
  bus is gone with it, so that nothing is known of the robots.
- ``--keep-going``, or a quorum other than `all`: a run goes on without a robot that died. A person may start that
  robot again by hand: from its liveliness token on it counts like any other, but its process is not a child of the
  launcher, which cannot end it.

Every wait is bounded by a named constant.
"""

import asyncio
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rmr.base.ids import named, spelled
from rmr.bus import wire
from rmr.bus.endpoint import BusError
from rmr.bus.keys import WORLD
from rmr.entry import ExitCode
from rmr_deploy.active_runs import write_processes
from rmr_deploy.event_log import EventLog
from rmr_deploy.page_start import PageStart, open_page
from rmr_deploy.preparation import RunPlan, agent_command, endpoint_of, world_command
from rmr_deploy.process_faults import FaultSchedule, ProcessFaults, ask_outage
from rmr_deploy.process_group import Child, ProcessGroup, exit_report, how
from rmr_deploy.restarts import Restarts, world_policy
from rmr_deploy.robot_lives import RobotLives, told_facts, told_status
from rmr_deploy.run_end import end_processes, judged_end, patiently, sweep, unready, who_came_back, who_ended
from rmr_deploy.run_loads import performed_loads, watched
from rmr_deploy.run_outcome import Life, RunOutcome
from rmr_deploy.run_requests import REQUEST_FIELDS, ROUTER, Answer, Service, called, serve_requests
from rmr_deploy.screen import RobotLine, Screen
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world.quorum import ALL, STOPPED, Fate

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


class LabRun:
    """A run in progress."""

    def __init__(self, plan: RunPlan, screen: Screen) -> None:
        self.plan = plan
        self.outcome = RunOutcome()
        self.monitor: StatusMonitor | None = None
        self.events = EventLog(plan.folder, self._lab_s)
        self._screen = screen
        self._page: PageStart | None = None
        self._processes = ProcessGroup()
        self.roster = plan.lab.roster if plan.has_world else plan.robots
        """The robots that this launcher judges and shows."""
        self.waiting: Callable[[], None] = lambda: None  # called while nobody answers at the endpoint
        # A robot that is dead may be started again, by the policy or a fault of the lab file.
        self.lives = RobotLives(
            plan.robots, self.outcome, lambda robot: self.restarts.waits(robot) or self.schedule.will_restart(robot)
        )
        self._robots = self.lives.children
        self.faults = ProcessFaults(
            self._robots,
            lambda who, name: self._start_world(name) if isinstance(who, str) else self._start_again((who,), name),
            lambda: self.monitor.now_s if self.monitor else 0.0,
        )
        self.outcome.faults = self.faults.entries
        self.restarts = Restarts(plan.options.restart, self._replace)
        self._services = self.faults.services
        self._service_restarts: dict[Service, Restarts] = {
            WORLD: Restarts(world_policy(plan.options.restart) if plan.options.durable else None, self._replace_world)
        }
        self.schedule = FaultSchedule([one for one in plan.lab.faults if one.robot in plan.robots], self._order)
        self._limit_s = plan.options.timeout_s or self._ready_limit_s + plan.duration_s + SILENCE_S_MAX
        self._began = time.monotonic()
        self._drawn = 0.0

    async def go(self) -> RunOutcome:
        """Run to the end; whatever happens, no process is left behind. Raises OSError if one cannot be started."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._interrupt, number.name)
        try:
            self._page = open_page(self.plan, self._screen.say)
            unregistered = self._start()
            about = {} if self._page is None else {"page": self._page.address}
            if unregistered:
                about["warning"] = unregistered
                self._screen.say(unregistered)
            self.events.note("started", f"lab {self.plan.lab.name} starts", connect=self._endpoint, **about)
            await self._attend()
            self.outcome.absent = self.lives.absent() | self._others()
            self.events.note("over", self.outcome.reason, finished=self.outcome.finished, reason=self.outcome.reason)
            await self._stop()
        finally:
            self._screen.close()
            if self._page is not None:
                self._page.close()
            self._processes.kill()
            if self.monitor is not None:
                self.monitor.close()
            self.plan.forget_secret()
            self.outcome.wall_s = time.monotonic() - self._began
        sweep(self.plan, self._processes, self.outcome.ended, self.monitor, self.events, self._screen.say)
        return self.outcome

    def _interrupt(self, signal_name: str) -> None:
        """Stop in order at the first request, at once at the second."""
        if self.outcome.interrupted:
            self.outcome.hurried = True
            self._processes.kill()
            return
        self.outcome.interrupted = True
        manner = "; once more to stop at once" if signal_name == "SIGINT" else f": {signal_name}"
        self._screen.say(f"stopping{manner}")

    # --- start ---------------------------------------------------------------------------------------------

    def _start(self) -> str:
        """Start the processes; return what `write_processes` does. Raises OSError."""
        self._endpoint = endpoint_of(self.plan)
        self._services[WORLD] = self._child(WORLD, WORLD, world_command(self.plan, self._endpoint))
        self._start_robots()
        return self._record_processes()

    def _start_robots(self, *, threaded: bool = False) -> None:
        for robots in self.plan.process_robots:
            ids = spelled(robots)
            command = agent_command(self.plan, robots, self._endpoint)
            child = self._child(f"robot-{ids}", f"robots-{ids}", command, threaded=threaded)
            self._robots |= dict.fromkeys(robots, child)

    def _record_processes(self) -> str:
        """Write the processes into the run folder; return what `write_processes` does. Raises OSError."""
        pids = {child.name: child.pid for child in self._processes.children}
        return write_processes(self.plan.folder, self._endpoint, pids, self.plan.about)

    def _start_again(self, robots: Sequence[int], name: str) -> Child:
        """Start the process `name`, which is `robots` from now on. Raises OSError."""
        part = name.replace("robot-", "robots-", 1)
        child = self._child(name, part, agent_command(self.plan, robots, self._endpoint), threaded=True)
        self._robots |= dict.fromkeys(robots, child)
        self._note_started(named(robots), child)
        for robot in robots:
            message = f"robot {robot} is started again"
            self.events.note("robot_started", message, robot=robot, process=name, pid=child.pid)
        return child

    def _note_started(self, who: str, child: Child) -> None:
        try:
            self._record_processes()
        except OSError as error:  # the process ends with the launcher all the same
            self._screen.say(f"{error.filename}: {error.strerror}; the verbs of a fleet do not see the new process")
        self._screen.say(f"{who} is started again, pid {child.pid}")

    def _start_world(self, name: str) -> Child:
        """Start the world again as the process `name`. Raises OSError."""
        child = self._child(name, name, world_command(self.plan, self._endpoint), threaded=True)
        self._services[WORLD] = child
        self.outcome.world_restarts += 1
        if self.plan.options.timeout_s is None:
            self._limit_s += READY_S_MAX  # lab time stands until its robots are back
        self._note_started(called(WORLD), child)
        self.events.note("world_started", "the world is started again", process=name, pid=child.pid)
        return child

    def _replace_world(self, _: Sequence[int], name: str) -> None:
        """Start the world again as the process `name`, because it has died. Raises OSError."""
        self._start_world(name)
        self.outcome.note_lives("restart", [WORLD], self._lab_s())

    def _replace(self, robots: Sequence[int], name: str) -> None:
        """Start the process `name` as the restart policy says. Raises OSError."""
        self._start_again(robots, name)
        self.outcome.note_lives("restart", robots, self._lab_s())

    def _child(self, name: str, part: str | None, command: Sequence[str], *, threaded: bool = False) -> Child:
        """Start the process `name`, which records into `part` if it records. Raises OSError."""
        log = self.plan.logs / f"{name}.jsonl"
        recording = None if part is None else self.plan.part(part)
        options = ["--log", str(log), *([] if recording is None else ["--record", str(recording)])]
        return self._processes.start(name, [*command, *options], log.with_suffix(".out"), threaded=threaded)

    # --- watch ---------------------------------------------------------------------------------------------

    async def _attend(self) -> None:
        """Return when the run is over; `outcome` says why."""
        who = self.plan.lab.name, self._endpoint, self.plan.credentials
        opening = asyncio.create_task(StatusMonitor.of(*who, self.waiting))
        try:
            await self._until(opening.done)
        finally:
            if opening.done() and not opening.cancelled():
                self._take_monitor(opening)
            opening.cancel()
        if self.outcome.reason or self.monitor is None:
            return
        monitor, roster = self.monitor, self.roster
        await self._join(monitor)
        if not self.outcome.reason:
            await self._until(lambda: monitor.ready(roster))
        if not self.outcome.reason:
            self.outcome.ready_s = time.monotonic() - self._began
            self._screen.say(f"{len(roster)} robots ready after {self.outcome.ready_s:.1f} s")
            self.events.note("ready", f"{len(roster)} robots are ready", ready_s=round(self.outcome.ready_s, 3))
            place, say = self._endpoint, self._screen.say
            with watched(self.plan, place, say), performed_loads(self.plan, place, self.events, say) as told:
                self.outcome.loads = told
                await self._until(self._finished)

    async def _join(self, monitor: StatusMonitor) -> None:
        """Join the other hosts of the lab, if there are any."""

    def _take_monitor(self, opened: asyncio.Task[StatusMonitor]) -> None:
        """Take the launcher's session on the bus, or the reason for which the router refused it."""
        try:
            self.monitor = opened.result()
        except BusError as error:
            self.outcome.reason = self.outcome.reason or str(error)

    def _finished(self) -> bool:
        """Whether the run has reached its end in good order."""
        outcome = self.outcome
        assert self.monitor is not None
        outcome.finished, outcome.reason = judged_end(self.plan.lab, self.monitor, self.lives.lost() | self._others())
        if outcome.finished:
            outcome.reason += who_came_back(self.lives.replaced())
        return bool(outcome.reason)

    def _others(self) -> dict[int, Fate]:
        """Return what became of the robots of other hosts that are not there and will not be."""
        return {}

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
        self._report_exits()  # before requests: the process that follows must find its predecessor retired
        serve_requests(self.plan.folder, self._answer)
        self.faults.resume()
        for restarts in (*self._service_restarts.values(), self.restarts):
            for problem in restarts.start_due():
                self._screen.say(problem)
        if self.monitor is not None and self._lab_s() is not None:
            for message, entry in self.schedule.perform_due(self.monitor.now):
                self._screen.say(message)
                self.events.note("fault", message, fault=entry)
        if self.monitor is not None:
            self.lives.note_returned(self.monitor, self._note_robot)
        if not self.outcome.reason:
            self.outcome.reason = self._early_end(time.monotonic() - self._began)

    @property
    def _ready_limit_s(self) -> float:
        return READY_S_MAX if self.plan.share is None else self.plan.share.wait_s

    def _early_end(self, elapsed_s: float) -> str:
        """Return why the run ends early by a person's will or a limit, if it does."""
        if self.outcome.interrupted:
            return "interrupted"
        if lacking := self._lacking():  # what follows one that has died could not be started
            return f"{called(lacking)} died, and cannot be started again"
        if self.outcome.ready_s is None and elapsed_s > self._ready_limit_s:
            return f"not ready within {self._ready_limit_s:g} s: {', '.join(self._unready())}"
        return f"not finished within {self._limit_s:g} s of wall time" if elapsed_s > self._limit_s else ""

    def _unready(self) -> list[str]:
        return unready(self.monitor, self.roster)

    def _answer(self, request: Mapping[str, Any]) -> Answer | asyncio.Future[str]:
        """Carry out a request, or answer a question."""
        if request.get("do") == "status":
            children, paused, ready_s = self._processes.children, self.faults.paused, self.outcome.ready_s
            return told_status(self.plan, children, self.lives, self.monitor, paused=paused, ready_s=ready_s)
        if request.get("do") == "facts":
            return told_facts(self.monitor, request.get("robot"))
        return self._order(request)

    def _order(self, request: Mapping[str, Any]) -> str:
        """Carry out a request; return why it is refused, or nothing."""
        robot = request.get("robot")
        if type(robot) is int and robot in self.lives.returned:
            return f"robot {robot} is a process that was started by hand"
        if robot == ROUTER and ROUTER not in self._services:
            return "there is no router in this run but its world, to which all connect"
        if robot == WORLD and not self.plan.options.durable:
            return "the world keeps no state, and the run would end with it: start the lab with rmr up --durable"
        if request.get("do") == "outage" and not isinstance(robot, str):
            refused = ask_outage(self.monitor, self.plan.lab.roster, request, self.faults.entries)
        else:
            refused = self.faults.perform(request)
        if not refused and (type(robot) is int or robot in self._services):
            self._note_order(robot, request)
        return refused

    def _note_order(self, who: Any, request: Mapping[str, Any]) -> None:
        """Note that an order about a robot, the world or the router was carried out."""
        if who in self._service_restarts:
            self._service_restarts[who].forget(wire.WORLD_ID)
        else:
            self.restarts.forget(who)
        fields = {key: request[key] for key in REQUEST_FIELDS if key in request}
        self.events.note("request", f"{request['do']} {called(who)}", **fields)

    def _lab_s(self) -> float | None:
        """Return lab time in seconds; None before it runs."""
        monitor = self.monitor
        return monitor.now_s if monitor is not None and monitor.running(self.roster) else None

    def _report_exits(self) -> None:
        """Show an exit report of each process that has ended since the last poll; end the run unless it goes on."""
        news = [child for child in self._processes.dead() if child.name not in self.outcome.ended]
        for child in news:
            code = child.exit_code()
            assert code is not None
            self.outcome.note_end(child.name, code, asked=child.name in self.faults.stopped)
            self._screen.say(exit_report(child))
            self.events.note(
                "process_ended", f"{child.name} {how(code)}", process=child.name, pid=child.pid, exit_code=code
            )
            robots = self.lives.of(child)
            if self.monitor is not None:
                for robot in robots:
                    self.monitor.retire(robot, self.outcome.fate(child.name))
            by_hand = child.name in self.faults.killed
            service = next((name for name, one in self._services.items() if one is child), None)
            replaced = self._replaced(child, code, service, robots)
            crashed = child.name in self.faults.crashed
            if by_hand or replaced or crashed:
                self.outcome.excused.add(child.name)
            if self.outcome.fate(child.name) == STOPPED or not (by_hand or crashed):
                word: Life = "stop" if self.outcome.fate(child.name) == STOPPED else "die"
                self.outcome.note_lives(word, robots if service is None else [service], self._lab_s())
        plan = self.plan
        may_die = plan.options.keep_going or plan.lab.quorum != ALL or not plan.has_world
        asked = all(child.name in self.outcome.excused for child in news)
        if news and not ((may_die or asked) and self._can_go_on(asked=asked)):
            lacking = self._lacking()
            died = sum(name.partition(".")[0] == lacking for name in self.outcome.died)
            self.outcome.reason = (
                f"{called(lacking)} died {died} times, and is not started again"
                if died > 1
                else who_ended({name: self.outcome.fate(name) for name in self.outcome.ended})
            )

    def _replaced(self, child: Child, code: int, service: Service | None, robots: Sequence[int]) -> bool:
        """Whether another process takes the place of one that has ended, by the restart policy."""
        if service == ROUTER:  # whoever ended it, and in whatever manner: nobody could order its start through it
            code = ExitCode.FAILED if self.outcome.ready_s is not None else ExitCode.INVALID
        elif child.name in self.faults.killed:
            return False
        restarts, crew = (
            (self.restarts, robots) if service is None else (self._service_restarts[service], [wire.WORLD_ID])
        )
        return restarts.failed(child, code, crew) is not None

    def _note_robot(self, event: str, robot: int, message: str) -> None:
        self._screen.say(message)
        self.events.note(event, message, robot=robot)
        assert self.monitor is not None
        ended: Life = "stop" if self.monitor.fate(robot) == STOPPED else "die"
        self.outcome.note_lives("restart" if event == "robot_back" else ended, [robot], self._lab_s())

    def _can_go_on(self, *, asked: bool) -> bool:
        """Whether a run goes on without those that have ended; during its start only if that was `asked` for."""
        may_lack = asked or self.outcome.ready_s is not None or self.plan.options.restart is not None
        return may_lack and not self._lacking() and self._anybody()

    def _lacking(self) -> Service | None:
        """Return the service that neither runs nor will.

        A world that was ended on request is waited for until it is started again.
        """
        for service, child in self._services.items():
            waits = self._service_restarts[service].waits(wire.WORLD_ID)
            asked = service == WORLD and child.name in self.faults.killed
            if child.name in self.outcome.ended and not waits and not asked:
                return service
        return None

    def _anybody(self) -> bool:
        return bool(set(self.roster) - self.lives.lost().keys() - self._others().keys())

    def _draw(self, *, now: bool = False) -> None:
        # Period with which the robots' lines on the screen are redrawn.
        if not now and time.monotonic() < self._drawn + 0.2:
            return
        self._drawn = time.monotonic()
        lines = [self._line(robot) for robot in self.roster]
        self._screen.show(self._lab_s(), lines)
        self.events.note_states((line.robot, line.state) for line in lines)

    def _line(self, robot: int) -> RobotLine:
        return self.lives.line(robot, self.monitor)

    # --- stop ----------------------------------------------------------------------------------------------

    async def _stop(self) -> None:
        """Stop the robots, then the world: ask each, wait for its last status, then send signals."""
        self.faults.resume(everything=True)
        monitor = self.monitor
        robots = list({child.name: child for child in self._robots.values()}.values())
        reaches = self._reaches_all()
        if monitor is not None and reaches:
            for robot in self.roster:
                monitor.ask_to_stop(robot, self.outcome.reason)
            await patiently(lambda: all(self._is_final(robot) for robot in self.roster), FINAL_S_MAX)
            self._report_silent()
            await self._processes.left(robots, LEAVE_S_MAX)
        await self._end(robots, asked=reaches)
        world = self._services.get(WORLD)
        if world is None:
            return
        if monitor is not None:
            monitor.ask_world_to_stop(self.outcome.reason)
            told = lambda: (monitor.truth is not None and monitor.truth.final) or self._gone(world)  # noqa: E731
            await patiently(told, FINAL_S_MAX)
            await self._processes.left([world], LEAVE_S_MAX)
        await self._end([world], asked=monitor is not None)

    async def _end(self, children: Sequence[Child], *, asked: bool) -> None:
        """End the processes that have not exited by themselves; report those that did not although `asked` to."""
        for line in await end_processes(self._processes, children, asked=asked):
            if not self.outcome.hurried:
                self._screen.say(line)

    def _reaches_all(self) -> bool:
        """Whether messages arrive: not without the router, which on one machine is the world."""
        return not self._gone(self._services.get(ROUTER) or self._services.get(WORLD))

    def _is_final(self, robot: int) -> bool:
        if self.monitor is not None and self.monitor.final(robot):
            return True
        return robot in self._robots and self._gone(self._robots[robot]) and robot not in self.lives.returned

    def _report_silent(self) -> None:
        """Name the robots whose last status did not come: the report holds their status before it."""
        silent = [robot for robot in self.roster if not self._is_final(robot)]
        if silent and not self.outcome.hurried:
            late = f"{named(silent)} did not tell the end within {FINAL_S_MAX:g} s"
            self._screen.say(f"{late}: the report has what was told before")

    @staticmethod
    def _gone(child: Child | None) -> bool:
        return child is None or child.exit_code() is not None

"""Orders about the robots of a run: kill, stop, start, restart, pause, and faults. The launcher carries them out.

A crash is a kill that stands for a failure of the robot: the restart policy applies to it, as it does not to what a
person has killed. A slow process is stopped and continued in turn, so that it runs for one tick in each period.

A robot that was killed or stopped is absent, as with ``--keep-going``: the run goes on without it, or with the
process that is started in its place. Its name gets a number: ``robot-3`` is followed by ``robot-3.1``.

What is done to a process like a fault of the lab file is noted in `entries`, in the form of such a file, for report
and recording: a pause is a stall whose length is known when it is over. An outage of the localisation is asked of the
world, which holds the sensors.

Faults of robots in the lab file become such orders when their time has come. `rmr sim` performs them at the exact
instant; here the launcher does so when it hears that lab time has passed it, up to 0.2 s later. Faults that find a
robot dead, or a restart that finds it alive, have no effect, as in the simulator. The radio's disturbances are the
world's affair.
"""

import asyncio
import signal
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf, isfinite
from typing import Any, TypeGuard

from rmr.base.time import Duration, Instant, in_seconds, seconds
from rmr.bus.keys import WORLD
from rmr_deploy.process_group import Child
from rmr_deploy.restarts import next_name
from rmr_deploy.run_requests import FAULT_S_MAX, ROUTER, Service, Who, called, service_named
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world.faults import fault_entry, fault_line
from rmr_world.lab import Fault, Kill, Outage, Restart, Slow, Stall

TURN_S = 1 / 60
"""How long a slow process runs in each period: one tick."""

OWN_ORDERS = {signal.SIGSTOP: "pause", signal.SIGCONT: "unpause"}
"""Signals that have an order of their own, which keeps account of them."""


class Paused:
    """A process that is stopped for a while."""

    def __init__(self, robot: int, child: Child, since_s: float, until: float, entry: dict[str, Any] | None) -> None:
        self.robot = robot
        self.child = child
        self.since_s = since_s
        """Lab time of its beginning."""
        self.until = until
        """When it goes on, on the monotonic clock."""
        self.entry = entry
        """Its entry, if its end is known."""


class ProcessFaults:
    """The faults of one run's processes, and orders about them."""

    def __init__(
        self, robots: dict[int, Child], start: Callable[[Who, str], Child], now_s: Callable[[], float]
    ) -> None:
        """`robots` are the processes by robot, also of later ones.

        `start` starts the process of a robot, or of the world, again under a name, `now_s` returns lab time in seconds.
        """
        self._robots = robots
        self.services: dict[Service, Child] = {}
        """The processes without which no run goes on, by what they are; also later ones."""
        self._start = start
        self._now_s = now_s
        self.killed: set[str] = set()
        """Names of the processes that were killed or stopped on request."""
        self.stopped: set[str] = set()
        """Those of them that were asked to stop."""
        self.crashed: set[str] = set()
        """Names of the processes that were killed by a fault."""
        self.entries: list[dict[str, Any]] = []
        """What was done, in the form of a lab file's faults."""
        self._paused: dict[str, Paused] = {}
        self._slowed: dict[str, asyncio.Task[None]] = {}

    @property
    def paused(self) -> list[str]:
        """The names of the processes that are stopped for a while."""
        return list(self._paused)

    def perform(self, request: Mapping[str, Any]) -> str:
        """Carry out a request; return why it is refused, or nothing."""
        robot = request.get("robot")
        service = service_named(robot)
        if service is not None and service in self.services:
            return self._perform(request, service, self.services[service])
        if type(robot) is not int or robot not in self._robots:
            return "there is no such robot in this run"
        child = self._robots[robot]
        others = sum(one is child for one in self._robots.values()) - 1
        if others:
            return f"robot {robot} shares its process with {others} more: start the run without --processes"
        return self._perform(request, robot, child)

    def _perform(self, request: Mapping[str, Any], robot: Who, child: Child) -> str:
        dead = child.exit_code() is not None
        do = request.get("do")
        if robot == ROUTER and do not in ("kill", "crash"):
            return "the router can be killed only, and is then started again by itself"
        if robot == WORLD and do not in ("kill", "crash", "stop", "start", "restart"):
            return "the world can be killed, stopped, started and restarted only"
        if do in ("start", "restart"):
            if dead:
                return self._restart(robot, child)
            runs = {"start": "runs already", "restart": "lives: kill it before it is restarted"}
            return f"{called(robot)} {runs[do]}"
        if dead:
            return f"{called(robot)} is dead{' already' if do in ('kill', 'stop', 'crash') else ''}"
        orders: dict[object, Callable[[], str]] = {
            "kill": lambda: self._kill(robot, child, request.get("signal")),
            "crash": lambda: self._crash(robot, child),
            "stop": lambda: self._stop(child),
        }
        if not isinstance(robot, str):
            orders |= self._own_orders(request, robot, child)
        order = orders.get(do) if isinstance(do, str) else None
        return "unknown request" if order is None else order()

    def _own_orders(self, request: Mapping[str, Any], robot: int, child: Child) -> dict[object, Callable[[], str]]:
        """Return the orders that robots alone take."""
        length = request.get("for_s")
        return {
            "stall": lambda: self._stall(robot, child, length),
            "slow": lambda: self._slow(robot, child, length, request.get("every_s")),
            "pause": lambda: self._pause(robot, child),
            "unpause": lambda: self._unpause(robot, child),
        }

    def _kill(self, robot: Who, child: Child, number: object) -> str:
        if number is None:
            number = signal.SIGKILL
        if type(number) is bool or not isinstance(number, int) or number not in signal.valid_signals():
            return "there is no such signal"
        if number in OWN_ORDERS:
            return f"{signal.Signals(number).name} is sent by the order {OWN_ORDERS[signal.Signals(number)]}"
        self.killed.add(child.name)
        return self._strike(robot, child, number)

    def _crash(self, robot: Who, child: Child) -> str:
        self.crashed.add(child.name)
        return self._strike(robot, child, signal.SIGKILL)

    def _strike(self, robot: Who, child: Child, number: int) -> str:
        self._continue(child.name)
        # The answer to an order from another machine leaves through the router: 0.2 s are ample for that.
        if robot == ROUTER:
            asyncio.get_running_loop().call_later(0.2, child.process.send_signal, number)
        else:
            child.process.send_signal(number)
        self.entries.append({"at": self._stamp(), "kill": robot})
        return ""

    def _stop(self, child: Child) -> str:
        self.killed.add(child.name)
        self.stopped.add(child.name)
        self._continue(child.name)  # a process that is stopped takes no SIGTERM
        child.process.send_signal(signal.SIGTERM)
        return ""

    def _restart(self, robot: Who, child: Child) -> str:
        try:
            started = self._start(robot, next_name(child.name))
        except OSError as error:
            return f"{called(robot)} cannot be started: {error.strerror or error}"
        if isinstance(robot, str):
            self.services[robot] = started
        else:
            self._robots[robot] = started
        self.entries.append({"at": self._stamp(), "restart": robot})
        return ""

    def _stall(self, robot: int, child: Child, for_s: object) -> str:
        if not _is_length(for_s):
            return f"a stall lasts up to {FAULT_S_MAX:g} s"
        until = time.monotonic() + for_s
        held = self._paused.get(child.name)
        now_s = self._stamp()
        entry = {"from": now_s, "to": round(now_s + for_s, 3), "stall": robot}
        self.entries.append(entry)
        if held is None:
            self._paused[child.name] = Paused(robot, child, now_s, until, entry)
        else:
            held.until = max(until, held.until)
        child.process.send_signal(signal.SIGSTOP)
        return ""

    def _slow(self, robot: int, child: Child, for_s: object, every_s: object) -> str:
        if not _is_length(for_s):
            return f"a robot is slow for up to {FAULT_S_MAX:g} s"
        if not _is_length(every_s) or every_s <= TURN_S:
            return f"the period of a slow robot is longer than a tick, which takes {TURN_S * 1e3:.1f} ms"
        if child.name in self._slowed:
            return f"robot {robot} is slow already"
        now_s = self._stamp()
        entry = {"from": now_s, "to": round(now_s + for_s, 3), "slow": robot, "every": every_s}
        self.entries.append(entry)
        turns = self._take_turns(child, time.monotonic() + for_s, every_s, entry)
        task = asyncio.get_running_loop().create_task(turns)
        self._slowed[child.name] = task
        task.add_done_callback(lambda _: self._slowed.pop(child.name, None))
        return ""

    async def _take_turns(self, child: Child, until: float, every_s: float, entry: dict[str, Any]) -> None:
        """Stop and continue `child` until then; it runs at the end, unless it is paused."""
        try:
            while time.monotonic() < until and child.exit_code() is None:
                child.process.send_signal(signal.SIGSTOP)
                await asyncio.sleep(min(every_s - TURN_S, max(0.0, until - time.monotonic())))
                self._unless_paused(child)
                await asyncio.sleep(TURN_S)
        except asyncio.CancelledError:
            entry["to"] = self._stamp()
            raise
        finally:
            self._unless_paused(child)

    def _unless_paused(self, child: Child) -> None:
        if child.name not in self._paused:
            child.process.send_signal(signal.SIGCONT)

    def _pause(self, robot: int, child: Child) -> str:
        if child.name in self._paused:
            return f"robot {robot} is paused already"
        self._paused[child.name] = Paused(robot, child, self._stamp(), inf, None)
        child.process.send_signal(signal.SIGSTOP)
        return ""

    def _unpause(self, robot: int, child: Child) -> str:
        if child.name not in self._paused:
            return f"robot {robot} is not paused"
        self._continue(child.name)
        return ""

    def _continue(self, name: str) -> None:
        """Let a process go on, and note how long it was stopped."""
        if name in self._slowed:
            self._slowed[name].cancel()
        held = self._paused.pop(name, None)
        if held is None:
            return
        now_s = self._stamp()
        if held.entry is None:
            self.entries.append({"from": held.since_s, "to": now_s, "stall": held.robot})
        elif time.monotonic() < held.until:
            held.entry["to"] = now_s
        held.child.process.send_signal(signal.SIGCONT)

    def _stamp(self) -> float:
        return round(self._now_s(), 3)

    def resume(self, *, everything: bool = False) -> None:
        """Let the processes go on whose stall is over, or `everything`."""
        now = time.monotonic()
        for task in list(self._slowed.values()) if everything else ():
            task.cancel()
        for name, held in list(self._paused.items()):
            if everything or now >= held.until:
                self._continue(name)


def _is_length(value: object) -> TypeGuard[float]:
    """Whether `value` is a number of seconds that a fault may last."""
    return isinstance(value, int | float) and isfinite(value) and 0.0 < value <= FAULT_S_MAX


class FaultSchedule:
    """The faults of a lab that are still to come."""

    def __init__(self, faults: Iterable[Fault], perform: Callable[[Mapping[str, Any]], str]) -> None:
        """`perform` carries out a request to the launcher and returns why it is refused."""
        self._perform = perform
        numbered = sorted((_begin(fault), i, fault) for i, fault in enumerate(faults))
        self._due = [(begin, fault) for begin, _, fault in numbered]

    def will_restart(self, robot: int) -> bool:
        """Whether a restart of `robot` is still to come."""
        return any(isinstance(fault, Restart) and fault.robot == robot for _, fault in self._due)

    def perform_due(self, now: Instant) -> list[tuple[str, dict[str, Any]]]:
        """Perform what is due; return a sentence about each fault, and its entry."""
        told = []
        while self._due and self._due[0][0] <= now:
            _, fault = self._due.pop(0)
            entry = fault_entry(fault)
            refused = self._perform(_request(fault, now))
            told.append((f"the lab file: {fault_line(entry)}{': ' if refused else ''}{refused}", entry))
        return told


def _begin(fault: Fault) -> Instant:
    return fault.at if isinstance(fault, Kill | Restart) else fault.start


def _request(fault: Fault, now: Instant) -> dict[str, Any]:
    """Return a fault that begins `now` as a request to the launcher."""
    match fault:
        case Kill(robot=robot):
            return {"do": "crash", "robot": robot}
        case Restart(robot=robot):
            return {"do": "start", "robot": robot}
        case Stall(end=end, robot=robot):
            return {"do": "stall", "robot": robot, "for_s": _left_s(end - now)}
        case Slow(end=end, robot=robot, every=every):
            return {"do": "slow", "robot": robot, "for_s": _left_s(end - now), "every_s": in_seconds(every)}
        case Outage(end=end, robot=robot):
            return {"do": "outage", "robot": robot, "for_s": _left_s(end - now)}


def _left_s(left: Duration) -> float:
    return max(0.001, in_seconds(left))


def ask_outage(
    monitor: StatusMonitor | None, roster: Sequence[int], request: Mapping[str, Any], entries: list[dict[str, Any]]
) -> str:
    """Let a robot hear no beacon for a while, and note it in `entries`; return why that is refused, or nothing."""
    robot = request.get("robot")
    for_s = request.get("for_s")
    if type(robot) is not int or robot not in roster:
        return "there is no such robot in this run"
    if not _is_length(for_s):
        return f"an outage lasts up to {FAULT_S_MAX:g} s"
    if monitor is None or not monitor.running(roster):
        return "lab time does not run yet"
    now_s = round(monitor.now_s, 3)
    monitor.silence(robot, monitor.now + seconds(for_s))
    entries.append({"from": now_s, "to": round(now_s + for_s, 3), "outage": robot})
    return ""

"""The run of a lab over several hosts, as the launcher of one of them sees it.

It is that of one machine with another list of processes. The launcher of the world's host starts a router, which
listens for all, and the world, waits for the robots of the other hosts, and alone decides when the run is over. The
others wait for it, compare their lab with its (`host_company`), start their robots and end with the run. One that is
interrupted stops its own robots; the run goes on without them.

The router is a process of its own, so that launchers and robots hear each other while the world is dead. Whether it
comes back is known to its launcher, which says so at once if it does not. The others wait as long as they hear that
launcher, and only if it is gone itself, for `GONE_S`.
"""

import asyncio
import os
import shlex
import time
from collections.abc import Mapping, Sequence
from typing import Any

from rmr.bus.admission import why_no_session
from rmr.bus.keys import WORLD
from rmr.bus.listening import SAY_AGAIN_S
from rmr.bus.process import Throttle
from rmr.record.recording import PARTS_FOLDER
from rmr_deploy.host_company import GONE_S, SILENT_S, HostCompany
from rmr_deploy.host_share import HostShare
from rmr_deploy.launch import FINAL_S_MAX, LEAVE_S_MAX, LabRun
from rmr_deploy.preparation import RunPlan, router_command
from rmr_deploy.process_group import Child
from rmr_deploy.process_identity import usage_of
from rmr_deploy.resolved_lab import resolved_lab
from rmr_deploy.restarts import Restarts, world_policy
from rmr_deploy.robot_lives import told_facts
from rmr_deploy.run_end import patiently, who_came_back, who_ended
from rmr_deploy.run_logs import told_log
from rmr_deploy.run_outcome import Elsewhere, RunOutcome
from rmr_deploy.run_requests import ROUTER, Answer, called, service_named
from rmr_deploy.screen import RobotLine, Screen
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world.quorum import ALL, DIED, Fate, absence

LAST_WORD_S = 0.1
"""Time for the last message of a launcher to be sent before its session is closed."""


class HostRun(LabRun):
    """The share of one host in a run in progress."""

    def __init__(self, plan: RunPlan, share: HostShare, screen: Screen) -> None:
        super().__init__(plan, screen)
        self.company: HostCompany | None = None
        self._share = share
        self._said: dict[str, str] = {}
        """What was said last about each topic."""
        self._noted: dict[int, Fate] = {}
        """Robots of other hosts whose end was said."""
        self._told_entries: dict[tuple[str, int], list[tuple[str, Any, Any]]] = {}
        """What befell the robots of other hosts, as far as it was said."""
        if share.has_world:
            # Several deaths in a row, and it is not started again: as for a world.
            self._service_restarts[ROUTER] = Restarts(world_policy(None), self._replace_router)
        self.waiting = Throttle(self._say_waiting, SAY_AGAIN_S)
        if not share.has_world:  # the world's host ends the run
            self._limit_s = plan.options.timeout_s or float("inf")

    def _say_waiting(self) -> None:
        if self._share.has_world:  # its own world is about to listen
            return
        where = f"{self._endpoint}, on host {self._share.hub.name}"
        self._say_once(
            "hub", f"waiting for the world of lab {self.plan.lab.name} at {where}{why_no_session(self._endpoint)}"
        )

    def _say_once(self, topic: str, message: str) -> None:
        """Say `message` unless it was the last one about `topic`."""
        if self._said.get(topic, "") != message:
            self._said[topic] = message
            if message:
                self._screen.say(message)

    # --- start -----------------------------------------------------------------------------------------------

    def _start(self) -> str:
        if self._share.has_world:
            self._services[ROUTER] = self._child(ROUTER, None, router_command(self.plan, self._share))
            return super()._start()
        self._endpoint = self._share.connect
        return self._record_processes()

    def _replace_router(self, _: Sequence[int], name: str) -> None:
        """Start the router again as the process `name`. Raises OSError."""
        command = router_command(self.plan, self._share)
        child = self._services[ROUTER] = self._child(name, None, command, threaded=True)
        self._note_started(called(ROUTER), child)
        self.outcome.note_lives("restart", [ROUTER], self._lab_s())

    async def _join(self, monitor: StatusMonitor) -> None:
        self.company = company = HostCompany(self.plan, self._share, monitor.bus, self._asked, self._told)
        if self._share.has_world:
            return
        await self._until(lambda: bool(company.refusal()) or company.settled)
        if self.outcome.reason:
            return
        if refusal := company.refusal():
            self.outcome.reason = refusal
            self.outcome.invalid = True
            return
        self._start_robots(threaded=True)
        self._record_processes()
        self._screen.say(f"host {self._share.here.name} takes part in lab {self.plan.lab.name}")

    def _unready(self) -> list[str]:
        if self.company is None or self.monitor is None:
            return [f"no world of lab {self.plan.lab.name} answers at {self._endpoint}{why_no_session(self._endpoint)}"]
        if not self._share.has_world and not self._robots:
            return [f"no rmr up --here {self._share.hub.name} is heard at {self._endpoint}: start it, of the same rmr"]
        missing = [f"host {host} is not there" for host in self.company.missing()]
        return missing or super()._unready()

    # --- watch -----------------------------------------------------------------------------------------------

    def _check_processes(self) -> None:
        if self.company is not None and self.monitor is not None:
            if self._share.has_world or self._robots:
                state = "waiting" if self.outcome.ready_s is None else "running"
                self.company.tell(state, self._gone_here(), befell=self.outcome.befell())
            if self._share.has_world:
                self._watch_hosts(self.company, self.monitor)
            else:
                self._follow(self.company, self.monitor)
        if not self.outcome.reason:
            super()._check_processes()

    def _watch_hosts(self, company: HostCompany, monitor: StatusMonitor) -> None:
        """Say which hosts are missing; end the run if it cannot go on without a robot of another host."""
        if self.outcome.ready_s is None:
            missing = ", ".join(company.missing())
            self._say_once("missing", f"waiting for host {missing}" if missing else "")
        silent = ", ".join(company.silent())
        self._say_once("silent", f"nothing is heard of host {silent}; its robots are waited for" if silent else "")
        for host, reason in company.reasons().items():
            self._say_once(f"left {host}", f"host {host} has left: {reason}")
        lost = self._others()
        self._say_befallen(company, lost)
        for robot in self._noted.keys() - lost.keys():
            del self._noted[robot]
        news = {robot: fate for robot, fate in lost.items() if robot not in self._noted}
        self._noted |= news
        for robot, fate in news.items():
            message = f"robot {robot} on host {self._share.host_of(robot)}: {fate}"
            self._screen.say(message)
            self.events.note("robot_state", message, robot=robot, state=fate)
            if robot not in monitor.present:
                monitor.retire(robot, fate)
        died = [robot for robot, fate in news.items() if fate == DIED and robot not in company.killed()]
        may_die = self.plan.options.keep_going or self.plan.lab.quorum != ALL
        if died and not may_die:
            self.outcome.reason = who_ended({f"robot {one} on host {self._share.host_of(one)}": DIED for one in died})
        elif news and not self._anybody():
            self.outcome.reason = f"no robot is left: {absence(self.lives.lost() | lost)}"

    def _say_befallen(self, company: HostCompany, lost: Mapping[int, Fate]) -> None:
        """Say what other hosts' launchers have done to their robots since; the end of one that is `lost` is said."""
        for (host, run), befell in company.befell.items():
            entries = [*befell.faults, *befell.lives]
            told = self._told_entries.setdefault((host, run), [])
            for entry in entries:
                word, robot = next(
                    (one for one in entry.items() if one[0] not in {"at", "from", "to", "every"}), ("", 0)
                )
                mark = (word, robot, entry.get("at", entry.get("from")))
                if mark in told or type(robot) is not int:
                    continue
                told.append(mark)
                if word == "restart":
                    self._note_befallen(f"robot {robot} on host {host} is started again", robot, "restarted")
                elif word in {"die", "stop"} and robot not in lost:
                    self._note_befallen(f"robot {robot} on host {host} has ended", robot, "ended")
                elif word not in {"die", "stop"}:
                    self._note_befallen(f"{word} robot {robot} on host {host}", robot, word)

    def _note_befallen(self, message: str, robot: int, state: str) -> None:
        self._screen.say(message)
        self.events.note("robot_state", message, robot=robot, state=state)

    def _follow(self, company: HostCompany, monitor: StatusMonitor) -> None:
        """End with the run, or when the launcher that decides about it is gone."""
        hub = company.hub
        silent_s = company.hub_silent_s
        host = f"host {self._share.hub.name}"
        where = f"{host}, which has the world of lab {self.plan.lab.name}"
        if hub is not None and hub.state == "over":
            self.outcome.finished = hub.finished
            self.outcome.reason = hub.reason
        elif silent_s > GONE_S:
            self.outcome.reason = f"no word of {where}, for {silent_s:.0f} s"
        elif silent_s > SILENT_S:
            self._say_once("hub", f"no word of {where}; waiting for it to return, for {GONE_S:g} s")
        else:
            is_silent = monitor.world_silent_s > SILENT_S
            self._say_once("hub", f"no word of the world on {host}, which waits for it, too" if is_silent else "")

    def _finished(self) -> bool:
        if not self._share.has_world:
            return bool(self.outcome.reason)
        over = super()._finished()
        if self.outcome.finished and self.company is not None:
            gone = {f"robot-{robot}" for robot in self._others()}
            told = [(name, host) for (host, _), befell in self.company.befell.items() for name in befell.died]
            back = [f"{name} on host {host}" for name, host in told if name.partition(".")[0] not in gone]
            self.outcome.reason += who_came_back(dict.fromkeys(back, DIED))
        return over

    def _others(self) -> dict[int, Fate]:
        """Return what became of the robots of other hosts that are judged here."""
        return self._gone_elsewhere() if self._share.has_world else {}

    def _gone_elsewhere(self) -> dict[int, Fate]:
        """Return what became of the robots of other hosts that are not there."""
        if self.company is None:
            return {}
        return self.company.lost(started=self.outcome.ready_s is not None)

    def _answer(self, request: Mapping[str, Any]) -> "Answer | asyncio.Future[str]":
        robot = request.get("robot")
        is_order = request.get("do") not in ("facts", "outage")
        host = self._home(robot)
        if is_order and self.company is not None and host not in (None, self._share.here.name):
            return asyncio.ensure_future(self.company.order(host, request))
        answer = super()._answer(request)
        if request.get("do") == "status" and isinstance(answer, dict):
            if not self._share.has_world:
                there = self.monitor is not None and self.monitor.world_there
                answer["processes"].append(self._row_elsewhere(f"{self._share.hub.name}/{WORLD}", lives=there))
            answer["processes"] += [self._process_elsewhere(robot) for robot in self._elsewhere]
            answer["robots"] += [self._robot_elsewhere(robot) for robot in self._elsewhere]
        return answer

    def _home(self, who: object) -> str | None:
        """Return the host of a robot, or of the world or router; None where there is none."""
        if service_named(who) is not None:
            return self._share.hub.name
        return self._share.host_of(who) if type(who) is int and who in self.plan.lab.roster else None

    @property
    def _elsewhere(self) -> list[int]:
        """The robots of other hosts."""
        return [robot for robot in self.plan.lab.roster if robot not in self.plan.robots]

    def _process_elsewhere(self, robot: int) -> dict[str, Any]:
        """Return the process of a robot of another host, as far as it is known, in the form of `told_status`."""
        name = f"{self._share.host_of(robot)}/robot-{robot}"
        return self._row_elsewhere(name, lives=robot not in self._gone_elsewhere())

    @staticmethod
    def _row_elsewhere(name: str, *, lives: bool) -> dict[str, Any]:
        state = "running" if lives else "ended"
        return {"name": name, "pid": None, "state": state, "exit_code": None, "up_s": None}

    def _robot_elsewhere(self, robot: int) -> dict[str, Any]:
        line = self._line(robot)
        late = None if self.monitor is None else self.monitor.report(robot).get("ticks_late")
        process = self._process_elsewhere(robot)["name"]
        told = {"robot": robot, "process": process, "state": line.state, "progress": line.progress}
        return {**told, "restarts": None, "ticks_late": late}

    def _asked(self, request: Mapping[str, Any]) -> str | None:
        """Carry out what another launcher or `rmr --connect` was asked; None if the robot is not of this one."""
        if request.get("do") == "down" and self._share.has_world:
            self._screen.say("stopping: rmr down on another machine")
            self.outcome.interrupted = True
            return ""
        robot = request.get("robot")
        own = service_named(robot) in self._services or (type(robot) is int and robot in self._robots)
        return self._order(request) if own else None

    def _told(self, request: Mapping[str, Any]) -> Answer | None:
        """Answer a question of `rmr --connect`; None while this host does not take part."""
        if not (self._share.has_world or self._robots):
            return None
        if request.get("do") == "facts":
            return told_facts(self.monitor, request.get("robot"))
        if request.get("do") == "logs":
            return told_log(self.plan.folder, request)
        if request.get("do") == "usage":
            pids = {"launcher": os.getpid()} | {child.name: child.pid for child in self._processes.children}
            return {"lab": self.plan.lab.name, "usage": {name: usage_of(pid) for name, pid in pids.items()}}
        if request.get("do") == "config":
            return resolved_lab(self.plan.lab)
        status = self._answer({"do": "status"})
        assert isinstance(status, Mapping)
        launcher = {"name": "launcher", "pid": os.getpid(), "state": "running", "exit_code": None}
        launcher["up_s"] = round(time.monotonic() - self._began, 1)
        shares = {host.name: list(host.robots) for host in self._share.hosts}
        about = {"hub": self._share.hub.name, "shares": shares, "folder": str(self.plan.folder.absolute())}
        return {**status, **about, "processes": [launcher, *status["processes"]]}

    def _gone_here(self) -> dict[int, str]:
        """Return what became of the own robots that are not there and will not be, in the words of `wire.ENDS`."""
        excused = self.outcome.excused
        gone = self.lives.lost()
        return {
            one: "killed" if end == DIED and self._robots[one].name in excused else end for one, end in gone.items()
        }

    def _line(self, robot: int) -> RobotLine:
        host = self._share.host_of(robot)
        if robot in self._robots:
            return self.lives.line(robot, self.monitor)._replace(host=host)
        fate = self._gone_elsewhere().get(robot)
        if fate is not None:
            return RobotLine(robot, fate, "", host)
        return RobotLine(robot, *(("starting", "") if self.monitor is None else self.monitor.line(robot)), host)

    def elsewhere(self) -> Elsewhere:
        """Return what the other hosts have of the run."""
        if self.company is None:
            return Elsewhere()
        hub = self.company.hub
        if self._share.has_world:
            return Elsewhere(folders=self.company.folders, befell=list(self.company.befell.values()))
        if hub is None or not self._robots:
            return Elsewhere(folders=self.company.folders)
        told = "the report is" if hub.state == "over" else "the run goes on; its report will be"
        return Elsewhere(f"{told} on host {hub.host}, in {hub.folder}", self.company.folders)

    # --- stop ------------------------------------------------------------------------------------------------

    async def _stop(self) -> None:
        if self.company is not None and self._share.has_world:
            self._tell_end(self.company)
        await super()._stop()
        if ROUTER in self._services:
            await self._end([self._services[ROUTER]], asked=False)
        if self.company is not None and not self._share.has_world and not (self.company.is_twin and not self._robots):
            self.company.tell("left", self._gone_here(), reason=self.outcome.reason, befell=self.outcome.befell())
            await asyncio.sleep(LAST_WORD_S)

    async def _end(self, children: Sequence[Child], *, asked: bool) -> None:
        await super()._end(children, asked=asked)
        if self.company is not None and self._reaches_all() and self._share.has_world and not self.outcome.hurried:
            # The last word of the other hosts comes through the router.
            await patiently(self._are_told, FINAL_S_MAX + LEAVE_S_MAX)

    def _are_told(self) -> bool:
        """Whether no other host stays; until then it is told again that the run is over, for a message may be lost."""
        assert self.company is not None
        self._tell_end(self.company)
        return not self.company.staying()

    def _tell_end(self, company: HostCompany) -> None:
        company.tell("over", self._gone_here(), finished=self.outcome.finished, reason=self.outcome.reason)

    def _reaches_all(self) -> bool:
        if self._share.has_world:
            return super()._reaches_all()
        # One that was refused must not end the robots of the launcher that takes part in its name.
        return bool(self._robots) and self.monitor is not None and self.monitor.connected

    def _is_final(self, robot: int) -> bool:
        if robot not in self._robots and (not self._share.has_world or robot in self._others()):
            return True  # it was not started, or has gone
        return super()._is_final(robot)


# --- what is told at the end: of its own robots, and how the recordings become one


def share_report(report: Mapping[str, Any], plan: RunPlan) -> dict[str, Any]:
    """Return `report` of a run with the robots of this host alone."""
    own = {str(robot) for robot in plan.robots}
    robots = {name: part for name, part in report["robots"].items() if name in own}
    jobs = [job for part in robots.values() for job in part["assertions"]]
    met, missed = (sum(job["met"] is wanted for job in jobs) for wanted in (True, False))
    absent = {key: [robot for robot in report[key] if str(robot) in own] for key in ("dead", "stopped", "never_came")}
    # Others' hosts tell of the wheel commands and messages of their own robots.
    bus = {key: [one for one in told if str(one[0]) in own] for key, told in report["bus"].items() if key != "lost"}
    report = {**report, "bus": report["bus"] | bus}
    return {**report, "robots": robots, "deadlines": {"met": met, "missed": missed, "best_possible": None}, **absent}


def join_hint(plan: RunPlan, outcome: RunOutcome) -> str:
    """Return the lines that say how the recordings of all hosts become one: each host has those of its own robots."""
    folders = outcome.elsewhere.folders
    found = [(host, folder) for host, each in sorted(folders.items()) for folder in each]
    lines = [f"host {host} has its recordings in {folder}/{PARTS_FOLDER}" for host, folder in found]
    if folders:
        lines.append(f"copied to here, as {', '.join(sorted(folders))}, they become one recording by")
    sources = [shlex.quote(str(plan.folder / PARTS_FOLDER)), *sorted(folders)]
    target = shlex.quote(str(plan.folder / "joined"))
    return "\n".join([*lines, f"    rmr record join {' '.join(f'{one}/*.mcap' for one in sources)} -o {target}"])

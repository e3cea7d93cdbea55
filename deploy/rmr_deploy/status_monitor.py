"""The launcher's view of a run on the bus: the newest status of each process, and the world's ground truth.

The launcher is a client of the star like any other. It knows what the processes publish; whether a process that it
started still runs is known to `process_group`. Nothing is requested again: statuses come several times a second, and
the last one of each sender is marked as final.

After the process of a robot has ended, the robot is absent until the liveliness token of another process shows. What
was published under the session number of the ended process then belongs to an earlier incarnation.

Where the router is gone, all tokens vanish and nothing is known of anybody: robots count as present until the
connection is back and their tokens have not come with it.

In the name of a robot whose token is there, or of the world, several sessions may speak: a process and the next one, or
forged messages. The one that was heard first is believed, unless it has fallen silent or lost its token.
"""

import asyncio
import math
import time
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from rmr.base.time import Instant, in_seconds
from rmr.bus import wire
from rmr.bus.certificates import read_credentials
from rmr.bus.keys import ROBOT_ROLE, WORLD, Keys, last_id
from rmr.bus.session import Bus, open_when_there
from rmr_world.incarnations import with_lost_jobs
from rmr_world.quorum import DIED, NEVER_CAME, STOPPED, Fate

AT_WORK = ("ready", "running", "finished")
"""States of a robot that has its program, its place and its clock."""


JUDGE_S: Final = 0.2
"""Time after a token has vanished in which a loss of the connection shows."""
RETURN_S: Final = 3.0
"""Time in which robots are back after the connection is: they try again once a second."""

SILENT_S: Final = 10.0
"""Time without a status after which a session is taken for over: a process sends two a second."""
SESSIONS_MAX: Final = 1000
"""Sessions in one sender's name that are told apart."""


class _Speakers:
    """The sessions that speak in one sender's name."""

    def __init__(self) -> None:
        self._heard: dict[int, float] = {}
        """When each was heard last, monotonic seconds; in the order in which they were heard first."""

    def believed(self, run: int) -> bool:
        """Take note that the session `run` was heard; return whether it is believed."""
        now = time.monotonic()
        if run not in self._heard and len(self._heard) >= SESSIONS_MAX:
            self._heard = {other: at for other, at in self._heard.items() if now - at < SILENT_S}
            if len(self._heard) >= SESSIONS_MAX:
                return False
        self._heard[run] = now
        return run == next(other for other, at in self._heard.items() if now - at < SILENT_S)

    def vanished(self) -> None:
        """Note that the sender's token has vanished: whoever speaks next may be its next process."""
        self._heard = dict.fromkeys(self._heard, -math.inf)


class StatusMonitor:
    """The newest status of each process of a lab."""

    def __init__(self, bus: Bus, lab: str) -> None:
        self.bus = bus
        self._keys = Keys(lab)
        self.robots: dict[int, wire.Status] = {}
        """The newest status of each robot's present incarnation."""
        self.world: wire.Status | None = None
        self.truth: wire.Truth | None = None
        self.world_there = False
        """Whether the world has a liveliness token."""
        self.present: set[int] = set()
        """Robots with a liveliness token, and those whose tokens have vanished with the connection."""
        self._came: set[int] = set()
        """Robots that have had one."""
        self._vanished: set[int] = set()
        """Those of `present` that have lost their token."""
        self._world_heard_s = time.monotonic()
        """When the world was last heard of, monotonic seconds; at first the beginning."""
        self._sessions: dict[int, int] = {}
        """Session number of each robot's newest status."""
        self._speakers: defaultdict[int, _Speakers] = defaultdict(_Speakers)
        """By sender."""
        self._dead_sessions: dict[int, set[int]] = {}
        self._parts: dict[int, Mapping[str, Any]] = {}
        """The newest part of the report of each robot's present incarnation."""
        self._past: dict[int, list[Mapping[str, Any]]] = {}
        """The newest part of the report of each earlier incarnation of each robot, oldest first."""
        bus.subscribe(self._keys.statuses, self._status, whole=True)
        bus.subscribe(self._keys.truth, self._truth)
        bus.watch_alive(self._keys.alive(ROBOT_ROLE, "*"), self._alive)
        bus.watch_alive(self._keys.world_alive, self._world_alive)

    @classmethod
    async def of(
        cls, lab: str, endpoint: str, secret: Path | None, waiting: Callable[[], None] = lambda: None
    ) -> "StatusMonitor":
        """Return the monitor of `lab` as soon as its router answers at `endpoint`; `secret` is a file, or a folder.

        `waiting` is called after each attempt without an answer. Raises SecretError, CertificateError, and
        NotAdmittedError when the router refuses the session.
        """
        return cls(await open_when_there(wire.OPERATOR_ID, endpoint, waiting, read_credentials(secret)), lab)

    def _status(self, _key: str, message: wire.Envelope) -> None:
        if not isinstance(message.body, wire.Status):
            return
        if message.sender == wire.WORLD_ID:
            if self._speaks(message):
                self.world = message.body
                self._world_heard_s = time.monotonic()
        elif (
            message.sender >= 0
            and message.run not in self._dead_sessions.get(message.sender, ())
            and (message.sender not in self.present or self._speaks(message))
        ):
            self.robots[message.sender] = message.body
            self._sessions[message.sender] = message.run
            if message.body.report:
                self._parts[message.sender] = message.body.report

    def _truth(self, _key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Truth) and message.sender == wire.WORLD_ID and self._speaks(message):
            self.truth = message.body
            self._world_heard_s = time.monotonic()

    def _speaks(self, message: wire.Envelope) -> bool:
        """Return whether `message` is of the session that is believed to be its sender's."""
        return self._speakers[message.sender].believed(message.run)

    def _alive(self, key: str, alive: bool) -> None:
        robot = last_id(key)
        if robot is None:
            return
        if alive:
            self.present.add(robot)
            self._came.add(robot)
            self._vanished.discard(robot)
        else:
            self._vanished.add(robot)
            self._speakers[robot].vanished()
            asyncio.get_running_loop().call_later(JUDGE_S, self._judge, robot)

    def _judge(self, robot: int, was_cut: bool = False) -> None:
        """Take a robot whose token has vanished for absent, unless the connection is gone or back just now."""
        if robot not in self._vanished:
            return
        if self.bus.connected and not was_cut:
            self._vanished.discard(robot)
            self.present.discard(robot)
        else:
            asyncio.get_running_loop().call_later(RETURN_S, self._judge, robot, not self.bus.connected)

    def _world_alive(self, _key: str, alive: bool) -> None:
        self.world_there = alive
        if not alive:
            self._speakers[wire.WORLD_ID].vanished()

    def fate(self, robot: int) -> Fate:
        """Return what became of a robot that is not there, as far as it has told: one that ends in order says so."""
        if robot not in self._came and robot not in self.robots:
            return NEVER_CAME
        return STOPPED if self.final(robot) and self._state(robot) == "stopped" else DIED

    def retire(self, robot: int, fate: Fate) -> None:
        """Note that the process of `robot` has ended: a token that shows from now on is of its next incarnation."""
        self.present.discard(robot)
        self._vanished.discard(robot)
        self._speakers[robot].vanished()
        if robot in self._sessions:
            self._dead_sessions.setdefault(robot, set()).add(self._sessions[robot])
        if robot in self._parts:
            self._past.setdefault(robot, []).append(with_lost_jobs(self._parts.pop(robot), fate))
        self.robots.pop(robot, None)

    @property
    def world_silent_s(self) -> float:
        """How long ago the world was last heard of, in seconds; it tells its status twice a second."""
        return time.monotonic() - self._world_heard_s

    @property
    def connected(self) -> bool:
        """Whether the router is there: without it every token vanishes, and nothing is known of any robot."""
        return self.bus.connected

    @property
    def now(self) -> Instant:
        """The newest lab time in a message; 0 before the lab clock runs."""
        speakers = self.present & self.robots.keys() or self.robots
        stamps = [self.robots[robot].stamp for robot in speakers]
        stamps += [said.stamp for said in (self.world, self.truth) if said is not None]
        return max(stamps, default=0)

    @property
    def now_s(self) -> float:
        """The newest lab time in a message, in seconds."""
        return in_seconds(self.now)

    def ready(self, roster: Sequence[int]) -> bool:
        """Whether every robot of `roster` is ready, or at work already."""
        return all(self._state(robot) in AT_WORK for robot in roster)

    def running(self, roster: Sequence[int]) -> bool:
        """Whether the lab clock runs for a robot of `roster`."""
        return any(self._state(robot) in AT_WORK[1:] for robot in roster)

    def finished(self, roster: Sequence[int]) -> bool:
        """Whether every robot of `roster` holds the finish fact."""
        return all((status := self.robots.get(robot)) is not None and status.finished for robot in roster)

    def final(self, robot: int) -> bool:
        """Whether the last status of `robot` has come."""
        status = self.robots.get(robot)
        return status is not None and status.final

    def report(self, robot: int) -> Mapping[str, Any]:
        """Return the newest part of the report of the robot's present incarnation; empty when none has come."""
        return self._parts.get(robot, {})

    def past(self, robot: int) -> Sequence[Mapping[str, Any]]:
        """Return the newest parts of the report of the robot's earlier incarnations, oldest first."""
        return self._past.get(robot, ())

    def cut_logs(self) -> list[tuple[str, str]]:
        """Return (name of the process, reason) of each log that could not be written to its end."""
        told: list[tuple[str, Mapping[str, Any]]] = [("the world", self.world.report if self.world else {})]
        told += [(f"robot {robot}", part) for robot, part in sorted(self._parts.items())]
        return [(name, str(part["log_cut_short"])) for name, part in told if part.get("log_cut_short")]

    def _state(self, robot: int) -> str:
        status = self.robots.get(robot)
        return "starting" if status is None else status.state

    def line(self, robot: int) -> tuple[str, str]:
        """Return the robot's state and its progress, as the screen shows them."""
        status = self.robots.get(robot)
        return ("starting", "") if status is None else (status.state, status.progress)

    def ask_to_stop(self, who: int | str, reason: str) -> None:
        """Ask a robot, or the world, for an orderly end."""
        self.bus.publish(self._keys.stop(who), wire.Stop(reason))

    def silence(self, robot: int, until: Instant) -> None:
        """Ask the world to let `robot` hear no beacon until then."""
        self.bus.publish(self._keys.silence, wire.Silence(robot, until))

    def ask_world_to_stop(self, reason: str) -> None:
        """Ask the world for an orderly end."""
        self.ask_to_stop(WORLD, reason)

    def close(self) -> None:
        """Leave the bus."""
        self.bus.close()

"""A robot's connection to the bus: it waits for its world, runs its node, and outlives the world.

    waiting     no world (yet, or any more): the process reports it and keeps trying
    ready       the world has accepted it, its body answers, lab time is known
    running     lab time runs and so does the node
    finished    running, and the lab's finish fact holds

A world that dies and returns, or another in its place, is a new run with a new clock and new poses, so the
robot then begins a new incarnation: a fresh node from the same byte-code. A mere loss of the connection ends
nothing: the same world, known by the number of its session, goes on with the same node.
"""

import asyncio
import contextlib
import logging
import random
import time
from typing import Any

from rmr.bus import wire
from rmr.bus.keys import ANY_LAB, ROBOT_ROLE, Keys
from rmr.bus.losses import Losses
from rmr.bus.process import Ending, LogFile, Throttle
from rmr.bus.process_recorder import ProcessRecorder
from rmr.bus.session import Bus
from rmr.entry import ExitCode
from rmr.mind.journal import DurableState, JournalError
from rmr.node.config import NodeConfig
from rmr.node.report import off_m, progress, robot_report
from rmr_agent.bus_ports import WorldActions
from rmr_agent.bytecode import RefusedError, check_actions
from rmr_agent.clock import LabClock
from rmr_agent.incarnation import Incarnation, Outlets, configuration, floor_grid, make_station, phase_of
from rmr_agent.local_air import LocalAir, announced
from rmr_agent.robot_recording import RobotRecording
from rmr_agent.robot_setup import RobotSetup, make_security
from rmr_agent.robot_telling import StatusPublisher, failure_words
from rmr_agent.state_folder import StateFullError, begun_header

SAY_AGAIN_S = 5.0
"""Period of the message that the robot waits for its world."""

ASK_S = 1.0
"""Limit for an answer of the world."""


FAILURES_MAX = 20
"""Bound of the different action failures shown on standard error; the log has them all."""

log = logging.getLogger("rmr")


class HostedRobot:
    """One robot of the process, with a seat of its own on the bus."""

    def __init__(
        self,
        robot: int,
        first: int,
        bus: Bus,
        connect: str,
        lab: str | None,
        setup: RobotSetup,
        ending: Ending,
        recorder: ProcessRecorder | None = None,
    ) -> None:
        """`first` is the first robot of the process; `recorder` is shared by all of them."""
        self._robot = robot
        self._first = first
        self._connect = connect
        self._setup = setup
        self._ending = ending
        self.leaving = Ending()
        """This robot's end; the process goes on while others live in it."""
        self._keys = Keys(lab or ANY_LAB)
        self._world: int | None = None
        """The session of the robot's world; others may answer in its name."""
        self._token = random.SystemRandom().getrandbits(48)
        self._clock = LabClock()
        self._clock_news = asyncio.Event()
        self._rejoin = asyncio.Event()
        self._waiting = Throttle(self._say_waiting, SAY_AGAIN_S)
        self._lost = False
        self._restarts = 0
        self._incarnation: Incarnation | None = None
        self._actions = WorldActions(
            lambda wish: bus.publish(self._keys.act(robot), wish), lambda: self._clock.at(time.monotonic_ns())
        )
        self._recording = RobotRecording(robot, recorder)
        self._last_published: tuple[Any, ...] = ()
        self._published_s = 0.0
        self._failures: list[str] = []
        self._bus = bus
        self._publisher = StatusPublisher(bus, self._say_failure)

    def _say_waiting(self) -> None:
        whose = "the" if self._keys.lab == ANY_LAB else f"lab {self._keys.lab}'s"
        log.info("waiting for %s world at %s: a zenoh router answers there, but no such world", whose, self._connect)

    # -- from nothing to a place in the lab -------------------------------------------------------------------

    async def run(self) -> None:
        """Live until the end is asked for: by `leaving`, which others may ask, too."""
        tasks: list[asyncio.Future[None]] = []
        try:
            await self.leaving.unless_asked(asyncio.ensure_future(self._lives_in_a_row(tasks)))
        finally:
            for task in tasks:
                task.cancel()
            await self._leave()

    async def _lives_in_a_row(self, tasks: list[asyncio.Future[None]]) -> None:
        while True:
            self._rejoin.clear()
            known = await self._join()
            if not tasks:
                self._listen()
                tasks += [asyncio.ensure_future(self._keep_time()), asyncio.ensure_future(self._tell())]
            if known.run != self._world:
                self._world = known.run
                self._begin(known)
            elif self._lost:
                log.info("the world is back; robot %d goes on", self._robot)
                self._doubt_time()
            self._disturb(known.body)
            self._lost = False
            await self._rejoin.wait()

    async def _join(self) -> wire.Envelope:
        """Return what the world tells the robot, in its envelope. A refusal asks for the end of the process.

        While the robot's world so far answers, no other session counts, and what tells of another lab than was asked
        for is no answer.
        """
        # An id may stay taken for so long: the world notices within it that its last bearer was killed.
        patience_s = time.monotonic() + 2.0
        while True:
            replies = await self._bus.ask(self._keys.map(self._robot), wire.AskMap(self._robot, self._token), ASK_S)
            maps = [(envelope, envelope.body) for envelope, _ in replies if isinstance(envelope.body, wire.Map)]
            maps = [answer for answer in maps if self._keys.lab in (ANY_LAB, answer[1].lab)]
            maps = [answer for answer in maps if answer[0].run == self._world] or maps
            labs = sorted({known.lab for _, known in maps})
            if len(labs) > 1:
                self._ending.ask(
                    f"several labs run at {self._connect}: {', '.join(labs)}; choose with --lab", ExitCode.USAGE
                )
            elif not maps:
                self._waiting()
                self._say_not_understood()
            elif self._accepted(maps[0][1], patience_s):
                self._keys = Keys(maps[0][1].lab)
                self._waiting.over()
                return maps[0][0]
            await asyncio.sleep(0.25)  # pause between requests while there is no world

    def _say_not_understood(self) -> None:
        """Say once what is wrong with an answer that is no map: its world may be of another version of rmr."""
        if self._bus.losses.malformed_last.startswith("Map:"):
            what = self._bus.losses.malformed_last
            self._say_failure(f"what answers at {self._connect} is no world that this robot understands ({what})")

    def _accepted(self, known: wire.Map, patience_s: float) -> bool:
        robot = self._robot
        if not known.listed:
            roster = ", ".join(map(str, known.roster))
            self._ending.ask(f"lab {known.lab} has no robot {robot}; its robots are {roster}", ExitCode.USAGE)
        elif not known.taken:
            return True
        elif time.monotonic() > patience_s:
            self._ending.ask(
                f"robot {robot} of lab {known.lab} is taken: another process is it already", ExitCode.FAILED
            )
        return False

    def _listen(self) -> None:
        """Subscribe to all but the air, once: what is declared is declared again after a loss of the connection."""
        bus = self._bus
        keys = self._keys
        bus.subscribe(keys.call(self._robot, "*" if bus.keyed else ""), self._on_air)
        bus.subscribe(keys.sense(self._robot), self._on_sense)
        bus.subscribe(keys.clock, self._on_clock)
        bus.subscribe(keys.disturbances, self._on_disturbances)
        bus.subscribe(keys.stop(self._robot), self._on_stop)
        bus.subscribe(keys.load(self._robot), self._on_load)
        bus.declare_alive(keys.alive(ROBOT_ROLE, self._robot))
        bus.watch_alive(keys.world_alive, self._on_world)
        bus.on_transport = self._on_transport

    def _begin(self, envelope: wire.Envelope) -> None:
        """Begin an incarnation in the world that sent `envelope`."""
        known = envelope.body
        assert isinstance(known, wire.Map)
        if self._incarnation is not None:
            self._incarnation.end()
            log.info("another run has begun; robot %d starts anew", self._robot)
        try:
            loaded, fresh, key, _ = self._setup
            phase = phase_of(self._first, known.roster)
            config, configure = configuration(self._robot, known, loaded, phase)
            security = make_security(self._robot, known, envelope.run, key)
            station = make_station(config, known.radio, security)
            send = Outlets(
                LocalAir(self._bus, self._keys, floor_grid(config), self._on_air, self._robot),
                lambda body: self._bus.publish(self._keys.act(self._robot), body),
                lambda body: self._bus.publish(self._keys.answers(self._robot), body),
            )
            handlers = self._actions.handlers(known.performs) | fresh()
            check_actions(loaded.program, handlers)
            # The log of a mind begins with its program: a robot that has waited for one is not recorded.
            minds = None if configure else self._recording.open(known, envelope.run, self._clock)

            def made(own: NodeConfig, state: DurableState | None = None) -> Incarnation:
                rest = (self._clock, send, self._fail, minds, state, configure)
                return Incarnation(own, loaded, handlers, station, *rest)

            if (folder := self._setup.states.get(self._robot)) is None:
                self._incarnation = made(config)
            else:
                header = begun_header(config, loaded, handlers, station.payload_max, known.lab, envelope.run)
                self._incarnation = folder.go_on(header, config, made)
        except (RefusedError, JournalError) as error:
            self._ending.ask(f"lab {known.lab}: {error}", ExitCode.INVALID)
            return
        self._recording.follow(self._incarnation)
        self._restarts = known.lives
        self._bus.losses = Losses()  # what the last run lost is not this one's
        self._clock.forget()
        self._clock_news.set()
        log.info("robot %d is in lab %s%s", self._robot, known.lab, self._incarnation.resumption)
        if configure:
            log.info("robot %d waits for a program: rmr load PROG.rbc", self._robot)

    def _fail(self, error: BaseException) -> None:
        if isinstance(error, StateFullError):
            self._ending.ask(str(error), ExitCode.FAILED)
        else:
            self._ending.break_down(error)

    # -- what comes in ------------------------------------------------------------------------------------------

    def _on_sense(self, _key: str, message: wire.Envelope) -> None:
        if self._incarnation is not None and isinstance(message.body, wire.Sense):
            self._incarnation.sense(message.body)
        elif self._incarnation is not None and isinstance(message.body, wire.Performed):
            self._actions.heard(message.body)
            self._incarnation.wake()

    def _on_air(self, _key: str, message: wire.Envelope) -> None:
        announcement = announced(message, self._bus.losses)
        if self._incarnation is not None and announcement is not None:
            self._incarnation.hear(announcement)

    def _on_clock(self, _key: str, _message: wire.Envelope) -> None:
        self._doubt_time()

    def _doubt_time(self) -> None:
        """Ask for lab time anew: it has started, stopped, or perhaps jumped."""
        self._clock.doubt()
        self._clock_news.set()

    def _on_disturbances(self, _key: str, message: wire.Envelope) -> None:
        if message.run == self._world:
            self._disturb(message.body)

    def _disturb(self, told: wire.Message) -> None:
        """Take over what disturbs the radio, as the map or the world's news have it."""
        if self._incarnation is not None and isinstance(told, wire.Map | wire.Disturbances):
            self._incarnation.disturb(told.disturbances if isinstance(told, wire.Map) else told.held)

    def _on_stop(self, _key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Stop):
            self.leaving.ask(message.body.reason or "asked to stop")

    def _on_load(self, _key: str, message: wire.Envelope) -> None:
        if self._incarnation is not None:
            self._incarnation.load(message.body)

    def _on_world(self, _key: str, alive: bool) -> None:
        if alive:
            self._rejoin.set()
        elif not self.leaving.asked:
            self._lost = True
            what = f"lab {self._keys.lab}'s world" if self._bus.connected else "the connection"
            log.info("lost %s at %s; waiting for it to return", what, self._connect)

    def _on_transport(self, up: bool) -> None:
        if up:
            self._rejoin.set()

    # -- lab time -------------------------------------------------------------------------------------------------

    async def _keep_time(self) -> None:
        """Ask for lab time, often at first and now and then later."""
        while True:
            self._clock_news.clear()
            burst = 1 if self._clock.delay is not None else 5  # questions in a row when nothing is known of lab time
            for _ in range(burst):
                await self._ask_time()
            if self._incarnation is not None:
                self._incarnation.wake()
            # While lab time stands it is asked for more often; two clocks drift 0.1 ms apart in 2 s.
            period_s = 2.0 if self._clock.running else 0.5
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._clock_news.wait(), period_s)

    async def _ask_time(self) -> None:
        asked = time.monotonic_ns()
        for envelope, received in await self._bus.ask(self._keys.clock, wire.AskClock(), ASK_S):
            body = envelope.body
            if isinstance(body, wire.Clock) and envelope.run == self._world:
                self._clock.sample(body.state, asked, body.arrived, body.stamp, received)

    # -- what goes out ----------------------------------------------------------------------------------------------

    async def _tell(self) -> None:
        """Publish the robot's state at changes and twice a second."""
        while True:
            await asyncio.sleep(0.25)  # period of the check whether the status has changed
            await self._publish_status(final=False)

    async def _publish_status(self, *, final: bool) -> None:
        incarnation = self._incarnation
        if incarnation is None:
            return
        incarnation.commit()
        now = incarnation.now()
        finished = incarnation.started and incarnation.node.finished()
        state = self._state(finished=finished, final=final)
        waits = "waits for a program" if incarnation.programs.waits else ""
        news = (state, progress(incarnation.node, now) if incarnation.started else waits, finished)
        due = time.monotonic() - self._published_s >= 0.5  # also without a change
        self._log_trace(incarnation)
        self._recording.status(now)
        if not (final or due or news != self._last_published):
            return
        self._last_published = news
        self._published_s = time.monotonic()
        status = wire.Status(state, news[1], finished, final, now, {})
        await self._publisher.tell(self._keys.status(self._robot), status, lambda: self._report(incarnation))

    def _report(self, incarnation: Incarnation) -> dict[str, Any]:
        malformed = self._bus.losses.malformed + incarnation.link.malformed
        bus: dict[str, Any] = {"lost": self._bus.losses.lost, "malformed": malformed}
        bus |= {"excess": excess} if (excess := self._bus.excess) else {}
        host = {"bus": bus, "late_samples": incarnation.late_samples.count} | incarnation.resumed
        host |= {"log_cut_short": LogFile.failure} if LogFile.failure else {}
        if not incarnation.started:
            return host
        host["off_m"] = off_m(incarnation.node, incarnation.body.place)
        return robot_report(incarnation.node, incarnation.link.station.counters.as_dict(), self._restarts) | host

    def _state(self, *, finished: bool, final: bool) -> str:
        assert self._incarnation is not None
        if final:
            return "stopped" if self.leaving.code == 0 else "failed"
        if not self._incarnation.ready:
            return "waiting"
        if not self._incarnation.started:
            return "ready"
        return "finished" if finished else "running"

    def _log_trace(self, incarnation: Incarnation) -> None:
        """Write what the node has noted since the last time into the log."""
        if incarnation.link.station.mute:
            self._say_failure("the radio's frame counter is used up: the robot sends nothing more; start it again")
        self._recording.trace(incarnation.node.trace_log)
        for entry in incarnation.node.trace_log:
            log.debug("%s", entry.get("what", ""), extra={"data": entry})
            if entry.get("what") == "finished":
                log.info("finished at %.1f s of lab time", entry["t"])
            elif (failure := failure_words(entry)) is not None:
                self._say_failure(failure)
        incarnation.node.trace_log.clear()

    def _say_failure(self, message: str) -> None:
        """Say once what has gone wrong: a program that tries again and again does not fill the screen."""
        if message not in self._failures and len(self._failures) < FAILURES_MAX:
            self._failures.append(message)
            log.warning("%s", message)

    async def _leave(self) -> None:
        """Tell for the last time."""
        if self._incarnation is not None:
            self._incarnation.end()
            await self._publish_status(final=True)
            self._recording.end()
            await asyncio.sleep(0.05)  # time for the final status to be sent before the session is closed
        self._bus.close()

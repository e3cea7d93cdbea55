"""The world as a process: lab time, physics in real time, sensor samples, and ground truth for operators.

The physics is stepped tick by tick of lab time. Late ticks are caught up, a bounded number at a time, and counted. A
world that is more than `BEHIND_MAX` behind sets lab time back instead. Each robot that is alive gets its sensor
samples, 60 a second while it moves and fewer while it is at rest.

A process claims the identity of a robot with its request for the map: the first one is that robot while its liveliness
token exists. Tokens that vanish while the world itself has lost its router are ignored.
"""

import asyncio
import logging
import time
from typing import TYPE_CHECKING, Any

from rmr.base.geometry import STILL, Pose, Twist
from rmr.base.time import NS_PER_S, TICK_HZ, Instant, in_seconds, milliseconds, tick_index, tick_start
from rmr.bus import wire
from rmr.bus.keys import ROBOT_ROLE, WORLD, Keys, last_id
from rmr.bus.late_messages import LateCommands
from rmr.bus.middleware import LEASE_MS
from rmr.bus.process import Ending, LogFile
from rmr.bus.process_recorder import ProcessRecorder
from rmr.bus.session import Bus
from rmr.entry import ExitCode
from rmr.radio.phy import NETWORK
from rmr_world.all_bodies import AllBodies
from rmr_world.disturbances import DisturbanceList
from rmr_world.faults import fault_entry, fault_line
from rmr_world.incarnation_claims import IncarnationClaims
from rmr_world.lab import Lab
from rmr_world.lab_time import LabTime
from rmr_world.physics import World
from rmr_world.world_messages import WorldRecorder, map_of, sense_of, truth_of
from rmr_world.world_state import SAVE_EVERY, WorldFolder

if TYPE_CHECKING:
    from rmr_ros.ros_bridge import RosBridge

CATCH_UP_MAX = 10
"""Late ticks that are caught up before the bus is served again."""

BEHIND_MAX = 60
"""Late ticks that are caught up at all; a world further behind sets lab time back."""

STANDING_EVERY = 4
"""A robot at rest gets every fourth sample: 15 a second."""

TRUTH_EVERY = 6
"""Ground truth is published at every sixth tick: 10 times a second."""

STATUS_S = 0.5
"""Period of the world's own status. Before lab time runs, samples have a third of this period."""

JUDGE_S = 0.2
"""Delay from the loss of a token to the decision on it: a loss of the world's own connection shows within this time."""

BACK_S = 3.0
"""Time for robots to return to a world that goes on: they try again once a second."""


log = logging.getLogger("rmr")


class WorldServer:
    """One lab's world on the bus."""

    def __init__(
        self,
        lab: Lab,
        seed: int,
        bus: Bus,
        ending: Ending,
        *,
        when_ready: bool,
        recorder: ProcessRecorder | None = None,
        folder: WorldFolder | None = None,
        bridge: "RosBridge | None" = None,
    ) -> None:
        """With a `folder` the world is durable, and goes on from what that holds. `bridge`: what is in ROS 2."""
        self._lab = lab
        self._seed = seed
        self._bus = bus
        self._ending = ending
        self._when_ready = when_ready
        self._keys = Keys(lab.name)
        self._physics = World(lab, seed)
        self._disturbances = DisturbanceList(
            lab.name, lab.roster, lab.disturbances, network=lab.radio.config.mode == NETWORK
        )
        self._time = LabTime()
        self._tick = 0
        self._begun: Instant = 0
        """Lab time when this process began to be the world."""
        self._late = 0
        self._late_commands = LateCommands()
        self._set_back = 0
        self._alive: set[int] = set()
        self._vanished: set[int] = set()
        """Robots whose token has vanished and that are not given up yet."""
        self._incarnations = IncarnationClaims()
        self._bodies = AllBodies(self._physics, bridge)
        self._ready: set[int] = set()
        self._commanded: dict[int, Twist] = {}
        self._seen: dict[int, Pose] = {}
        self._map = map_of(lab, seed)
        self._recorder = WorldRecorder(recorder, lab, seed, lambda: bus.run)
        self._folder = folder
        self._awaited: frozenset[int] = frozenset()
        """Robots that were there when the world was interrupted."""
        if folder is not None and folder.held is not None:
            self._go_on(folder.held)

    def _go_on(self, held: dict[str, Any]) -> None:
        """Take over the state of an interrupted world; lab time stands until `_drive`."""
        self._bus.go_on_as(held["run"])
        self._late = held["late"]
        self._set_back = held["set_back"]
        self._disturbances.bring_back(held["added"])
        if not held["runs"]:
            return
        self._tick = held["tick"] + SAVE_EVERY
        self._begun = now = tick_start(self._tick)
        self._physics.bring_back(self._tick, held)
        self._incarnations.bring_back(held["lives"], now)
        self._awaited = frozenset(held["here"])
        self._time.stand(now)
        log.info("the world goes on as it was at %.3f s of lab time", in_seconds(now))

    def _keep(self) -> None:
        """Write the state, if the world is durable."""
        if self._folder is None:
            return
        state: dict[str, Any] = {"run": self._bus.run, "runs": self._time.state != "waiting", "tick": self._tick}
        state |= {"here": sorted(self._alive), "lives": self._incarnations.kept(), "added": self._disturbances.kept()}
        state |= {"late": self._late, "set_back": self._set_back}
        try:
            self._folder.write(state | self._physics.kept())
        except OSError as error:
            why = f"the world's state cannot be written to {self._folder.path}: {error.strerror}"
            self._ending.ask(why, ExitCode.FAILED)

    async def _until_back(self) -> None:
        """Let lab time stand until the robots that were there are back, `BACK_S` at most."""
        end = time.monotonic() + BACK_S
        while not self._awaited <= self._alive and time.monotonic() < end:
            await asyncio.sleep(JUDGE_S / 4)
        self._time.go_on(time.monotonic_ns())
        self._publish_clock()
        log.info("lab time runs")

    # -- run ------------------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Serve until the process is asked to end."""
        self._serve()
        self._recorder.begin(lambda: self._time.at(time.monotonic_ns()), self._poses())
        tasks = [asyncio.ensure_future(job) for job in (self._drive(), self._publish_periodically())]
        if not self._when_ready and self._time.state == "waiting":
            self._start()
        ended = asyncio.ensure_future(self._ending.wait())
        await asyncio.wait([*tasks, ended], return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            if task.done() and (error := task.exception()) is not None:
                self._ending.break_down(error)
            task.cancel()
        await self._leave()

    def _serve(self) -> None:
        """Declare all keys. The liveliness token comes last, for a process that sees it may send requests at once."""
        bus = self._bus
        keys = self._keys
        bus.subscribe(keys.acts, self._on_act)
        bus.subscribe(keys.statuses, self._on_status)
        bus.subscribe(keys.stop(WORLD), self._on_stop)
        bus.subscribe(keys.silence, self._on_silence)
        bus.serve(keys.map("*"), self._answer_map)
        bus.serve(keys.clock, self._answer_clock)
        bus.serve(keys.disturbances, self._answer_disturbances)
        bus.watch_alive(keys.alive(ROBOT_ROLE, "*"), self._on_alive)
        bus.declare_alive(keys.world_alive)

    def _start(self) -> None:
        # Delay from the decision to start to lab time 0, within which the start reaches all robots.
        self._time.start(time.monotonic_ns(), milliseconds(100))
        self._publish_clock()
        log.info("lab time runs")
        for given in self._disturbances.given:
            log.info("the lab file disturbs the radio: %s", fault_line(fault_entry(given)))

    async def _leave(self) -> None:
        """Stop lab time, publish the last messages, leave."""
        self._time.stop(time.monotonic_ns())
        self._keep()
        self._publish_clock()
        self._publish_status(final=True)
        self._publish_truth(final=True)  # the last message: its receivers have all others by then
        await asyncio.sleep(0.05)  # time for the last messages to be sent before the session is closed

    # -- requests ---------------------------------------------------------------------------------------------

    def _answer_map(self, message: wire.Envelope, _arrived: int) -> wire.Message | None:
        if not isinstance(message.body, wire.AskMap) or message.body.robot != message.sender:
            return None
        robot, token = message.body
        known = self._map._replace(clock=self._time.state, disturbances=self._disturbances.held)
        if robot not in self._lab.roster:
            return known._replace(listed=False)
        alive = robot in self._alive and robot not in self._vanished
        taken = not self._incarnations.claim(robot, token, time.monotonic(), alive=alive)
        lives, ended = self._incarnations.life(robot, token)
        known = known._replace(navigates=any(body.robot == robot and body.navigate for body in self._lab.bodies))
        return known._replace(taken=taken, lives=lives, predecessor_ended=ended)

    def _answer_clock(self, message: wire.Envelope, arrived: int) -> wire.Message | None:
        if not isinstance(message.body, wire.AskClock):
            return None
        return wire.Clock(self._time.state, self._time.at(arrived), self._time.at(time.monotonic_ns()))

    def _answer_disturbances(self, message: wire.Envelope, _arrived: int) -> wire.Message | None:
        """Perform a request of `rmr fault`, or refuse it with the reason; a change is published before the answer."""
        if not isinstance(message.body, wire.AskDisturbances):
            return None
        wish, wanted = message.body
        disturbed = self._disturbances
        now = self._bounded_now()
        refused = ""
        before = disturbed.held
        if wish == "clear":
            disturbed.clear(now)
            self._recorder.fault(now, {"clear": "all"})
            log.info("rmr fault ends all that it has added, at %.3f s of lab time", in_seconds(max(0, now)))
        elif wish == "add" and wanted is not None:
            refused = disturbed.add(wanted, now)
            if not refused:
                self._recorder.added(now, disturbed.added[-1])
                log.info("rmr fault disturbs the radio: %s", fault_line(fault_entry(disturbed.added[-1])))
        if disturbed.held != before:
            self._publish_disturbances()
        return self._disturbances_message(refused)

    # -- input ------------------------------------------------------------------------------------------------

    def _on_act(self, _key: str, message: wire.Envelope) -> None:
        body = message.body
        if message.sender not in self._alive or self._time.state != "running":
            return
        if isinstance(body, wire.Perform):
            self._perform(message.sender, message.run, body)
        elif isinstance(body, wire.Act):
            self._commanded[message.sender] = twist = Twist(body.v, body.w)
            now = self._time.at(time.monotonic_ns())
            self._late_commands.note(message.sender, body.stamp, now)
            self._bodies.act(message.sender, twist, body.stamp, now)

    def _perform(self, robot: int, run: int, wish: wire.Perform) -> None:
        """Carry out what a robot has said now, or says again: a world that was killed meanwhile does not know of it."""
        if wish.name is not None and wish.begun < self._begun:
            lost = wire.Performed(wish.serial, "the world was started again meanwhile")
            self._bus.publish(self._keys.sense(robot), lost)
        else:
            self._bodies.perform((robot, run, wish.serial), wish.name, wish.args)

    def _on_status(self, _key: str, message: wire.Envelope) -> None:
        body = message.body
        if isinstance(body, wire.Status) and body.state == "ready" and message.sender in self._lab.roster:
            self._ready.add(message.sender)
            if self._when_ready and self._time.state == "waiting" and self._ready >= set(self._lab.roster):
                self._start()

    def _on_stop(self, _key: str, message: wire.Envelope) -> None:
        if isinstance(message.body, wire.Stop):
            self._ending.ask(message.body.reason or "asked to stop")

    def _on_silence(self, _key: str, message: wire.Envelope) -> None:
        body = message.body
        if isinstance(body, wire.Silence) and body.robot in self._lab.roster:
            self._physics.silence(body.robot, body.until)
            log.info("robot %d hears no beacon until %.3f s of lab time", body.robot, in_seconds(body.until))

    def _on_alive(self, key: str, alive: bool) -> None:
        robot = last_id(key)
        if robot is None or robot not in self._lab.roster:
            return
        if not alive:
            self._vanished.add(robot)
            self._incarnations.vanished(robot, self._bounded_now())
            asyncio.get_running_loop().call_later(JUDGE_S, self._judge, robot)
            return
        self._vanished.discard(robot)
        if robot not in self._alive:
            self._alive.add(robot)
            log.info("robot %d is here", robot)
        self._publish_sense(robot)

    def _judge(self, robot: int) -> None:
        """Decide whether a robot whose token has vanished has left."""
        if self._ending.asked or robot not in self._vanished:
            return
        if self._bus.is_client and not self._bus.connected:
            asyncio.get_running_loop().call_later(LEASE_MS / 1000, self._judge, robot)
            return
        self._vanished.discard(robot)
        self._alive.discard(robot)
        self._ready.discard(robot)
        self._incarnations.release(robot)
        log.info("robot %d has left", robot)

    # -- physics ------------------------------------------------------------------------------------------------

    async def _drive(self) -> None:
        """Step the physics in lab time; before that runs, publish samples so that robots can localise themselves."""
        self._keep()
        if self._time.stands:
            await self._until_back()
        while self._time.state != "running":
            self._bodies.carry(0)
            self._bodies.show(0, self._alive)
            for robot in sorted(self._alive):
                self._publish_sense(robot)
            await asyncio.sleep(STATUS_S / 3)
        while True:
            due = tick_start(self._tick + 1) - self._time.at(time.monotonic_ns())
            await asyncio.sleep(max(0, due) / NS_PER_S)
            if due <= 0:
                self._catch_up()

    def _catch_up(self) -> None:
        """Step the ticks that are due, at most `CATCH_UP_MAX`."""
        behind = tick_index(self._time.at(time.monotonic_ns())) - self._tick
        if behind > BEHIND_MAX:
            self._time.set_back((behind - 1) * NS_PER_S // TICK_HZ)
            self._set_back += 1
            log.warning("the world was held up for %.1f s; lab time is set back", (behind - 1) / TICK_HZ)
            self._publish_clock()
            behind = 1
        ticks = min(behind, CATCH_UP_MAX)
        self._late += min(ticks, behind - 1)
        for _ in range(ticks):
            self._tick += 1
            self._bodies.carry(tick_start(self._tick))
            for (ended, _, serial), failure in self._bodies.performed():
                self._bus.publish(self._keys.sense(ended), wire.Performed(serial, failure))
            self._physics.step(tick_start(self._tick))
        self._bodies.show(tick_start(self._tick), self._alive)
        for robot in sorted(self._alive):
            if self._due(robot, ticks):
                self._publish_sense(robot)
        if self._crossed(SAVE_EVERY, ticks):
            self._keep()
        if self._crossed(TRUTH_EVERY, ticks):
            self._publish_truth(final=False)
            self._recorder.poses(tick_start(self._tick), self._poses())

    def _poses(self) -> list[tuple[int, Pose]]:
        return [(robot, self._physics.pose(robot)) for robot in self._lab.roster]

    def _crossed(self, every: int, ticks: int) -> bool:
        return self._tick // every != (self._tick - ticks) // every

    def _due(self, robot: int, ticks: int) -> bool:
        """Return whether `robot` gets a sample now: always while it moves or is commanded, else every fourth tick."""
        if self._commanded.get(robot, STILL) != STILL or self._seen.get(robot) != self._physics.pose(robot):
            return True
        return (self._tick + robot) // STANDING_EVERY != (self._tick + robot - ticks) // STANDING_EVERY

    # -- output ----------------------------------------------------------------------------------------------------

    def _publish_clock(self) -> None:
        now = self._time.at(time.monotonic_ns())
        self._bus.publish(self._keys.clock, wire.Clock(self._time.state, now, now))

    def _disturbances_message(self, refused: str = "") -> wire.Disturbances:
        disturbed = self._disturbances
        now = self._bounded_now()
        return wire.Disturbances(self._lab.name, now, disturbed.held, len(disturbed.given), refused)

    def _bounded_now(self) -> Instant:
        """Return lab time, limited to what the physics can catch up: later times are about to be set back.

        With such a time, disturbances that are still active would be dropped, and new ones would begin too late.
        """
        return min(self._time.at(time.monotonic_ns()), tick_start(self._tick + BEHIND_MAX))

    def _publish_disturbances(self) -> None:
        self._bus.publish(self._keys.disturbances, self._disturbances_message())

    def _publish_sense(self, robot: int) -> None:
        self._seen[robot] = self._physics.pose(robot)
        if (sample := self._bodies.sense(robot, tick_start(self._tick))) is not None:
            self._bus.publish(self._keys.sense(robot), sense_of(sample))

    def _publish_truth(self, *, final: bool) -> None:
        truth = truth_of(self._physics, self._lab.roster, tick_start(self._tick), self._late, final=final)
        self._bus.publish(self._keys.truth, truth)

    async def _publish_periodically(self) -> None:
        """Publish the status, and the disturbances and poses where they are due, every `STATUS_S` seconds."""
        while True:
            self._publish_status(final=False)
            self._disturbances.forget(self._bounded_now())
            if self._disturbances.touched:  # repeated, for robots that started in between or lost a message
                self._publish_disturbances()
            if self._time.state != "running":
                self._publish_truth(final=False)
            await asyncio.sleep(STATUS_S)

    def _publish_status(self, *, final: bool) -> None:
        now = self._time.at(time.monotonic_ns())
        here = f"{len(self._alive)} of {len(self._lab.roster)} robots"
        state = "stopped" if final else "ready" if self._time.state == "waiting" else "running"
        status = wire.Status(state, f"{in_seconds(max(0, now)):.1f} s, {here}", False, final, now, self._report())
        self._bus.publish(self._keys.status(WORLD), status)

    def _report(self) -> dict[str, Any]:
        return {
            "ros2": self._bodies.report(),
            "alive": sorted(self._alive),
            "ready": sorted(self._ready),
            "contacts": [list(contact) for contact in self._physics.contacts[:100]],
            "late_commands": self._late_commands.report(),
            "ticks_late": self._late,
            "set_back": self._set_back,
            "faults": [fault_entry(one) for one in self._disturbances.history],
            "log_cut_short": LogFile.failure,
            "bus": {"lost": self._bus.losses.lost, "malformed": self._bus.losses.malformed, "excess": self._bus.excess},
        }

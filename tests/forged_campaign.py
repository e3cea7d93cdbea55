"""Forged messages from a holder of the bus's secret, upon a real world, real robots and a launcher's view of them.

Every message is drawn within its type: what the strict decoding takes. Half of them carry the number of their alleged
sender's session, as somebody could who listens; statuses do not, for such a one is the sender's by all that there is to
see. A rival answers beside the world whatever is asked for, maps and lab time, too, and announces itself as a world
now and then; robots ask for their map again as after a lost connection. Wheel commands are obeyed, as from the robot
itself. No other order that is obeyed is among them (a stop, an outage without end, another program): what comes of it
is no lie. Meanwhile the lab runs. At the end nothing may have ended, and what the launcher knows of each robot is what
that robot tells (`problems`).

Run as a program for a long campaign: ``python forged_campaign.py SEED [MESSAGES]``.
"""

import asyncio
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

from rmr.base.time import NEVER, NS_PER_S, seconds
from rmr.bus import wire
from rmr.bus.checks import COUNT_MAX, QUANTITY_MAX
from rmr.bus.keys import WORLD_ROLE, Keys
from rmr.bus.losses import SENT_AT_ONCE, SENT_PER_S
from rmr.bus.process import Ending
from rmr.bus.session import Bus, open_bus
from rmr.lang.compiler import compile_file
from rmr.radio.air import PLACE_MAX_M, Announcement
from rmr.radio.frame import encode_ack
from rmr.radio.links import Disturbance
from rmr.radio.phy import airtime
from rmr_agent.bytecode import Loaded
from rmr_agent.robot import HostedRobot
from rmr_agent.robot_setup import RobotSetup
from rmr_deploy.preparation import free_port
from rmr_deploy.status_monitor import StatusMonitor
from rmr_world.lab_file import load_lab
from rmr_world.server import WorldServer

LAB = Path(__file__).parent / "integration" / "labs" / "dash"
ROBOTS = (1, 2, 3)
KEYS = Keys("dash")
AT_ONCE = 25
"""Messages between two pauses."""
PAUSE_S = 0.01
SETTLED_S = 20.0
"""Time within which all is as it was, at the end."""
STREAMS = 64
"""Bound of senders times keys that a process listens to here."""


class Forger:
    """Draws messages."""

    def __init__(self, seed: int, runs: dict[int, int], lab_now: Callable[[], int]) -> None:
        """`runs` are the numbers of the sessions that are there, by sender; `lab_now` is lab time."""
        self._rng = Random(f"{seed}/forged")
        self._runs = runs
        self._lab_now = lab_now

    def _size(self, least: float, most: float) -> float:
        rng = self._rng
        ends = [least, most, 0.0, 5e-324, rng.uniform(least, most), rng.uniform(-1, 1), rng.gauss(0, 1e4)]
        return min(most, max(least, rng.choice(ends)))

    def _quantity(self) -> float:
        return self._size(-QUANTITY_MAX, QUANTITY_MAX)

    def _place(self) -> float:
        return self._size(-PLACE_MAX_M, PLACE_MAX_M) * 0.999

    def _count(self) -> int:
        rng = self._rng
        return rng.choice([0, 1, rng.randrange(100), rng.randrange(COUNT_MAX), COUNT_MAX])

    def _instant(self) -> int:
        rng = self._rng
        near = self._lab_now() + round(rng.gauss(0, NS_PER_S))
        return rng.choice([near, near, near, 0, -NEVER, NEVER, rng.randrange(-NEVER, NEVER)])

    def _sense(self) -> tuple[str, int, wire.Message]:
        rng = self._rng
        true = rng.random() < 0.5  # most fields are what a body may produce: one that is not shows
        far = 2.0 if true else QUANTITY_MAX
        ranges = [(rng.randrange(5), self._size(0.0, far)) for _ in range(rng.randrange(4))]
        bodies = [tuple(self._quantity() for _ in range(4)) for _ in range(rng.randrange(3))]
        wheels = [rng.uniform(0, 1) if true else self._quantity() for _ in range(4)]
        truth = (self._place(), self._place(), self._quantity())
        robot = rng.choice(ROBOTS)
        body = wire.Sense(self._instant(), *wheels, tuple(ranges), tuple(bodies), rng.random() < 0.2, truth)
        return KEYS.sense(robot), wire.WORLD_ID, body

    def _act(self) -> tuple[str, int, wire.Message]:
        robot = self._rng.choice(ROBOTS)
        return KEYS.act(robot), robot, wire.Act(self._quantity(), self._quantity(), self._instant())

    def _status(self) -> tuple[str, int, wire.Message]:
        rng = self._rng
        who = rng.choice((*ROBOTS, wire.WORLD_ID, 9))
        report: dict[str, Any] = rng.choice([{}, {"restarts": self._count(), "facts": ["at(@1, goal)"]}])
        flags = (rng.random() < 0.5, rng.random() < 0.5)
        body = wire.Status(rng.choice(wire.STATES), "forged", *flags, self._instant(), report)
        return KEYS.status("world" if who < 0 else who), who, body

    def _truth(self) -> tuple[str, int, wire.Message]:
        bodies = tuple((robot, self._place(), self._place(), 0.0, abs(self._quantity())) for robot in ROBOTS)
        return KEYS.truth, wire.WORLD_ID, wire.Truth(self._instant(), bodies, self._count(), None, self._count(), False)

    def _radio(self) -> tuple[str, int, wire.Message]:
        rng = self._rng
        octets = encode_ack(rng.randrange(256))
        start = max(0, self._lab_now() + round(rng.gauss(0, 10 * NS_PER_S)))
        x, y = rng.uniform(0, 1.5), rng.uniform(0, 1.2)
        source = rng.choice(ROBOTS)
        announced = Announcement(source, 1, 0, start, start + airtime(len(octets)), 0.0, x, y, octets)
        return KEYS.call(rng.choice(ROBOTS)), source, wire.Handshake(announced)

    def _clock(self) -> tuple[str, int, wire.Message]:
        news = wire.Clock(self._rng.choice(wire.CLOCK_STATES), self._instant(), self._instant())
        return KEYS.clock, wire.WORLD_ID, news

    def _disturbances(self) -> tuple[str, int, wire.Message]:
        until = self._lab_now() + NS_PER_S
        held = (Disturbance(0, max(1, until), loss=self._rng.random()),)
        return KEYS.disturbances, wire.WORLD_ID, wire.Disturbances("dash", self._instant(), held, 0, "forged")

    def _load(self) -> tuple[str, int, wire.Message]:
        return KEYS.load(self._rng.choice(ROBOTS)), wire.OPERATOR_ID, wire.Load(self._rng.randbytes(40))

    def _silence(self) -> tuple[str, int, wire.Message]:
        until = self._rng.choice([-NEVER, 0, self._lab_now() + NS_PER_S // 2])
        return KEYS.silence, wire.OPERATOR_ID, wire.Silence(self._rng.choice((*ROBOTS, 9)), until)

    def _held(self) -> tuple[Disturbance, ...]:
        return tuple(Disturbance(0, NS_PER_S // 2, loss=self._rng.random()) for _ in range(self._rng.randrange(3)))

    def answer(self, true: wire.Map, asked: wire.Message) -> wire.Message:
        """Return an answer to a request; a map is one of the `true` lab or of another, with anything else in it."""
        rng = self._rng
        if isinstance(asked, wire.AskClock):
            return wire.Clock(rng.choice(wire.CLOCK_STATES), self._instant(), self._instant())
        if isinstance(asked, wire.AskDisturbances):
            lab, refused = rng.choice(("dash", "other")), rng.choice(("", "no"))
            return wire.Disturbances(lab, self._instant(), self._held(), 0, refused)
        roster = tuple(sorted(rng.sample(range(1, 12), rng.randrange(1, 6))))
        facts = tuple(("at", rng.choice((None, *ROBOTS)), (self._count(),)) for _ in range(rng.randrange(3)))
        finish = rng.choice((None, ("at", (None, self._count()))))
        lab = rng.choice(("dash", "dash", "other"))
        head = (lab, rng.random() < 0.5, rng.random() < 0.5, rng.randrange(5), self._count(), roster)
        rest = (rng.choice(wire.CLOCK_STATES), self._held(), rng.choice((None, self._instant())))
        return wire.Map(*head, true.arena, true.radio, facts, finish, *rest)

    def message(self) -> tuple[str, bytes]:
        """Return a key and the octets of a message on it."""
        rng = self._rng
        shares = {self._sense: 80, self._act: 40, self._status: 40, self._radio: 20, self._truth: 10, self._load: 5}
        shares |= {self._clock: 2, self._disturbances: 2, self._silence: 1}
        (draw,) = rng.choices(list(shares), list(shares.values()))
        key, sender, body = draw()
        run = self._runs.get(sender, 0) if rng.random() < 0.5 and not isinstance(body, wire.Status) else self._count()
        return key, wire.encode(sender, run, self._count(), body)

    def request(self) -> tuple[str, wire.Message]:
        """Return a key and a request on it."""
        rng = self._rng
        robot = rng.choice((*ROBOTS, 9))
        wish = rng.choice([("list", None), ("clear", None), ("add", Disturbance(0, NS_PER_S // 2, loss=rng.random()))])
        return rng.choice(
            [
                (KEYS.map(robot), wire.AskMap(robot, self._count())),
                (KEYS.clock, wire.AskClock()),
                (KEYS.disturbances, wire.AskDisturbances(*wish)),
            ]
        )


class Stage:
    """A world, its robots, a launcher's view of them, and a forger, each with a session of its own."""

    def __init__(self, seed: int) -> None:
        lab = load_lab(LAB)
        program = compile_file(LAB / "dash.rmr").program
        assert program is not None
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.endings = {who: Ending() for who in (wire.WORLD_ID, *ROBOTS)}
        self._buses = [open_bus(wire.WORLD_ID, listen=endpoint)]
        self._world_bus = self._buses[0]
        self.world = WorldServer(lab, seed, self._world_bus, self.endings[wire.WORLD_ID], when_ready=True)
        setup = RobotSetup(Loaded(program, 1, b"code"), dict, None)
        self.robots = {}
        self.runs = {wire.WORLD_ID: self._world_bus.run}
        for robot in ROBOTS:
            bus = self._client(robot, endpoint)
            self.runs[robot] = bus.run
            ending = self.endings[robot]
            self.robots[robot] = HostedRobot(robot, robot, bus, endpoint, "dash", setup, ending)
        self.monitor = StatusMonitor(self._client(wire.OPERATOR_ID, endpoint), "dash")
        self.forger = self._client(wire.OPERATOR_ID, endpoint)
        self.rival = self._client(wire.WORLD_ID, endpoint)
        self.answered: Counter[str] = Counter()
        """Requests that the rival has answered, too, by their type."""
        self.began = time.monotonic()
        self.believed: set[int] = set()
        """In whose name a forged status was believed."""
        self.lost = False
        """Whether a token has vanished, as on a machine that is too slow: what comes next may be another process."""
        self._lives = [asyncio.ensure_future(self.world.run())]
        self._lives += [asyncio.ensure_future(robot.run()) for robot in self.robots.values()]

    def _client(self, sender: int, endpoint: str) -> Bus:
        bus = open_bus(sender, connect=endpoint)
        self._buses.append(bus)
        return bus

    def lab_now(self) -> int:
        """Return lab time."""
        return self.world._time.at(time.monotonic_ns())

    async def until(self, claim: Callable[[], object]) -> bool:
        """Wait until `claim` holds, `SETTLED_S` at most; return whether it does."""
        end = time.monotonic() + SETTLED_S
        while not claim():
            if time.monotonic() > end:
                return False
            await asyncio.sleep(0.02)
        return True

    async def forge(self, seed: int, messages: int) -> None:
        """Send so many messages, a hundredth of them requests."""
        forger = Forger(seed, self.runs, self.lab_now)
        put = self.forger._session.put
        self._compete(forger)
        withdraw: Callable[[], None] | None = None
        for number in range(0, messages, AT_ONCE):
            for key, data in (forger.message() for _ in range(AT_ONCE)):
                wire.decode(data)  # it is within its type
                put(key, data)
            if number % (4 * AT_ONCE) == 0:
                key, asked = forger.request()
                seat = self.forger.seat(asked.robot if isinstance(asked, wire.AskMap) else wire.OPERATOR_ID)
                await seat.ask(key, asked, 0.2)
                seat.close()
            if number % (20 * AT_ONCE) == 0:
                for robot in self.robots.values():
                    robot._rejoin.set()
                withdraw = self.rival.declare_alive(KEYS.alive(WORLD_ROLE, 9)) if withdraw is None else withdraw()
            await asyncio.sleep(PAUSE_S)
            self.lost |= self.monitor.present != set(ROBOTS)
            self.believed |= {who for who, said in self.said() if said is not None and said.progress == "forged"}

    def _compete(self, forger: Forger) -> None:
        """Answer, beside the world, what robots and others ask it for."""

        def answer(message: wire.Envelope, _arrived: int) -> wire.Message:
            self.answered[type(message.body).__name__] += 1
            return forger.answer(self.world._map, message.body)

        for key in (KEYS.map("*"), KEYS.clock, KEYS.disturbances):
            self.rival.serve(key, answer)

    def said(self) -> list[tuple[int, wire.Status | None]]:
        """Return what the launcher takes each process to have said last."""
        return [(wire.WORLD_ID, self.monitor.world), *((robot, self.monitor.robots.get(robot)) for robot in ROBOTS)]

    def problems(self) -> Iterator[str]:
        """Yield what is wrong with processes, and with what is told of them."""
        for who, ending in self.endings.items():
            if ending.asked:
                yield f"{who} ends: {ending.reason}"
        if self.believed and not self.lost:
            yield f"forged statuses of {sorted(self.believed)} are believed"
        if self.monitor.present != set(ROBOTS):
            yield f"of the robots {ROBOTS} these are told to live: {sorted(self.monitor.present)}"
        for robot, hosted in self.robots.items():
            status = self.monitor.robots.get(robot)
            if status is None or status.progress == "forged" or status.state not in ("running", "finished"):
                yield f"robot {robot} is told to be {status}"
            told = self.monitor.report(robot)
            yield from self._lies(robot, told, hosted._report(hosted._incarnation))  # type: ignore[arg-type]
        elapsed_s = time.monotonic() - self.began
        for robot, hosted in self.robots.items():
            if hosted._incarnation is not None and abs(hosted._incarnation.now() - self.lab_now()) > seconds(1):
                yield f"robot {robot} takes it to be {hosted._incarnation.now()}, the world {self.lab_now()}"
        for name, _, worst_s in self.world._late_commands.report():
            if worst_s > elapsed_s:
                yield f"a command of robot {name} is told to be {worst_s} s late, after {elapsed_s:.0f} s"
        if not 0 <= self.monitor.now <= self.lab_now() + seconds(1):
            yield f"the launcher takes it to be {self.monitor.now}, the world {self.lab_now()}"

    def _lies(self, robot: int, told: Any, own: dict[str, Any]) -> Iterator[str]:
        for field in ("restarts", "undelivered", "finish_s"):
            if told.get(field) != own.get(field):
                yield f"robot {robot} has {field} {own.get(field)}, the launcher {told.get(field)}"
        elapsed_s = time.monotonic() - self.began
        if own["bus"]["lost"] > STREAMS * (SENT_AT_ONCE + SENT_PER_S * elapsed_s):
            yield f"robot {robot} counts {own['bus']['lost']} lost messages after {elapsed_s:.0f} s"
        off_m = own["off_m"]
        if off_m is None or not off_m < 0.2 or not math.isfinite(off_m):
            yield f"robot {robot} is {off_m} m from where it takes itself to be"

    async def end(self) -> None:
        """End all of them in order."""
        for ending in self.endings.values():
            ending.ask("over")
        for robot in self.robots.values():
            robot.leaving.ask("over")
        await asyncio.wait(self._lives)
        for bus in reversed(self._buses):
            bus.close()


async def _play(seed: int, messages: int) -> list[str]:
    failures: list[str] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: failures.append(str(context)))
    stage = Stage(seed)
    try:
        if not await stage.until(lambda: stage.monitor.running(ROBOTS)):
            return [f"the lab never ran: {stage.monitor.robots}"]
        await stage.forge(seed, messages)
        await stage.until(lambda: not list(stage.problems()))
        unheard = {"AskMap", "AskClock", "AskDisturbances"} - stage.answered.keys()
        failures += [f"the rival was never asked: {', '.join(sorted(unheard))}"] if unheard else []
        return [*failures, *stage.problems()]
    finally:
        await stage.end()


def problems(seed: int, messages: int) -> list[str]:
    """Run the lab under so many forged messages; return what is wrong."""
    return asyncio.run(_play(seed, messages))


def main(seed: int, messages: int) -> int:
    """Run a campaign; return the number of problems."""
    found = problems(seed, messages)
    print("\n".join(found[:20]))
    print(f"seed {seed}: {messages} forged messages, {len(found)} problems")
    return len(found)


if __name__ == "__main__":
    sys.exit(bool(main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 100_000)))

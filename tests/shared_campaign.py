"""Random histories of shared facts: robots over a network that loses, doubles, delays, reorders and is cut.

Facts come and go, robots are killed and restarted. At every look, what a robot has heard of another one was true of it
within the last three seconds and the longest delay of a frame. At the end the network is healed and nothing changes any
more; then each robot knows exactly what each other one that lives holds, and nothing of a dead one.

Run as a program for a long campaign: ``python shared_campaign.py FIRST LAST``; each failing seed is printed.
"""

import sys
from collections.abc import Callable
from random import Random

from rmr.base.arena import NOWHERE
from rmr.base.kernel import RADIO, ROBOT, Alarm, Kernel
from rmr.base.time import NEVER, Instant, milliseconds, seconds
from rmr.base.values import Robot
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.node.payloads import PAYLOAD_OCTETS_MAX, PayloadKind
from rmr.node.ports import Confirmed, Ports, Received
from rmr.node.trace import TraceLevel
from rmr.vm.engines import Engine

SOURCE = """
type shared level(robot, int).
type shared mood(robot, mood).
type set(robot, int, int).
type drop(robot, int).
type swing(robot).
type seen(robot, robot, int).
type least(robot, int).
type wary(robot, robot).
least(R, 99).
peer(R, N), level(N, L) -o seen(R, N, L).
seen(R, _, _) -o 1.
least(R, Old), M = min(L, peer(R, B), level(B, L)), M != Old -o least(R, M).
peer(R, N), mood(N, wild), not wary(R, N) -o wary(R, N).
wary(R, N), not mood(N, wild), peer(R, N) -o 1.
set(R, A, B), level(R, A) -o level(R, B).
drop(R, A), level(R, A) -o 1.
swing(R), mood(R, calm) -o mood(R, wild).
swing(R), mood(R, wild) -o mood(R, calm).
swing(R), not mood(R, _) -o mood(R, calm).
"""
LATE_MAX = milliseconds(400)
"""Longest delay of a frame."""
LASTS = seconds(3)
HEALED = seconds(5)
"""After so long without faults and changes all is known: the refreshings of three seconds, and two for a restart."""
VALUES = 4


class Station:
    """A node's link and its timer."""

    payload_max = PAYLOAD_OCTETS_MAX

    def __init__(self, history: "History", robot: int, epoch: int) -> None:
        self.history = history
        self.robot = robot
        self.received: list[Received] = []
        roster = tuple(range(1, history.robots + 1))
        config = NodeConfig(
            robot, roster, NOWHERE, history.seed, epoch=epoch, trace=TraceLevel.NOTHING, engine=history.engine
        )
        self.node = Node(config, history.program, Ports(self, None), {}, 7)
        self.alarm = Alarm(history.kernel, ROBOT, self.tick)
        self.on = True

    def transmit(self, payload: bytes, destination: int | None, _handle: int, due: Instant = NEVER) -> None:
        del due
        self.history.transmit(self.robot, payload, destination)

    def receive(self) -> list[Received]:
        received, self.received = self.received, []
        return received

    def confirmations(self) -> list[Confirmed]:
        return []

    def tick(self, now: Instant) -> None:
        if self.on:
            self.node.tick(now)
            self.history.note(self.robot)
            self.alarm.set(max(self.node.next_wake, now + 1))


class History:
    """One run."""

    def __init__(self, seed: int, program: Program) -> None:
        self.seed = seed
        self.program = program
        rng = self.rng = Random(seed)
        self.kernel = Kernel()
        self.robots = rng.randint(2, 5)
        self.engine = rng.choice(list(Engine))
        self.loss = rng.choice((0.0, 0.2, 0.5))
        self.double = rng.choice((0.0, 0.3))
        self.late = rng.choice((0, LATE_MAX))
        self.apart: set[tuple[int, int]] = set()
        self.lives = dict.fromkeys(range(1, self.robots + 1), 0)
        self.frames: list[tuple[Instant, int]] = []
        self.held: dict[tuple[int, str, tuple], list[list[Instant]]] = {}
        """By robot, predicate and values: from when to when it held them."""
        self.problems: list[str] = []
        self.heard = {each.predicate: program.predicates[each.other].name for each in program.ensemble}
        self.own = {name: program.index(name) for name in self.heard.values()}
        self.stations = {robot: self._begun(robot) for robot in self.lives}

    def _begun(self, robot: int) -> Station:
        station = Station(self, robot, self.lives[robot])
        station.node.start(self.kernel.now)
        station.alarm.set(self.kernel.now)
        return station

    # -- the air ------------------------------------------------------------------------------------------------

    def transmit(self, source: int, payload: bytes, destination: int | None) -> None:
        now = self.kernel.now
        if payload[0] == PayloadKind.SHARED:
            self.frames.append((now, source))
        for target in self.stations if destination is None else (destination,):
            cut = (min(source, target), max(source, target)) in self.apart
            if target == source or cut:
                continue
            for _ in range(1 + (self.rng.random() < self.double)):
                if self.rng.random() >= self.loss:
                    at = now + milliseconds(2) + self.rng.randint(0, self.late)
                    self.kernel.at(at, RADIO, self._arrival(source, target, payload, destination is not None))

    def _arrival(self, source: int, target: int, payload: bytes, unicast: bool) -> Callable[[Instant], None]:
        def arrive(now: Instant) -> None:
            station = self.stations[target]
            if station.on:
                station.received.append(Received(payload, source, unicast, -50.0, 255, now))
                station.alarm.set(now)

        return arrive

    # -- what is true -------------------------------------------------------------------------------------------

    def facts(self, robot: int, name: str) -> list[tuple]:
        return list(self.stations[robot].node.machine.held(self.own[name]))

    def note(self, robot: int) -> None:
        """Write down what a robot holds from now on."""
        now = self.kernel.now
        station = self.stations[robot]
        for name in self.own:
            present = self.facts(robot, name) if station.on else []
            for args in present:
                spans = self.held.setdefault((robot, name, args), [])
                if not spans or spans[-1][1] != NEVER:
                    spans.append([now, NEVER])
            for (who, what, args), spans in self.held.items():
                if (who, what) == (robot, name) and args not in present and spans[-1][1] == NEVER:
                    spans[-1][1] = now

    def look(self) -> None:
        """Check that what robots have heard was true a short time ago."""
        now = self.kernel.now
        for robot, station in self.stations.items():
            for predicate, name in self.heard.items() if station.on else ():
                for source, *args in station.node.machine.held(predicate):
                    spans = self.held.get((int(source), name, tuple(args)), [])
                    if not any(
                        begun <= now and end >= now - LASTS - LATE_MAX - milliseconds(10) for begun, end in spans
                    ):
                        self.problems.append(f"{now / 1e9}: robot {robot} knows {name}(@{source}, {args}), long gone")

    def known(self, robot: int) -> set[tuple]:
        machine = self.stations[robot].node.machine
        return {(name, *map(int_or_text, args)) for p, name in self.heard.items() for args in machine.held(p)}

    # -- the run ------------------------------------------------------------------------------------------------

    def run(self) -> list[str]:
        """Run the history; return what is wrong."""
        rng = self.rng
        for _ in range(rng.randint(5, 60)):
            self._happen(rng.choices(("fact", "burst", "kill", "restart", "cut", "join"), (60, 3, 3, 5, 6, 6))[0])
            until = self.kernel.now + rng.choice(
                (0, milliseconds(rng.randint(1, 300)), milliseconds(rng.randint(1, 4000)))
            )
            while self.kernel.now < until:
                self.kernel.run_until(min(until, self.kernel.now + milliseconds(250)))
                self.look()
        self.loss = 0.0
        self.apart.clear()
        self.kernel.run_until(self.kernel.now + HEALED + self.late)
        self.look()
        for robot, station in self.stations.items():
            if station.on:
                expected = {
                    (name, other, *map(int_or_text, args))
                    for other in self.stations
                    if other != robot and self.stations[other].on
                    for name in self.own
                    for args in self.facts(other, name)
                }
                if self.known(robot) != expected:
                    self.problems.append(f"robot {robot} knows {self.known(robot)}, true is {expected}")
        for robot in self.stations:
            times = [at for at, source in self.frames if source == robot]
            self._check_rate(robot, times)
        return self.problems

    def _check_rate(self, robot: int, times: list[Instant]) -> None:
        """Frames are 0.2 s apart, so that a second has six at most, and those of a life's end."""
        first = 0
        for last, at in enumerate(times):
            while times[first] <= at - seconds(1):
                first += 1
            if last - first + 1 > 6 + 2 * self.lives[robot]:
                self.problems.append(f"robot {robot} sent {last - first + 1} frames within a second before {at / 1e9}")

    def _happen(self, what: str) -> None:
        rng = self.rng
        robot = rng.choice(list(self.stations))
        station = self.stations[robot]
        match what:
            case "fact" if station.on:
                first, second = rng.randrange(VALUES), rng.randrange(VALUES)
                name, args = rng.choice(
                    [("level", (first,)), ("set", (first, second)), ("drop", (first,)), ("swing", ())]
                )
                station.node.insert(self.kernel.now, name, args)
                station.alarm.set(self.kernel.now)
            case "burst" if station.on:
                for _ in range(40):
                    station.node.insert(self.kernel.now, "swing", ())
                    station.alarm.set(self.kernel.now)
                    self.kernel.run_until(self.kernel.now + milliseconds(20))
            case "kill" if station.on:
                station.on = False
                station.received.clear()
                self.note(robot)
            case "restart" if not station.on:
                self.lives[robot] += 1
                self.stations[robot] = self._begun(robot)
            case "cut":
                other = rng.choice(list(self.stations))
                self.apart.add((min(robot, other), max(robot, other)))
            case "join":
                self.apart.clear()
            case _:
                pass


def int_or_text(value: object) -> int | str:
    """Return a value without its type, for sets."""
    return int(value) if isinstance(value, int | Robot) else str(value)


def campaign_program() -> Program:
    """Return the program that all histories run."""
    program = compile_source(SOURCE).program
    assert program is not None
    return program


if __name__ == "__main__":
    the_program = campaign_program()
    for the_seed in range(int(sys.argv[1]), int(sys.argv[2])):
        for problem in History(the_seed, the_program).run()[:3]:
            print(the_seed, problem, flush=True)

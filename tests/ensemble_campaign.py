"""Random histories of ensemble rules: 2 to 12 robots over an air that loses, doubles, delays, reorders and is cut.

Robots crash and lose their memory, or crash and execute their journal again (`DurableNode`). Each fact has a number of
its own, and every insertion is recorded in every life. At the end the air is healed and all robots live; then no fact
may have been used twice, no firing be half, and nothing be set aside, held or left unfired.

`LoadHistory` has switches to other programs in it, with ensemble rules and without, of robots that hear of them at
different instants, and of robots that die around them.

Run as a program for a long campaign: ``python ensemble_campaign.py FIRST LAST [FILE]``; each failing seed is printed,
and FILE holds the counts so far as JSON. With ``loads`` as a fourth word the histories have switches.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from heapq import heappop, heappush
from itertools import product
from pathlib import Path
from random import Random

from rmr.base.arena import NOWHERE
from rmr.base.time import NEVER, Instant, milliseconds, seconds
from rmr.base.values import Robot
from rmr.bytecode.program import Duty, Program
from rmr.lang.compiler import compile_source
from rmr.mind.durable_node import DurableNode
from rmr.mind.journal import Journal, JournalHeader, read_journal
from rmr.node import payloads
from rmr.node.config import NodeConfig
from rmr.node.node import Node
from rmr.node.ports import Confirmed, Ports, Received
from rmr.node.trace import TraceLevel
from rmr.vm.engines import Engine
from rmr.vm.machine_events import FactInserted

LATE_MAX = milliseconds(400)
"""Longest delay of a frame, but for the copies that come after any time."""
FAULTS_FOR = seconds(12)
HEALED = seconds(80)
"""Longer than a delivery of an ordinary fact lives, and than the longest pause between two repeats of a lasting one."""

TYPES = """
type waiting(robot, int).
type free(robot, int).
type tool(robot, int).
type !got(robot, int, int).
type !gave(robot, int, int).
"""
PROGRAM = f"""{TYPES}waiting(A, X), free(B, Y), peer(A, B) -o got(A, X, Y), gave(B, X, Y).
"""
KEPT = f"""{TYPES}waiting(A, X), $tool(A, _), free(B, Y), peer(A, B), X % 3 = Y % 3 -o got(A, X, Y), gave(B, X, Y).
"""
MUTUAL = f"""{TYPES}waiting(A, X), waiting(B, Y), peer(A, B) -o got(A, X, Y), gave(B, X, Y).
"""
"""Every robot offers to every other one: what waits is used on either side."""
TRIO = """
type waiting(robot, int).
type free(robot, int).
type tool(robot, int).
type spare(robot, int).
type !got(robot, int, int, int).
type !gave(robot, int, int, int).
type !lent(robot, int, int, int).
waiting(A, X), $tool(A, _), free(B, Y), spare(C, Z), peer(A, B), peer(A, C)
    -o got(A, X, Y, Z), gave(B, X, Y, Z), lent(C, X, Y, Z).
"""
"""Two robots besides the home decide."""
QUARTET = """
type waiting(robot, int).
type free(robot, int).
type tool(robot, int).
type spare(robot, int).
type fourth(robot, int).
type !got(robot, int, int, int, int).
type !gave(robot, int, int, int, int).
type !lent(robot, int, int, int, int).
type !left(robot, int, int, int, int).
waiting(A, X), $tool(A, _), free(B, Y), spare(C, Z), fourth(D, W), peer(A, B), peer(A, C), peer(A, D)
    -o got(A, X, Y, Z, W), gave(B, X, Y, Z, W), lent(C, X, Y, Z, W), left(D, X, Y, Z, W).
"""
"""Three robots besides the home decide, in each order of their numbers."""
PROGRAMS = (PROGRAM, KEPT, MUTUAL, TRIO, QUARTET)
KINDS = {TRIO: ("waiting", "free", "spare"), QUARTET: ("waiting", "free", "spare", "fourth")}
"""The facts of a firing, in the order of its numbers; of the other programs the first two."""
ROBOTS_MAX = {2: (4, 4, 4, 4, 4, 6, 12), 3: (4, 4, 4, 4, 6), 4: (4, 4, 4, 5)}
"""Largest numbers of robots to draw from, by robots of a firing; the search for a firing of four takes long."""
IN_BETWEEN = (
    *("held", "offer", "fired", "refused", "out_", "reserve", "booked", "commit", "abort", "ask_", "asking", "note"),
    *("closing", "settled", "stands", "hello", "have", "aside", "forget", "telling", "lost", "doubt", "query"),
)
"""Beginnings of the names of predicates that hold nothing once all is settled."""
RECORDS = ("got", "gave", "lent", "left")
"""What the robots of a firing hold of it, in the order of its numbers."""


@cache
def compiled(text: str) -> Program:
    """Return the program of a source."""
    program = compile_source(text).program
    assert program is not None
    return program


class AirLink:
    """The radio of one life of a robot."""

    payload_max = payloads.PAYLOAD_OCTETS_MAX

    def __init__(self, history: "History", robot: int) -> None:
        self.history = history
        self.robot = robot
        self.received: list[Received] = []

    def transmit(self, payload: bytes, destination: int | None, handle: int, due: Instant = NEVER) -> None:
        """Send a frame."""
        del handle, due
        if destination is not None:
            self.history.send(self.robot, destination, payload)

    def receive(self) -> list[Received]:
        """Return what has arrived since the last call."""
        received, self.received = self.received, []
        return received

    def confirmations(self) -> list[Confirmed]:
        """Return nothing: no frame of coordination is sent."""
        return []


class Disk:
    """Holds the journal of one robot."""

    def __init__(self) -> None:
        self.data = b""

    def append(self, data: bytes) -> None:
        """Write behind what is there."""
        self.data += data

    def sync(self) -> None:
        """Do nothing: no power is lost."""


@dataclass
class Token:
    """A fact with a number of its own."""

    name: str
    robot: int
    life: int


@dataclass
class History:
    """One run."""

    seed: int
    text: str = PROGRAM
    engine: Engine = Engine.GENERATED
    crashes: bool = True
    durable: bool | None = None
    """Whether crashed robots execute their journals again; drawn if None."""
    now: Instant = 0
    tokens: dict[int, Token] = field(default_factory=dict)
    seen: dict[str, list[tuple[int, int, tuple[int, ...]]]] = field(default_factory=dict)
    """By record: robot, its life, and the numbers of the facts, of each insertion."""

    def __post_init__(self) -> None:
        self.rng = Random(self.seed)
        self.program = compiled(self.text)
        self.seen = {name: [] for name in RECORDS}
        self.names = KINDS.get(self.text, ("waiting", "free"))
        least = len(self.names)
        self.count = self.rng.randint(least, self.rng.choice(ROBOTS_MAX[least]))
        if self.durable is None:
            self.durable = self.rng.random() < 0.3
        self.disks = [Disk() for _ in range(self.count)]
        self.loss = self.rng.choice((0.0, 0.2, 0.5))
        self.double = self.rng.choice((0.0, 0.3))
        self.late = self.rng.choice((0, LATE_MAX))
        self.lives = [-1] * self.count
        self.nodes: list[Node | None] = [None] * self.count
        self.links: list[AirLink | None] = [None] * self.count
        self.cut: set[frozenset[int]] = set()
        self.air: list[tuple[Instant, int, int, int, bytes]] = []
        """(arrival, number, source, destination, frame)."""
        self.old: list[tuple[int, int, bytes]] = []
        self.frames = 0
        self.crashed = 0

    # ---- the air

    def send(self, source: int, destination: int, payload: bytes) -> None:
        """Send a frame, or lose it, or double it; some copies come much later."""
        self.old.append((source, destination, payload))
        if frozenset((source, destination)) in self.cut:
            return
        copies = 2 if self.rng.random() < self.double else 1
        for _ in range(copies):
            if self.rng.random() >= self.loss:
                delay = milliseconds(5) + (self.rng.randrange(self.late) if self.late else 0)
                self.put(self.now + delay, source, destination, payload)

    def put(self, at: Instant, source: int, destination: int, payload: bytes) -> None:
        """Let a frame arrive at an instant."""
        self.frames += 1
        heappush(self.air, (at, self.frames, source, destination, payload))

    # ---- robots

    def start(self, robot: int) -> None:
        """Begin a life of a robot."""
        self.lives[robot] += not self.durable or self.lives[robot] < 0
        life = self.lives[robot]

        def witness(_: int, __: Instant, event: object) -> None:
            if isinstance(event, FactInserted):
                name = self.program.predicates[event.predicate].name
                if name in RECORDS:
                    self.seen[name].append((robot, life, event.args))  # type: ignore[arg-type]

        config = NodeConfig(
            robot,
            range(self.count),
            NOWHERE,
            self.seed,
            epoch=life,
            trace=TraceLevel.FACTS,
            engine=self.engine,
            witness=witness,
        )
        link = AirLink(self, robot)
        node = self.make(config, link, self.disks[robot])
        self.links[robot], self.nodes[robot] = link, node
        node.start(self.now)
        if not (isinstance(node, DurableNode) and node.resumed):
            self.insert(robot, "tool")

    def make(self, config: NodeConfig, link: AirLink, disk: Disk) -> Node:
        """Return the node of a robot, which goes on from its journal if it is durable."""
        ports = Ports(link, None)
        if not self.durable:
            return Node(config, self.program, ports, {}, 7)
        found = read_journal(disk.data)
        journal = Journal(disk, synced=False, crc=found.crc)
        if not found.records:
            journal.header(JournalHeader(config.robot, "campaign", self.seed, 7, False, b""))
        return DurableNode(config, self.program, ports, {}, 7, journal, found.records)

    def insert(self, robot: int, name: str) -> None:
        """Give a living robot a fact with a new number."""
        node = self.nodes[robot]
        if node is not None:
            number = len(self.tokens)
            self.tokens[number] = Token(name, robot, self.lives[robot])
            node.insert(self.now, name, (number,))

    def crash(self, robot: int) -> None:
        """End a life: its memory is lost, unless it is durable."""
        self.crashed += 1
        self.nodes[robot] = self.links[robot] = None

    # ---- a run

    def run(self) -> list[str]:
        """Run the history; return what is wrong."""
        for robot in range(self.count):
            self.start(robot)
        events = sorted(self.rng.randrange(FAULTS_FOR) for _ in range(self.rng.randint(4, 20 + self.count)))
        for at in events:
            self.until(at)
            self.happen()
        self.until(FAULTS_FOR)
        self.loss, self.late = 0.0, 0
        self.cut.clear()
        for robot in range(self.count):
            if self.nodes[robot] is None:
                self.start(robot)
        self.until(FAULTS_FOR + HEALED)
        return self.problems()

    def happen(self) -> None:
        """Let a fact come, or a fault."""
        rng = self.rng
        robot = rng.randrange(self.count)
        kinds = (*self.names, "crash", "cut", "part", "late")
        kind = rng.choices(kinds, (5, *[4 for _ in self.names[1:]], 3 * self.crashes, 1, 1, 2))[0]
        if kind in self.names:
            self.insert(robot, kind)
        elif kind == "crash" and self.nodes[robot] is not None:
            self.crash(robot)
        elif kind == "crash":
            self.start(robot)
        elif kind == "cut":
            other = rng.randrange(self.count)
            self.cut ^= {frozenset((robot, other))}
        elif kind == "part":
            # A partition, or the end of all cuts.
            here = {each for each in range(self.count) if rng.random() < 0.5}
            across = {frozenset((one, other)) for one in here for other in range(self.count) if other not in here}
            self.cut = set() if self.cut else across
        elif self.old:
            # A copy that comes after any time, of any life.
            self.put(self.now + rng.randrange(seconds(8)), *rng.choice(self.old))

    def until(self, end: Instant) -> None:
        """Let time pass."""
        while True:
            wakes = [node.next_wake for node in self.nodes if node is not None]
            at = min([*wakes, self.air[0][0] if self.air else NEVER])
            if at > end:
                self.now = end
                return
            self.now = max(self.now, at)
            while self.air and self.air[0][0] <= self.now:
                _, _, source, destination, payload = heappop(self.air)
                link = self.links[destination]
                if link is not None:
                    link.received.append(Received(payload, source, True, -50, 200, self.now))
            for robot, node in enumerate(self.nodes):
                link = self.links[robot]
                if node is not None and link is not None and (link.received or node.next_wake <= self.now):
                    node.tick(self.now)
                    node.next_wake = max(node.next_wake, self.now + 1)

    # ---- what must hold

    def problems(self) -> list[str]:
        """Return what is wrong at the end."""
        return [*self.twice(), *self.half(), *self.unsettled()]

    def firings(self) -> set[tuple[int, ...]]:
        """The numbers of the facts of each firing that a robot has seen in any life."""
        return {numbers for seen in self.seen.values() for _, _, numbers in seen}

    def has(self, place: int, firing: tuple[int, ...]) -> bool:
        """Whether a robot of a firing got its part."""
        return any(numbers == firing for _, _, numbers in self.seen[RECORDS[place]])

    def survives(self, number: int) -> bool:
        """Whether the robot of a fact has lived since."""
        token = self.tokens[number]
        return self.lives[token.robot] == token.life

    def excused(self, place: int, firing: tuple[int, ...]) -> bool:
        """Whether a robot may not know of a firing: it had reserved, and all that knew lost their memory."""
        if place == 0 or self.has(place, firing):
            return False
        robots = [self.tokens[number].robot for number in firing]
        last = max(range(1, len(firing)), key=robots.__getitem__)
        others = [each for each in range(len(firing)) if each not in (place, last) and self.has(each, firing)]
        knew = {0, last, *others}
        return place != last and not any(self.survives(firing[each]) for each in knew)

    def twice(self) -> list[str]:
        """Facts that were used by two firings, in whatever life."""
        used = Counter(
            number
            for firing in self.firings()
            for place, number in enumerate(firing)
            if not self.excused(place, firing)
        )
        wrong = [f"fact {number} was used {times} times" for number, times in used.items() if times > 1]
        for name, seen in self.seen.items():
            # A durable robot that dies before it has written does again what nobody has heard of.
            again = Counter(() if self.durable else seen)
            wrong += [f"{name} {each} came twice" for each, times in again.items() if times > 1]
        return wrong

    def half(self) -> list[str]:
        """Firings of which a living robot has one part, and another, or the same, lacks one."""
        wrong = []
        firings = self.firings()
        for firing in firings:
            for place, number in enumerate(firing):
                lacks = not self.has(place, firing) or self.holds(number) if self.survives(number) else False
                if lacks and not self.excused(place, firing):
                    wrong.append(f"{firing}: the robot of {number} has no part")
        used = {number for firing in firings for number in firing}
        for number, token in self.tokens.items():
            lives = self.lives[token.robot] == token.life
            if lives and token.name != "tool" and number not in used and not self.holds(number):
                wrong.append(f"fact {number} is gone")
            if lives and token.name == "tool" and not self.holds(number):
                wrong.append(f"tool {number} is gone")
        return wrong

    def holds(self, number: int) -> bool:
        """Whether a fact holds at the end."""
        token = self.tokens[number]
        node = self.nodes[token.robot]
        assert node is not None
        index = self.program.index(token.name)
        assert index is not None
        return (number,) in node.machine.held(index)

    def unsettled(self) -> list[str]:
        """What is set aside, held back or could fire at the end."""
        wrong = []
        for robot, node in enumerate(self.nodes):
            assert node is not None
            wrong += [f"{robot}: {each} is set aside" for each in node.machine.set_aside()]
            wrong += [f"{robot}: {each}" for each in node.outstanding]
            for hidden in self.program.ensemble:
                name = self.program.predicates[hidden.predicate].name
                if name.startswith(IN_BETWEEN) and node.machine.held(hidden.predicate):
                    wrong.append(f"{robot}: {name} {node.machine.held(hidden.predicate)}")
                if hidden.duty is Duty.LIFE and node.machine.held(hidden.predicate) != [(self.lives[robot],)]:
                    wrong.append(f"{robot}: not life {self.lives[robot]}")
        return [*wrong, *self.unfired()]

    def unfired(self) -> list[str]:
        """Facts that a rule could use at the end."""
        wrong = []
        if len(self.names) > 2:
            found = [self.left(name) for name in self.names]
            apart = (each for each in product(*found) if len({robot for robot, _ in each}) == len(each))
            return [f"{each} are left" for each in apart]
        left = {name: self.left(name) for name in ("waiting", "free")}
        for one, x in left["waiting"]:
            for other, y in left["waiting" if self.text == MUTUAL else "free"]:
                if one != other and (self.text != KEPT or x % 3 == y % 3):
                    wrong.append(f"{x} of {one} and {y} of {other} are left")
        return wrong

    def left(self, name: str) -> list[tuple[int, int]]:
        """The facts of a predicate that are left, with their robots."""
        index = self.program.index(name)
        assert index is not None
        found = [(robot, node.machine.held(index)) for robot, node in enumerate(self.nodes) if node is not None]
        return [(robot, args[0]) for robot, facts in found for args in facts if not isinstance(args[0], Robot)]  # type: ignore[misc]


WITHOUT = (
    f"{TYPES}tool(A, 0), waiting(A, 0) -o tool(A, 0).\n",
    """
type waiting(robot, int).
type free(robot, int).
type tool(robot, int).
type spare(robot, int).
type !got(robot, int, int, int).
type !gave(robot, int, int, int).
type !lent(robot, int, int, int).
tool(A, 0), waiting(A, 0) -o tool(A, 0).
""",
)
"""Programs that only keep the facts of the others."""
LOADS = (
    (PROGRAM, KEPT, MUTUAL, WITHOUT[0], "type !more(robot).\n" + PROGRAM),
    (TRIO, WITHOUT[1], "type !more(robot).\n" + TRIO),
)
"""Programs between which robots switch; all of a row have the same facts."""


class LoadHistory(History):
    """A run in which the robots switch to other programs."""

    def __post_init__(self) -> None:
        """Draw the programs and the instants of the switches."""
        self.durable = False
        super().__post_init__()
        rng = Random(f"loads {self.seed}")
        self.programs = LOADS[self.seed % 3 == 0]
        self.text = rng.choice(self.programs)
        self.names = ("waiting", "free", "spare")[: 2 + (self.programs is LOADS[1])]
        self.count = rng.randint(len(self.names), 4)
        self.disks = self.disks[:1] * self.count
        self.lives, self.nodes, self.links = [-1] * self.count, [None] * self.count, [None] * self.count
        self.loss = rng.choice((0.0, 0.1, 0.2, 0.4))
        self.versions = [self.text, *(rng.choice(self.programs) for _ in range(rng.choice((1, 1, 2, 3))))]
        """The program of each version; version 0 is that at the start."""
        self.runs = [0] * self.count
        """By robot, the version that it runs."""
        instants = sorted(rng.randrange(seconds(1), FAULTS_FOR) for _ in self.versions[1:])
        self.due: list[tuple[Instant, int, int, str]] = []
        for version, at in enumerate(instants, 1):
            for robot in range(self.count):
                told = rng.random()
                if told < 0.8:
                    heappush(self.due, (at - rng.randrange(seconds(4)), robot, version, "hold"))
                late = 0 if told < 0.8 else rng.randrange(seconds(8))
                heappush(self.due, (at + late, robot, version, "switch"))
            if rng.random() < 0.5:
                # Near the switch a robot dies, and comes back with the program that it finds.
                robot = rng.randrange(self.count)
                died = max(0, at + rng.randrange(-seconds(2), seconds(1)))
                heappush(self.due, (died, robot, version, "crash"))
                heappush(self.due, (died + rng.randrange(seconds(6)), robot, version, "start"))
            for _ in range(rng.choice((4, 12, 30))):
                before = max(0, at + rng.randrange(-seconds(5), seconds(1)))
                heappush(self.due, (before, rng.randrange(self.count), rng.randrange(len(self.names)), "fact"))
            if rng.random() < 0.2:
                robot = rng.randrange(self.count)
                aborted = rng.randrange(seconds(1), FAULTS_FOR)
                heappush(self.due, (aborted, robot, 0, "hold"))
                heappush(self.due, (aborted + seconds(3), robot, 0, "go on"))
        self.instants = [0, *instants]
        self.chance = rng
        self.switches = self.doubts = 0

    def make(self, config: NodeConfig, link: AirLink, disk: Disk) -> Node:
        """Return the node of a robot, which has asked the others for their program, mostly in vain if they are few."""
        robot = config.robot
        newest = max(version for version, at in enumerate(self.instants) if at <= self.now)
        heard = newest if self.chance.random() < 0.7 else 0
        own = self.versions[0]
        config = replace(config, witness=self.witness(robot, self.lives[robot]))
        node = Node(config, compiled(own), Ports(link, None), {}, self.digest(own))
        self.runs[robot] = 0
        if heard:
            self.switch(robot, node, heard)
        elif newest:
            heappush(self.due, (self.now + self.chance.randrange(seconds(6)), robot, newest, "switch"))
        return node

    def digest(self, text: str) -> int:
        """Return the digest of a program."""
        return 7 + 259 * self.programs.index(text)

    def switch(self, robot: int, node: Node, version: int) -> None:
        """Let a robot run a newer version."""
        if version > self.runs[robot]:
            self.runs[robot] = version
            self.switches += 1
            text = self.versions[version]
            changed = node.change_program(self.now, compiled(text), self.digest(text))
            self.doubts += bool(changed.in_doubt)

    def witness(self, robot: int, life: int) -> Callable[[int, Instant, object], None]:
        """Return what records each insertion; what is carried over counts once."""

        def told(_: int, __: Instant, event: object) -> None:
            if isinstance(event, FactInserted):
                program = compiled(self.versions[self.runs[robot]])
                name = program.predicates[event.predicate].name
                if name in RECORDS and (robot, life, event.args) not in self.seen[name]:
                    self.seen[name].append((robot, life, event.args))  # type: ignore[arg-type]

        return told

    def until(self, end: Instant) -> None:
        """Let time pass, with what is due of loads in it."""
        while self.due and self.due[0][0] <= end:
            at, robot, version, what = heappop(self.due)
            super().until(max(at, self.now))
            node = self.nodes[robot]
            if what == "start" and node is None:
                self.start(robot)
            elif node is None:
                continue
            elif what == "crash":
                self.crash(robot)
            elif what == "fact":
                self.insert(robot, self.names[version])
            elif what == "switch":
                self.switch(robot, node, version)
            elif what in ("hold", "go on") and version >= self.runs[robot]:
                node.hold_offers(self.now, what == "hold")
        super().until(end)

    def problems(self) -> list[str]:
        """Return what is wrong at the end."""
        self.text = self.versions[-1]
        self.program = compiled(self.text)
        behind = [robot for robot, version in enumerate(self.runs) if self.versions[version] != self.text]
        wrong = [f"{robot} runs an old program" for robot in behind]
        return [*wrong, *super().problems()]

    def unfired(self) -> list[str]:
        """Facts that a rule could use at the end."""
        return [] if self.text in WITHOUT else super().unfired()


def histories(first: int, last: int, *, loads: bool = False) -> Iterator[tuple[str, History, list[str]]]:
    """Yield where each history stands, the history, and what is wrong with it."""
    for seed in range(first, last):
        if loads:
            engine = (Engine.GENERATED, Engine.INTERPRETER)[seed % 8 == 0]
            history: History = LoadHistory(seed, engine=engine)
            yield str(seed), history, history.run()
            continue
        for place, text in enumerate(PROGRAMS):
            engine = (Engine.GENERATED, Engine.INTERPRETER)[seed % 8 == 0]
            history = History(seed, text, engine)
            yield f"{seed} {place}", history, history.run()


def main(first: int, last: int, file: Path | None = None, *, loads: bool = False) -> int:
    """Run the seeds; return how many fail."""
    counts: Counter[str] = Counter()
    for name, history, wrong in histories(first, last, loads=loads):
        counts.update(runs=1, failed=bool(wrong), durable=bool(history.durable), robots=history.count)
        counts.update(facts=len(history.tokens), firings=len(history.firings()), frames=history.frames)
        counts.update(lives=sum(history.lives) + history.count, crashes=history.crashed)
        if isinstance(history, LoadHistory):
            counts.update(switches=history.switches, doubts=history.doubts)
        if wrong:
            print(name, wrong[:4], flush=True)
        if file is not None and counts["runs"] % 100 == 0:
            file.write_text(json.dumps(counts, indent=1) + "\n")
    print(json.dumps(counts))
    return counts["failed"]


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2]), *map(Path, sys.argv[3:4]), loads="loads" in sys.argv[4:]) != 0)

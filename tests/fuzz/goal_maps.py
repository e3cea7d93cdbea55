"""Random maps with doors that shut and open: robots take a shortest way, and no robot walks to and fro.

    python tests/fuzz/goal_maps.py --cases 10000 --seed 1

A robot stands in a room and wants to be in another. Doors shut and open between its steps. While nothing changes, the
number of its steps equals the shortest way (breadth first, over the doors as they are). Both engines take the same way.
The exit status is 1 if a case fails.
"""

import argparse
import sys
from collections import deque
from dataclasses import dataclass
from random import Random

from rmr.base.streams import Choices
from rmr.base.values import Symbol
from rmr.bytecode.program import Program
from rmr.lang.compiler import compile_source
from rmr.vm.engines import Engine, new_machine
from rmr.vm.machine import Machine
from rmr.vm.machine_events import FactInserted, RuleFired

Door = tuple[str, str]

AHEAD: Door = ("", "")
"""A door that is on a shortest way, and next."""

KINDS = {
    "sensed": ("type sensor door(robot, area, area).", "at(R, A), door(R, A, B) -o at(R, B)."),
    "shut": (
        "type sensor shut(robot, area, area). type !door(robot, area, area).",
        "at(R, A), door(R, A, B), not shut(R, A, B) -o at(R, B).",
    ),
    "joined": (
        "type sensor door(robot, area, int). type sensor side(robot, int, area). type !unused(robot).",
        "at(R, A), side(R, D, B), door(R, A, D), not unused(R) -o at(R, B).",
    ),
    "measured": (
        "type sensor width(robot, area, area, int).",
        "width(R, A, B, W), at(R, A), W * 2 > 1 -o at(R, B).",
    ),
    "effect": (
        "type sensor door(robot, area, area). type action go(R: robot, A: area) -o at(R, A).",
        "at(R, A), door(R, A, B) -o go(R, B).",
    ),
}
"""Ways to write a map: its types, and the rules."""


@dataclass
class GoalMap:
    """A map, and what happens on it before each step of the robot."""

    kind: str
    rooms: list[str]
    doors: list[Door]
    start: str
    goal: str
    changes: list[list[Door]]
    """Doors that change (open ones shut, shut ones open) before each of the first steps."""


def drawn(seed: int, number: int) -> GoalMap:
    """Draw a map."""
    rng = Random(f"{seed}/{number}")
    rooms = [f"r{index}" for index in range(rng.randint(4, rng.choice([6, 10, 20])))]
    pairs = [(one, other) for one in rooms for other in rooms if one != other]
    # Two ways round, of different lengths as a rule, both to and fro; and some doors anywhere.
    ring = rng.sample(rooms, len(rooms))
    around = [*zip(ring, ring[1:] + ring[:1], strict=True)]
    doors = list(dict.fromkeys([*around, *[(other, one) for one, other in around]]))
    doors = [door for door in doors if rng.random() < 0.95]
    doors += [
        door
        for door in rng.sample(pairs, rng.choice([1, len(rooms) // 2, len(rooms), 2 * len(rooms)]))
        if door not in doors
    ]
    rng.shuffle(doors)
    goal = ring[0]
    away = distances(set(doors), goal)
    start = max(rooms[1:] if goal == rooms[0] else rooms[:-1], key=lambda room: (away.get(room, 0), room != goal))
    changes = [
        [rng.choice(rng.choice([doors, pairs, [AHEAD], [AHEAD]])) for _ in range(rng.choice([0, 1, 1, 2]))]
        for _ in range(rng.choice([0, 2, 4, 6, 8]))
    ]
    return GoalMap(rng.choice(list(KINDS)), rooms, doors, start, goal, changes)


def text_of(drawn_map: GoalMap) -> str:
    """Return the program of a map."""
    types, rules = KINDS[drawn_map.kind]
    lines = ["type at(robot, area).", types, rules, f"at(R, {drawn_map.start}). ?at(R, {drawn_map.goal})."]
    return "\n".join(lines)


def distances(doors: set[Door], goal: str) -> dict[str, int]:
    """Return the number of doors between each room and the goal, by breadth-first search."""
    found = {goal: 0}
    queue = deque([goal])
    while queue:
        room = queue.popleft()
        for one, other in doors:
            if other == room and one not in found:
                found[one] = found[room] + 1
                queue.append(one)
    return found


class Walk:
    """One robot on a map."""

    def __init__(self, drawn_map: GoalMap, engine: Engine) -> None:
        compiled = compile_source(text_of(drawn_map)).program
        assert compiled is not None
        self.program: Program = compiled
        self.map = drawn_map
        self.machine: Machine = new_machine(
            compiled, 1, Choices(f"maps/{drawn_map.start}"), engine=engine, trace=True, firing_budget=1
        )
        self.now = 0
        self.open: set[Door] = set()
        self.numbers: dict[Door, int] = {}
        self.walked = [drawn_map.start]
        self.rules: list[int] = []
        for door in drawn_map.doors:
            self.change(door)

    def ahead(self) -> Door | None:
        """Return the first door of a shortest way; None if there is no way."""
        found = distances(self.open, self.map.goal)
        here = self.walked[-1]
        return min(
            [each for each in self.open if each[0] == here and found.get(each[1], -1) == found.get(here, -1) - 1],
            default=None,
        )

    def change(self, door: Door) -> None:
        """Shut or open a door."""
        args = tuple([Symbol(room) for room in door])
        opens = door not in self.open
        self.open ^= {door}
        machine = self.machine
        index = self.program.index
        match self.map.kind:
            case "shut" if opens:
                machine.insert(self.now, index("door"), args)
                machine.withdraw(self.now, index("shut"), args)
            case "shut":
                machine.insert(self.now, index("shut"), args)
            case "joined":
                number = self.numbers.setdefault(door, len(self.numbers))
                for name, values in (("door", (args[0], number)), ("side", (number, args[1]))):
                    (machine.insert if opens else machine.withdraw)(self.now, index(name), values)
            case "measured":
                machine.withdraw(self.now, index("width"), (*args, 0 if opens else 3))
                machine.insert(self.now, index("width"), (*args, 3 if opens else 0))
            case _ if opens:
                machine.insert(self.now, index("door"), args)
            case _:
                machine.withdraw(self.now, index("door"), args)

    def step(self) -> None:
        """Let the robot take one step."""
        self.now += 1
        self.machine.run(self.now)
        for event in self.machine.drain():
            if isinstance(event, RuleFired):
                self.rules.append(event.rule)
            elif isinstance(event, FactInserted) and event.predicate == self.program.index("at"):
                self.walked.append(str(event.args[0]))
            elif type(event).__name__ == "ActionDerived":
                self.machine.complete(self.now, event.serial, True)
                self.step_effects()

    def step_effects(self) -> None:
        """Take note of the effect of an action."""
        for event in self.machine.drain():
            if isinstance(event, FactInserted) and event.predicate == self.program.index("at"):
                self.walked.append(str(event.args[0]))


def fault_of(drawn_map: GoalMap) -> str | None:
    """Return what is wrong with the ways that the engines take; None if nothing is."""
    walks = []
    for engine in (Engine.INTERPRETER, Engine.GENERATED):
        walk = Walk(drawn_map, engine)
        walk.machine.start(0)
        walk.machine.drain()
        fault = _walked(walk)
        if fault is not None:
            return f"{engine.value}: {fault}"
        walks.append(walk.walked)
    return None if walks[0] == walks[1] else f"the engines take different ways: {walks}"


def _walked(walk: Walk) -> str | None:
    """Walk; return what is wrong."""
    goal = walk.map.goal
    for changes in walk.map.changes:
        for door in changes:
            if door != AHEAD:
                walk.change(door)
            elif (ahead := walk.ahead()) is not None:
                walk.change(ahead)
        if walk.walked[-1] == goal:
            return None
        before = distances(walk.open, goal).get(walk.walked[-1])
        walk.step()
        if before is not None and distances(walk.open, goal).get(walk.walked[-1]) != before - 1:
            return f"a step away from the goal: {walk.walked}, doors {sorted(walk.open)}"
    here = len(walk.walked)
    left = distances(walk.open, goal).get(walk.walked[-1])
    for _ in range(left or 0):
        walk.step()
    if left is not None and (walk.walked[-1] != goal or len(walk.walked) != here + left):
        return f"{walk.walked[here - 1 :]} in place of {left} steps, doors {sorted(walk.open)}"
    return None


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--case", type=int, help="only this one, shown")
    options = parser.parse_args()
    if options.case is not None:
        one = drawn(options.seed, options.case)
        print(text_of(one), one, fault_of(one), sep="\n")
        return 0
    faults = 0
    for number in range(options.cases):
        fault = fault_of(drawn(options.seed, number))
        if fault is not None:
            faults += 1
            print(f"case {number}: {fault}", flush=True)
    print(f"seed {options.seed}: {options.cases} maps, {faults} faults")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())

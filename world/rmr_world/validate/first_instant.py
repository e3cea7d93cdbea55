"""The first instant of each robot: its program run on its initial facts alone, at lab time 0.

Without senses, radio and actions this shows the jobs that start at once and the area of the first `moveto`. What begins
later, or depends on what robots sense or receive, it does not show.
"""

from functools import lru_cache
from typing import NamedTuple

from rmr.base.arena import Area
from rmr.base.streams import Choices
from rmr.base.values import Symbol, Value
from rmr.bytecode.program import Program
from rmr.vm.engines import Engine, new_machine
from rmr.vm.job import TimedJob
from rmr.vm.machine_events import ActionDerived, VmEvent
from rmr_world.bound import destinations
from rmr_world.lab import Lab
from rmr_world.random_facts import Range, StatedFact

ROBOTS_MAX = 200
"""Robots whose program is run; in a larger lab the first ones show what is wrong."""
MOVETO = "moveto"
"""The provided action that drives a robot to an area, in turns through the bottleneck."""


class FirstInstant(NamedTuple):
    """What the program of a robot does at once."""

    events: tuple[VmEvent, ...]
    jobs: tuple[TimedJob, ...]
    """The jobs that it has begun."""


class FirstInstants:
    """The first instant of each robot, which is run when somebody asks for it, and once."""

    def __init__(self, lab: Lab, program: Program) -> None:
        self._lab = lab
        self._program = program
        self._known: dict[int, FirstInstant] = {}

    def of(self, robot: int) -> FirstInstant:
        """Return the first instant of `robot`."""
        if robot not in self._known:
            self._known[robot] = _run(self._lab, self._program, robot)
        return self._known[robot]


@lru_cache(maxsize=4)
def first_instants(lab: Lab, program: Program) -> FirstInstants:
    """Return the first instants of the robots of `lab`, the same for all rules that ask."""
    return FirstInstants(lab, program)


def _run(lab: Lab, program: Program, robot: int) -> FirstInstant:
    machine = new_machine(program, robot, Choices(f"{lab.seed}/robot{robot}/vm"), engine=Engine.INTERPRETER)
    machine.start(0)
    for fact in lab.stated_facts:
        index = program.index(fact.name)
        if index is not None and fact.owner in (None, robot):
            machine.insert(0, index, largest_args(fact))
    machine.run(0)
    return FirstInstant(tuple(machine.drain()), tuple(machine.jobs))


def largest_args(fact: StatedFact) -> tuple[Value, ...]:
    """Return the arguments of a fact, with the largest number of each range.

    A deadline that cannot be met even so cannot be met in any run.
    """
    return tuple((arg.high if arg.whole else float(arg.high)) if isinstance(arg, Range) else arg for arg in fact.args)


@lru_cache(maxsize=4)
def first_destinations(lab: Lab, program: Program) -> dict[int, Area]:
    """Return where robots go: the destination that the lab names, else the area of the first `moveto`."""
    found = destinations(lab)
    for start in lab.robots[:ROBOTS_MAX]:
        if start.id not in found:
            area = _first_area(lab, program, start.id)
            if area is not None:
                found[start.id] = area
    return found


def _first_area(lab: Lab, program: Program, robot: int) -> Area | None:
    moveto = program.index(MOVETO)
    for event in first_instants(lab, program).of(robot).events if moveto is not None else ():
        if isinstance(event, ActionDerived) and event.predicate == moveto and event.executor == robot and event.args:
            name = event.args[0]
            return lab.arena.area(str(name)) if isinstance(name, Symbol) else None
    return None

"""From a lab's path to simulations, and from a simulation to its report.

What all runs of a lab have in common is read, compiled and checked once (`load`); each seed then makes a run of its
own. Nothing of one run reaches another, and nothing of one robot another robot: the user's file of actions is run anew
for each life of each robot, as its globals may hold state.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from rmr.base.time import Duration
from rmr.coord.values import Order, Values
from rmr.node.trace import Level
from rmr_sim.chaos import with_chaos
from rmr_sim.checkers.watch import watch
from rmr_sim.event import Event
from rmr_sim.simulation import Simulation
from rmr_sim.user_events import load_events
from rmr_world.faults import told
from rmr_world.judge import judged
from rmr_world.lab import Lab, load_lab
from rmr_world.program import LoadedProgram, load_handlers, load_lab_program
from rmr_world.radio_key import radio_key
from rmr_world.report import assemble


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of a run beside its seed."""

    robots: int | None = None
    """Only the first so many of the lab."""
    loss: float | None = None
    """Share of radio frames lost, instead of the lab's."""
    actions: Path | None = None
    """The file of the user's actions, instead of the lab's."""
    event_file: Path | None = None
    """The file of the user's events, instead of the lab's."""
    chaos: bool = False
    """Whether faults are drawn from the seed."""
    order: Order = Order.OURS
    """By which rule leaders order jobs."""
    wait: Duration | None = None
    """The waiting time n of leaders, instead of what they work out."""
    duration: Duration | None = None
    """After which a run ends at the latest, instead of the lab's."""
    without: frozenset[str] = frozenset()
    """Rules of motion that robots leave out, by name: for ablation experiments."""


@dataclass(frozen=True, slots=True)
class Loaded:
    """What all runs of one lab have in common."""

    lab: Lab
    program: LoadedProgram
    options: Options
    warnings: tuple[str, ...]
    """What a person should know before the first run, each with its line end."""
    key: bytes | None = field(repr=False)
    """The radio's, where that is secured."""

    def simulation(self, seed: int | None = None, trace: Level = Level.NOTES) -> Simulation:
        """Return the run of `seed` (None: the lab's). Raises ProgramError when the user's files are wrong."""
        lab, program = self.lab, self.program
        handlers = load_handlers(program.program, lab.actions)
        seed = lab.seed if seed is None else seed
        if self.options.chaos:
            lab = with_chaos(lab, seed)
        values = Values(order=self.options.order, wait=self.options.wait)
        fresh = partial(load_handlers, program.program, lab.actions) if lab.actions else None
        without = self.options.without
        simulation = Simulation(
            lab, program.program, program.digest, seed, handlers, trace, self.key, values, fresh, without
        )
        watch(simulation)
        for event in load_events(lab.events, lab, seed):
            simulation.schedule(event)
        return simulation


def load(path: Path, options: Options) -> Loaded:
    """Return what all runs of the lab in `path` have in common.

    Raises LabError or ProgramError with what is wrong.
    """
    lab = load_lab(path)
    if options.robots is not None:
        lab = lab.with_robots(options.robots)
    if options.loss is not None:
        lab = replace(lab, radio=replace(lab.radio, loss=options.loss))
    if options.duration is not None:
        lab = replace(lab, duration=options.duration)
    lab = replace(lab, actions=options.actions or lab.actions, events=options.event_file or lab.events)
    program = judged(lab, load_lab_program(lab))
    warnings = [program.warnings] if program.warnings else []
    return Loaded(lab, program, options, tuple(warnings), radio_key(lab))


def prepare(
    path: Path,
    *,
    seed: int | None = None,
    trace: Level = Level.NOTES,
    events: Iterable[Event] = (),
    warn: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Simulation:
    """Return one run of the lab in `path`, in which also `events` happen; `options` are those of `Options`.

    Raises LabError or ProgramError with what is wrong.
    """
    loaded = load(path, Options(**options))
    for text in loaded.warnings:
        warn(text)
    simulation = loaded.simulation(seed, trace)
    for event in events:
        simulation.schedule(event)
    return simulation


def report_of(simulation: Simulation, finished: bool) -> dict[str, Any]:
    """Return the report of a run that is over; wall time is left out, so that equal seeds give equal octets."""
    world = simulation.world
    report = assemble(
        simulation.lab,
        mode="simulated",
        seed=simulation.seed,
        finished=finished,
        time_s=simulation.time_s,
        wall_s=None,
        robots=simulation.robot_parts(),
        truth={"collisions": world.collisions, "min_gap_m": world.min_gap_m},
        bus_lost=0,
    )
    report["faults"] = told(simulation.lab)
    report["violations"] = [violation.as_dict() for violation in sorted(simulation.violations)]
    report["violations_omitted"] = simulation.violations_omitted
    return report

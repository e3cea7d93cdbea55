"""Set-up of simulated runs: from a lab's path to simulations, and from a simulation to its report.

The lab and its program are read, compiled and validated once (`load`); each seed then makes a run of its own. Runs
share no state, and neither do robots: the user's file of actions is executed for each incarnation of each robot, as its
globals may hold state.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from rmr.base.record import record
from rmr.base.time import Duration
from rmr.coord.timing import Order, ScheduleTiming, Timing
from rmr.mind.mind_log import MindSink
from rmr.node.trace import TraceLevel
from rmr.radio.phy import NETWORK
from rmr_sim.chaos import with_chaos
from rmr_sim.checkers.attachment import attach_checkers
from rmr_sim.event import Event
from rmr_sim.simulation import Simulation
from rmr_sim.user_events import InvariantChecker, load_events
from rmr_world.faults import fault_entries
from rmr_world.finding import LabError
from rmr_world.lab import Lab, ProgramLoad
from rmr_world.lab_file import load_lab, radio_key
from rmr_world.lab_program import (
    LoadedProgram,
    later_programs,
    load_handlers,
    load_lab_program,
    validated,
)
from rmr_world.run_report import assemble


@record
class Options:
    """The options of a run other than its seed."""

    robots: int | None = None
    """Number of robots, the first ones of the lab; None: all."""
    loss: float | None = None
    """Share of radio frames lost, instead of the lab's."""
    actions: Path | None = None
    """The file of the user's actions, instead of the lab's."""
    event_file: Path | None = None
    """The file of the user's events, instead of the lab's."""
    chaos: bool = False
    """Whether faults are drawn from the seed."""
    hard_chaos: bool = False
    """Whether faults are drawn from the seed, those of hard chaos, too."""
    durable: bool = False
    """Whether restarted robots go on from their disks."""
    order: Order = Order.OURS
    """The rule by which leaders order jobs."""
    wait: Duration | None = None
    """The waiting time n of leaders, instead of the one that they compute."""
    duration: Duration | None = None
    """Lab time at which a run ends at the latest, instead of the lab's."""
    facts: tuple[str, ...] = ()
    """Facts beside the lab's, in the form of its file."""
    faults: tuple[object, ...] = ()
    """Faults beside the lab's, in the form of its file: a mapping for each."""
    without: frozenset[str] = frozenset()
    """Rules of motion that robots leave out, by name: for ablation experiments."""


@dataclass(frozen=True, slots=True)
class LoadedLab:
    """The shared parts of all runs of one lab."""

    lab: Lab
    program: LoadedProgram
    options: Options
    warnings: tuple[str, ...]
    """Warnings of the compiler and of validation, each with its line end."""
    key: bytes | None = field(repr=False)
    """The key of the radio, if that is secured."""
    loads: tuple[tuple[ProgramLoad, LoadedProgram], ...] = ()
    """The programs that robots get during a run."""

    def simulation(
        self,
        seed: int | None = None,
        trace: TraceLevel = TraceLevel.NOTES,
        minds: MindSink | None = None,
        harmed: Callable[[Lab], Lab] | None = None,
    ) -> Simulation:
        """Return the run of `seed` (None: the lab's). Raises ProgramError when the user's files are wrong.

        `minds` takes the logs of the robots' inputs (`rmr.mind`). `harmed` returns the lab with further faults.
        """
        lab = self.lab
        program = self.program
        handlers = load_handlers(program.program, lab.actions, lab.performs)
        seed = lab.seed if seed is None else seed
        if self.options.chaos or self.options.hard_chaos:
            lab = with_chaos(lab, seed, hard=self.options.hard_chaos)
        if harmed is not None:
            lab = harmed(lab)
        timing = Timing(self.options.order, schedule=ScheduleTiming(wait=self.options.wait))
        fresh = partial(load_handlers, program.program, lab.actions, lab.performs) if lab.actions else None
        without = self.options.without
        later = [loaded.program for _, loaded in self.loads]
        simulation = Simulation(
            lab,
            program.program,
            program.digest,
            seed,
            handlers,
            trace,
            self.key,
            timing,
            fresh,
            without,
            minds,
            self.options.durable,
            later,
        )
        if self.loads:
            from rmr_sim.program_loads import attach_loads  # noqa: PLC0415 - few labs have any

            attach_loads(simulation, program, self.loads, handlers)
        attach_checkers(simulation)
        users = load_events(lab.events, lab, seed)
        for event in users.events:
            simulation.schedule(event)
        simulation.observers += [InvariantChecker(simulation, function) for function in users.invariants]
        return simulation


def load(path: Path, options: Options) -> LoadedLab:
    """Load and validate the lab in `path`. Raises LabError or ProgramError with all errors."""
    lab = load_lab(path, {"facts": options.facts, "faults": options.faults})
    if options.robots is not None:
        lab = lab.with_robots(options.robots)
    if options.loss is not None and lab.radio.config.mode == NETWORK:
        message = "--loss is of the emulated radio, and this lab has mode: network; lose frames by its faults"
        raise LabError([lab.error(("radio", "mode"), message)])
    if options.loss is not None:
        lab = replace(lab, radio=replace(lab.radio, config=replace(lab.radio.config, loss=options.loss)))
    if options.duration is not None:
        lab = replace(lab, duration=options.duration)
    lab = replace(lab, actions=options.actions or lab.actions, events=options.event_file or lab.events)
    program = validated(lab, load_lab_program(lab))
    warnings = [program.warnings] if program.warnings else []
    loads = later_programs(lab, durable=options.durable)
    warnings += [each.warnings for _, each in loads if each.warnings]
    return LoadedLab(lab, program, options, tuple(warnings), radio_key(lab), loads)


def prepare(
    path: Path,
    *,
    seed: int | None = None,
    trace: TraceLevel = TraceLevel.NOTES,
    events: Iterable[Event] = (),
    warn: Callable[[str], None] = lambda _: None,
    **options: Any,
) -> Simulation:
    """Return one run of the lab in `path` with additional `events`; `options` are the fields of `Options`.

    Raises LabError or ProgramError with all errors.
    """
    loaded = load(path, Options(**options))
    for text in loaded.warnings:
        warn(text)
    simulation = loaded.simulation(seed, trace)
    for event in events:
        simulation.schedule(event)
    return simulation


def report_of(simulation: Simulation, finished: bool) -> dict[str, Any]:
    """Return the report of a run that is over, without wall time, so that equal seeds give equal octets."""
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
        dead=[robot.robot for robot in simulation.robots if not robot.alive],
    )
    report["faults"] = fault_entries(simulation.lab)
    if simulation.loads:
        report["loads"] = simulation.loads
    report["violations"] = [violation.as_dict() for violation in sorted(simulation.violations)]
    report["violations_omitted"] = simulation.violations_omitted
    return report

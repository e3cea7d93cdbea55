"""From a lab's path to a simulation, and from a simulation to its report."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from rmr.node.trace import Level
from rmr_sim.simulation import Simulation
from rmr_world.checks import check_program
from rmr_world.document import LabError
from rmr_world.lab import load_lab
from rmr_world.program import load_handlers, load_lab_program
from rmr_world.radiokey import radio_key
from rmr_world.report import assemble


def prepare(
    path: Path,
    *,
    seed: int | None = None,
    robots: int | None = None,
    loss: float | None = None,
    actions: Path | None = None,
    trace: Level = Level.NOTES,
    warn: Callable[[str], None] = lambda _: None,
) -> Simulation:
    """Return the simulation of the lab in `path`.

    Raises LabError or ProgramError with what is wrong.
    """
    lab = load_lab(path)
    if robots is not None:
        lab = lab.with_robots(robots)
    if loss is not None:
        lab = replace(lab, radio=replace(lab.radio, loss=loss))
    loaded = load_lab_program(lab)
    if loaded.warnings:
        warn(loaded.warnings)
    if lab.faults:
        warn(f"{lab.path}: faults: kill, restart and stall are not injected yet; the run goes without them\n")
    problems = check_program(lab, loaded.program)
    if problems:
        raise LabError(problems)
    handlers = load_handlers(loaded.program, actions)
    seed = lab.seed if seed is None else seed
    return Simulation(lab, loaded.program, loaded.digest, seed, handlers, trace, radio_key(lab))


def report_of(simulation: Simulation, finished: bool) -> dict[str, Any]:
    """Return the report of a run that is over; wall time is left out, so that equal seeds give equal octets."""
    world = simulation.world
    return assemble(
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

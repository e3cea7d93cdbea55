"""One run of the score: a provided lab, an example or a drawn lab, and its row.

A row has what a run is judged by: whether it finished, contacts, violations, deadlines, time and its bound, and the
processor time per second of lab time in units of a calibration loop, which is timed during the run. A lab
that is refused before the run has a row that says why, and nothing else.
"""

import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from drawn_lab import ROOT, command, draw_lab

from rmr.base.geometry import distance
from rmr.base.time import NS_PER_S, Instant
from rmr_sim.run_setup import LoadedLab, Options, load
from rmr_sim.seed_run import Result, Row, reasons, run_seed
from rmr_sim.simulation import Simulation
from rmr_sim.violation import CONTACT
from rmr_world.finding import LabError
from rmr_world.lab_program import ProgramError

CALIBRATION: Final = 10_000
"""Turns of the loop, about 5 ms: it is timed in each second of lab time."""
TABLE: Final = [float(index) for index in range(1 << 16)]
"""What the loop works on: some megabytes, as a run does, so that both suffer when caches are shared."""
SETTLED: Final = 2 * NS_PER_S
"""From when on a robot should know its place."""
LOOK: Final = NS_PER_S
"""How often it is compared with the true one; ticks begin at whole seconds, too."""
TOLD_MAX: Final = 3
"""Violations that a row quotes."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A run to take: a lab file of the tree, or the lab that a seed draws."""

    name: str
    """Identifies the row: a lab with what differs from its file, or ``drawn/SEED``."""
    seed: int
    lab: Path | None = None
    """None: a drawn lab."""
    options: dict[str, Any] = field(default_factory=dict)
    """Of `rmr_sim.run_setup.Options`."""

    @property
    def command(self) -> str:
        """What repeats the run."""
        if self.lab is None:
            return command(self.seed, chaos=bool(self.options.get("chaos")))
        robots = f" --robots {self.options['robots']}" if "robots" in self.options else ""
        chaos = " --chaos" if self.options.get("chaos") else ""
        return f"rmr sim {self.lab.relative_to(ROOT)} --seed {self.seed}{robots}{chaos}"


def drawn_entry(seed: int, *, chaos: bool = False) -> Entry:
    """Return the run of a drawn lab."""
    return Entry(f"drawn/{seed}", seed, None, {"chaos": True} if chaos else {})


def calibration_s() -> float:
    """Return the processor time of a loop of the kind that robots spend their time in, seconds."""
    began = time.process_time()
    table, place, total = TABLE, 1, 0.0
    for _ in range(CALIBRATION):
        place = (place * 1_103_515_245 + 12_345) & 0xFFFF
        x, y = table[place], table[place ^ 0x5555]
        total += (x * x + y * y) ** 0.5
        table[place] = min(x + 1.0, total)
    return time.process_time() - began


def taken(entry: Entry, calibration: Callable[[], float] = calibration_s) -> Row:
    """Carry out one run; return its row."""
    if entry.lab is not None:
        return _row(entry, entry.lab, {}, calibration)
    drawn = draw_lab(entry.seed)
    robot = drawn.lab["robot"]
    kinds = {**drawn.kinds, "radius": robot["radius"], "speed": robot["speed"]}
    with tempfile.TemporaryDirectory() as folder:
        return _row(entry, drawn.write(Path(folder)), kinds, calibration)


def _row(entry: Entry, lab: Path, kinds: dict[str, Any], calibration: Callable[[], float]) -> Row:
    head: Row = (
        {"name": entry.name, "seed": entry.seed, "kinds": kinds} if kinds else {"name": entry.name, "seed": entry.seed}
    )
    try:
        loaded = load(lab, Options(**entry.options))
    except (LabError, ProgramError) as error:
        return {**head, "refused": str(error).replace(f"{lab}/", "").splitlines()[:TOLD_MAX]}
    watched = _Watched(loaded, calibration)
    result = run_seed(watched, entry.seed)
    loops = watched.loops_s or [calibration()]
    result = result._replace(took_s=result.took_s - sum(watched.loops_s))
    loop_s = sum(loops) / len(loops)
    return {**head, **_judged(result), "off_m": watched.off_m(), **_cost(result, loop_s), **_told(result, loaded)}


class _Watched:
    """A loaded lab for `run_seed` that keeps hold of its run, whose robots are looked at when it is over."""

    def __init__(self, loaded: LoadedLab, calibration: Callable[[], float]) -> None:
        self._loaded = loaded
        self._calibration = calibration
        self.loops_s: list[float] = []
        """Processor times of the calibration between ticks of the run: what else the machine does slows both."""
        self._off_m: list[float] = []

    def simulation(self, seed: int) -> Simulation:
        """Return the run of `seed`."""
        run = self._loaded.simulation(seed)
        run.observers.append(partial(self._look, run))
        return run

    def _look(self, run: Simulation, now: Instant) -> None:
        """Time the calibration, and note how far robots are off their places, once in a while."""
        if now % LOOK:
            return
        self.loops_s.append(self._calibration())
        if now < SETTLED:
            return
        for robot in run.robots:
            pose = None if robot.node.driver is None else robot.node.driver.localiser.pose
            if robot.alive and pose is not None:
                self._off_m.append(distance(pose.x, pose.y, *run.world.pose(robot.robot)[:2]))

    def off_m(self) -> float | None:
        """Return how far a robot was off its estimate at most, metres; None if none knew its place."""
        return round(max(self._off_m), 3) if self._off_m else None


def _judged(result: Result) -> Row:
    row = result.row
    return {
        "finished": row["finished"],
        "contacts": row["collisions"],
        "violations": {check: count for check, count in sorted(row["violations"].items()) if check != CONTACT},
        "met": row["deadlines"]["met"],
        "missed": row["deadlines"]["missed"],
        "time_s": row["time_s"],
        "bound_s": row["bound_s"],
        "wrong": reasons(row),
    }


def _cost(result: Result, loop_s: float) -> Row:
    """Return the processor time per second of lab time, in loops of the calibration, and the lab time."""
    lab_s = result.time_s
    return {"lab_s": round(lab_s, 3), "cost": round(result.took_s / loop_s / lab_s, 3) if lab_s else None}


def _told(result: Result, loaded: LoadedLab) -> Row:
    """Return what helps to find the cause of a failed run: its first violations, and the robots that did not finish."""
    if result.report is None:
        return {"breakdown": result.breakdown} if result.breakdown else {}
    report = result.report
    unfinished = [int(robot) for robot, part in report["robots"].items() if part["finish_s"] is None]
    return {
        "robots": len(loaded.lab.robots),
        "unfinished": unfinished if not report["finished"] else [],
        "duration_s": loaded.lab.duration / NS_PER_S,
        "first": report["violations"][:TOLD_MAX],
    }

"""`rmr.simulate`: `rmr sim` as a function that returns plain data and the trajectories of the robots.

It raises the exceptions of `rmr.base.errors`, prints nothing and writes no file.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from html import escape
from numbers import Real
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import numpy.typing as npt

from rmr.base.errors import UsageError, require
from rmr.base.time import NS_PER_S, TICK_HZ, Instant, in_seconds, seconds
from rmr.coord.timing import Order
from rmr.node.trace import TraceLevel
from rmr_sim.event import Event
from rmr_sim.run_setup import Options, load, report_of
from rmr_sim.simulation import Simulation
from rmr_world.provided_labs import missing, resolve
from rmr_world.run_report import COLUMNS, summary, table_rows

Trajectory = npt.NDArray[np.float64]
"""Rows of (t_s, x_m, y_m, heading_rad)."""

RATE_HZ = 10.0
"""Default rate of the samples of the robots' true poses, per second."""


@dataclass(frozen=True, slots=True)
class Run:
    """The results of one simulated run."""

    report: dict[str, Any] = field(repr=False)
    """The report, as `rmr sim --json` prints it."""
    trajectories: dict[int, Trajectory] = field(repr=False)
    """By robot: an array of shape (samples, 4), rows (t_s, x_m, y_m, heading_rad) of its true pose; heading is
    counter-clockwise from the x axis, in [-pi, pi]."""
    trace: list[dict[str, Any]] = field(repr=False)
    """The trace in order of time, as `rmr sim --trace` writes it (docs/trace.md)."""
    warnings: list[str]
    """Warnings about the lab and its program, as `rmr sim` prints them before the run."""

    @property
    def lab(self) -> str:
        """The lab's name."""
        return str(self.report["lab"])

    @property
    def seed(self) -> int:
        """The seed of the run."""
        return int(self.report["seed"])

    @property
    def finished(self) -> bool:
        """Whether every robot held the lab's finish fact in time."""
        return bool(self.report["finished"])

    @property
    def time_s(self) -> float:
        """Duration of the run in lab time, in seconds."""
        return float(self.report["time_s"])

    def _repr_html_(self) -> str:
        """Return what a notebook shows: how the run ended, the table of `rmr sim`, and the robots' ways."""
        head, *rows = [
            f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"
            for tag, cells in [("th", COLUMNS), *(("td", cells) for cells in table_rows(self.report))]
        ]
        table = f"<table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>"
        return f"<div><p>{escape(summary(self.report))}</p>{table}{self._ways()}</div>"

    def _ways(self) -> str:
        """Return the trajectories as SVG, a metre in 200 pixels, with a dot where each robot ends."""
        ways = {robot: rows[:, 1:3] * (1, -1) for robot, rows in self.trajectories.items() if len(rows)}
        if not ways:
            return ""
        points = np.concatenate(list(ways.values()))
        left, top = points.min(axis=0) - 0.1
        width, height = np.ptp(points, axis=0) + 0.2
        drawn = ""
        for robot, way in ways.items():
            colour = f"hsl({robot * 137.5 % 360:.0f} 70% 45%)"  # the golden angle parts neighbours in the roster
            line = " ".join(f"{x:.3f},{y:.3f}" for x, y in way)
            drawn += f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="0.01"/>'
            x, y = way[-1]
            drawn += f'<circle cx="{x:.3f}" cy="{y:.3f}" r="0.03" fill="{colour}"><title>@{robot}</title></circle>'
        size = f'width="{200 * width:.0f}" viewBox="{left:.3f} {top:.3f} {width:.3f} {height:.3f}"'
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{drawn}</svg>'


def simulate(
    lab: str | PathLike[str],
    seed: int | None = None,
    *,
    robots: int | None = None,
    loss: float | None = None,
    chaos: bool = False,
    hard_chaos: bool = False,
    durable: bool = False,
    facts: Iterable[str] = (),
    faults: Iterable[Mapping[str, object]] = (),
    order: str = Order.OURS.value,
    actions: str | PathLike[str] | None = None,
    events: str | PathLike[str] | Iterable[Event] | None = None,
    duration: float | None = None,
    rate: float = RATE_HZ,
) -> Run:
    """Simulate a lab in virtual time; the same seed gives the same run.

    `lab` is a folder with a ``lab.yaml``, such a file, or the name of a provided lab. The other arguments are the
    options of `rmr sim`, and

    - `events`: the file of `--events`, or events themselves (`rmr_sim.event.Event`);
    - `facts`, `faults`: more of them than the lab file has, each in the form of an item there: ``"due(@1, 30)"``,
      ``{"at": "5s", "kill": 2}``;
    - `duration`: seconds of lab time after which the run ends at the latest, instead of the lab's;
    - `rate`: samples of each robot's pose per second, 60 at most.

    Raises UsageError for an argument that cannot be used, LabError or ProgramError for a lab or a program that is
    wrong, EventError when an event's own code fails.
    """
    path = lab_in(lab)
    event_file, own_events = _file_or_events(events)
    wanted = options_of(
        robots=robots,
        loss=loss,
        chaos=chaos,
        hard_chaos=hard_chaos,
        durable=durable,
        facts=facts,
        faults=faults,
        order=order,
        actions=actions,
        event_file=event_file,
        duration=duration,
    )
    sampled = _checked_rate(rate)
    seed = _whole("seed", seed, 0)
    with reading():
        loaded = load(path, wanted)
        simulation = loaded.simulation(seed, TraceLevel.FACTS)
    for event in own_events:
        simulation.schedule(event)
    sampler = Sampler(simulation, sampled)
    simulation.checkers.append(sampler.sample)
    finished = simulation.run()
    warnings = [line for text in loaded.warnings for line in text.splitlines()]
    return Run(report_of(simulation, finished), sampler.trajectories(), simulation.trace(), warnings)


def lab_in(lab: str | PathLike[str]) -> Path:
    """Return the path of a lab. Raises UsageError."""
    require("lab", lab, (str, PathLike), "a path, or the name of a provided lab")
    path = resolve(Path(lab))
    if not path.exists():
        raise UsageError(missing(path))
    return path


def options_of(
    *,
    robots: int | None,
    loss: float | None,
    chaos: bool,
    hard_chaos: bool,
    durable: bool,
    facts: Iterable[str],
    faults: Iterable[Mapping[str, object]],
    order: str,
    actions: str | PathLike[str] | None,
    event_file: Path | None,
    duration: float | None,
) -> Options:
    """Return the options of runs. Raises UsageError."""
    require("actions", actions, (str, PathLike, NoneType), "the path of a file of handlers")
    return Options(
        robots=_whole("robots", robots, 1),
        loss=_checked_loss(loss),
        actions=None if actions is None else Path(actions),
        event_file=event_file,
        chaos=chaos,
        hard_chaos=hard_chaos,
        durable=durable,
        facts=_items("facts", facts, str, "a fact in program syntax, such as 'due(@1, 30)'"),
        faults=_items("faults", faults, Mapping, "a mapping, such as {'at': '5s', 'kill': 2}"),
        order=_order(order),
        duration=_checked_duration(duration),
    )


@contextmanager
def reading() -> Iterator[None]:
    """Raise UsageError for a file that cannot be read."""
    try:
        yield
    except OSError as error:
        raise UsageError(f"{error.filename}: {error.strerror}" if error.filename else str(error)) from error


def _items(name: str, given: object, kind: type, words: str) -> tuple[Any, ...]:
    """Return the items of a list, each a `kind`. Raises UsageError."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise UsageError(f"{name} should be a list; each item is {words}")
    items = tuple(given)
    for item in items:
        if not isinstance(item, kind):
            raise UsageError(f"{name}: {item!r:.40} should be {words}")
    return items


class Sampler:
    """Takes the robots' true poses at the first tick at or after each multiple of a period, the first tick included."""

    def __init__(self, simulation: Simulation, rate_hz: float) -> None:
        self._simulation = simulation
        self._rate_hz = rate_hz
        self._taken = 0
        self._rows: dict[int, list[tuple[float, float, float, float]]] = {
            robot.robot: [] for robot in simulation.robots
        }

    def sample(self, now: Instant) -> None:
        """Take a sample if one is due at `now`."""
        if now + 1 < self._taken * NS_PER_S / self._rate_hz:  # ticks begin at whole nanoseconds
            return
        self._taken += 1
        t_s = in_seconds(now)
        for robot, rows in self._rows.items():
            rows.append((t_s, *self._simulation.world.pose(robot)))

    def trajectories(self) -> dict[int, Trajectory]:
        """Return the samples, by robot."""
        return {robot: np.array(rows, np.float64).reshape(-1, 4) for robot, rows in self._rows.items()}


# ---- arguments


def _file_or_events(events: str | PathLike[str] | Iterable[Event] | None) -> tuple[Path | None, Sequence[Event]]:
    if isinstance(events, str | PathLike):
        return Path(events), ()
    takes = "the path of a file of events, or a list of `rmr_sim.event.Event`"
    require("events", events, (Iterable, NoneType), takes)
    own = tuple(events or ())
    for event in own:
        require("events", event, Event, takes)
    return None, own


def _whole(name: str, number: int | None, least: int) -> int | None:
    if number is not None and (type(number) is not int or number < least):
        raise UsageError(f"{name}: a whole number from {least}, not {number!r}")
    return number


def _checked_loss(loss: float | None) -> float | None:
    require("loss", loss, (Real, NoneType), "a share from 0 up to 1")
    if loss is not None and not 0.0 <= loss < 1.0:
        raise UsageError(f"loss: a share from 0 up to 1, not {loss!r}")
    return loss


def _checked_duration(duration: float | None) -> int | None:
    require("duration", duration, (Real, NoneType), "a number of seconds above 0")
    if duration is None:
        return None
    if not 0.0 < duration < math.inf:
        raise UsageError(f"duration: a number of seconds above 0, not {duration!r}")
    return seconds(duration)


def _checked_rate(rate: float) -> float:
    takes = f"samples per second, above 0 and {TICK_HZ} at most"
    require("rate", rate, Real, takes)
    if not 0.0 < rate <= TICK_HZ:
        raise UsageError(f"rate: {takes}, not {rate!r}")
    return float(rate)


def _order(name: str) -> Order:
    known = [each.value for each in Order]
    if name not in known:
        raise UsageError(f"order: {name!r} is none of {', '.join(known)}")
    return Order(name)

"""Ways out of where robots stand in each other's way, without any order that somebody gives.

The robots of these scenes have no time assertion, so nobody leads and there are no slots: each one has a place to be at
and goes there (`goto`), around what it sees and hears. The scenes are symmetric but for the noise of sensors and wheels
and a jitter of the starts, 1 cm and 10 degrees (sigma), drawn from the seed. There is a way
out if every robot gets to its place within two minutes; of *parked for good* if the robot says that there is none.
Contacts are counted apart: in a crowd without any order, robots that see 60 degrees ahead do touch now and then.
"""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiment import Data, figure, panel, series, table, target
from intervals import quantile, share, text
from runs import ROOT, Row, Run, pooled, row

from rmr.base.streams import stream

NAME = "standoffs"
SEEDS = range(1, 21)
QUICK = range(1, 4)
PROGRAMS = ROOT / "tests" / "evaluation" / "programs"
JITTER_M, JITTER_DEG = 0.01, 10.0
DURATION_S = 120.0
FOUND_MIN = 99.0
"""Per cent of the seeds of each scene."""

Place = tuple[float, float]


class Trip(NamedTuple):
    """A robot's start, heading in degrees, place to be at, and how long it waits first."""

    start: Place
    heading: float
    goal: Place
    hold_s: float = 0.0


class Scene(NamedTuple):
    """One arrangement."""

    name: str
    size: tuple[float, float]
    trips: tuple[Trip, ...]
    boxes: tuple[tuple[float, float, float, float], ...] = ()
    program: str = "way.rmr"


def circle(count: int, side: float, radius: float) -> tuple[Trip, ...]:
    """Return robots on a circle, each with the place opposite as its goal."""
    trips = []
    for index in range(count):
        angle = math.tau * index / count
        x, y = radius * math.cos(angle), radius * math.sin(angle)
        start, goal = (side / 2 + x, side / 2 + y), (side / 2 - x, side / 2 - y)
        trips.append(Trip(start, math.degrees(angle) + 180.0, goal))
    return tuple(trips)


SCENES = (
    Scene("face to face", (1.5, 1.0), (Trip((0.3, 0.5), 0.0, (1.2, 0.5)), Trip((1.2, 0.5), 180.0, (0.3, 0.5)))),
    Scene("crossing at right angles", (1.5, 1.5), circle(4, 1.5, 0.55)),
    Scene("eight across a circle", (2.4, 2.4), circle(8, 2.4, 0.95)),
    Scene(
        "door, one from each side", (2.0, 1.5),
        (Trip((0.3, 0.75), 0.0, (1.7, 0.75)), Trip((1.7, 0.75), 180.0, (0.3, 0.75))),
        ((0.9, 0.0, 1.1, 0.55), (0.9, 0.95, 1.1, 1.5)),
    ),
    Scene(
        "dead end: out of a pocket and around it", (2.0, 1.5), (Trip((1.1, 0.75), 0.0, (1.7, 0.75)),),
        ((0.6, 0.45, 1.4, 0.5), (0.6, 1.0, 1.4, 1.05), (1.35, 0.5, 1.4, 1.0)),
    ),
    Scene("parked on the goal, leaves after 10 s", (1.5, 1.0), (
        Trip((0.3, 0.5), 0.0, (1.2, 0.5)), Trip((1.2, 0.5), 180.0, (0.3, 0.5), 10.0),
    )),
    Scene("parked for good", (1.5, 1.0), (
        Trip((0.3, 0.5), 0.0, (1.2, 0.5)), Trip((1.2, 0.5), 180.0, (1.2, 0.5)),
    ), program="once.rmr"),
)  # fmt: skip


def lab_of(scene: Scene, seed: int) -> str:
    """Return the lab file of a scene with the starts of `seed`."""
    rng = stream(f"evaluation/standoffs/{scene.name}/{seed}")
    robots, facts = [], []
    for robot, trip in enumerate(scene.trips, 1):
        x, y = (at + rng.gauss(0.0, JITTER_M) for at in trip.start)
        pose = f"{x:.3f}, {y:.3f}, {trip.heading + rng.gauss(0.0, JITTER_DEG):.1f}deg"
        robots.append(f"  - {{id: {robot}, pose: [{pose}]}}")
        facts.append(f"  - aim(@{robot}, {trip.goal[0]:.3f}, {trip.goal[1]:.3f})")
        facts.append(f"  - hold(@{robot}, {trip.hold_s:.1f})")
    return "\n".join([
        "lab: standoff",
        f"program: {PROGRAMS / scene.program}",
        f"duration: {DURATION_S:.0f}s",
        "finish: there(R)",
        f"arena: {{size: [{scene.size[0]}, {scene.size[1]}], cell: 0.05}}",
        "obstacles: [" + ", ".join(f"{{box: {list(box)}}}" for box in scene.boxes) + "]",
        "robots:", *robots, "facts:", *facts,
        f"localisation: {{beacons: [[0, 0], [{scene.size[0]}, 0]], rate: 10, sigma: 0.005}}", "",
    ])  # fmt: skip


def told(simulation: Any, _: Any) -> Row:
    """Return how many robots said that there is no way."""
    return {"no_way": sum(note["what"] == "said" for note in simulation.trace())}


def played(point: tuple[int, int]) -> Row:
    """Run one scene with one seed."""
    index, seed = point
    scene = SCENES[index]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lab.yaml"
        path.write_text(lab_of(scene, seed))
        found = row(Run(str(path), seed, measure=told))
    wanted = scene.program == "once.rmr"
    return {
        "scene": scene.name,
        **{key: found[key] for key in ("seed", "finished", "time_s", "collisions", "min_gap_m", "no_way")},
        "way_out": found["finished"] and found["no_way"] == wanted,
    }


def free_s(scene: Scene) -> float:
    """Return the time of the longest straight trip at full speed, with its wait."""
    return max(math.dist(trip.start, trip.goal) / 0.2 + trip.hold_s for trip in scene.trips)


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Run every scene with each seed."""
    runs = pooled(played, [(index, seed) for index in range(len(SCENES)) for seed in seeds], jobs)
    rows = [summary(scene, [run for run in runs if run["scene"] == scene.name]) for scene in SCENES]
    return {
        "rows": rows,
        "targets": [
            *(
                target(f"way out: {each['scene']}", 100.0 * each["way_out"]["value"], at_least=FOUND_MIN, unit="%")
                for each in rows
            ),
            target("stand-offs without any order: contacts", sum(run["collisions"] for run in runs), at_most=0),
        ],
        "figure": drawn(runs, len(seeds)),
        "runs": runs,
    }  # fmt: skip


def summary(scene: Scene, runs: Sequence[Row]) -> Row:
    """Return what the table tells of one scene."""
    times = [run["time_s"] for run in runs if run["way_out"]]
    return {
        "scene": scene.name,
        "robots": len(scene.trips),
        "way_out": share(len(times), len(runs)),
        "touched": share(sum(run["collisions"] > 0 for run in runs), len(runs)),
        "contacts": sum(run["collisions"] for run in runs),
        "time_s": quantile(times, 0.5) if times else None,
        "p95_s": quantile(times, 0.95) if times else None,
        "free_s": free_s(scene),
    }


def drawn(runs: Sequence[Row], seeds: int) -> Data:
    """Return the times as a figure."""
    shown = []
    for scene in SCENES:
        times = sorted(run["time_s"] for run in runs if run["scene"] == scene.name and run["way_out"])
        if times and scene.program == "way.rmr":
            shown.append(series(scene.name, times, [100.0 * (at + 1) / seeds for at in range(len(times))]))
    axes = panel("seconds", "runs in which all have arrived by then, %", shown, y_from=0.0)
    return figure("Ways out of stand-offs", f"{seeds} seeds a scene", [axes])


def tables(data: Data) -> dict[str, list[str]]:
    """Return the table of the page; the shares that find a way out are among the targets."""
    header = ("scene", "robots", "time, s: median", "95th percentile", "free way, s")
    lines = [
        (
            each["scene"],
            str(each["robots"]),
            *("" if each[key] is None else text(each[key], 1) for key in ("time_s", "p95_s")),
            f"{each['free_s']:.1f}",
        )
        for each in data["rows"]
    ]
    return {NAME: table(header, lines)}

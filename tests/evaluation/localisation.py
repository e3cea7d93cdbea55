"""Localisation: how far a driving robot's estimate is from where it is, over many seeds.

A robot drives at its full speed through an empty room of 3 m x 1.5 m, from one random place to the next; its sensors
are those of the simulator (`rmr_world.sensors`), each seed a robot with scale errors, bias and noise of its own;
beacons stand in two corners, ranges have a sigma of 5 mm and come at 10 Hz from each. The filter is the robots' own.

In the first part nothing is amiss, in the second no range is heard for one second in each five. The error is the
distance between estimate and truth: its root mean square over a drive from 2 s on, when the filter has settled; in the
second part also the root mean square within the outages alone.
"""

import math
from collections.abc import Iterator, Sequence
from random import Random

from experiment import Data, figure, panel, series, table, target
from intervals import quantile, text
from runs import Row, pooled

from rmr.base.arena import Arena
from rmr.base.geometry import Point, Pose, wrap
from rmr.base.streams import stream
from rmr.base.time import Instant, in_seconds, seconds, tick_start
from rmr.node.motion.localiser import Localiser
from rmr.node.ports import Sensed
from rmr_world.sensors import Sensors

NAME = "localisation"
SEEDS = range(1, 201)
QUICK = range(1, 11)
WIDE_M, HIGH_M = 3.0, 1.5
SPEED_MPS = 0.2
TURN_RADPS = math.pi
RATE_HZ = 10.0
SIGMA_M = 0.005
DRIVE_S = 60.0
SETTLED_S = 2.0
OUTAGE_S, EVERY_S = 1.0, 5.0
RMS_MAX_M, OUTAGE_RMS_MAX_M = 0.01, 0.05
MARGIN_M = 0.1
"""A robot's distance from walls."""


def drive(rng: Random) -> Iterator[tuple[Instant, Pose, float, float]]:
    """Yield instant, true pose, way and turn of each tick of a drive from place to place."""
    x, y = place(rng)
    theta = rng.uniform(-math.pi, math.pi)
    goal = place(rng)
    index = 0
    while tick_start(index) < seconds(DRIVE_S):
        dt = in_seconds(tick_start(index + 1) - tick_start(index))
        away = math.hypot(goal[0] - x, goal[1] - y)
        if away < 0.02:
            goal = place(rng)
        error = wrap(math.atan2(goal[1] - y, goal[0] - x) - theta)
        turn = max(-TURN_RADPS * dt, min(TURN_RADPS * dt, error))
        way = SPEED_MPS * dt if abs(error) < 0.5 else 0.0
        x, y = x + way * math.cos(theta + turn / 2.0), y + way * math.sin(theta + turn / 2.0)
        theta = wrap(theta + turn)
        index += 1
        yield tick_start(index), Pose(x, y, theta), way, turn


def place(rng: Random) -> tuple[float, float]:
    return rng.uniform(MARGIN_M, WIDE_M - MARGIN_M), rng.uniform(MARGIN_M, HIGH_M - MARGIN_M)


def errors(seed: int, *, outages: bool) -> list[tuple[float, float]]:
    """Return (seconds, distance between estimate and truth) for each tick of a drive, from the first fix on."""
    rng = stream(f"evaluation/drive/{seed}")
    beacons = (Point(0.0, 0.0), Point(WIDE_M, 0.0))
    arena = Arena(WIDE_M, HIGH_M, 0.05, (), (), beacons=beacons)
    sensors = Sensors(stream(f"evaluation/sensors/{seed}"), beacons, RATE_HZ, SIGMA_M, 0.0)
    localiser = Localiser(arena)
    found = []
    before = 0
    for now, pose, way, turn in drive(rng):
        sensors.moved(way, turn)
        dt = in_seconds(now - before)
        compass, gyro = sensors.compass(pose.theta), sensors.gyro(turn / dt)
        ranges = sensors.ranges(now, pose.x, pose.y)
        if outages and away(in_seconds(now)):
            ranges = ()
        truth = (pose.x, pose.y, pose.theta)
        localiser.feed(
            now, Sensed(now, sensors.left_m, sensors.right_m, gyro, compass, ranges, (), bumped=False, truth=truth)
        )
        if localiser.pose is not None:
            found.append((in_seconds(now), math.hypot(localiser.pose.x - pose.x, localiser.pose.y - pose.y)))
        before = now
    return found


def away(at_s: float) -> bool:
    """Return whether there is an outage: the last second of each five."""
    return at_s % EVERY_S >= EVERY_S - OUTAGE_S


def rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(value * value for value in values) / len(values))


def driven(seed: int) -> Row:
    """Return the errors of one robot's drives, without and with outages."""
    calm = [error for at, error in errors(seed, outages=False) if at >= SETTLED_S]
    disturbed = [(at, error) for at, error in errors(seed, outages=True) if at >= SETTLED_S]
    within = [error for at, error in disturbed if away(at)]
    return {
        "seed": seed,
        "rms_m": rms(calm),
        "most_m": max(calm),
        "outage_rms_m": rms([error for _, error in disturbed]),
        "within_rms_m": rms(within),
        "within_most_m": max(within),
    }


def run(seeds: Sequence[int], jobs: int) -> Data:
    """Drive with each seed."""
    runs = pooled(driven, seeds, jobs)
    rows = [summary(runs, key) for key in ("rms_m", "outage_rms_m", "within_rms_m")]
    return {
        "options": {"sigma_m": SIGMA_M, "rate_hz": RATE_HZ, "drive_s": DRIVE_S, "outage_s": OUTAGE_S},
        "rows": rows,
        "targets": [
            target("position error (RMS), worst drive", rows[0]["worst_mm"], at_most=1e3 * RMS_MAX_M, unit="mm"),
            target(
                "position error (RMS) within outages of 1 s, worst drive",
                rows[2]["worst_mm"], at_most=1e3 * OUTAGE_RMS_MAX_M, unit="mm",
            ),
        ],
        "figure": drawn(runs),
        "runs": [{key: round(value, 6) for key, value in run.items()} for run in runs],
    }  # fmt: skip


def summary(runs: Sequence[Row], key: str) -> Row:
    """Return what the table tells of one kind of error."""
    values = [1e3 * run[key] for run in runs]
    return {"what": key, "median": quantile(values, 0.5), "p99": quantile(values, 0.99), "worst_mm": max(values)}


def drawn(runs: Sequence[Row]) -> Data:
    """Return the distributions of the drives' errors."""
    shown = []
    for key, label in (("rms_m", "all ranges heard"), ("within_rms_m", "within outages of 1 s")):
        ordered = sorted(1e3 * run[key] for run in runs)
        shown.append(series(label, ordered, [100.0 * (at + 1) / len(ordered) for at in range(len(ordered))]))
    axes = panel("position error of a drive (RMS), mm", "drives with at most so much, %", shown, y_from=0.0)
    note = f"{len(runs)} seeds, each a robot that drives for {DRIVE_S:.0f} s at 0.2 m/s; ranges 10 Hz, sigma 5 mm"
    return figure("Localisation", note, [axes])


def tables(data: Data) -> dict[str, list[str]]:
    """Return the table of the page."""
    names = {
        "rms_m": "all ranges heard",
        "outage_rms_m": "no ranges for 1 s in each 5 s: the whole drive",
        "within_rms_m": "the same: within the outages",
    }
    header = ("position error of a drive (RMS)", "drives", "median, mm", "p99, mm", "worst, mm")
    lines = [
        (names[row["what"]], str(row["median"]["n"]), text(row["median"]), text(row["p99"]), f"{row['worst_mm']:.2f}")
        for row in data["rows"]
    ]
    return {NAME: table(header, lines)}

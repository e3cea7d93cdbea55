"""The labs of the simulator's benchmark, written for any number of robots.

*Crossing*: robots on a square grid, 1 m apart, drive to and fro between their own place and the next, the one half to
the right, the other half upwards, so that each crosses the ways of others all the time. The radio is so weak that a
robot hears those within some 4 m, as the halls of larger fleets are cut into cells.

*Hall*: robots stream from a square where they stand through a door one robot wide to places beyond it, one after the
other in the order in which they are due, as in `deploy/labs/hall`: at any time most of them stand.

*Flood*: robots without bodies on a grid; each tells the one to its right and the one above it of a wave that has come,
and a wave begins at the first robot, one in a minute. Nothing drives and nothing is sensed.
"""

from collections.abc import Iterator
from math import ceil, hypot, sqrt
from pathlib import Path

PITCH_M = 1.0
"""Between robots of the crossing."""
HALL_PITCH_M = 0.42
"""Between robots of the hall: one can pass between two."""
HALL_AROUND_M = 0.36
"""From the outermost robots of the hall to its walls."""
HALL_ROOM_M = 0.5
"""From the robots and places of the hall that are next to its door to the door."""
DOOR_M = 0.3
"""Width and depth of the door: one robot fits."""
HALL_S = 135
"""By then a hundred robots are out of the hall."""
CROSSING_S = 10
"""Nearly to the next place and back."""
FLOOD_S = 60
"""One wave and the silence behind it: the next one begins a minute later."""

HALL = """\
// From where they stand to their places, each in its turn.
type action moveto(R: robot, A: area) -o at(R, A).
type sensor at(robot, area).
type !due(robot, float).

start(R).

start(R), due(R, D) -o crossing(R, D).
crossing: assert(crossing(R, D), at(R, exit), D, broadcast(R)).
crossing(R, _) -o moveto(R, exit).
"""

CROSSING = """\
// To and fro between two places, for as long as the lab lasts.
type action goto(R: robot, float, float).
type !home(robot, float, float).
type !away(robot, float, float).

out(R).

out(R), away(R, X, Y) -o goto(R, X, Y) then back(R).
back(R), home(R, X, Y) -o goto(R, X, Y) then out(R).
"""

FLOOD = """\
// Waves that run through all robots: who hears of a newer one tells its neighbors.
type action wait(robot, float).
type !edge(robot, robot).
type seen(robot, int).
type wave(robot, int).
type origin(robot, int).

seen(R, 0).
origin(@1, 1).

origin(R, N) -o wave(R, N), wait(R, 60.0) then origin(R, N + 1).
wave(R, N), seen(R, Old), N > Old -o seen(R, N), {B | edge(R, B) | wave(B, N)}.
wave(R, N), $seen(R, Old), N <= Old -o 1.
"""


def columns(robots: int) -> int:
    """Return how many robots stand in a row."""
    return ceil(sqrt(robots))


def crossing(folder: Path, robots: int) -> Path:
    """Write the lab of `robots` that cross each other's ways, and return its folder."""
    wide = columns(robots)
    side = (wide + 1) * PITCH_M

    def facts() -> Iterator[str]:
        for index in range(robots):
            row, column = divmod(index, wide)
            x, y = (column + 0.5) * PITCH_M, (row + 0.5) * PITCH_M
            dx, dy = (PITCH_M, 0.0) if (row + column) % 2 else (0.0, PITCH_M)
            yield f"home(@{index + 1}, {x}, {y})"
            yield f"away(@{index + 1}, {x + dx}, {y + dy})"

    text = f"""\
lab: crossing
program: crossing.rmr
duration: {CROSSING_S}s
arena: {{size: [{side}, {side}], cell: 0.1}}
robots:
  - {{ids: 1-{robots}, grid: {{from: [0.5, 0.5], step: [{PITCH_M}, {PITCH_M}], columns: {wide}}}}}
radio: {{tx_power_dbm: -20, sensitivity_dbm: -85, exponent: 3.0}}
localisation: {{beacons: [[0, 0], [{side}, 0]], rate: 10, sigma: 0.005}}
facts:
"""
    return _written(folder / f"crossing-{robots}", "crossing.rmr", CROSSING, text, facts())


def hall(folder: Path, robots: int) -> Path:
    """Write the lab of `robots` that queue for a door, and return its folder; who is nearer to it is due earlier."""
    deep = columns(robots)
    across = 2 * HALL_AROUND_M + (deep - 1) * HALL_PITCH_M
    door, middle = HALL_AROUND_M + (deep - 1) * HALL_PITCH_M + HALL_ROOM_M, across / 2
    offsets = [
        (HALL_ROOM_M + column * HALL_PITCH_M, (row - (deep - 1) / 2) * HALL_PITCH_M)
        for column in range(deep)
        for row in range(deep)
    ]
    offsets.sort(key=lambda offset: hypot(*offset))
    starts = [(door - dx, middle + dy) for dx, dy in offsets[:robots]]
    places = [[round(door + DOOR_M + dx, 2), round(middle + dy, 2)] for dx, dy in reversed(offsets[:robots])]
    text = f"""\
lab: hall
program: hall.rmr
duration: {HALL_S}s
arena: {{size: [{2 * door + DOOR_M:.2f}, {across:.2f}], cell: 0.05}}
obstacles:
  - {{box: [{door:.2f}, 0.0, {door + DOOR_M:.2f}, {middle - DOOR_M / 2:.2f}]}}
  - {{box: [{door:.2f}, {middle + DOOR_M / 2:.2f}, {door + DOOR_M:.2f}, {across:.2f}]}}
areas:
  entry: {{at: [{door - 0.1:.2f}, {middle:.2f}]}}
  exit: {{slots: {places}}}
bottleneck: entry
robots:
"""
    text += "".join(f"  - {{id: {i}, pose: [{x:.2f}, {y:.2f}, 0deg]}}\n" for i, (x, y) in enumerate(starts, 1))
    text += f"""\
radio: {{tx_power_dbm: 0, sensitivity_dbm: -85, exponent: 3.0}}
localisation: {{beacons: [[0, 0], [{2 * door + DOOR_M:.2f}, 0]], rate: 10, sigma: 0.005}}
facts:
"""
    facts = (f"due(@{i}, {24 + 2 * i})" for i in range(1, robots + 1))
    return _written(folder / f"hall-{robots}", "hall.rmr", HALL, text, facts)


def flood(folder: Path, robots: int) -> Path:
    """Write the lab of `robots` without bodies through which waves run, and return its folder."""
    wide = columns(robots)
    side = (wide + 1) * PITCH_M

    def facts() -> Iterator[str]:
        for index in range(robots):
            column = index % wide
            if column + 1 < wide and index + 1 < robots:
                yield f"edge(@{index + 1}, @{index + 2})"
            if index + wide < robots:
                yield f"edge(@{index + 1}, @{index + wide + 1})"

    text = f"""\
lab: flood
program: flood.rmr
duration: {FLOOD_S}s
arena: {{size: [{side}, {side}], cell: 0.1}}
robots:
  - {{ids: 1-{robots}, grid: {{from: [0.5, 0.5], step: [{PITCH_M}, {PITCH_M}], columns: {wide}}}}}
radio: {{tx_power_dbm: -38, sensitivity_dbm: -85, exponent: 3.0}}
facts:
"""
    return _written(folder / f"flood-{robots}", "flood.rmr", FLOOD, text, facts())


def _written(folder: Path, name: str, program: str, lab: str, facts: Iterator[str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(program, "utf-8")
    (folder / "lab.yaml").write_text(lab + "".join(f"  - {fact}\n" for fact in facts), "utf-8")
    return folder

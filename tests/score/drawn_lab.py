"""Labs that nobody chose: floor, robots, beacons, program and deadlines drawn from a seed.

    python tests/score/drawn_lab.py SEED [FOLDER]

writes the lab of the seed into a folder (build/drawn/SEED), with `lab.yaml`, the program and, for some, an image of the
floor; `rmr check` and `rmr sim` take it. The seed of its run is the same.

Each part has a random stream of its own, `drawn/SEED/PART`: another way to draw one part changes no other.
Robots are mostly near the default (7 cm, 0.2 m/s), some far from it: 0.05 to 0.5 m, 0.1 to 2 m/s. A lab that
`rmr check` refuses is no failure. One that it accepts has a way to its end: whatever robots stand at their places, the
others can drive around them.
"""

import argparse
import math
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from random import Random
from typing import Any, Final

import yaml
from drawn_floor import DEFAULT_RADIUS_M, DEFAULT_SPEED_MPS, FLOORS, Floor, Gate, Shape, draw_floor, pixels, places
from drawn_program import PROGRAMS, Scene, Work, draw_work

from rmr.base.geometry import Point, distance
from rmr.base.streams import stream
from rmr.node.config import IN_RANGE_DB
from rmr.radio.phy import RadioConfig, path_loss_db

ROOT: Final = Path(__file__).parents[2]
ROBOTS: Final = (2, 30)
RADII_M: Final = (0.05, 0.5)
SPEEDS_MPS: Final = (0.1, 2.0)
BEACONS: Final = (2, 8)
NEAR: Final = 0.7
"""Share of labs whose robots are near the default in radius, and of those in speed."""
CROSSED_S_MAX: Final = 30.0
"""Time for the diagonal of the floor at full speed, at most: slower robots are made faster, up to the fastest."""
DURATION_S: Final = (45.0, 900.0)
"""Range of the duration of a run."""
CELLS_MAX: Final = 200_000
"""Cells of the planning grid, of which a lab file may have 250,000."""
FROM_IMAGE: Final = 0.15
"""Share of floors that are given as images."""
ROOM: Final = (1.0, 2.0, 4.0, 16.0)
"""Areas of the floor, relative to the usual one, that are tried until two robots find places."""
CORRIDORS_FROM: Final = 5_000
"""Labs of seeds before this have no corridors that meet: their rows are compared with those that were landed."""
NAMINGS: Final = ("none", "bottleneck", "passages", "stations")


@dataclass(frozen=True, slots=True)
class DrawnLab:
    """A lab as the contents of its files."""

    seed: int
    kinds: dict[str, str]
    """What was drawn: `floor`, `image`, `program`, `naming`, `beacons`, `robots`, `deadlines`."""
    lab: dict[str, Any]
    """The lab file."""
    program: str
    image: bytes | None

    def write(self, folder: Path) -> Path:
        """Write the files into `folder`, which is made; return it."""
        folder.mkdir(parents=True, exist_ok=True)
        text = yaml.safe_dump(self.lab, sort_keys=False, default_flow_style=None, width=120)
        (folder / "lab.yaml").write_text(f"# {self}\n{text}", encoding="utf-8")
        (folder / "drawn.rmr").write_text(self.program, encoding="utf-8")
        if self.image is not None:
            (folder / "floor.pgm").write_bytes(self.image)
        return folder

    @property
    def digest(self) -> str:
        """Identifies the files: another way to draw makes another lab of the same seed."""
        parts = (yaml.safe_dump(self.lab, sort_keys=False), self.program)
        return sha256("\0".join(parts).encode() + (self.image or b"")).hexdigest()[:12]

    def __str__(self) -> str:
        robot = self.lab["robot"]
        kinds = ", ".join(f"{name}: {value}" for name, value in self.kinds.items())
        return f"Drawn lab {self.seed}; {kinds}, radius: {robot['radius']} m, speed: {robot['speed']} m/s."


def draw_lab(seed: int) -> DrawnLab:
    """Return the lab of a seed, an integer from 0."""
    return next(lab for lab in (_with_room(seed, room) for room in ROOM) if len(lab.lab["robots"]) >= ROBOTS[0])


def _with_room(seed: int, room: float) -> DrawnLab:
    """Return the lab of a seed with so much room on its floor, with as many robots as find a place."""
    robots_rng, floor_rng, rng = (stream(f"drawn/{seed}/{part}") for part in ("robots", "floor", "kinds"))
    program = rng.choices(list(PROGRAMS), (30, 20, 20, 20, 10))[0]
    weights = (10, 25, 20, 20, 10, 15, 0 if seed < CORRIDORS_FROM else 50)
    kind = "open" if program == "formation" else rng.choices(list(FLOORS), weights)[0]
    count, shape = _robots(robots_rng)
    image = floor_rng.random() < FROM_IMAGE
    step = round(max(0.02, 0.2 * shape.radius), 2) if image else 0.01
    floor = draw_floor(floor_rng, kind, shape, count, step, room)
    least = min(SPEEDS_MPS[1], round(math.hypot(floor.width, floor.height) / CROSSED_S_MAX, 2))
    shape = Shape(shape.radius, max(shape.speed, least))
    naming = _naming(rng, floor, program)
    tightness = rng.choice(("loose", "fair", "tight"))
    starts = places(stream(f"drawn/{seed}/starts"), floor, shape.radius, count, parked=False)
    word = "assert" if naming == "bottleneck" or rng.random() < (0.6 if naming == "stations" else 0.2) else "watch"
    scene = Scene(stream(f"drawn/{seed}/program"), floor, shape, starts, word, tightness)
    work = draw_work(scene, program)
    kinds = {
        "floor": kind,
        "image": "yes" if image else "no",
        "program": program,
        "naming": naming,
        "deadlines": f"{tightness} ({word})",
        "robots": str(len(work.ideal_s)),
    }
    lab = _lab(seed, floor, shape, starts[: len(work.ideal_s)], work)
    _name(stream(f"drawn/{seed}/naming"), lab, floor, naming, shape)
    kinds["beacons"] = _beacons(stream(f"drawn/{seed}/beacons"), lab, floor)
    _disturb(stream(f"drawn/{seed}/radio"), lab)
    _reach(lab, floor)
    lab["duration"] = f"{_duration_s(shape, work, exclusive=word == 'assert' or naming != 'none'):.0f}s"
    if image:
        lab["map"] = "floor.pgm"
        del lab["obstacles"]
    return DrawnLab(seed, kinds, lab, work.text, pixels(floor, step) if image else None)


def _reach(lab: dict[str, Any], floor: Floor) -> None:
    """Let the radio surely reach over the floor, as `rmr check` advises: else no program and no turns are possible."""
    radio = RadioConfig()
    loss_db = path_loss_db(math.hypot(floor.width, floor.height), radio.exponent)
    if loss_db > radio.tx_power_dbm - radio.sensitivity_dbm:
        power = math.ceil(radio.sensitivity_dbm + loss_db + IN_RANGE_DB)
        lab["radio"] = {**lab.get("radio", {}), "tx_power_dbm": power}


def _robots(rng: Random) -> tuple[int, Shape]:
    """Return how many robots there are and what they are like."""
    count = round(math.exp(rng.uniform(math.log(ROBOTS[0]), math.log(ROBOTS[1]))))
    return count, Shape(
        round(_near_or_far(rng, DEFAULT_RADIUS_M, RADII_M), 3),
        round(_near_or_far(rng, DEFAULT_SPEED_MPS, SPEEDS_MPS), 2),
    )


def _near_or_far(rng: Random, default: float, limits: tuple[float, float]) -> float:
    """Return the default, a value near to it, or one far off."""
    if rng.random() < NEAR:
        return default * rng.choice((1.0, rng.uniform(0.8, 1.3)))
    return math.exp(rng.uniform(*map(math.log, limits)))


def _naming(rng: Random, floor: Floor, program: str) -> str:
    """Return which places of the floor the lab file names."""
    if program == "station" and rng.random() < 0.7:
        return "stations"
    if not floor.gates or program == "formation":
        return "none"
    return rng.choices(("none", "bottleneck", "passages"), (25, 35, 40))[0]


def _lab(seed: int, floor: Floor, shape: Shape, starts: list[Point], work: Work) -> dict[str, Any]:
    """Return the lab file without what is named and disturbed."""
    rng = stream(f"drawn/{seed}/headings")
    area = floor.width * floor.height
    cell = 0.05 if area < 60.0 else round(0.05 * max(1.0, shape.radius / DEFAULT_RADIUS_M), 2)
    cell = max(cell, math.ceil(100.0 * math.sqrt(area / CELLS_MAX)) / 100.0)
    poses = [[*start, f"{15 * rng.randrange(24)}deg"] for start in starts]
    return {
        "lab": f"drawn{seed}",
        "program": "drawn.rmr",
        "seed": seed,
        "duration": "",
        "finish": work.finish,
        "arena": {"size": [floor.width, floor.height], "cell": cell},
        "obstacles": [entry for entry, _ in floor.obstacles],
        "areas": dict(work.areas),
        "robots": [{"id": robot, "pose": pose} for robot, pose in enumerate(poses, 1)],
        "facts": work.facts,
        "robot": {"radius": shape.radius, "speed": shape.speed},
    }


def _name(rng: Random, lab: dict[str, Any], floor: Floor, naming: str, shape: Shape) -> None:
    """Name the bottleneck, some of the passages or all that have room, or the stations."""
    if naming == "stations":
        lab["stations"] = [name for name in lab["areas"] if name.startswith("s")]
    if naming not in ("bottleneck", "passages"):
        return
    gates = rng.sample(floor.gates, len(floor.gates))
    gates.sort(key=lambda gate: not gate.narrow)
    if naming == "bottleneck":
        gates = gates[:1]
    elif rng.random() < 0.3:
        gates = gates[: rng.randint(1, len(gates))]
    named = {}
    for number, gate in enumerate(_apart(gates, shape.radius), 1):
        mouths = [f"m{number}a", f"m{number}b"]
        lab["areas"] |= {mouth: {"at": list(end)} for mouth, end in zip(mouths, gate.ends, strict=True)}
        named[f"pass{number}"] = {"mouths": mouths}
    if naming == "passages":
        lab["passages"] = named
    else:
        lab["bottleneck"] = named["pass1"]


def _apart(gates: list[Gate], radius: float) -> list[Gate]:
    """Return those of `gates` that have room for robots that wait, as `rmr check` asks for it."""
    found: list[Gate] = []
    for gate in gates:
        others = (end for other in found for end in other.ends)
        if all(distance(*end, *other) >= 8.0 * radius + 0.1 for other in others for end in gate.ends):
            found.append(gate)
    return found


def _beacons(rng: Random, lab: dict[str, Any], floor: Floor) -> str:
    """Place beacons; return how."""
    where = rng.choices(("default", "wall", "around", "anywhere"), (25, 25, 25, 25))[0]
    lab["localisation"] = {}
    if where == "default":
        return where
    count = rng.choices(range(BEACONS[0], BEACONS[1] + 1), (35, 20, 15, 10, 8, 6, 6))[0]
    side = rng.randrange(4)
    apart = 0.3 * min(floor.width, floor.height)
    found: list[Point] = []
    while len(found) < count:
        at = _beacon(rng, floor, where, side)
        if all(distance(*at, *other) >= apart for other in found):
            found.append(at)
        apart *= 0.99
    lab["localisation"]["beacons"] = [list(at) for at in found]
    return f"{count} {where}"


def _beacon(rng: Random, floor: Floor, where: str, side: int) -> Point:
    """Return a drawn place of one beacon: on one wall, on any, or anywhere."""
    x, y = round(rng.uniform(0.0, floor.width), 2), round(rng.uniform(0.0, floor.height), 2)
    if where == "anywhere":
        return Point(min(x, floor.width), min(y, floor.height))
    wall = side if where == "wall" else rng.randrange(4)
    if rng.random() < 0.3:  # a corner, as people place them
        x, y = rng.choice((0.0, floor.width)), rng.choice((0.0, floor.height))
    return (Point(x, 0.0), Point(x, floor.height), Point(0.0, y), Point(floor.width, y))[wall]


def _disturb(rng: Random, lab: dict[str, Any]) -> None:
    """Let some labs lose frames or pulses."""
    if rng.random() < 0.25:
        lab["radio"] = {"loss": round(rng.uniform(0.02, 0.2), 2)}
    if rng.random() < 0.2:
        lab["localisation"]["dropout"] = round(rng.uniform(0.05, 0.3), 2)


def _duration_s(shape: Shape, work: Work, *, exclusive: bool) -> float:
    """Return several times what robots need that wait for each other now and then, `exclusive`: one after the other.

    Events of a time assertion exclude each other, and so do drives through a passage.
    """
    alone = sum(work.ideal_s) if exclusive else max(work.ideal_s, default=0.0)
    queue = len(work.ideal_s) * work.legs * (6.0 * shape.radius / shape.speed + 2.0)
    return min(max(DURATION_S[0], 20.0 + 2.5 * alone + 1.2 * queue), DURATION_S[1])


def command(seed: int, *, chaos: bool = False) -> str:
    """Return the command that repeats the run of a drawn lab."""
    folder = f"build/drawn/{seed}"
    return f"python tests/score/drawn_lab.py {seed} && rmr sim {folder}{' --chaos' if chaos else ''}"


def main() -> int:
    """Write the lab of a seed; return the exit code."""
    parser = argparse.ArgumentParser(description="Write the lab that a seed draws, for rmr check and rmr sim.")
    parser.add_argument("seed", type=int)
    parser.add_argument("folder", type=Path, nargs="?", help="default: build/drawn/SEED")
    options = parser.parse_args()
    if options.seed < 0:
        parser.error(f"a seed is an integer from 0, not {options.seed}")
    drawn = draw_lab(options.seed)
    folder = options.folder or ROOT / "build" / "drawn" / str(options.seed)
    try:
        drawn.write(folder)
    except OSError as error:
        print(f"{folder}: {error.strerror}", file=sys.stderr)
        return 2
    print(f"{drawn}\n{folder}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Drawn layouts of beacons: a robot's estimate is near its position wherever beacons stand, or the lab is refused.

Floor, obstacles, beacons (2 to 8, anywhere on the floor or its walls), loss of pulses and the drive are drawn from the
seed. The body is driven by a script that knows the truth; like the robot itself it stands while there is no pose. As a
script it prints a line for each layout that is not right, and a summary:

    .venv/bin/python tests/sim/drawn_beacons.py 1-1000
"""

import math
import sys
import tempfile
from pathlib import Path
from random import Random
from typing import NamedTuple

from rmr.base.geometry import STILL, Twist
from rmr.base.time import tick_start
from rmr.node.motion.localiser import Localiser
from rmr_world.finding import LabError
from rmr_world.lab import Lab
from rmr_world.lab_file import load_lab
from rmr_world.physics import World

ERROR_M_MAX = 0.15
"""Bound of the distance between estimate and truth."""
LOCATED_S_MAX = 6.0
"""Bound of the time until a standing robot is located."""
TICKS = 1200
MARGIN_M = 0.13


class Drawn(NamedTuple):
    """The result of one layout."""

    refused: bool
    error_m: float = 0.0
    """Greatest distance between estimate and truth."""
    located_s: float = 0.0
    """When it was located first."""
    dropped: int = 0
    """Number of estimates that were dropped."""

    @property
    def is_right(self) -> bool:
        """Whether the robot is refused, or knows where it is."""
        return self.refused or (self.error_m <= ERROR_M_MAX and self.located_s <= LOCATED_S_MAX)


def layout(seed: int) -> str:
    """Return the lab file of a drawn layout."""
    rng = Random(f"{seed}/layout")
    width, height = round(rng.uniform(1.5, 6.0), 2), round(rng.uniform(1.5, 6.0), 2)
    beacons = []
    for _ in range(rng.randint(2, 8)):
        x, y = rng.uniform(0.0, width), rng.uniform(0.0, height)
        if rng.random() < 0.5:  # on a wall
            x, y = rng.choice(((x, 0.0), (x, height), (0.0, y), (width, y)))
        beacons.append([round(x, 2), round(y, 2)])
    robot = [round(rng.uniform(0.15, width - 0.15), 2), round(rng.uniform(0.15, height - 0.15), 2)]
    obstacles = []
    for _ in range(rng.randint(0, 5)):
        x, y, r = rng.uniform(0, width), rng.uniform(0, height), rng.uniform(0.05, 0.3)
        if math.dist((x, y), robot) > r + 0.25:
            obstacles.append(f"{{circle: [{x:.2f}, {y:.2f}, {r:.2f}]}}")
    dropout = rng.choice((0.0, 0.1, 0.3))
    return (
        f"lab: drawn\nprogram: none.rmr\nduration: 60s\narena: {{size: [{width}, {height}]}}\n"
        f"obstacles: [{', '.join(obstacles)}]\n"
        f"robots: [{{id: 1, pose: [{robot[0]}, {robot[1]}, {rng.randrange(360)}deg]}}]\n"
        f"localisation: {{beacons: {beacons}, dropout: {dropout}}}\n"
    )


def drawn(seed: int, folder: Path) -> Drawn:
    """Return what becomes of a robot in the layout of `seed`."""
    path = folder / "lab.yaml"
    path.write_text(layout(seed), "utf-8")
    try:
        lab = load_lab(path)
    except LabError as error:
        if "so it cannot tell where it is" not in str(error):
            raise
        return Drawn(refused=True)
    return driven(lab, seed)


def driven(lab: Lab, seed: int) -> Drawn:
    """Return the errors of a robot that drives about in `lab`."""
    rng = Random(f"{seed}/drive")
    world = World(lab, seed)
    localiser = Localiser(lab.arena)
    error_m = 0.0
    located_s = math.inf
    turn = 0.0
    for tick in range(1, TICKS + 1):
        now = tick_start(tick)
        world.step(now)
        localiser.feed(now, world.sense(1, now))
        pose = world.pose(1)
        twist = STILL
        if localiser.pose is not None:
            located_s = min(located_s, tick / 60)
            error_m = max(error_m, math.dist(localiser.pose[:2], pose[:2]))
            ahead = pose.x + 0.1 * math.cos(pose.theta), pose.y + 0.1 * math.sin(pose.theta)
            if tick % 60 == 0:
                turn = rng.uniform(-1.0, 1.0)
            twist = Twist(0.2, turn) if lab.arena.clearance(*ahead) > MARGIN_M else Twist(0.0, 2.0)
        world.act(1, twist, now, now)
    return Drawn(False, error_m, located_s, localiser.dropped)


def main() -> None:
    """Try the seeds of the command line."""
    first, last = map(int, sys.argv[1].split("-"))
    results = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, last + 1):
            result = drawn(seed, Path(folder))
            results.append(result)
            if not result.is_right or result.dropped:
                print(seed, result)
    kept = [each for each in results if not each.refused]
    wrong = sum(not each.is_right for each in results)
    print(f"{len(results)} layouts, {len(results) - len(kept)} refused, {wrong} wrong")
    error_m = max(each.error_m for each in kept)
    print(f"greatest error {error_m:.3f} m, last located {max(each.located_s for each in kept):.2f} s")


if __name__ == "__main__":
    main()

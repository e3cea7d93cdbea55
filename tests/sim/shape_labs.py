"""Labs for robots of any radius and speed: their floors grow with what the robots need.

`crossing`: robots of both sides change places on open floor. `head_on`: the same in a lane where one can pass another
that stands in its middle. `bottleneck`: a wall with a door, by which robots of both sides drive in turns.
"""

import math
from random import Random

from rmr.base.motion_scale import view_depth

KINDS = ("crossing", "head_on", "bottleneck")

PROGRAM = """
type action moveto(R: robot, A: area) -o at(R, A) else stuck(R, A).
type sensor at(robot, area).
type !goes(robot, area).
start(R).
start(R), goes(R, A) -o moveto(R, A).
stuck(R, A) -o moveto(R, A).
at(R, A), goes(R, A) -o !there(R).
"""


def shape_lab(kind: str, radius: float, speed: float, robots: int, rng: Random, *, view: float | None = None) -> str:
    """Return the lab file of `robots` that change sides, half of them on each."""
    depth = view_depth(radius, speed) if view is None else view
    step = max(4.0 * radius, 2.0 * radius + 0.15)
    rows = (robots + 1) // 2
    wait = 2.0 * radius + 0.1
    high = max(rows * step, 6.0 * radius) + 0.1
    if kind == "head_on":
        high = 7.0 * radius + 0.2
        rows = 1
    columns = math.ceil((robots + 1) // 2 / rows)
    side = columns * step + wait
    middle = max(2.0 * depth, 8.0 * radius) + 0.5
    width = 2.0 * side + middle
    ys = [0.5 * high + (i - 0.5 * (rows - 1)) * step for i in range(rows)]
    places = [(radius + 0.1 + column * step, y) for column in range(columns) for y in ys]
    left = [(x + rng.uniform(0.0, 0.05), y) for x, y in places]
    right = [(width - x, y) for x, y in left]
    starts = left[: (robots + 1) // 2] + right[: robots // 2]
    goals = right[: (robots + 1) // 2] + left[: robots // 2]
    if kind == "head_on":  # who is nearest to the middle goes to the far end, else it would bar the lane
        goals = right[: (robots + 1) // 2][::-1] + left[: robots // 2][::-1]
    if kind == "crossing":
        mine, others = goals[: (robots + 1) // 2], goals[(robots + 1) // 2 :]
        rng.shuffle(mine)
        rng.shuffle(others)
        goals = mine + others
    areas = [f"  g{i}: {{at: [{x:.3f}, {y:.3f}]}}" for i, (x, y) in enumerate(goals, 1)]
    lines = ["lab: shapes", "program: shapes.rmr", f"duration: {60 + 40 * robots * max(1.0, width / speed / 20):.0f}s"]
    lines += ["finish: there(R)", f"arena: {{size: [{width:.3f}, {high:.3f}]}}"]
    if kind == "bottleneck":
        door = 1.4 * radius + 0.03  # half of it
        length = 3.0 * radius
        x0, x1, y = 0.5 * (width - length), 0.5 * (width + length), 0.5 * high
        lines += ["obstacles:", f"  - {{box: [{x0:.3f}, 0, {x1:.3f}, {y - door:.3f}]}}"]
        lines += [f"  - {{box: [{x0:.3f}, {y + door:.3f}, {x1:.3f}, {high:.3f}]}}"]
        lines += ["passages: {door: {mouths: [mw, me]}}"]
        areas += [f"  mw: {{at: [{x0 - radius:.3f}, {y:.3f}]}}", f"  me: {{at: [{x1 + radius:.3f}, {y:.3f}]}}"]
    lines += ["areas:", *areas, "robots:"]
    for i, (x, y) in enumerate(starts, 1):
        lines.append(f"  - {{id: {i}, pose: [{x:.3f}, {y:.3f}, {0 if x < 0.5 * width else 180}deg]}}")
    facts = ", ".join(f'"goes(@{i}, g{i})"' for i in range(1, robots + 1))
    shown = "" if view is None else f", view: {{depth: {view}}}"
    lines += [f"facts: [{facts}]", f"robot: {{radius: {radius}, speed: {speed}{shown}}}"]
    lines += [f"localisation: {{beacons: [[0, 0], [{width:.3f}, 0]]}}", ""]
    return "\n".join(lines)

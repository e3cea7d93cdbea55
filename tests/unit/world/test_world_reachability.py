"""Ways before a run: what the check accepts, the planner of the robots finds."""

from random import Random

import pytest
from world_labs import lab_of

from rmr.base.geometry import Point
from rmr.node.motion.astar import plan
from rmr_world.validate.reachability import Ways


@pytest.mark.parametrize("cell", [0.05, 0.13, 0.22])
@pytest.mark.parametrize("radius", [0.05, 0.07, 0.12])
def test_the_check_and_the_planner_agree_on_whether_there_is_a_way(tmp_path, cell, radius):
    lab = lab_of(
        tmp_path,
        f"""\
lab: room
program: room.rmr
arena: {{size: [3.1, 2.3], cell: {cell}}}
obstacles:
  - {{box: [1.5, 0.0, 1.51, 0.9]}}
  - {{box: [1.5, {0.9 + 2 * radius + 0.035}, 1.51, 2.3]}}
  - {{circle: [2.3, 0.5, 0.3]}}
robot: {{radius: {radius}}}
robots:
  - {{id: 1, pose: [0.5, 0.75, 0deg]}}
""",
    )
    ways = Ways(lab)
    rng = Random(f"2/ways/{cell}/{radius}")
    places = [Point(rng.uniform(radius, 3.1 - radius), rng.uniform(radius, 2.3 - radius)) for _ in range(20)]
    for start in places[:10]:
        for goal in places[10:]:
            if lab.arena.clearance(*goal) >= radius + 0.005:
                assert ways.between(start, goal) == (plan(lab.arena, start, goal) is not None)

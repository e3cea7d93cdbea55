"""Bodies that roll and bodies that the engine moves go the same ways, to the bit, wherever they run into something."""

from random import Random

import pytest
from world_labs import lab_of

from rmr.base.geometry import Twist
from rmr.base.time import tick_start
from rmr_world import physics
from rmr_world.contact_engine import ContactEngine
from rmr_world.physics import World

ROBOTS = 4
LAB = """\
lab: crowded
program: crowded.rmr
arena: {size: [1.6, 1.2]}
obstacles:
  - {box: [0.7, 0.0, 0.9, 0.3]}
  - {circle: [0.8, 0.9, 0.1]}
robots:
  - {ids: 1-4, grid: {from: [0.2, 0.5], step: [0.4, 0], columns: 4}}
"""
TICKS = 1200
FOR_EVER = TICKS + 1


def driven(world: World, seed: int) -> list[object]:
    """Return what can be seen of robots that drive about at random, at every tick.

    Until two contacts are at once: these the engine takes in an order that depends on what it was asked before.
    """
    rng, found, twists = Random(seed), [], {}
    for tick in range(TICKS):
        if tick % 45 == 0:
            twists = {robot: Twist(rng.uniform(-0.1, 0.2), rng.gauss(0.0, 1.0)) for robot in range(1, ROBOTS + 1)}
            twists[rng.randint(1, ROBOTS)] = Twist(0.0, 0.0)
        for robot, twist in twists.items():
            if rng.random() < 0.9:
                world.act(robot, twist, tick_start(tick), tick_start(tick))
        world.step(tick_start(tick + 1))
        if world.touching > 1:
            break
        found += [world.pose(robot) for robot in twists]
        found += [world.min_gap_m, world.collisions]
    return [*found, world.contacts]


@pytest.mark.medium
def test_bodies_move_as_if_the_engine_were_asked_at_every_tick(tmp_path, monkeypatch):
    lab = lab_of(tmp_path, LAB)
    asked, step = [], ContactEngine.step
    monkeypatch.setattr(ContactEngine, "step", lambda engine, s: (asked.append(engine), step(engine, s)))
    rolled = collisions = 0
    for seed in range(12):
        with monkeypatch.context() as patch:
            patch.setattr(physics, "SETTLED_TICKS", FOR_EVER)
            often = World(lab, seed)
            expected = driven(often, seed)
        always, collisions = len(asked), collisions + often.collisions
        asked.clear()
        assert driven(World(lab, seed), seed) == expected
        assert 0 < len(asked) < always, "the engine was never asked, or at every tick"
        rolled += always - len(asked)
        asked.clear()
    assert rolled > 5000, "hardly a body has rolled"
    assert collisions > 30, "nobody has run into anything"

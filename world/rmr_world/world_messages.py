"""What the world tells, as messages of the bus: its map, the samples of the sensors, the ground truth."""

import math
from dataclasses import asdict

from rmr.base import arena
from rmr.base.time import Instant
from rmr.bus import wire
from rmr.node.ports import Sensed
from rmr_world.lab import Lab
from rmr_world.physics import World


def map_of(lab: Lab, seed: int) -> wire.Map:
    """Return the map of `lab` before lab time runs, as a robot of it is told."""
    finish = lab.finish_pattern
    radio = asdict(lab.radio.config) | {
        "seed": seed if lab.radio.seed is None else lab.radio.seed,
        "security": lab.radio.security,
        "pan": lab.pan,
    }
    return wire.Map(
        lab=lab.name,
        listed=True,
        taken=False,
        lives=0,
        seed=seed,
        roster=lab.roster,
        arena=arena.to_data(lab.arena),
        radio=radio,
        facts=tuple((fact.name, fact.owner, fact.args) for fact in lab.initial_facts),
        finish=None if finish is None else (finish.name, finish.constants),
        clock="waiting",
        disturbances=tuple(lab.disturbances),
    )


def sense_of(sensed: Sensed) -> wire.Sense:
    """Return what a robot is told of its sensors."""
    s = sensed
    bodies = tuple([(body.x, body.y, body.vx, body.vy) for body in s.bodies])
    return wire.Sense(s.stamp, s.left_m, s.right_m, s.gyro, s.compass, s.ranges, bodies, s.bumped, s.truth)


def truth_of(physics: World, roster: tuple[int, ...], stamp: Instant, late: int, *, final: bool) -> wire.Truth:
    """Return the ground truth at `stamp`, after `late` ticks that were stepped late."""
    gap = physics.min_gap_m
    return wire.Truth(
        stamp=stamp,
        robots=tuple((robot, *physics.pose(robot), physics.distance_m(robot)) for robot in roster),
        collisions=physics.collisions,
        min_gap_m=gap if math.isfinite(gap) else None,
        ticks_late=late,
        final=final,
    )

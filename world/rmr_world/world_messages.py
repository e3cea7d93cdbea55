"""What the world tells: messages of the bus, and its part of the recording.

The messages are its map, the samples of the sensors and the ground truth; the recording gets the scene, true poses and
disturbances of the radio.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

from rmr.base import arena
from rmr.base.geometry import Pose
from rmr.base.time import Instant
from rmr.bus import wire
from rmr.bus.process_recorder import ProcessRecorder
from rmr.node.ports import Sensed
from rmr.radio.links import Disturbance
from rmr.record.foxglove_messages import grid, scene
from rmr.record.record_writer import RecordWriter
from rmr.record.robot_observer import PoseRecorder
from rmr_world.faults import fault_entry
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
        performs=lab.performs,
    )


def sense_of(sensed: Sensed) -> wire.Sense:
    """Return what a robot is told of its sensors."""
    s = sensed
    bodies = tuple([(body.x, body.y, body.vx, body.vy) for body in s.bodies])
    fix = None if s.fix is None else s.fix.values()
    felt = (s.stamp, s.left_m, s.right_m, s.gyro, s.compass, s.ranges)
    return wire.Sense(*felt, bodies, s.bumped, s.truth, fix, s.facts)


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


class WorldRecorder:
    """The world's part of the recording; without a `recorder` it is none."""

    def __init__(self, recorder: ProcessRecorder | None, lab: Lab, seed: int, run: Callable[[], int]) -> None:
        """`run` returns the number of the world's session."""
        self._recorder = recorder
        self._lab = lab
        self._seed = seed
        self._run = run
        self._writer: RecordWriter | None = None
        self._poses: PoseRecorder | None = None

    def begin(self, now: Callable[[], Instant], poses: Iterable[tuple[int, Pose]]) -> None:
        """Begin the file, with the scene and the first poses; `now` is lab time."""
        lab = self._lab
        if self._recorder is None:
            return
        self._writer = writer = self._recorder.begin(lab.name, self._seed, lab.roster, self._run(), now)
        first = max(0, now())  # of a world that goes on: the part before has what was earlier
        writer.write("/scene", first, scene(lab.arena, lab.roster))
        writer.write("/floor", first, grid(lab.arena))
        self._poses = PoseRecorder(writer)
        self.poses(first, poses)
        for disturbance in () if first else lab.disturbances:
            self.fault(0, fault_entry(disturbance))

    def poses(self, now: Instant, poses: Iterable[tuple[int, Pose]]) -> None:
        """Take the true poses, by robot."""
        if self._poses is not None:
            self._poses.take(now, poses)

    def added(self, now: Instant, disturbance: Disturbance) -> None:
        """Take a disturbance that `rmr fault` has added."""
        self.fault(now, fault_entry(disturbance))

    def fault(self, now: Instant, entry: dict[str, Any]) -> None:
        """Take a fault, as an entry of a lab file."""
        if self._writer is not None:
            self._writer.write("/faults", now, {"fault": entry})

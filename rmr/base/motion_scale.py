"""What follows from a robot's radius and speed: the lengths, speeds and times of motion and coordination.

The margins of `rmr.node.motion` were measured with one robot, `REFERENCE`. What covers the error of localisation alone
is the same for all robots, and stands where it is used. All else has parts that grow with different things:

- *way to stand*, v LAG_S + v^2 / (2 BRAKE): what has to be seen or heard early enough;
- *blur*, what a robot drives within the age of a sample: gaps to bodies that drive, by the speed that they have;
- *size*, the radius: how far places are apart, how far aside an escape leads;
- *tempo*, the time to drive the own width: when standing is a deadlock.

For the reference robot each value is that which was measured, to the bit. No margin is less than that: localisation,
radio and grid do not become finer with a smaller or slower robot. docs/motion.md has the argument.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from rmr.base.arena import BRAKE, REFERENCE, RobotShape
from rmr.base.time import TICK_S, Duration, milliseconds, seconds

LAG_S: Final = 0.117
"""Wheels go on for 0.1 s after the last command; with the frame in which it is given."""
REACTION_BRAKE: Final = 0.7
"""Deceleration of a robot that stops for another one, m/s^2, its own and the other's; the wheels can do `BRAKE`."""
PLANNED_BRAKE: Final = 0.5
"""Deceleration of planned stops, and of slowing down early, m/s^2."""
SAMPLE_AGE_S: Final = 2.0 * TICK_S
"""Age of a sample in a process that is called in time, seconds."""
HEADING_ERROR: Final = 0.03
"""Three standard deviations of the estimated heading, radians."""
NOTICE_S: Final = 0.4
"""Time in which two robots that come into each other's view begin to brake, seconds."""
HEAR_S: Final = 0.65
"""Time in which a robot hears of a change, seconds: three hellos of those that drive."""
LEAST_HORIZON_S: Final = 1.0
"""How far ahead the paths of robots are predicted that stop at once, seconds; else for the time to drive six widths."""


def way_to_stand(speed: float, brake: float = BRAKE) -> float:
    """Return how far a robot moves on from `speed` m/s until it stands, metres."""
    return speed * LAG_S + speed * speed / (2.0 * brake)


def view_depth(radius: float, speed: float) -> float:
    """Return the depth of view by default, metres from the robot's centre to the nearest point of another body.

    The radius, the ways to stand of two robots that come towards each other, and what they drive until both brake: 8 cm
    at 0.2 m/s, as much as there is room in the view of the reference robot.
    """
    faster = max(0.0, speed - REFERENCE.speed)
    wider = max(0.0, radius - REFERENCE.radius)
    return REFERENCE.view_depth + wider + 2.0 * _beyond_reference(speed, BRAKE) + NOTICE_S * faster


def least_view_depth(radius: float, speed: float) -> float:
    """Return the depth of view with which two robots that come towards each other can just stop, metres."""
    return radius + 2.0 * way_to_stand(speed, REACTION_BRAKE)


def blur_m(speed: float) -> float:
    """Return how much farther than the reference robot one drives at `speed` m/s within the age of a sample, metres."""
    return SAMPLE_AGE_S * max(0.0, speed - REFERENCE.speed)


def _beyond_reference(speed: float, brake: float) -> float:
    """Return by how much a robot's way to stand is longer than that of the reference robot, metres; 0 at least."""
    return max(0.0, way_to_stand(speed, brake) - way_to_stand(REFERENCE.speed, brake))


@dataclass(frozen=True, slots=True)
class MotionScale:
    """The derived quantities of robots of one shape."""

    radius: float
    """Metres."""
    speed: float
    """m/s."""
    size: float
    """The radius, in those of the reference robot; 1 at least."""
    pace: float
    """The speed, in those of the reference robot; 1 at least."""
    tempo: float
    """Time to drive the own width, in that of the reference robot; 1 at least."""
    astray_m: float
    """How far an error of the heading leads it astray on its way to stand, beyond the reference robot, metres."""
    stop_s: float
    """Time to stop from full speed for another robot, seconds."""
    conflict_gap_m: float
    """Predicted gap between hulls that is wide enough, metres."""
    near_m: float
    """Robots whose centres are farther apart than this cannot matter before the next update, metres."""
    update: Duration
    """Period with which a driving robot takes in the hellos of the others that drive."""
    unwatched: Duration
    """The wheels may turn at full speed for this long after the newest sample."""
    start_s: float
    """Time that speeding up from standstill costs against full speed, seconds."""
    headway_m: float
    """Gap between two hulls in a row that both drive at full speed, metres."""
    ramp: Duration
    """Speeding up and slowing down of drives in common time: half of what the wheels can do."""
    step_s: float
    """Step of the prediction of paths, seconds: in it a robot drives less than a radius."""
    steps: int
    """Steps of the prediction, with the present."""

    @property
    def horizon_s(self) -> float:
        """How far ahead paths are predicted, seconds."""
        return self.step_s * (self.steps - 1)


@lru_cache(maxsize=64)
def scale_of(shape: RobotShape) -> MotionScale:
    """Return the derived quantities of robots of this `shape`."""
    radius = shape.radius
    speed = shape.speed
    size = max(1.0, radius / REFERENCE.radius)
    pace = max(1.0, speed / REFERENCE.speed)
    faster = max(0.0, speed - REFERENCE.speed)
    wider = max(0.0, radius - REFERENCE.radius)
    widths = (radius / REFERENCE.radius) / (speed / REFERENCE.speed)
    step_s = 0.25 * widths
    horizon_s = max(4.0 * widths, LEAST_HORIZON_S) + faster / BRAKE
    return MotionScale(
        radius=radius,
        speed=speed,
        size=size,
        pace=pace,
        tempo=max(1.0, widths),
        astray_m=HEADING_ERROR * _beyond_reference(speed, BRAKE),
        stop_s=0.4 + faster / REACTION_BRAKE,
        conflict_gap_m=0.04 + 2.0 * blur_m(speed),
        near_m=0.5 + 2.0 * (wider + _beyond_reference(speed, BRAKE) + HEAR_S * faster),
        update=round(milliseconds(200) / pace),
        unwatched=max(seconds(SAMPLE_AGE_S), round(milliseconds(50) / pace)),
        start_s=max(0.0, 0.15 + (speed - REFERENCE.speed) / (2.0 * BRAKE)),
        headway_m=0.07 + (LAG_S + SAMPLE_AGE_S) * faster,
        ramp=round(milliseconds(500) * pace),
        step_s=step_s,
        steps=round(horizon_s / step_s) + 1,
    )

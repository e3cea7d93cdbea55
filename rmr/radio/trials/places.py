"""Positions of stations, in metres around the origin."""

from math import cos, pi, radians, sin, sqrt
from random import Random

Place = tuple[float, float]

ORIGIN: Place = (0.0, 0.0)


def at_angle(distance_m: float, angle_deg: float) -> Place:
    """Return the place at a distance from the origin in a direction."""
    return distance_m * cos(radians(angle_deg)), distance_m * sin(radians(angle_deg))


def circle(count: int, radius_m: float) -> list[Place]:
    """Return `count` places equally spaced on a circle."""
    return [at_angle(radius_m, 360.0 * index / count) for index in range(count)]


def disk(count: int, radius_m: float, rng: Random) -> list[Place]:
    """Return `count` places drawn evenly from a disk."""
    polar = [(radius_m * sqrt(rng.random()), 2 * pi * rng.random()) for _ in range(count)]
    return [(distance * cos(angle), distance * sin(angle)) for distance, angle in polar]

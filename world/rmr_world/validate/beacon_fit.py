"""Fit of the beacons: where they stand, a robot can tell its position from the mirror image, and well enough to stop.

For the mirror image the robots' own search (`rmr.node.motion.multilateration`) says which positions a set of ranges
leaves. It is asked for places all over the floor. Of most layouts the geometry of the beacons alone tells enough: they
stand on one wall, or far enough beside each line.

How well a robot knows its position follows from the geometry as well: near the line through two beacons ranges say
little of the way across it. The robots' own filter is asked (`rmr.node.motion.ekf`).
"""

import math
from collections.abc import Iterator, Sequence

from rmr.base.arena import Arena
from rmr.base.geometry import Point, distance, hypot
from rmr.bytecode.program import Program
from rmr.node.motion.ekf import RANGE_SIGMA, Ekf
from rmr.node.motion.localiser import DECIDES, ECHOES_MAX, range_sigma
from rmr.node.motion.multilateration import SAME_M, Echo, hypotheses
from rmr.node.motion.shield import SIGMAS
from rmr_world.finding import FilePath, Finding
from rmr_world.lab import Lab
from rmr_world.validate.lab_draft import LabDraft

LINE_SHARE = 0.1
"""Part of the floor's diagonal by which a beacon stands beside the line of others that tells every image apart.

At a distance d of a beacon and u of the line, h beside it gives a difference of 2 u h / d of two ranges. With u of
SAME_M / 2 and ranges of RANGE_SIGMA that is 1.4 standard deviations, and DECIDES is reached with a dozen ranges.
"""
WORST_M = 0.05
"""Standard deviation with which a robot arrives, metres: of one that has ranges, no more."""
SETTLED_S = 10.0
"""Time for which it stands, seconds."""
LOOKS_MAX = 4000
"""Places of the floor that are looked at, at most."""


def no_mirror_image(draft: LabDraft) -> Iterator[Finding]:
    """No two places on the free floor have the same distances to all beacons."""
    arena = draft.arena
    if "arena" in draft.cut or "localisation" in draft.cut or not draft.robot_fits_arena:
        return
    found = mirrored(arena)
    if found is None:
        return
    here, there = found
    count = len(set(arena.beacons))
    beside = f"{LINE_SHARE * _diagonal(arena):.2g} m"
    message = (
        f"a robot at ({here.x:.2f}, {here.y:.2f}) is as far from {'both' if count == 2 else f'all {count}'} beacons as "
        f"one at ({there.x:.2f}, {there.y:.2f}), so it cannot tell where it is: put them along one wall, or another "
        f"beacon {beside} or more beside their line"
    )
    yield draft.error(("localisation", "beacons"), message)


def mirrored(arena: Arena) -> tuple[Point, Point] | None:
    """Return the two places farthest apart on the free floor that ranges do not tell apart; None if there are none."""
    beacons = list(dict.fromkeys(arena.beacons))
    if len(beacons) < 2 or _is_clear(arena, beacons):
        return None
    times = max(1, ECHOES_MAX // len(beacons))
    radius = arena.shape.radius
    wide = max(0.0, arena.width - 2.0 * radius)
    high = max(0.0, arena.height - 2.0 * radius)
    step = max(SAME_M, (wide * high / LOOKS_MAX) ** 0.5)
    found: tuple[Point, Point] | None = None
    apart = 0.0
    for i in range(int(wide / step) + 1):
        for k in range(int(high / step) + 1):
            here = Point(radius + i * step, radius + k * step)
            if arena.clearance(*here) < radius:
                continue
            image = _image(arena, beacons, here, times)
            if image is not None and distance(*here, *image) > apart:
                apart = distance(*here, *image)
                found = here, image
    return found


def _image(arena: Arena, beacons: Sequence[Point], here: Point, times: int) -> Point | None:
    """Return a place that a robot at `here` takes for possible after `times` exact ranges to each beacon."""
    echoes = [Echo(k, x, y, distance(x, y, *here)) for k, (x, y) in enumerate(beacons)]
    for other in hypotheses(echoes, arena, range_sigma(arena)):
        if times * other.misfit < DECIDES and distance(other.x, other.y, *here) >= SAME_M:
            return Point(other.x, other.y)
    return None


def _is_clear(arena: Arena, beacons: Sequence[Point]) -> bool:
    """Return whether the geometry of the beacons alone tells that there is no image."""
    a, b = max(((a, b) for a in beacons for b in beacons), key=lambda pair: distance(*pair[0], *pair[1]))
    base = distance(*a, *b)

    def off(point: Point) -> float:
        """Return how far `point` is to the left of the line of the two beacons that are farthest apart."""
        return ((b.x - a.x) * (point.y - a.y) - (b.y - a.y) * (point.x - a.x)) / base

    if max(abs(off(beacon)) for beacon in beacons) >= LINE_SHARE * _diagonal(arena) * range_sigma(arena) / RANGE_SIGMA:
        return True
    radius = arena.shape.radius
    sides = [off(Point(x, y)) for x in (radius, arena.width - radius) for y in (radius, arena.height - radius)]
    return len(beacons) == 2 and (min(sides) >= -0.5 * SAME_M or max(sides) <= 0.5 * SAME_M)


def _diagonal(arena: Arena) -> float:
    return hypot(arena.width, arena.height)


def place_known_too_badly(lab: Lab, _program: Program) -> Iterator[Finding]:
    """Warn of places nearer to a wall than a robot that knows its position no better drives up to it."""
    arena = lab.arena
    if len(set(arena.beacons)) < 2 or lab.localisation.dropout == 1.0:
        return
    for area in arena.areas:
        for index, place in enumerate(area.places if area.box is None else ()):
            spare = arena.clearance(*place) - arena.shape.radius
            if not 0.0 <= spare < SIGMAS * WORST_M:
                continue
            sigma = settled_sigma(lab, place)
            if spare < SIGMAS * sigma:
                path: FilePath = ("areas", area.name, "slots", index)
                message = (
                    f"a robot at ({place.x:g}, {place.y:g}), near the line through the beacons, knows its position to "
                    f"{1e3 * sigma:.0f} mm and keeps three times that off walls; it has {1e3 * spare:.0f} mm there, so "
                    "it may arrive late or never: move the place, or add a beacon beside the line"
                )
                yield lab.warning(path if path in lab.places else ("areas", area.name), message)


def settled_sigma(lab: Lab, place: Point) -> float:
    """Return the standard deviation of the position of a robot that has stood at `place`, metres, across its worst."""
    arena = lab.arena
    ekf = Ekf(place.x, place.y, 0.0, sigma=WORST_M, range_sigma=range_sigma(arena))
    pulses_s = lab.localisation.rate * (1.0 - lab.localisation.dropout)
    for _ in range(math.ceil(SETTLED_S * pulses_s)):
        ekf.predict(0.0, 0.0, 0.0, 1.0 / pulses_s)
        for beacon in arena.beacons:
            ekf.range(beacon, distance(*beacon, *place))
    return ekf.position_sigma


CHECKS = (no_mirror_image,)
"""The rules of the beacons that need the lab file alone."""
LINT = (place_known_too_badly,)
"""The lint of the beacons of a lab."""

"""Multilateration: the positions on the floor that explain a set of ranges (least squares, Gauss-Newton).

The circles of two beacons meet on both sides of the beacons' line, so ranges may fit in two places. `hypotheses`
returns each local minimum of the squared residuals at which a hull can be. The two intersections of the pair of
circles that cross at the largest angle are the starts of the search; Levenberg and Marquardt's damping leads from
there to the minimum, and no step leaves the floor.

Ranges need not be heard at one place: each comes with the beacon as it would stand if the robot had been all the time
where it is now (`Echo`), which a compass and odometry tell whatever the position is.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from rmr.base.arena import Arena
from rmr.base.geometry import Point, hypot

STEPS_MAX: Final = 30
"""Steps of one search, at most; some five are usual."""
CLOSE_M: Final = 1e-5
"""A smaller step ends the search."""
BASE_M_MIN: Final = 1e-3
"""Beacons nearer to each other than this are one."""
APART_M: Final = 0.05
"""How far beside the beacons' line the search begins at least: on it the residuals have a saddle."""
SAME_M: Final = 0.1
"""Two minima nearer to each other than this are one hypothesis, whose uncertainty covers both."""
OVERLAP_M: Final = 0.05
"""How far a hull may seem to stand inside an obstacle: the error of a first position, with room."""


class Echo(NamedTuple):
    """One range, as heard from where the robot is now."""

    beacon: int
    """The beacon's index: echoes of one beacon with itself have no base."""
    x: float
    """The beacon's place, moved by what the robot has driven since the pulse."""
    y: float
    metres: float


class Hypothesis(NamedTuple):
    """A position that may be the robot's."""

    x: float
    y: float
    misfit: float
    """Sum of the squared residuals in units of the range's variance: chi-squared, of two degrees fewer than ranges."""
    pxx: float
    """Covariance of the position, square metres."""
    pxy: float
    pyy: float

    @property
    def sigma_m(self) -> float:
        """Standard deviation of the position along its worst axis, metres."""
        half = 0.5 * (self.pxx - self.pyy)
        return math.sqrt(0.5 * (self.pxx + self.pyy) + math.sqrt(half * half + self.pxy * self.pxy))


def hypotheses(echoes: Sequence[Echo], arena: Arena, sigma_m: float) -> list[Hypothesis]:
    """Return the positions on the floor of `arena` that `echoes` with noise of `sigma_m` fit, the best one first.

    Empty without ranges to two beacons in different places.
    """
    found: list[Hypothesis] = []
    for start in _intersections(echoes):
        fit = _fitted(echoes, start, arena, sigma_m)
        if arena.clearance(fit.x, fit.y) >= arena.shape.radius - OVERLAP_M:
            found.append(fit)
    found.sort(key=lambda each: each.misfit)
    if len(found) == 2:
        off_x = found[1].x - found[0].x
        off_y = found[1].y - found[0].y
        if hypot(off_x, off_y) < SAME_M:
            best = found[0]
            wide = best._replace(
                pxx=best.pxx + off_x * off_x, pxy=best.pxy + off_x * off_y, pyy=best.pyy + off_y * off_y
            )
            return [wide]
    return found


def _intersections(echoes: Sequence[Echo]) -> list[Point]:
    """Return where the two circles meet that cross at the largest angle; for circles that do not, points nearby."""
    newest = {echo.beacon: echo for echo in echoes}
    several = list(newest.values())
    best: list[Point] = []
    widest = -1.0
    for i, a in enumerate(several):
        for b in several[i + 1 :]:
            base = hypot(b.x - a.x, b.y - a.y)
            if base < BASE_M_MIN:
                continue
            along = (base * base + a.metres * a.metres - b.metres * b.metres) / (2.0 * base)
            up = math.sqrt(max(0.0, a.metres * a.metres - along * along))
            angle = base * up / max(1e-9, a.metres * b.metres)  # its sine, by the area of the triangle
            if angle > widest:
                widest = angle
                up = max(up, APART_M)
                ux = (b.x - a.x) / base
                uy = (b.y - a.y) / base
                best = [
                    Point(a.x + along * ux - side * up * uy, a.y + along * uy + side * up * ux) for side in (1.0, -1.0)
                ]
    return best


def _fitted(echoes: Sequence[Echo], start: Point, arena: Arena, sigma_m: float) -> Hypothesis:
    """Return the local minimum of the squared residuals that is downhill from `start`."""
    margin = arena.shape.radius
    right = max(margin, arena.width - margin)
    top = max(margin, arena.height - margin)
    x = max(margin, min(right, start.x))
    y = max(margin, min(top, start.y))
    damping = 1e-3
    cost, nxx, nxy, nyy, gx, gy = _normal_equations(echoes, x, y)
    for _ in range(STEPS_MAX):
        axx = nxx + damping
        ayy = nyy + damping
        # At a wall a step that leads out of the floor is one along the wall.
        free_x = not ((x <= margin and gx < 0.0) or (x >= right and gx > 0.0))
        free_y = not ((y <= margin and gy < 0.0) or (y >= top and gy > 0.0))
        if free_x and free_y:
            determinant = axx * ayy - nxy * nxy
            dx = (ayy * gx - nxy * gy) / determinant
            dy = (axx * gy - nxy * gx) / determinant
        else:
            dx = gx / axx if free_x else 0.0
            dy = gy / ayy if free_y else 0.0
        to_x = max(margin, min(right, x + dx))
        to_y = max(margin, min(top, y + dy))
        tried = _normal_equations(echoes, to_x, to_y)
        if tried[0] > cost:
            damping *= 10.0
            continue
        moved = abs(to_x - x) + abs(to_y - y)
        x = to_x
        y = to_y
        cost, nxx, nxy, nyy, gx, gy = tried
        damping = max(1e-6, 0.1 * damping)
        if moved < CLOSE_M:
            break
    variance = sigma_m * sigma_m
    # A direction of which the ranges say nothing has the size of the floor as its uncertainty.
    least = variance / (arena.width * arena.width + arena.height * arena.height)
    nxx += least
    nyy += least
    share = variance / (nxx * nyy - nxy * nxy)
    return Hypothesis(x, y, cost / variance, nyy * share, -nxy * share, nxx * share)


def _normal_equations(echoes: Sequence[Echo], x: float, y: float) -> tuple[float, float, float, float, float, float]:
    """Return the sum of squared residuals at (x, y), the normal matrix (xx, xy, yy), and the right-hand side."""
    cost = nxx = nxy = nyy = gx = gy = 0.0
    for echo in echoes:
        dx = x - echo.x
        dy = y - echo.y
        away = max(1e-9, hypot(dx, dy))
        hx = dx / away
        hy = dy / away
        off = echo.metres - away
        cost += off * off
        nxx += hx * hx
        nxy += hx * hy
        nyy += hy * hy
        gx += hx * off
        gy += hy * off
    return cost, nxx, nxy, nyy, gx, gy

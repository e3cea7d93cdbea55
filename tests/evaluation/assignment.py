"""The best assignments of places to robots, to compare with: worked out whole, by one who knows everything.

`ways[i][k]` is the way of robot i to place k, metres; there are as many places as robots.
"""

import math
from collections.abc import Sequence

Ways = Sequence[Sequence[float]]


def ways_between(starts: Sequence[Sequence[float]], places: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return the length of every straight way from a start to a place."""
    return [[math.dist(start, place) for place in places] for start in starts]


def least_squares(ways: Ways) -> float:
    """Return the least sum of squared ways, by the Hungarian method (shortest augmenting paths with potentials)."""
    n = len(ways)
    rows, columns = [0.0] * (n + 1), [0.0] * (n + 1)
    held = [0] * (n + 1)
    """The robot, from 1, that has each place, from 1; place 0 is that of the robot to be placed."""
    for robot in range(1, n + 1):
        held[0], place = robot, 0
        slack, before, seen = [math.inf] * (n + 1), [0] * (n + 1), [False] * (n + 1)
        while held[place]:
            seen[place] = True
            for other in range(1, n + 1):
                if not seen[other]:
                    spare = ways[held[place] - 1][other - 1] ** 2 - rows[held[place]] - columns[other]
                    if spare < slack[other]:
                        slack[other], before[other] = spare, place
            place = min((other for other in range(1, n + 1) if not seen[other]), key=lambda other: slack[other])
            step = slack[place]
            for other in range(n + 1):
                if seen[other]:
                    rows[held[other]] += step
                    columns[other] -= step
                else:
                    slack[other] -= step
        while place:
            held[place] = held[before[place]]
            place = before[place]
    return sum(ways[held[place] - 1][place - 1] ** 2 for place in range(1, n + 1))


def least_longest(ways: Ways) -> float:
    """Return the least that the longest way can be: no assignment brings all robots to places with less."""
    lengths = sorted({length for row in ways for length in row})
    low, high = 0, len(lengths) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if _possible(ways, lengths[middle]) else (middle + 1, high)
    return lengths[low]


def _possible(ways: Ways, longest: float) -> bool:
    """Return whether all robots find places within `longest`, by augmenting paths."""
    holder: dict[int, int] = {}

    def placed(robot: int, tried: set[int]) -> bool:
        for place, length in enumerate(ways[robot]):
            if length <= longest and place not in tried:
                tried.add(place)
                if place not in holder or placed(holder[place], tried):
                    holder[place] = robot
                    return True
        return False

    return all(placed(robot, set()) for robot in range(len(ways)))

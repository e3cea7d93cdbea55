"""Topology: the pairs of robots that are in radio range of each other.

A topology is a symmetric relation between robots, never of a robot with itself. The complete one is never spelt out:
ten thousand robots would have fifty million pairs. The others are neighbours by robot, in ascending order, so that a
broadcast reaches them in the same order on every machine.
"""

import json
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Protocol

from rmr.base.ids import shown
from rmr.eval.options import OptionError
from rmr.lang.analyse.names import meant

FILE_OCTETS_MAX = 1 << 26
"""64 MiB: a million pairs take about 12 MB; a larger file is no topology."""

Pair = tuple[int, int]


class Topology(Protocol):
    """The neighbourhood relation of the robots."""

    def neighbors(self, robot: int) -> Collection[int]:
        """Return the robots in range of `robot`, in ascending order."""

    def adjacent(self, one: int, other: int) -> bool:
        """Return whether the two are in range of each other."""

    def degree(self, robot: int) -> int:
        """Return how many robots are in range of `robot`."""


class Complete:
    """All are in range of all."""

    def __init__(self, robots: Collection[int]) -> None:
        self._robots = robots

    def neighbors(self, robot: int) -> Collection[int]:
        """Return all robots but `robot`."""
        return [other for other in self._robots if other != robot]

    def adjacent(self, one: int, other: int) -> bool:
        """Return whether both exist and are two."""
        return one != other and one in self._robots and other in self._robots

    def degree(self, robot: int) -> int:
        """Return how many others there are."""
        return len(self._robots) - (robot in self._robots)


class Listed:
    """The pairs are listed."""

    def __init__(self, robots: Iterable[int], pairs: Iterable[Pair]) -> None:
        found: dict[int, dict[int, None]] = {robot: {} for robot in robots}
        for one, other in pairs:
            found[one][other] = None
            found[other][one] = None
        self._neighbors = {robot: dict.fromkeys(sorted(others)) for robot, others in found.items()}

    def neighbors(self, robot: int) -> Collection[int]:
        """Return the robots in range of `robot`."""
        return self._neighbors[robot].keys()

    def adjacent(self, one: int, other: int) -> bool:
        """Return whether the pair is listed."""
        return other in self._neighbors[one]

    def degree(self, robot: int) -> int:
        """Return how many robots are in range of `robot`."""
        return len(self._neighbors[robot])


def _line(robots: Sequence[int]) -> Iterator[Pair]:
    """Each with the next."""
    yield from pairwise(robots)


def _ring(robots: Sequence[int]) -> Iterator[Pair]:
    """A line whose last robot is in range of the first; two robots are one pair."""
    yield from _line(robots)
    if len(robots) > 2:
        yield robots[-1], robots[0]


def _grid(robots: Sequence[int]) -> Iterator[Pair]:
    """Rows as long as the square root of the number, rounded up; each with those beside, before and behind it."""
    columns = math.isqrt(len(robots) - 1) + 1
    for place, robot in enumerate(robots):
        if (place + 1) % columns and place + 1 < len(robots):
            yield robot, robots[place + 1]
        if place + columns < len(robots):
            yield robot, robots[place + columns]


def _star(robots: Sequence[int]) -> Iterator[Pair]:
    """The first with all others."""
    yield from ((robots[0], other) for other in robots[1:])


_SHAPES: dict[str, Callable[[Sequence[int]], Iterator[Pair]]] = {
    "line": _line,
    "ring": _ring,
    "grid": _grid,
    "star": _star,
}
COMPLETE = "complete"
NAMES = (COMPLETE, *_SHAPES)


def named(name: str, robots: Collection[int]) -> Topology:
    """Return the topology called `name`, one of NAMES, over `robots` in ascending order."""
    if name == COMPLETE:
        return Complete(robots)
    return Listed(robots, _SHAPES[name](tuple(robots)))


# ---- files


def read(text: str, robots: Collection[int]) -> Topology:
    """Return the topology that `text` names, one of NAMES or a file, over `robots`. Raises OptionError."""
    if text in NAMES:
        return named(text, robots)
    names = ", ".join(NAMES)
    try:
        with Path(text).open("rb") as stream:
            octets = stream.read(FILE_OCTETS_MAX + 1)
    except FileNotFoundError:
        hint = meant(text, list(NAMES))
        raise OptionError(f"there is no file {shown(text)}; " + (hint or f"write {names}, or a file")) from None
    except (OSError, ValueError) as error:
        raise OptionError(f"cannot read {shown(text)}: {getattr(error, 'strerror', None) or error}") from None
    if len(octets) > FILE_OCTETS_MAX:
        raise OptionError(f"{text}: larger than {FILE_OCTETS_MAX >> 20} MiB")
    try:
        return from_text(octets.decode("utf-8"), text, robots)
    except UnicodeDecodeError as error:
        raise OptionError(f"{text}: not UTF-8 at octet {error.start}; {names} are known by name") from None


_PAIR_LINE = re.compile(r"([0-9]{1,6})(?:\s*[-,]\s*|\s+)([0-9]{1,6})", re.ASCII)


def from_text(text: str, file: str, robots: Collection[int]) -> Topology:
    """Return the topology that a file's text lists: lines such as ``1 2`` or ``1-2``, or JSON, a list of pairs.

    Raises OptionError that names file, line and what is wrong there.
    """
    pairs = _json_pairs(text, file) if text.lstrip().startswith("[") else _line_pairs(text, file)
    return Listed(robots, [_checked(pair, place, robots) for pair, place in pairs])


def _line_pairs(text: str, file: str) -> Iterator[tuple[Pair, str]]:
    """Yield the pairs with their places, one a line; ``#`` begins a comment."""
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].strip()
        if not content:
            continue
        match = _PAIR_LINE.fullmatch(content)
        if match is None:
            raise OptionError(f"{file}:{number}: expected two robots such as 1 2 or 1-2, found {shown(content)}")
        yield (int(match[1]), int(match[2])), f"{file}:{number}"


def _json_pairs(text: str, file: str) -> Iterator[tuple[Pair, str]]:
    """Yield the pairs of a JSON list with their places; JSON keeps no lines, so an item is named by its number."""
    try:
        items = json.loads(text)
    except json.JSONDecodeError as error:
        raise OptionError(f"{file}:{error.lineno}:{error.colno}: this is no JSON: {error.msg}") from None
    except (ValueError, RecursionError):  # a number of thousands of digits, lists in lists
        raise OptionError(f"{file}:1: this is no list of pairs of robots") from None
    for number, item in enumerate(items, 1):
        if not (isinstance(item, list) and len(item) == 2 and all(type(each) is int for each in item)):
            raise OptionError(f"{file}: item {number}: expected a pair such as [1, 2], found {shown(json.dumps(item))}")
        yield (item[0], item[1]), f"{file}: item {number}"


def _checked(pair: Pair, place: str, robots: Collection[int]) -> Pair:
    one, other = pair
    for robot in pair:
        if robot not in robots:
            raise OptionError(f"{place}: robot {robot} is not among the robots of --robots")
    if one == other:
        raise OptionError(f"{place}: robot {one} is paired with itself; a pair is two robots")
    return pair

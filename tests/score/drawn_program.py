"""Programs of drawn labs: single drives, tours, loads fetched and carried, places shared by all, formations.

Each kind is one text whose time assertion is a `watch` or an `assert`, with facts that say who goes where by when. A
drive without a way is tried again, so that a run that does not finish is no fault of the program's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from random import Random
from typing import Any, Final

from drawn_floor import Floor, Shape, places

from rmr.base.geometry import Point, distance
from rmr_world.provided_labs import labs_folder

DETOUR: Final = 1.3
"""Length of a drive over that of the straight line, as deadlines are drawn."""
WAIT_S: Final = (1.0, 6.0)
"""Range of the time that a robot spends at a place."""
FACTORS: Final = {"loose": (4.0, 8.0), "fair": (2.0, 4.0), "tight": (1.1, 2.0)}
"""Range of a deadline over the time of the robot's drives and waits alone."""
PACE: Final = "const pace = 0.18."

HEAD = """\
type action moveto(R: robot, A: area) -o at(R, A) else stuck(R, A).
type sensor at(robot, area).
"""

TOUR = """\
// Each robot visits its places one after the other, each by a deadline.
type !within(robot, float).  // seconds for each place
type tour(robot, list area).

start(R).
start(R) -o next(R).

next(R), tour(R, [A | Rest]), within(R, D) -o tour(R, Rest), leg(R, A, D).
next(R), tour(R, []) -o done(R).

legs: {word}(leg(R, A, D), there(R, A), D, broadcast(R)).

leg(R, A, _) -o going(R, A), moveto(R, A).
going(R, A), at(R, A) -o there(R, A).
there(R, _) -o next(R).
stuck(R, A) -o moveto(R, A).
"""

DRIVE = """\
// Each robot drives to its place by a deadline.
type !goes(robot, area).
type !due(robot, float).  // seconds

start(R).
start(R), due(R, D), goes(R, A) -o crossing(R, D), moveto(R, A).
at(R, A), goes(R, A) -o done(R).

crossing: {word}(crossing(R, D), done(R), D, broadcast(R)).

stuck(R, A) -o moveto(R, A).
"""

CARRY = """\
// Each robot fetches goods from a store and carries them home, once or more often, each time by a deadline.
type action wait(R: robot, S: float) -o rested(R).
type !store(robot, area).
type !home(robot, area).
type !due(robot, float).  // seconds
type rounds(robot, int).

start(R).
start(R) -o next(R).

next(R), rounds(R, N), N > 0, due(R, D) -o rounds(R, N - 1), ordered(R, D).
next(R), rounds(R, 0) -o done(R).

delivery: {word}(ordered(R, D), delivered(R), D, broadcast(R)).

ordered(R, _), store(R, A) -o moveto(R, A) then wait(R, {wait}).
rested(R), home(R, B) -o homing(R), moveto(R, B).
homing(R), at(R, B), home(R, B) -o delivered(R).
delivered(R) -o next(R).

stuck(R, A), store(R, A) -o moveto(R, A) then wait(R, {wait}).
stuck(R, B), home(R, B) -o moveto(R, B).
"""


@dataclass(slots=True)
class Work:
    """What robots do on a floor, as parts of the lab file."""

    text: str
    """The program."""
    finish: str
    ideal_s: list[float]
    """By robot, the time of its drives and waits alone."""
    legs: int
    """Drives of a robot, at most."""
    areas: dict[str, dict[str, Any]] = field(default_factory=dict)
    facts: list[str] = field(default_factory=list)
    stations: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Scene:
    """What programs are drawn for."""

    rng: Random
    floor: Floor
    shape: Shape
    starts: Sequence[Point]
    word: str
    """`assert` where drives are to have turns, else `watch`."""
    tightness: str

    def way_s(self, *points: Point) -> float:
        """Return the time of drives through `points`, seconds."""
        length = sum(distance(*a, *b) for a, b in pairwise(points))
        return 1.0 + DETOUR * length / self.shape.speed

    def due_s(self, ideal_s: float) -> float:
        """Return a drawn deadline for what takes `ideal_s` alone."""
        return round(ideal_s * self.rng.uniform(*FACTORS[self.tightness]), 1)

    def wait_s(self) -> float:
        """Return a drawn time at a place."""
        return round(self.rng.uniform(*WAIT_S), 1)

    def goals(self) -> list[Point]:
        """Return a place for each robot to park; on floors with openings often on the other side of them."""
        rng, floor, count = self.rng, self.floor, len(self.starts)
        flow = rng.choice(("mixed", "across", "across")) if floor.gates else "mixed"
        found = places(rng, floor, self.shape.radius, count)
        if flow == "across":
            order = sorted(range(count), key=lambda robot: self.starts[robot].x)
            far = dict(zip(order, sorted(found, key=lambda place: -place.x), strict=False))
            return [far[robot] for robot in range(count) if robot in far]
        return found


def _drive(scene: Scene) -> Work:
    goals = scene.goals()
    ideal = [scene.way_s(start, goal) for start, goal in zip(scene.starts, goals, strict=False)]
    work = Work(HEAD + DRIVE.format(word=scene.word), "done(R)", ideal, 1)
    for robot, goal in enumerate(goals, 1):
        work.areas[f"g{robot}"] = {"at": list(goal)}
        work.facts += [f"goes(@{robot}, g{robot})", f"due(@{robot}, {scene.due_s(ideal[robot - 1])})"]
    return work


def _tour(scene: Scene) -> Work:
    """Each robot visits one to three places of a pool that all share, and parks at a place of its own."""
    rng = scene.rng
    goals = scene.goals()
    pool = places(rng, scene.floor, scene.shape.radius, rng.randint(2, 6), beside=goals)
    work = Work(HEAD + TOUR.format(word=scene.word), "done(R)", [], 0)
    work.areas |= {f"p{number}": {"at": list(place)} for number, place in enumerate(pool, 1)}
    for robot, (start, goal) in enumerate(zip(scene.starts, goals, strict=False), 1):
        stops = rng.sample(range(len(pool)), min(len(pool), rng.randint(1, 3)))
        way = scene.way_s(start, *(pool[stop] for stop in stops), goal)
        names = ", ".join([*(f"p{stop + 1}" for stop in stops), f"g{robot}"])
        work.areas[f"g{robot}"] = {"at": list(goal)}
        work.facts += [
            f"tour(@{robot}, [{names}])",
            f"within(@{robot}, {scene.due_s(way / (len(stops) + 1))})",
        ]
        work.ideal_s.append(way)
        work.legs = max(work.legs, len(stops) + 1)
    return work


def _carry(scene: Scene) -> Work:
    """Robots in one to three groups, each with a store that has a place for each of them."""
    found = scene.goals()
    half = len(found) // 2  # the floor may have no place for more
    pool = places(scene.rng, scene.floor, scene.shape.radius, len(found), beside=found)
    goals = found if len(pool) == len(found) else found[:half]
    pool = pool[: len(goals)] if len(goals) <= len(pool) else found[half : 2 * half]
    groups = scene.rng.randint(1, max(1, min(3, len(goals))))
    return _to_stores(scene, goals, [pool[group::groups] for group in range(groups)])


def _station(scene: Scene) -> Work:
    """One to three stores with fewer places than robots, which therefore share them."""
    goals = scene.goals()
    pool = places(scene.rng, scene.floor, scene.shape.radius, scene.rng.randint(1, 6), beside=goals)
    if not pool:
        pool, goals = goals[:1], goals[1:]
    middle = pool[: scene.rng.randint(1, max(1, min(3, len(goals))))]
    stores: list[list[Point]] = [[] for _ in middle]
    for place in pool:  # each joins the store that is nearest: the places of one lie together
        near = min(range(len(middle)), key=lambda number: distance(*middle[number], *place))
        stores[near].append(place)
    return _to_stores(scene, goals, stores)


def _to_stores(scene: Scene, goals: Sequence[Point], stores: Sequence[Sequence[Point]]) -> Work:
    wait_s = scene.wait_s()
    rounds = scene.rng.choice((1, 1, 2))
    work = Work(HEAD + CARRY.format(word=scene.word, wait=wait_s), "done(R)", [], 2 * rounds)
    for number, slots in enumerate(filter(None, stores), 1):
        slotted = len(slots) > 1
        work.areas[f"s{number}"] = {"slots": [list(place) for place in slots]} if slotted else {"at": list(slots[0])}
    for robot, (start, goal) in enumerate(zip(scene.starts, goals, strict=False), 1):
        number = (robot - 1) % len(stores)
        store = stores[number][0]
        once_s = scene.way_s(start, store, goal) + wait_s
        work.areas[f"g{robot}"] = {"at": list(goal)}
        work.facts += [
            f"store(@{robot}, s{number + 1})",
            f"home(@{robot}, g{robot})",
            f"due(@{robot}, {scene.due_s(once_s)})",
            f"rounds(@{robot}, {rounds})",
        ]
        work.ideal_s.append(rounds * once_s)
    return work


def _formation(scene: Scene) -> Work:
    """The program of the lab `formation`, with one to three drawn shapes."""
    count, speed = len(scene.starts), scene.shape.speed
    pace = f"const pace = {round(0.9 * speed, 3)}."
    text = (labs_folder() / "formation" / "formation.rmr").read_text(encoding="utf-8")
    assert text.count(PACE) == 1, "the program of the lab formation has its pace in one line"
    shapes = scene.rng.randint(1, 3)
    work = Work(text.replace(PACE, pace), f"standing(R, {shapes})", [], shapes)
    longest_s = scene.way_s(Point(0.0, 0.0), Point(scene.floor.width, scene.floor.height))
    for number in range(1, shapes + 1):
        stands = places(scene.rng, scene.floor, scene.shape.radius, count)
        work.facts.append(f"shape(R, {number}, {[list(place) for place in stands]})")
        count = min(count, len(stands))
    work.facts.append(f"within(R, {scene.due_s(longest_s)})")
    work.ideal_s = [shapes * longest_s] * count
    return work


PROGRAMS: Final[dict[str, Callable[[Scene], Work]]] = {
    "drive": _drive,
    "tour": _tour,
    "carry": _carry,
    "station": _station,
    "formation": _formation,
}
"""The kinds of programs."""


def draw_work(scene: Scene, kind: str) -> Work:
    """Return what a kind of program has robots do; fewer than `scene` has where the floor has no place for more."""
    return PROGRAMS[kind](scene)

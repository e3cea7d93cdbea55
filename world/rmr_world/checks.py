"""From a document to a `Lab`: what the schema says of each key, then what relates the parts to each other.

Nothing stops at the first mistake. A part that the schema refuses is reported and cut out, the rest is built
and judged: robots and areas against walls, obstacles and one another, names against what they name.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from rmr.base.arena import Area, Arena, Obstacle, RobotShape
from rmr.base.geometry import Point, Pose, distance
from rmr.base.values import Symbol
from rmr.bytecode.program import Constant
from rmr.node.motion.grid import TIGHT_MARGIN_M
from rmr.radio.links import DISTURBANCES_MAX, Disturbance
from rmr.radio.phy import Bursts, RadioConfig
from rmr.radio.security import UNSECURED
from rmr.radio.settings import SETTINGS
from rmr_world.accepted import Accepted, accepted
from rmr_world.arena import area_of, grid_poses, obstacle_of, overlaps
from rmr_world.document import Document, LabError, Path_
from rmr_world.faults import deaths, passing, standing
from rmr_world.lab import KEYED, PROGRAMS, Fault, Lab, Localisation, RadioSettings, RobotStart
from rmr_world.schema import (
    RADIUS_M_MIN,
    AreaSpec,
    RadioSpec,
    RobotSpec,
    near_miss,
)
from rmr_world.terms import TermError, parse_fact, parse_finish
from rmr_world.units import ROBOTS_MAX

_TOUCH_M = 1e-9
"""Bodies that stand side by side do not overlap."""
APART_M = 0.01
"""Between two robots on neighbouring places: they know no better where they are."""


def build(document: Document, path: Path) -> Lab:
    """Return the lab that `document` describes. Raises LabError with all problems."""
    judge = _Judge(document, accepted(document))
    lab = judge.lab(path)
    if judge.problems:
        raise LabError(judge.problems)
    return lab


class _Judge:
    """Builds the lab part by part and collects what does not fit."""

    def __init__(self, document: Document, accepted: Accepted) -> None:
        self._document = document
        self._accepted = accepted
        self._spec = accepted.spec
        self.problems = accepted.problems
        raw = document.value if isinstance(document.value, dict) else {}
        areas = raw.get("areas")
        self._area_names = sorted(areas) if isinstance(areas, dict) else []

    def _complain(self, path: Path_, message: str) -> None:
        self.problems.append(self._document.problem(path, message))

    def lab(self, path: Path) -> Lab:
        """Return the lab; it is whole only if `problems` is empty."""
        spec = self._spec
        arena = self._arena()
        robots = self._robots(arena)
        if Path(spec.program).suffix not in PROGRAMS:
            self._complain(("program",), f"should be a .rmr or .rbc file, not '{spec.program}'")
        self._texts(robots, arena)
        faults, disturbances = self._faults({robot.id for _, robot in robots})
        return Lab(
            name=spec.lab,
            program=path.parent / spec.program,
            seed=spec.seed,
            duration=spec.duration,
            finish=spec.finish or "",
            arena=arena,
            robots=tuple(robot for _, robot in robots),
            facts=tuple(spec.facts),
            radio=_radio(spec.radio),
            localisation=Localisation(spec.localisation.rate, spec.localisation.sigma, spec.localisation.dropout),
            faults=faults,
            disturbances=disturbances,
            path=path,
            actions=self._file(("actions",), spec.actions, path),
            events=self._file(("events",), spec.events, path),
            key_file=None if spec.radio.key_file is None else path.parent / spec.radio.key_file,
            places=self._document.places,
        )

    def _file(self, path: Path_, name: str | None, lab_file: Path) -> Path | None:
        """Return where a file that the lab names lies; complain if it is not there."""
        if name is None:
            return None
        file = lab_file.parent / name
        if not file.is_file():
            beside = sorted(each.name for each in file.parent.glob("*.py"))
            self._complain(path, f"there is no file {file}{near_miss(file.name, beside)}")
        return file

    def _arena(self) -> Arena:
        spec = self._spec
        width, height = spec.arena.size
        shape = RobotShape(
            spec.robot.radius, spec.robot.speed, spec.robot.turn, spec.robot.view.angle, spec.robot.view.depth
        )
        if 2.0 * shape.radius > min(width, height) and "arena" not in self._accepted.cut:
            self._complain(("robot", "radius"), f"a robot of radius {shape.radius:g} m does not fit into the arena")
            shape = replace(shape, radius=RADIUS_M_MIN)  # else every place would be too small as well
        bare = Arena(width, height, spec.arena.cell, self._obstacles(width, height), shape=shape)
        areas = tuple(area for name, item in spec.areas.items() if (area := self._area(name, item, bare)))
        arena = replace(bare, areas=areas, beacons=self._beacons(width, height))
        return replace(arena, bottleneck=self._mouths(arena))

    def _mouths(self, arena: Arena) -> tuple[str, ...]:
        """Return the areas at the mouths of the bottleneck; complain if two of them are no two places."""
        path, spec = ("bottleneck",), self._spec.bottleneck
        names = () if spec is None else tuple(spec.mouths)
        for name in names:
            if name not in self._area_names:
                self._complain(path, f"area '{name}' is not defined{near_miss(name, self._area_names)}")
        places = [area.places[0] for name in names if (area := arena.area(name)) is not None]
        if len(places) == 2 and distance(*places[0], *places[1]) < 2 * arena.shape.radius:
            self._complain(path, "its two mouths are closer than a robot is wide")
        return names

    def _obstacles(self, width: float, height: float) -> tuple[Obstacle, ...]:
        obstacles: list[Obstacle] = []
        for i, item in self._accepted.items("obstacles"):
            try:
                obstacle = obstacle_of(item)
            except ValueError as error:
                self._complain(("obstacles", i), str(error))
                continue
            obstacles.append(obstacle)
            if not overlaps(obstacle, width, height):
                self._complain(("obstacles", i), "lies outside the arena")
        return tuple(obstacles)

    def _area(self, name: str, spec: AreaSpec, arena: Arena) -> Area | None:
        path: Path_ = ("areas", name)
        try:
            area = area_of(name, spec)
        except ValueError as error:
            self._complain(path, str(error))
            return None
        if spec.box is not None:
            x0, y0, x1, y1 = spec.box
            self._inside((*path, "box"), [Point(x0, y0), Point(x1, y1)], arena, fit=False)
        elif spec.at is not None:
            self._inside((*path, "at"), area.places, arena)
        else:
            kind = "slots" if spec.slots else "line"
            self._inside((*path, kind), area.places, arena, indexed=kind == "slots")
            self._apart((*path, kind), area.places, arena.shape.radius)
        self._inside((*path, "queue"), area.queue, arena)
        self._apart((*path, "queue", "spacing"), area.queue, arena.shape.radius)
        return area

    def _inside(
        self, path: Path_, places: Sequence[Point], arena: Arena, *, fit: bool = True, indexed: bool = False
    ) -> None:
        """Complain about places out of the arena or, with `fit`, where a robot cannot stand.

        With `indexed` every such place is named, else the first of the worse kind.
        """
        width, height, radius = arena.width, arena.height, arena.shape.radius
        out, tight = [], []
        for k, (x, y) in enumerate(places):
            at, where = ((*path, k), "it") if indexed or not fit else (path, f"({x:g}, {y:g})")
            if not (0.0 <= x <= width and 0.0 <= y <= height):
                out.append((at, f"{where} is out of the arena, {width:g} m x {height:g} m"))
            elif fit and arena.clearance(x, y) < radius + TIGHT_MARGIN_M - _TOUCH_M:
                spare = f"with {TIGHT_MARGIN_M * 1000:g} mm to spare"
                tight.append((at, f"a robot of radius {radius:g} m does not fit at ({x:g}, {y:g}) {spare}"))
        for at, message in [*out, *tight][: None if indexed else 1]:
            self._complain(at if indexed else path, message)

    def _apart(self, path: Path_, places: Sequence[Point], radius: float) -> None:
        for k, a in enumerate(places):
            for i, b in enumerate(places[:k]):
                if distance(*a, *b) < 2 * radius + APART_M - _TOUCH_M:
                    least = f"two robots of radius {radius:g} m and {APART_M * 1000:g} mm"
                    self._complain(path, f"places {i} and {k} are closer than {least}")
                    return

    def _beacons(self, width: float, height: float) -> tuple[Point, ...]:
        given = self._spec.localisation.beacons
        if given is None:
            return Point(0.0, 0.0), Point(width, 0.0)
        for k, (x, y) in enumerate(given):
            if not (0.0 <= x <= width and 0.0 <= y <= height):
                self._complain(("localisation", "beacons", k), f"is out of the arena, {width:g} m x {height:g} m")
        return tuple(Point(x, y) for x, y in given)

    def _robots(self, arena: Arena) -> list[tuple[int, RobotStart]]:
        """Return the robots, each with the index of the item that made it."""
        robots: list[tuple[int, RobotStart]] = []
        for i, item in self._accepted.items("robots"):
            for start in _starts(item):
                self._robot(("robots", i), start, robots, arena)
                robots.append((i, start))
        if len(robots) > ROBOTS_MAX:
            self._complain(("robots",), f"there are {len(robots)} robots; at most {ROBOTS_MAX} are possible")
        return robots

    def _robot(self, path: Path_, start: RobotStart, others: list[tuple[int, RobotStart]], arena: Arena) -> None:
        """Complain if `start` repeats an id, or overlaps a wall, an obstacle or one of the `others`."""
        radius, (x, y, _) = arena.shape.radius, start.pose
        if any(other.id == start.id for _, other in others):
            self._complain(path, f"robot {start.id} is there already")
            return
        inside = [k for k, obstacle in enumerate(arena.obstacles) if obstacle.distance(x, y) < radius - _TOUCH_M]
        touching = [o.id for _, o in others if distance(x, y, o.pose.x, o.pose.y) < 2 * radius - _TOUCH_M]
        if not (0.0 <= x <= arena.width and 0.0 <= y <= arena.height):
            self._complain(path, f"robot {start.id} starts out of the arena, {arena.width:g} m x {arena.height:g} m")
        elif min(x, y, arena.width - x, arena.height - y) < radius - _TOUCH_M:
            self._complain(path, f"robot {start.id} starts inside a wall")
        elif inside:
            self._complain(path, f"robot {start.id} starts inside an obstacle")
        if touching:
            self._complain(path, f"robot {start.id} starts inside robot {touching[0]}")

    def _texts(self, robots: list[tuple[int, RobotStart]], arena: Arena) -> None:
        """Judge `facts` and `finish`."""
        ids = {robot.id for _, robot in robots}
        told = {problem.path for problem in self.problems}
        facts = self._accepted.items("facts")
        parted = _parted([text for _, text in facts])
        if parted:
            words = 'in [ ] a comma parts the items: put each fact in quotation marks, "..."'
            self._complain(("facts", facts[parted[0]][0]), words)
        for i, text in [each for number, each in enumerate(facts) if number not in parted]:
            if f"facts.{i}" in told:
                continue
            try:
                owner = parse_fact(text).owner
            except TermError as error:
                self._complain(("facts", i), str(error))
                continue
            if owner is not None:
                self._known(("facts", i), owner, ids)
        if not self._spec.finish:
            return
        try:
            pattern = parse_finish(self._spec.finish)
        except TermError as error:
            self._complain(("finish",), str(error))
            return
        if pattern.name == "at":
            self._destination(pattern.patterns, arena, len(robots))

    def _destination(self, patterns: tuple[Any, ...], arena: Arena, robots: int) -> None:
        """Judge the area of ``finish: at(R, area)``."""
        if len(patterns) != 1:
            self._complain(("finish",), "at has two arguments: at(R, area)")
            return
        if not isinstance(patterns[0], Constant) or not isinstance(patterns[0].value, Symbol):
            return
        name = str(patterns[0].value)
        area = arena.area(name)
        if name not in self._area_names and name.lower() in map(str.lower, self._area_names):
            return  # the area's name itself is told of
        if name not in self._area_names:
            self._complain(("finish",), f"area '{name}' is not defined{near_miss(name, self._area_names)}")
        elif area is not None and area.slotted and len(area.places) < robots:
            self._complain(("finish",), f"area '{name}' has {len(area.places)} slots for {robots} robots")
        elif area is not None and not area.slotted and area.box is None and robots > 1:
            self._complain(("finish",), f"area '{name}' is one point for {robots} robots; give it slots, or a box")

    def _known(self, path: Path_, robot: int, ids: set[int]) -> None:
        if robot not in ids and "robots" not in self._accepted.cut:
            self._complain(path, f"robot {robot} is not in this lab")

    def _faults(self, ids: set[int]) -> tuple[tuple[Fault, ...], tuple[Disturbance, ...]]:
        """Return what befalls robots, and what befalls the radio."""
        found: list[tuple[Path_, Fault | Disturbance]] = [*standing(self._spec.radio)]
        for i, item in self._accepted.items("faults"):
            found += passing(item, ("faults", i), sorted(ids))
        befallen = [(path, fault) for path, fault in found if not isinstance(fault, Disturbance)]
        for path, message in () if "faults" in self._accepted.cut else deaths(befallen):
            self._complain(path, message)
        for path, fault in found:
            named = [i for group in fault.groups for i in group] if isinstance(fault, Disturbance) else [fault.robot]
            for robot in dict.fromkeys(named):
                self._known(path, robot, ids)
                if named.count(robot) > 1:
                    self._complain(path, f"robot {robot} is named twice")
        disturbances = tuple(fault for _, fault in found if isinstance(fault, Disturbance))
        if len(disturbances) > DISTURBANCES_MAX:
            message = f"the radio is disturbed in {len(disturbances)} ways; at most {DISTURBANCES_MAX} are possible"
            self._complain(("faults",), message)
        return tuple(fault for _, fault in befallen), disturbances


def _parted(texts: Sequence[str]) -> list[int]:
    """Return the indices of the parts of facts that a list in brackets has parted at their commas."""
    open_ = [text.count("(") - text.count(")") for text in texts]
    begins = any(a > 0 > b for a, b in pairwise(each for each in open_ if each))
    return [i for i, each in enumerate(open_) if each] if begins else []


def _radio(spec: RadioSpec) -> RadioSettings:
    values = spec.model_dump(include={setting.name for setting in SETTINGS})
    if values["bursts"] is not None:
        values["bursts"] = Bursts(**values["bursts"])
    security = spec.security or (UNSECURED if spec.key_file is None else KEYED)
    return RadioSettings(RadioConfig(**values), spec.seed, security)


def _starts(spec: RobotSpec) -> list[RobotStart]:
    if spec.grid is not None and spec.ids is not None:
        poses = grid_poses(spec.grid, len(spec.ids))
        return [RobotStart(robot, pose) for robot, pose in zip(spec.ids, poses, strict=True)]
    assert spec.id is not None
    assert spec.pose is not None
    return [RobotStart(spec.id, Pose(*spec.pose))]

"""The parts of a lab as far as its document defines them: what the checks of phase 2 look at.

The draft is built from the part of the document that conforms to the schema. A part that cannot be built (a polygon
that crosses itself, a fact that does not parse) becomes an error of the draft and is left out. The draft states no
other rule: whether the parts fit together is checked by `floor_fit` and `reference_fit`.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

from rmr.base.arena import BOTTLENECK, Area, Arena, FloorPassage, Obstacle, Polygon, RobotShape
from rmr.base.geometry import Point, Pose
from rmr.base.motion_scale import view_depth
from rmr.radio.links import Disturbance
from rmr.radio.phy import Bursts, RadioConfig
from rmr.radio.security import UNSECURED
from rmr.radio.settings import SETTINGS
from rmr_world.document import Document
from rmr_world.fact_syntax import (
    FinishPattern,
    TermError,
    parse_fact,
    parse_finish,
    parse_ros_action,
    parse_topic_fact,
)
from rmr_world.faults import permanent_faults, timed_faults
from rmr_world.finding import FilePath, Finding, near_miss
from rmr_world.found_passages import found_passages
from rmr_world.hosts import hosts_of
from rmr_world.lab import (
    KEYED,
    Fault,
    Lab,
    Localisation,
    ProgramLoad,
    RadioSettings,
    RobotStart,
    Ros2Body,
    RosAction,
    TopicFact,
    ros_name,
)
from rmr_world.lab_geometry import area_of, box_corners, grid_poses, obstacles_of
from rmr_world.random_facts import StatedFact
from rmr_world.schema import RADIUS_M_MIN, AreaSpec, RadioSpec, RobotSpec, Ros2Spec
from rmr_world.validate.schema_conformance import SchemaResult


class LabDraft:
    """The parts of one lab, each with its place in the file."""

    def __init__(self, document: Document, result: SchemaResult, path: Path) -> None:
        self.document = document
        self.spec = result.spec
        self.path = path
        """The lab file; files that it names are relative to its folder."""
        self.cut = result.cut
        """Sections from which the schema phase removed something: what refers to them is not checked."""
        self.errors = list(result.errors)
        """Errors of the schema and of parts that cannot be built."""
        self._result = result
        raw = document.value if isinstance(document.value, dict) else {}
        areas = raw.get("areas")
        self.area_names = sorted(areas) if isinstance(areas, dict) else []
        """Names of all areas in the file, of wrong ones too: a reference to these is no further error."""
        self.obstacles = self._obstacles()
        """The convex parts of each obstacle, with its index in the file."""
        self.map_unknown_free = 0
        """Cells of the map that are free although they have the grey that means unknown."""
        self.map_boxes = self._map_boxes()
        """What the map blocks."""
        self.areas = self._areas()
        self.arena = self._arena()
        self.robots = self._robots()
        """The robots, each with the index of the item in the file that defines it."""
        self.ids = {start.id for _, start in self.robots}
        self.arena = self._passages_found()
        self.facts = self._facts()
        """Facts by their index in the file."""
        self.topic_facts = self._topic_facts()
        given = self.spec.actions
        self.action_files = (
            [given] if isinstance(given, str) else [each for each in given or () if isinstance(each, str)]
        )
        """The file of handlers, if there is one; more are a mistake."""
        self.ros_actions = self._ros_actions()
        self.finish = None if not self.spec.finish else self._finish(self.spec.finish)
        self.bodies = self._bodies()
        """Bodies that are not simulated, each with the index of its entry in the file."""
        self.faults = self._faults()
        """Faults of robots and disturbances of the radio, each with the path of the robots that it names."""

    def error(self, path: FilePath, message: str) -> Finding:
        """Return an error at `path` of the file."""
        return self.document.finding(path, message)

    def undefined_area(self, name: str) -> str:
        """Return the message for a reference to an area that is not in the file."""
        return f"area '{name}' is not defined{near_miss(name, self.area_names)}"

    def robot_is_unknown(self, robot: int) -> bool:
        """Return whether the lab certainly has no such robot."""
        return robot not in self.ids and "robots" not in self.cut

    def lab(self) -> Lab:
        """Return the lab; it is complete only if there are no errors."""
        spec = self.spec
        folder = self.path.parent
        faults = [fault for _, fault in self.faults]
        return Lab(
            name=spec.lab,
            program=folder / spec.program,
            seed=spec.seed,
            duration=spec.duration,
            finish=spec.finish or "",
            quorum=spec.quorum,
            arena=self.arena,
            robots=tuple(robot for _, robot in self.robots),
            facts=tuple(text for text in spec.facts if isinstance(text, str)),
            fact_items=tuple(i for i, _ in self.facts),
            topic_facts=tuple(self.topic_facts),
            ros_actions=tuple(self.ros_actions),
            radio=_radio_settings(spec.radio),
            localisation=Localisation(spec.localisation.rate, spec.localisation.sigma, spec.localisation.dropout),
            bodies=tuple(body for _, body in self.bodies),
            faults=tuple(fault for fault in faults if not isinstance(fault, Disturbance)),
            disturbances=tuple(fault for fault in faults if isinstance(fault, Disturbance)),
            loads=tuple(ProgramLoad(load.at, folder / load.program, tuple(load.robots or ())) for load in spec.loads),
            path=self.path,
            actions=folder / self.action_files[0] if self.action_files else None,
            events=None if spec.events is None else folder / spec.events,
            map_file=None if spec.map is None else folder / spec.map,
            key_file=None if spec.radio.key_file is None else folder / spec.radio.key_file,
            mtls=spec.bus.security == "mtls",
            hosts=hosts_of(spec.hosts),
            map_unknown_free=self.map_unknown_free,
            places=self.document.places,
        )

    # -- the floor ----------------------------------------------------------------------------------------------

    @property
    def robot_fits_arena(self) -> bool:
        """Whether a robot is no wider than the arena."""
        return 2.0 * self.spec.robot.radius <= min(self.spec.arena.size) or "arena" in self.cut

    def _arena(self) -> Arena:
        spec = self.spec
        width, height = spec.arena.size
        # A robot that is too large for the arena fits nowhere: with the least radius that is one error, not many.
        radius = spec.robot.radius if self.robot_fits_arena else RADIUS_M_MIN
        view = spec.robot.view
        depth = view_depth(radius, spec.robot.speed) if view.depth is None else view.depth
        shape = RobotShape(radius, spec.robot.speed, spec.robot.turn, view.angle, depth)
        return Arena(
            width,
            height,
            spec.arena.cell,
            tuple(part for parts in (*(parts for _, parts in self.obstacles), self.map_boxes) for part in parts),
            shape=shape,
            areas=tuple(area for _, area in self.areas.values()),
            beacons=self._beacons(),
            range_sigma=spec.localisation.sigma,
            passages=self._passages(),
            stations=self._stations(shape),
        )

    def _passages_found(self) -> Arena:
        """Return the arena with the passages of its floor beside those that the file names.

        A passage in which a robot stays is none: at its start, at a goal that is no box, or in a station.
        """
        arena = self.arena
        none = self.spec.passages is not None and not self.spec.passages
        if none or self.spec.bottleneck is not None or not self.robot_fits_arena:
            return arena
        starts = [Point(start.pose.x, start.pose.y) for _, start in self.robots]
        goals = [place for area in arena.areas if area.box is None for place in area.places]
        stations = [place for name, _ in arena.stations for place in self.places_in(self.areas[name][1])]
        return replace(arena, passages=(*arena.passages, *found_passages(arena, [*starts, *goals, *stations])))

    @property
    def entrances(self) -> dict[FilePath, tuple[str, list[str]]]:
        """The name and the areas at the entrances of each passage, by the path of its key."""
        spec = self.spec
        found: dict[FilePath, tuple[str, list[str]]] = {}
        if spec.bottleneck is not None:
            found["bottleneck",] = BOTTLENECK, spec.bottleneck.mouths
        return found | {("passages", name): (name, each.mouths) for name, each in (spec.passages or {}).items()}

    def _passages(self) -> tuple[FloorPassage, ...]:
        """Return the passages whose entrances are areas of the file."""
        return tuple(
            FloorPassage(name, tuple(self.areas[mouth][1] for mouth in mouths))
            for name, mouths in self.entrances.values()
            if all(mouth in self.areas for mouth in mouths)
        )

    def _stations(self, shape: RobotShape) -> tuple[tuple[str, int], ...]:
        """Return the stations with their capacities: of a box as many robots as fit side by side."""
        named = self.spec.stations.items()
        places = {name: self.places_of(self.areas[name][1], shape) for name, _ in named if name in self.areas}
        return tuple((name, station.capacity or places[name]) for name, station in named if name in places)

    def places_of(self, area: Area, shape: RobotShape | None = None) -> int:
        """Return how many robots of `shape` (None: of the lab) can stand in `area` at a time."""
        return len(self.places_in(area, shape))

    def places_in(self, area: Area, shape: RobotShape | None = None) -> tuple[Point, ...]:
        """Return where robots of `shape` (None: of the lab) can stand in `area`."""
        if area.box is None:
            return area.places
        # The planner doubles the start-up time of a lab without such a station.
        from rmr.node.driver import spots  # noqa: PLC0415

        shape = self.arena.shape if shape is None else shape
        parts = tuple(part for parts in (*(parts for _, parts in self.obstacles), self.map_boxes) for part in parts)
        floor = Arena(*self.spec.arena.size, self.spec.arena.cell, parts, shape=shape)
        return tuple(place for place in spots(floor, area) if floor.clearance(*place) > shape.radius)

    def _obstacles(self) -> list[tuple[int, list[Obstacle]]]:
        built: list[tuple[int, list[Obstacle]]] = []
        for i, item in self._result.items("obstacles"):
            try:
                built.append((i, obstacles_of(item)))
            except ValueError as error:
                self.errors.append(self.error(("obstacles", i), str(error)))
        return built

    def _map_boxes(self) -> list[Obstacle]:
        name = self.spec.map
        if name is None or "arena" in self.cut:
            return []
        from rmr_world.floor_map import MapError, boxes, read_map  # noqa: PLC0415 - few labs have a map

        width, height = self.spec.arena.size
        try:
            floor = read_map(self.path.parent / name)
            if floor.size_m is not None and max(abs(floor.size_m[0] - width), abs(floor.size_m[1] - height)) > 1e-6:
                said = ", ".join(f"{length:g}" for length in floor.size_m)
                self.errors.append(self.error(("arena", "size"), f"should be [{said}], the size of {name}"))
                return []
            self.map_unknown_free = floor.unknown_free
            return [Polygon(box_corners(box)) for box in boxes(floor, width, height)]
        except MapError as error:
            self.errors.append(self.error(("map",), str(error)))
            return []

    def _areas(self) -> dict[str, tuple[AreaSpec, Area]]:
        built = {}
        for name, item in self.spec.areas.items():
            try:
                built[name] = (item, area_of(name, item))
            except ValueError as error:
                self.errors.append(self.error(("areas", name), str(error)))
        return built

    def _beacons(self) -> tuple[Point, ...]:
        given = self.spec.localisation.beacons
        if given is None:
            return Point(0.0, 0.0), Point(self.spec.arena.size[0], 0.0)
        return tuple(Point(x, y) for x, y in given)

    # -- robots, facts, faults ----------------------------------------------------------------------------------

    def _robots(self) -> list[tuple[int, RobotStart]]:
        return [(i, start) for i, item in self._result.items("robots") for start in _starts(item)]

    def _facts(self) -> list[tuple[int, StatedFact]]:
        parsed: list[tuple[int, StatedFact]] = []
        wrong = {each.path for each in self.errors}
        items = [(i, item) for i, item in self._result.items("facts") if isinstance(item, str)]
        split = _split_facts([text for _, text in items])
        if split:
            message = 'in [ ] a comma parts the items: put each fact in quotation marks, "..."'
            self.errors.append(self.error(("facts", items[split[0]][0]), message))
        for number, (i, text) in enumerate(items):
            if number in split or f"facts.{i}" in wrong:
                continue
            try:
                parsed.append((i, parse_fact(text)))
            except TermError as error:
                self.errors.append(self.error(("facts", i), str(error)))
        return parsed

    def _topic_facts(self) -> list[TopicFact]:
        parsed = []
        for i, item in self._result.items("facts"):
            if isinstance(item, str):
                continue
            try:
                parsed.append(TopicFact(item.topic, item.type, parse_topic_fact(item.fact), item.every, i))
            except TermError as error:
                self.errors.append(self.error(("facts", i, "fact"), str(error)))
        return parsed

    def _ros_actions(self) -> list[RosAction]:
        parsed = []
        given = self.spec.actions
        for i, item in enumerate(() if isinstance(given, str) else given or ()):
            if isinstance(item, str):
                continue
            try:
                about = parse_ros_action(item.action)
            except TermError as error:
                self.errors.append(self.error(("actions", i, "action"), str(error)))
                continue
            ends = item.topic or "", item.service or ""
            parsed.append(RosAction(*about, item.type, *ends, tuple(item.fields.items()), item.within, i))
        return parsed

    def _finish(self, text: str) -> FinishPattern | None:
        try:
            return parse_finish(text)
        except TermError as error:
            self.errors.append(self.error(("finish",), str(error)))
            return None

    def _bodies(self) -> list[tuple[int, Ros2Body]]:
        """Return the bodies in ROS 2; an entry without robots means all of the lab."""
        roster = sorted(self.ids)
        return [
            (i, _ros2_body(entry.ros2, robot))
            for i, entry in self._result.items("bodies")
            for robot in entry.robots or roster
        ]

    def _faults(self) -> list[tuple[FilePath, Fault | Disturbance]]:
        roster = sorted(self.ids)
        built: list[tuple[FilePath, Fault | Disturbance]] = [*permanent_faults(self.spec.radio)]
        for i, item in self._result.items("faults"):
            built += timed_faults(item, ("faults", i), roster)
        return built


def _split_facts(texts: Sequence[str]) -> list[int]:
    """Return the indices of parts of facts: without quotation marks, YAML splits a fact in brackets at its commas."""
    open_ = [text.count("(") - text.count(")") for text in texts]
    begins = any(a > 0 > b for a, b in pairwise(each for each in open_ if each))
    return [i for i, each in enumerate(open_) if each] if begins else []


def _radio_settings(spec: RadioSpec) -> RadioSettings:
    values = spec.model_dump(include={setting.name for setting in SETTINGS})
    if values["bursts"] is not None:
        values["bursts"] = Bursts(**values["bursts"])
    security = spec.security or (UNSECURED if spec.key_file is None else KEYED)
    return RadioSettings(RadioConfig(**values), spec.seed, security)


def _ros2_body(spec: Ros2Spec, robot: int) -> Ros2Body:
    namespace = spec.namespace.rstrip("/")
    names = spec.odom, spec.cmd_vel, spec.pose, spec.scan, spec.navigate
    odom, cmd_vel, pose, scan, navigate = (ros_name(name, robot, namespace) if name else "" for name in names)
    places = Pose(*spec.origin), namespace, scan, Pose(*spec.scan_at), navigate
    return Ros2Body(robot, odom, cmd_vel, pose, spec.sigma, spec.heading_sigma, *places)


def _starts(spec: RobotSpec) -> list[RobotStart]:
    if spec.grid is not None and spec.ids is not None:
        poses = grid_poses(spec.grid, len(spec.ids))
        return [RobotStart(robot, pose) for robot, pose in zip(spec.ids, poses, strict=True)]
    assert spec.id is not None
    assert spec.pose is not None
    return [RobotStart(spec.id, Pose(*spec.pose))]

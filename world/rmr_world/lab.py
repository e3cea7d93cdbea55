"""The lab as one immutable value: arena, robots, radio, facts, faults, and what the run is about.

`rmr_world.lab_file.load_lab` reads it from a lab file. Physics, simulator, launcher and world server take it as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rmr.base.arena import Arena
from rmr.base.geometry import Pose
from rmr.base.record import record
from rmr.base.streams import stable_hash
from rmr.base.time import Duration, Instant
from rmr.base.values import Value
from rmr.radio.links import Disturbance
from rmr.radio.phy import RadioConfig
from rmr.radio.security import UNSECURED
from rmr_world.fact_syntax import FinishPattern, parse_fact, parse_finish
from rmr_world.finding import FilePath, Finding, LabError
from rmr_world.provided_labs import LAB_FILE
from rmr_world.quorum import ALL, Quorum
from rmr_world.random_facts import LabFact, StatedFact, drawn

_NO_OFFSET = Pose(0.0, 0.0, 0.0)
PROGRAM_SUFFIXES = frozenset({".rmr", ".rbc"})
"""Suffixes of program files: source and byte-code."""
KEYED = "enc-mic-64"
"""Security level of a radio for which only a key is given: safe against forgery, with 103 octets of payload left."""


@record
class RobotStart:
    """A robot and where it starts."""

    id: int
    pose: Pose


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """The settings of a lab's radio."""

    config: RadioConfig = field(default_factory=RadioConfig)
    """The model of the radio that all robots share."""
    seed: int | None = None
    """Seed of losses and shadowing; None: the run's seed."""
    security: str = UNSECURED
    """A name of `rmr.radio.security.LEVELS`."""


@record
class Localisation:
    """The ultrasonic localisation service; the beacons stand in the arena (paper V.B.1)."""

    rate: float = 10.0
    """Pulses of each beacon per second."""
    sigma: float = 0.005
    """Standard deviation of a range, metres."""
    dropout: float = 0.0
    """Share of the pulses that a robot misses."""


@record
class Ros2Body:
    """The body of a robot that is one of ROS 2."""

    robot: int
    odom: str
    """Names of its topics, from the root."""
    cmd_vel: str
    pose: str
    sigma_m: float = 0.03
    """Standard deviation of a pose that has no covariance, metres and radians."""
    sigma_rad: float = 0.0524
    origin: Pose = _NO_OFFSET
    """Pose of the floor's lower left corner in the frame of the poses."""
    namespace: str = ""
    """In which the topics of its facts are."""
    scan: str = ""
    """The topic of its laser scans; empty: they are not read."""
    scan_at: Pose = _NO_OFFSET
    """Pose of the lidar on the robot."""
    navigate: str = ""
    """The action of Nav2 by which it drives; empty: it has none."""


@record
class TopicFact:
    """A sensed fact that holds with the newest message of a topic of ROS 2."""

    topic: str
    """See `ros_name`."""
    type: str
    fact: LabFact
    """Its symbols are paths of fields."""
    every: Duration
    item: int
    """Index of its entry under `facts` in the file."""


@record
class RosAction:
    """An action that ends when a service of ROS 2 has answered, or as soon as a message is published."""

    name: str
    owner: int | None
    """Whose action it is; None: each robot's."""
    args: tuple[str | None, ...]
    """For each argument without the robot the path of the field that gets it; None: none does."""
    type: str
    topic: str
    """Empty: a service. For both see `ros_name`."""
    service: str
    fields: tuple[tuple[str, Value], ...]
    """What else is said, by the paths of fields."""
    within: Duration
    """How long a service may take to answer."""
    item: int
    """Index of its entry under `actions` in the file."""


def ros_name(name: str, robot: int, namespace: str) -> str:
    """Return a name of `robot` in ROS 2 from the root; its own ones are in `namespace`. `{id}` stands for its id."""
    return (name if name.startswith("/") else f"{namespace}/{name}").replace("{id}", str(robot))


@record
class Kill:
    """A robot's process dies."""

    at: Instant
    robot: int


@record
class Restart:
    """A robot that was killed starts again, without memory."""

    at: Instant
    robot: int


@record
class Stall:
    """A robot's process is stopped for a while."""

    start: Instant
    end: Instant
    robot: int


@record
class Slow:
    """A robot's node is called once in `every` nanoseconds only, instead of in each tick of 1/60 s."""

    start: Instant
    end: Instant
    robot: int
    every: Duration


@record
class Outage:
    """A robot receives no pulse of the localisation service for a while."""

    start: Instant
    end: Instant
    robot: int


Fault = Kill | Restart | Stall | Slow | Outage
"""A fault of one robot."""


@record
class ProgramLoad:
    """Robots get a new program while they run."""

    at: Instant
    program: Path
    robots: tuple[int, ...] = ()
    """Who gets it; empty: all."""


@record
class LabHost:
    """One host of a lab, and its share of the processes."""

    name: str
    address: str
    """The name or IP address by which other hosts reach it."""
    port: int
    """Of its router, or, without one, that of nobody."""
    has_world: bool
    has_router: bool
    robots: tuple[int, ...]
    """Ascending."""

    def endpoint(self, protocol: str) -> str:
        """Return where other hosts reach its router."""
        return f"{protocol}/{f'[{self.address}]' if ':' in self.address else self.address}:{self.port}"


@dataclass(frozen=True, slots=True)
class Lab:
    """A whole lab."""

    name: str
    program: Path
    seed: int
    """Seed of the run. For another seed than the file's, replace it here: random facts are drawn from it."""
    duration: Duration
    """Lab time at which the run ends at the latest."""
    finish: str
    """Fact pattern that ends the run once every robot holds a match; empty: the run lasts its `duration`."""
    arena: Arena
    robots: tuple[RobotStart, ...]
    """In the order of the file."""
    facts: tuple[str, ...] = ()
    radio: RadioSettings = RadioSettings()
    localisation: Localisation = field(default_factory=Localisation)
    bodies: tuple[Ros2Body, ...] = ()
    """The bodies that are not simulated; `rmr sim` simulates them, too."""
    topic_facts: tuple[TopicFact, ...] = ()
    """Facts that come from ROS 2; `rmr sim` has none of them."""
    ros_actions: tuple[RosAction, ...] = ()
    """Actions that ROS 2 carries out; in `rmr sim` they end at once."""
    faults: tuple[Fault, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    """Disturbances of the radio: `radio.links` and `radio.partition`, then those of `faults`."""
    loads: tuple[ProgramLoad, ...] = ()
    quorum: Quorum = ALL
    """How many robots have to hold the finish fact."""
    path: Path = Path(LAB_FILE)
    actions: Path | None = None
    """The file with the handlers of the program's own actions."""
    events: Path | None = None
    """The file with the user's own events, for the simulator."""
    map_file: Path | None = None
    """The file with the map of its floor: an image, or a map file of ROS."""
    key_file: Path | None = None
    """The file with the radio's key. It is no part of `radio`, whose settings are public on the bus."""
    mtls: bool = False
    """Whether the processes of its bus are those with keys alone."""
    hosts: tuple[LabHost, ...] = ()
    """The hosts over which its processes may be spread, as the file has them."""
    map_unknown_free: int = field(default=0, compare=False)
    """How many cells of the map are free by its own threshold although they have the grey that means unknown."""
    fact_items: tuple[int, ...] = field(default=(), compare=False, repr=False)
    """Index in the file of each of `facts`; empty: `facts` is the whole list of the file."""
    places: Mapping[FilePath, tuple[int, int]] = field(default_factory=dict, compare=False, repr=False)
    """Line and column of the file's parts, for findings about the lab together with its program."""

    @property
    def pan(self) -> int:
        """Identifier of the lab's personal area network on the radio; never the broadcast one, 0xffff."""
        return stable_hash(self.name, 2) & 0x7FFF

    @property
    def roster(self) -> tuple[int, ...]:
        """The robots' ids, ascending."""
        return tuple(sorted(robot.id for robot in self.robots))

    @property
    def stated_facts(self) -> tuple[StatedFact, ...]:
        """`facts`, parsed."""
        return tuple(map(parse_fact, self.facts))

    @property
    def given(self) -> list[str]:
        """The predicates of facts that come with the lab."""
        return [*(fact.name for fact in self.stated_facts), *(each.fact.name for each in self.topic_facts)]

    @property
    def performs(self) -> tuple[str, ...]:
        """The actions that the world carries out for its robots."""
        return tuple(dict.fromkeys(each.name for each in self.ros_actions))

    @property
    def is_closed(self) -> bool:
        """Whether robots get no facts but `facts` and what their program derives and senses."""
        return self.actions is None and self.events is None and not self.loads and not self.topic_facts

    @property
    def initial_facts(self) -> tuple[LabFact, ...]:
        """The facts that robots hold at the start: `facts` with random numbers drawn from the seed."""
        indices = self.fact_items or range(len(self.facts))
        numbered = zip(indices, self.stated_facts, strict=True)
        return tuple(fact for index, stated in numbered for fact in drawn(stated, index, self.seed, self.roster))

    @property
    def finish_pattern(self) -> FinishPattern | None:
        """`finish`, parsed; None when there is none."""
        return parse_finish(self.finish) if self.finish else None

    def error(self, path: FilePath, message: str) -> Finding:
        """Return an error at `path` of the lab file, or at the section that it belongs to."""
        return Finding(str(self.path), *self._place(path), ".".join(map(str, path)), message)

    def warning(self, path: FilePath, message: str) -> Finding:
        """Return a warning at `path` of the lab file, or at the section that it belongs to."""
        return replace(self.error(path, message), is_warning=True)

    def _place(self, path: FilePath) -> tuple[int, int]:
        return self.places.get(path, self.places.get(path[:1], (1, 1)))

    def with_robots(self, count: int) -> "Lab":
        """Return the lab with its first `count` robots, and the facts and faults of these.

        Raises LabError when the lab has fewer.
        """
        if not 1 <= count <= len(self.robots):
            message = f"there are {len(self.robots)} robots in this lab, so not {count}"
            raise LabError([self.error(("robots",), message)])
        if isinstance(self.quorum, int) and self.quorum > count:
            raise LabError([self.error(("quorum",), f"{self.quorum} robots cannot finish in a run of {count}")])
        robots = self.robots[:count]
        ids = {robot.id for robot in robots}
        kept = [i for i, fact in enumerate(self.stated_facts) if fact.owner is None or fact.owner in ids]
        facts = tuple(self.facts[i] for i in kept)
        items = self.fact_items or range(len(self.facts))
        fact_items = tuple(items[i] for i in kept)
        bodies = tuple(body for body in self.bodies if body.robot in ids)
        topic_facts = tuple(each for each in self.topic_facts if each.fact.owner is None or each.fact.owner in ids)
        ros_actions = tuple(each for each in self.ros_actions if each.owner is None or each.owner in ids)
        faults = tuple(fault for fault in self.faults if fault.robot in ids)
        loads = tuple(
            replace(load, robots=tuple(robot for robot in load.robots if robot in ids))
            for load in self.loads
            if not load.robots or ids.intersection(load.robots)
        )
        disturbances = tuple(rest for each in self.disturbances if (rest := _among(each, ids)) is not None)
        return replace(
            self,
            robots=robots,
            facts=facts,
            fact_items=fact_items,
            bodies=bodies,
            topic_facts=topic_facts,
            ros_actions=ros_actions,
            faults=faults,
            disturbances=disturbances,
            loads=loads,
        )


def _among(disturbance: Disturbance, ids: set[int]) -> Disturbance | None:
    """Return `disturbance` restricted to the robots `ids`; None if no link of theirs is left."""
    if not disturbance.groups:
        return disturbance
    groups = tuple(kept for group in disturbance.groups if (kept := tuple(i for i in group if i in ids)))
    return disturbance._replace(groups=groups) if len(groups) > 1 else None

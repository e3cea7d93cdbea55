"""The lab as one value: arena, robots, radio, what the run is about. Read from a lab file, checked whole.

`load_lab` reports every mistake of a file at once, each with line and column. It goes in three passes:
`document` reads YAML with positions, `schema` judges it key by key, `checks` judges how the parts fit. A part
that fails a pass is left out of the next one, so that one slip neither hides other mistakes nor causes
complaints about itself. A `Lab` is plain and immutable; physics, simulator and hosts take it as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rmr.base.arena import Arena
from rmr.base.geometry import Pose
from rmr.base.streams import stable_hash
from rmr.base.time import Duration, Instant
from rmr.radio.links import Disturbance
from rmr.radio.phy import RadioConfig
from rmr.radio.security import UNSECURED
from rmr_world.document import LabError, Path_, Problem, read
from rmr_world.provided_labs import LAB_FILE, resolve
from rmr_world.ranges import LabFact, StatedFact, drawn
from rmr_world.terms import FinishPattern, parse_fact, parse_finish

PROGRAMS = frozenset({".rmr", ".rbc"})
"""How the file of a program ends."""
KEYED = "enc-mic-64"
"""Of a radio of which only the key is given: no luck forges a frame, and 103 octets of payload are left."""


@dataclass(frozen=True, slots=True)
class RobotStart:
    """A robot and where it starts."""

    id: int
    pose: Pose


@dataclass(frozen=True, slots=True)
class RadioSettings:
    """The radio's settings of a lab."""

    config: RadioConfig = field(default_factory=RadioConfig)
    """The model of the radio that all robots share."""
    seed: int | None = None
    """None: the run's seed."""
    security: str = UNSECURED
    """A name of `rmr.radio.security.LEVELS`."""


@dataclass(frozen=True, slots=True)
class Localisation:
    """The ultrasonic localisation service; the beacons stand in the arena (paper V.B.1)."""

    rate: float = 10.0
    """Pulses of each beacon per second."""
    sigma: float = 0.005
    """Standard deviation of a range, metres."""
    dropout: float = 0.0
    """Share of the pulses that a robot does not hear."""


@dataclass(frozen=True, slots=True)
class Kill:
    """A robot's process dies."""

    at: Instant
    robot: int


@dataclass(frozen=True, slots=True)
class Restart:
    """A robot that died starts again, and remembers nothing."""

    at: Instant
    robot: int


@dataclass(frozen=True, slots=True)
class Stall:
    """A robot's process does nothing for a while."""

    start: Instant
    end: Instant
    robot: int


@dataclass(frozen=True, slots=True)
class Slow:
    """A robot's mind is called every so often only, instead of in each frame of 1/60 s."""

    start: Instant
    end: Instant
    robot: int
    every: Duration


@dataclass(frozen=True, slots=True)
class Outage:
    """A robot hears no beacon for a while."""

    start: Instant
    end: Instant
    robot: int


Fault = Kill | Restart | Stall | Slow | Outage
"""What befalls a robot."""


@dataclass(frozen=True, slots=True)
class Lab:
    """A whole lab."""

    name: str
    program: Path
    seed: int
    """Of the run: who wants another one than the file's replaces it here, for facts are drawn by it."""
    duration: Duration
    """The run ends then at the latest."""
    finish: str
    """Fact pattern that every robot holds in the end; empty: the run lasts its `duration`."""
    arena: Arena
    robots: tuple[RobotStart, ...]
    """In the order of the file."""
    facts: tuple[str, ...] = ()
    radio: RadioSettings = RadioSettings()
    localisation: Localisation = Localisation()
    faults: tuple[Fault, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    """Of the radio: `radio.links` and `radio.partition`, then the `faults` that concern it."""
    path: Path = Path(LAB_FILE)
    actions: Path | None = None
    """The file with the handlers of the program's own actions."""
    events: Path | None = None
    """The file with the user's own events, for the simulator."""
    key_file: Path | None = None
    """Holds the radio's key. Not among the radio's settings, which all of the bus can read."""
    fact_items: tuple[int, ...] = field(default=(), compare=False, repr=False)
    """For each of `facts` its index in the file's list; empty: they are all of them."""
    places: Mapping[Path_, tuple[int, int]] = field(default_factory=dict, compare=False, repr=False)
    """Line and column of the file's parts, for complaints that need the program."""

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
    def initial_facts(self) -> tuple[LabFact, ...]:
        """What robots hold in the beginning: `facts` with the numbers that the seed draws."""
        indices = self.fact_items or range(len(self.facts))
        numbered = zip(indices, self.stated_facts, strict=True)
        return tuple(fact for index, stated in numbered for fact in drawn(stated, index, self.seed, self.roster))

    @property
    def finish_pattern(self) -> FinishPattern | None:
        """`finish`, parsed; None when there is none."""
        return parse_finish(self.finish) if self.finish else None

    def with_robots(self, count: int) -> "Lab":
        """Return the lab with its first `count` robots and the facts that concern them.

        Raises LabError when the lab has fewer.
        """
        if not 1 <= count <= len(self.robots):
            message = f"there are {len(self.robots)} robots in this lab, so not {count}"
            raise LabError([Problem(str(self.path), *self.places.get(("robots",), (1, 1)), "robots", message)])
        robots = self.robots[:count]
        ids = {robot.id for robot in robots}
        kept = [i for i, fact in enumerate(self.stated_facts) if fact.owner is None or fact.owner in ids]
        facts, items = tuple(self.facts[i] for i in kept), self.fact_items or range(len(self.facts))
        fact_items = tuple(items[i] for i in kept)
        faults = tuple(fault for fault in self.faults if fault.robot in ids)
        disturbances = tuple(left for each in self.disturbances if (left := _among(each, ids)) is not None)
        return replace(
            self, robots=robots, facts=facts, fact_items=fact_items, faults=faults, disturbances=disturbances
        )


def _among(disturbance: Disturbance, ids: set[int]) -> Disturbance | None:
    """Return what is left of `disturbance` when only the robots `ids` take part."""
    if not disturbance.groups:
        return disturbance
    groups = tuple(kept for group in disturbance.groups if (kept := tuple(i for i in group if i in ids)))
    return disturbance._replace(groups=groups) if len(groups) > 1 else None


def lab_path(path: Path) -> Path:
    """Return the lab file that `path` means: a lab file, its folder, or the name of a provided lab."""
    path = resolve(path)
    return path / LAB_FILE if path.is_dir() else path


def load_lab(path: Path) -> Lab:
    """Return the lab in `path`: a lab file, a folder with a ``lab.yaml``, or the name of a provided lab.

    Raises LabError with everything that is wrong with it.
    """
    from rmr_world.checks import build  # noqa: PLC0415  (pydantic loads only where a file is read)

    file = lab_path(path)
    if file.suffix in PROGRAMS:
        raise LabError(
            [Problem(str(file), 1, 1, "", "is a program: name the lab file that it stands in, or its folder")]
        )
    return build(read(file), file)


__all__ = ["Lab", "LabError", "Problem", "load_lab"]

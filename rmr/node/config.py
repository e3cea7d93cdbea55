"""The configuration that a robot gets before it starts: its identity, its place, its finish fact."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from math import hypot
from typing import Final

from rmr.base.arena import Arena
from rmr.base.motion_scale import scale_of
from rmr.base.time import Duration, Instant, milliseconds, seconds
from rmr.base.values import Value
from rmr.bytecode.program import Anything, Constant
from rmr.coord.timing import Timing
from rmr.node.profile import Profile, profile_of
from rmr.node.trace import TraceLevel
from rmr.radio.phy import NETWORK, RadioConfig, path_loss_db
from rmr.vm.engines import Engine
from rmr.vm.provenance import ProvenanceLog

GivenFact = tuple[str, int | None, tuple[Value, ...]]
"""Predicate, owner (None: every robot), arguments without the owner."""
FinishPattern = tuple[str, tuple[Anything | Constant, ...]]
"""Predicate and patterns, without the owner, of the fact that ends the robot's part."""

UNKNOWN_INSIDE: Final[Duration] = seconds(1)
"""Expected length of a crossing whose action is not a drive; it is extended while the action lasts longer."""
STUCK: Final[Duration] = seconds(20)
"""An action fails when what it needs has been missing for so long: the robot's position, a way that nobody bars, or a
place of a station that the dead do not have."""
LISTEN: Final[Duration] = milliseconds(1200)
"""Time that a restarted robot listens before it drives: two hellos of each parked robot."""
LISTEN_FOR_ALL: Final[Duration] = seconds(10)
"""Longest time that a robot listens before it drives on a floor within radio range: until it knows where each of the
others is. A robot that is silent for longer is taken for absent, unless another robot hears it."""
IN_RANGE_DB: Final = 6.0
"""Margin above the sensitivity at which reception is certain."""


@dataclass(frozen=True, slots=True)
class NodeConfig:
    """One robot's configuration."""

    robot: int
    roster: Collection[int]
    """Ids of all robots of the lab, this one's included; of many, a container with a fast ``in`` (a dict)."""
    arena: Arena
    seed: int
    radio: RadioConfig = field(default_factory=RadioConfig)
    """Power and path loss, by which distances are estimated from signal strength."""
    facts: tuple[GivenFact, ...] = ()
    """Facts of the lab beside the program's; those of other robots are ignored."""
    finish: FinishPattern | None = None
    """The fact that ends the robot's part; None: nothing does."""
    epoch: int = 0
    """Number of earlier starts; distinguishes its messages from those of an earlier life."""
    predecessor_ended: Instant | None = None
    """An instant at which the robot's life before this one had ended; None: only its start is known to be later."""
    phase: Duration = 0
    """Delay of its frames to those of the lab: hosts that share a machine spread theirs."""
    trace: TraceLevel = TraceLevel.NOTES
    """How much the robot records in its trace."""
    engine: Engine = Engine.GENERATED
    """What runs the program; all engines do the same."""
    turn: Duration = UNKNOWN_INSIDE
    """Expected length of a turn without a drive; extended while its action lasts longer."""
    timing: Timing = field(default_factory=Timing)
    """The constants of coordination; the payload of a frame is determined by the link."""
    witness: Callable[[int, Instant, object], None] | None = None
    """Callback of checkers for each event inside the robot: (robot, instant, event)."""

    provenance: ProvenanceLog | None = None
    """Log of where facts and actions come from; with one the program is interpreted, whatever `engine` says."""
    shared_repeats: int | None = None
    """How often shared facts are told again after a change; None: for as long as they hold, as over a real radio."""
    navigates: bool = False
    """Whether its body has a driver of its own, which `navigate` lets drive."""
    without: frozenset[str] = frozenset()
    """Rules of motion that are left out, by name, in an experiment (`motion.speed_law`, `motion.standoff.escapes`)."""
    firings: dict[str, int] = field(default_factory=dict)
    """How often each rule of motion has had an effect; robots of one simulation share it."""

    @property
    def profile(self) -> Profile:
        """What robots of a group of this size do."""
        return profile_of(len(self.roster), scale_of(self.arena.shape).pace)

    @property
    def listens(self) -> Duration:
        """How long a robot that begins waits, at most, for the places of the others before it drives.

        On a floor wider than the radio's range the others are not all to be heard from, and most are far away.
        """
        if self.reaches_all:
            return LISTEN_FOR_ALL
        return LISTEN if self.epoch else 0

    @property
    def reaches_all(self) -> bool:
        """Whether the radio reaches over the whole floor."""
        return self.surely_hears(hypot(self.arena.width, self.arena.height))

    def surely_hears(self, distance_m: float) -> bool:
        """Return whether the radio surely reaches so far."""
        if self.radio.mode == NETWORK:
            return True
        loss_db = path_loss_db(distance_m, self.radio.exponent)
        return self.radio.tx_power_dbm - loss_db >= self.radio.sensitivity_dbm + IN_RANGE_DB

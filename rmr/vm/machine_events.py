"""Events of the virtual machine: its output to the host, in the order in which they happened.

The machine changes nothing but its own facts. All effects on the radio, the robot's body or the operator leave it as
one of these events (the paper's NEW_ACTION and NEW_FACT, figure 6).
"""

from rmr.base.record import record
from rmr.base.time import Instant
from rmr.vm.job import TimedJob
from rmr.vm.store import Args


@record
class RuleFired:
    """A rule was applied (paper IV.B, "Process The Rule")."""

    rule: int
    """Index into the program's rules."""
    at: Instant


@record
class FactSent:
    """A rule derived a fact of another robot: the host must send it."""

    destination: int
    """The robot that owns it."""
    predicate: int
    args: Args
    """Without the owner."""
    number: int = 0
    """Of what the robot sends, from 1; 0 without a provenance log."""


@record
class GoalSent:
    """A rule derived a goal of another robot: the host must send it."""

    destination: int
    """The robot whose goal it is."""
    predicate: int
    args: Args
    """Without the owner."""
    number: int = 0
    """As that of a fact."""


@record
class ActionDerived:
    """An action was derived, by a rule or by a missed deadline."""

    serial: int
    """Identifies the action in `Machine.complete`; 0 if another robot executes it and nothing waits for its end."""
    predicate: int
    executor: int
    """The robot that is to execute it."""
    args: Args
    """Without the executor."""
    origin: tuple[int, int] | None = None
    """If another robot derived it and waits for its end: that robot, and the serial for its `complete`."""
    number: int = 0
    """Of an action of another robot: as that of a fact."""


@record
class JobStarted:
    """A fact that starts a time assertion's job was inserted; a job that was running has restarted."""

    job: TimedJob


@record
class JobFinished:
    """The finish fact was inserted, in time or (``job.missed``) late."""

    job: TimedJob


@record
class JobMissed:
    """A deadline passed without the finish fact; its violation is derived."""

    job: TimedJob


@record
class FinishAwaited:
    """A job waits for a fact of another robot: that robot must be asked to report it (`Machine.await_finish`)."""

    destination: int
    """The robot of the finish fact."""
    assertion: int
    """Index into the program's assertions."""
    start_args: Args
    """The start fact's arguments without the owner: they bind the variables of the finish pattern."""
    since: Instant
    """When the job started; earlier insertions do not count."""


@record
class FinishSeen:
    """A fact for which another robot's job waits was inserted here: the host must send it (`Machine.finish_seen`)."""

    destination: int
    """The job's robot."""
    assertion: int
    args: Args
    """The finish fact's, without the owner."""
    at: Instant
    """When it was inserted."""


@record
class GoalAchieved:
    """A fact that matches an open goal was inserted, or held already."""

    predicate: int
    args: tuple[object, ...]
    """The goal's arguments: values, or ANY."""
    at: Instant


@record
class GoalWithdrawn:
    """A rule withdrew an open goal, or a sub-goal ended because no goal is left that it serves."""

    predicate: int
    args: tuple[object, ...]
    """The goal's arguments: values, or ANY."""
    at: Instant
    served: tuple[int, tuple[object, ...]] | None = None
    """Of a sub-goal: predicate and arguments of the goal whose achievement or withdrawal ended it."""


@record
class ActionCancelled:
    """No goal is left that an action under way serves: the host has to stop it and report its failure (`complete`)."""

    serial: int
    predicate: int
    args: Args
    """Without the executor, which is this robot."""
    served: tuple[int, tuple[object, ...]]
    """Predicate and arguments of the goal whose achievement or withdrawal ended it."""
    at: Instant


@record
class FactInserted:
    """Traced only: a fact of this robot now holds."""

    predicate: int
    args: Args
    at: Instant


@record
class FactRemoved:
    """Traced only: a fact was consumed or withdrawn."""

    predicate: int
    args: Args
    at: Instant


@record
class RuleRepeats:
    """A rule has fired many times for the same facts while no goal was achieved; reported once for each rule."""

    rule: int
    """Index into the program's rules."""
    firings: int
    at: Instant


@record
class ExpressionFailed:
    """An expression has no value (``1 / 0``): the item, match or firing that needed it was left out."""

    where: str
    """``rule 3``, ``assertion crossing``, ``effect of moveto``."""
    reason: str
    at: Instant


@record
class BoundReached:
    """A bound was exceeded for the first time; the excess is dropped and counted from now on (`Machine.dropped`)."""

    what: str
    """``facts``, ``lengths`` (of all facts), ``goals``, ``actions``, ``chains``, ``jobs``, ``failures``, ``matches``,
    ``rotor`` (the least recent firings), ``ranking`` (runs in a row that waited for ranks; then firings go by estimates
    until the search is finished), ``ways`` (steps of that search; what lies beyond has estimates), ``watches``."""
    bound: int
    """How many are kept."""
    at: Instant


VmEvent = (
    RuleFired
    | FactSent
    | GoalSent
    | ActionDerived
    | ActionCancelled
    | JobStarted
    | JobFinished
    | JobMissed
    | FinishAwaited
    | FinishSeen
    | GoalAchieved
    | GoalWithdrawn
    | FactInserted
    | FactRemoved
    | RuleRepeats
    | ExpressionFailed
    | BoundReached
)

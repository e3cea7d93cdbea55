"""Provenance: a log of where each fact, goal and action of one robot comes from (why-provenance of Datalog engines).

A robot writes this log only where its configuration has one, as in `rmr why`; the machine is then `ObservedMachine`.
Records come in the order in which things happened. They refer to each other by numbers: a fact by the serial number of
its insertion (a fact that comes back is another one), a firing by its number, an action by the serial number under
which its end is awaited.

The machine knows the causes inside it: firings, effects of actions, steps that follow an action, missed deadlines. The
host passes the cause of an input with it; an input without one comes from outside.
"""

from typing import NamedTuple

from rmr.base.time import Instant
from rmr.base.values import Value
from rmr.bytecode.program import Pattern
from rmr.vm.derive import Chain, DerivedKind
from rmr.vm.store import Args


class GivenCause(NamedTuple):
    """A fact or goal that holds at the start."""

    giver: str
    """``program``, ``lab``, or ``robot``: the robot's own number."""


class OutsideCause(NamedTuple):
    """An input of the host that neither program, lab nor sensors made."""


class SensedCause(NamedTuple):
    """A sensed fact: the robot's sensors state or withdraw it."""


class FiringCause(NamedTuple):
    """Derived by a firing."""

    number: int
    chain: int
    """Place among the chains that the firing derived."""


class DeliveredCause(NamedTuple):
    """Another robot has sent it; source, epoch and sequence number identify the delivery on both robots."""

    source: int
    epoch: int
    sequence: int


class HeardCause(NamedTuple):
    """A neighbour holds a shared fact, or holds it no more, as it has told last."""

    source: int
    lost: bool = False
    """It is taken to be gone since the neighbour is not heard any more."""


class SentKey(NamedTuple):
    """A delivery of the robot's own, as its frames name it."""

    destination: int
    epoch: int
    sequence: int


class UndeliveredCause(NamedTuple):
    """A delivery has been given up; a program may learn that by the fact ``undelivered``."""

    destination: int
    name: str
    """Name of the predicate that was not delivered."""
    sent: SentKey | None
    """None: it was refused before it had a number."""


class StandsCause(NamedTuple):
    """The robot at home has acknowledged a decision about a rule over several robots."""

    sent: SentKey


class EffectCause(NamedTuple):
    """An effect of an action that has ended."""

    action: int
    ok: bool
    news: DeliveredCause | OutsideCause = OutsideCause()
    """Of an action of another robot: how its end became known."""


class StepCause(NamedTuple):
    """A step that follows the end of an action (``a(R) then b(R)``)."""

    action: int
    news: DeliveredCause | OutsideCause = OutsideCause()
    """As that of an effect."""


class HandlerCause(NamedTuple):
    """The Python handler of an action has inserted or withdrawn the fact."""

    action: int


class MissedCause(NamedTuple):
    """The violation of a missed deadline."""

    job: int
    """The job's serial number."""


Cause = (
    GivenCause
    | OutsideCause
    | SensedCause
    | FiringCause
    | EffectCause
    | StepCause
    | HandlerCause
    | DeliveredCause
    | HeardCause
    | UndeliveredCause
    | StandsCause
    | MissedCause
)


class InsertionRecord(NamedTuple):
    """A fact holds from now on. A set that holds the fact already records nothing."""

    at: Instant
    fact: int
    """Serial number of the insertion."""
    predicate: int
    args: Args
    cause: Cause


class RemovalRecord(NamedTuple):
    """A fact was consumed or withdrawn."""

    at: Instant
    fact: int
    cause: Cause
    """A firing, or what the sensors state."""


class Rival(NamedTuple):
    """Another rule that was satisfied when a rule fired."""

    rule: int
    rank: int | None
    urgency: int
    """As `rmr.vm.urgency` defines it."""
    matched: tuple[int, ...] = ()
    """A fact for each positive atom of its body: the match with which it would have fired."""


class ChainOrigin(NamedTuple):
    """A derived chain and the facts matched by the comprehension or aggregate that derived it."""

    chain: Chain
    inner: tuple[int, ...]
    """Serial numbers of the facts, in addition to those of the rule's own body."""


class FiringRecord(NamedTuple):
    """A rule has fired."""

    at: Instant
    number: int
    """From 1."""
    rule: int
    bindings: tuple[Value, ...]
    """The rule's slots after its body has matched; 0 is the robot."""
    matched: tuple[int, ...]
    """A fact for each positive atom of the body."""
    consumed: tuple[int, ...]
    """Facts removed, those of comprehensions and aggregates too."""
    derived: tuple[ChainOrigin, ...]
    rank: int | None
    """Number of further firings to an open goal; None: the firing leads to no goal."""
    rivals: tuple[Rival, ...]
    """The other rules that were satisfied."""
    goals: tuple[tuple[int, tuple[Pattern, ...]], ...]
    """Open goals: predicate and patterns."""
    urgency: int
    """As `rmr.vm.urgency` defines it."""


class SendRecord(NamedTuple):
    """A fact, goal or action of another robot was derived: the host has to send it.

    The machine's event has the number of this record among its kind, from 1.
    """

    at: Instant
    role: DerivedKind
    destination: int
    predicate: int
    args: Args
    cause: Cause


class ActionRecord(NamedTuple):
    """An action was derived for this robot, or one of another robot whose end is awaited here."""

    at: Instant
    serial: int
    predicate: int
    executor: int
    args: Args
    cause: Cause
    then: Chain
    """Steps that wait for its end."""


class GoalRecord(NamedTuple):
    """A goal was opened; one that holds already is achieved at once."""

    at: Instant
    predicate: int
    args: tuple[Pattern, ...]
    cause: Cause


class JobRecord(NamedTuple):
    """A fact has started a time assertion's job, or restarted it."""

    at: Instant
    job: int
    fact: int


class ToldRecord(NamedTuple):
    """An event of the host's own: progress of actions and deliveries, schedules, jobs."""

    at: Instant
    event: object


ProvenanceRecord = (
    InsertionRecord | RemovalRecord | FiringRecord | SendRecord | ActionRecord | GoalRecord | JobRecord | ToldRecord
)

OUTSIDE = OutsideCause()
SENSED = SensedCause()


class ProvenanceLog:
    """The log of one incarnation of a robot."""

    def __init__(self) -> None:
        self.records: list[ProvenanceRecord] = []
        self.unfinished: list[int] = []
        """After which firings, by number, a run of the machine ended although a rule may have been satisfied."""

    def told(self, now: Instant, event: object) -> None:
        """Note an event of the host."""
        self.records.append(ToldRecord(now, event))

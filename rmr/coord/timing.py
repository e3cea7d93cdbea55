"""The constants of coordination: intervals, time-outs and bounds, each with its reason.

The safety of a schedule rests on three relations between them. They are checked when a `Timing` is made.

* The frozen zone outlasts a lease, two clock errors and the delay of a frame. A robot that may still enter under an
  old schedule finds the same slot in the newest one.
* A new slot lies far enough ahead for the claims that precede every entry.
* A silent leader is replaced only after all of its leases have ended.
"""

from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from rmr.base.time import NS_PER_MS, Duration

MS: Final = NS_PER_MS

ABSENT_MAX: Final = 7
"""Missed slots in a row that a JOB can tell of: three bits."""

GRID: Final[Duration] = 10 * MS
"""Slots and triggers lie on this grid: two octets of it reach 10.9 minutes."""
HEADWAY_UNIT: Final[Duration] = 20 * MS
"""A headway travels in one octet of this unit: up to 5.1 s."""
RECORDS_MAX: Final = 128
"""Robots remembered per group. More than a group may hold; the oldest of the finished make room first."""
JOBS_MAX: Final = 100
"""Jobs that one leader takes at a time; further robots repeat their requests until there is room."""
GROUPS_MAX: Final = 32
"""Groups remembered per robot; idle ones make room, oldest first."""
BANS_MAX: Final = 8
"""Leaders that one robot avoids at a time."""
OUTPUT_MAX: Final = 1024
"""Frames and events that wait to be drained, per robot. A host that never drains loses the oldest."""
IN_FLIGHT_MAX: Final = 64
"""Unicast frames whose outcome is awaited, per robot."""


PAYLOAD_MAX: Final = 116
"""Octets that an IEEE 802.15.4 data frame with short addresses leaves."""


class Order(Enum):
    """Rule by which a leader orders jobs; all but the first serve comparisons."""

    OURS = "ours"
    """Most deadlines met (`rmr.coord.schedule`)."""
    EDF = "edf"
    """The earliest deadline first."""
    FCFS = "fcfs"
    """First come, first served: in order of joining."""
    NONE = "none"
    """No coordination: robots request no crossing."""


@dataclass(frozen=True, slots=True)
class ElectionTiming:
    """Discovery and election of a leader (paper IV.C), and answers to a question."""

    ask_spread: Duration = 50 * MS
    """Upper bound of the random delay before the first question, so that one of several candidates speaks first."""
    reply_spread: Duration = 6 * MS
    """Spread per expected answer to a broadcast. A JOB frame with channel access and acknowledgement takes 4 ms. Of 50
    answers at 5 ms each one in twenty would find no free channel, at 6 ms one in thirty."""
    answer_time: Duration = 20 * MS
    """Time that an answer needs beside the spread: dither, channel access and one retransmission."""
    answers_max: int = JOBS_MAX
    """Answers are spread for at most this many robots: a leader takes no more jobs."""
    asks: int = 3
    """Unanswered questions after which a candidate leads: three in a row are rarely all lost."""
    ask_gap: Duration = 110 * MS
    """Interval of questions: room for a relay after the longest spread."""
    ask_jitter: Duration = 20 * MS
    """Random part of the interval of questions."""
    backoff: Duration = 460 * MS
    """Retry delay after deferring to an earlier candidate; slightly longer than an election."""
    backoff_jitter: Duration = 50 * MS
    """Random part of the retry delay."""
    answer_jitter: Duration = 20 * MS
    """Upper bound of the leader's delay before it answers a question."""
    relay_wait: Duration = 20 * MS
    """A member relays the schedule in answer to a question after this and a spread, unless the leader has answered."""
    join_jitter: Duration = 10 * MS
    """Upper bound of the random delay before a member sends its JOB frame."""
    takeover_wait: Duration = 300 * MS
    """Waiting time of a leader that replaces another one, while the members join again."""


@dataclass(frozen=True, slots=True)
class ScheduleTiming:
    """Schedules, leases and slots; the order in which jobs are given them."""

    wait: Duration | None = None
    """The paper's waiting time n where it is fixed; None: computed (`Ledger.wait`)."""
    wait_max: Duration = 1000 * MS
    """Upper bound of the computed waiting time n."""
    spread: Duration = 250 * MS
    """Usual spread of the triggers of one occasion (tau of the waiting time)."""

    repetition: Duration = 250 * MS
    """Interval of schedules (R)."""
    extra_gap: Duration = 80 * MS
    """Interval of the additional repeats of a changed schedule."""
    extra: int = 2
    """Number of additional repeats of a changed schedule."""
    answer_gap: Duration = 100 * MS
    """Minimum interval of a leader's answers to worse leaders."""
    lease: Duration = 1000 * MS
    """Time for which a schedule entitles to enter (L): three of four repetitions may be lost."""
    frozen: Duration = 1100 * MS
    """Frozen zone (F): a slot nearer than this is neither moved nor given to another job."""
    window: Duration = 250 * MS
    """Entry window (w): how late a robot may enter its slot."""
    lead: Duration = 600 * MS
    """Minimum distance of a new slot from now (LEAD)."""
    clear: Duration = 20 * MS
    """Margin between slots of opposite directions, beside window and clock errors."""

    replan_wait: Duration = 30 * MS
    """Time for which a leader gathers JOB frames before it plans again."""
    replan_job: Duration = 10 * MS
    """The same per job beyond those of one frame, where the news concerns no slot that is near."""
    soon: Duration = 3000 * MS
    """A robot with a slot within this is sent changes at once, the others in turn. Two robots claim in this time.
    None of the others may enter under a schedule that it holds, for a lease is shorter."""
    revision: Duration = 100 * MS
    """A change of release or duration larger than this is reported to the leader."""
    grace: Duration = 400 * MS
    """A slot in time counts as in time for the order while its owner's estimates make it late by no more than this.
    Estimates are upper bounds, and a job that fell behind all others for tenths of a second would certainly be late."""

    absent_wait: Duration = 1000 * MS
    """First back-off of a job whose robot was not ready for its slot; doubles with each slot missed in a row."""
    absent_wait_max: Duration = 8000 * MS
    """Upper bound of that back-off."""
    absent_passes: int = 2
    """Passages of others that may go before a job whose robot was not ready; doubles likewise."""
    absent_passes_max: int = 16
    """Upper bound of those passages. After them the job goes before all others, for one slot."""
    bypass_max: int = 32
    """A waiting job that this many later ones have overtaken, and as many as it waits among, goes before all others:
    overtaking is bounded."""

    path_repeats: int = 3
    """How often the leader's path is sent."""
    path_gap: Duration = 120 * MS
    """Interval of those repeats."""


@dataclass(frozen=True, slots=True)
class ClaimTiming:
    """Claims and beacons of the robots that enter or are inside."""

    beacon: Duration = 100 * MS
    """Interval of the beacons of a robot that claims or is inside (H)."""
    quiet: Duration = 500 * MS
    """Minimum time of claiming before entry (W)."""
    ahead: Duration = 50 * MS
    """Claims begin earlier than they must by this."""
    stall: Duration = 100 * MS
    """A robot that was not awake for longer than this begins its claims anew."""
    poll: Duration = 40 * MS
    """Poll interval while claiming: shorter than a stall even when woken one tick late."""
    entry_poll: Duration = 10 * MS
    """Poll interval while the entry window is open."""
    final_gap: Duration = 60 * MS
    """Interval of the repeats of OUT, GONE and YIELD."""
    finals: int = 3
    """How often OUT, GONE and YIELD are sent."""
    reminder_gap: Duration = 200 * MS
    """Minimum interval of the OUT of a robot whose finished job is still listed."""
    witness_min: Duration = 5 * MS
    """Minimum delay before a witness repeats the beacon of a robot inside that has become silent."""
    witness_spread: Duration = 40 * MS
    """Random part of that delay, at least 6 ms for each known robot. Another witness's repeat cancels it."""


@dataclass(frozen=True, slots=True)
class LivenessTiming:
    """When silence counts: of a leader, of a robot inside, of a waiting job."""

    suspicion: Duration = 1500 * MS
    """A leader that is silent for this long is replaced (T_SUS); all its leases have ended by then."""
    stagger: Duration = 150 * MS
    """Additional delay of each further member of the list, so that one of them takes over."""
    gone: Duration = 10_000 * MS
    """A robot inside that is silent for this long is presumed gone (T_GONE): longer than any stall."""
    follow: Duration = 2000 * MS
    """A robot inside that is silent for this long, and was there when it was heard last, is not followed in."""
    keep: Duration = 2000 * MS
    """Interval at which a member repeats its job to the leader, less a spread: one schedule sets all their clocks."""
    drop: Duration = 5000 * MS
    """A waiting job that is not heard of for this long is dropped: two repeats may be lost."""
    drop_provisional: Duration = 3000 * MS
    """The same for jobs known from the predecessor's list alone."""
    ban: Duration = 5000 * MS
    """A leader that does not acknowledge is avoided for this long."""
    no_acks: int = 3
    """Unicasts in a row without acknowledgement after which a leader is avoided."""
    rejoin_first: Duration = 100 * MS
    """First delay after which an unlisted job is sent again; doubles."""
    rejoin_max: Duration = 800 * MS
    """Upper bound of that delay."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Intervals and time-outs in nanoseconds, and counts. The defaults are those of the explored models.

    Raises ValueError when the values break one of the relations of this module.
    """

    order: Order = Order.OURS
    """How a leader orders the jobs of its group."""
    payload_max: int = PAYLOAD_MAX
    """Octets of a frame's payload; fewer where the radio secures frames. The same for all robots."""
    clock_error: Duration = 5 * MS
    """Upper bound of the distance of any robot's clock from lab time (EPS)."""
    future: Duration = 100 * MS
    """A frame dated farther ahead than this has a broken clock and is dropped."""
    dither: Duration = 8 * MS
    """Random delay of each frame. Robots tick on one grid, and their frames must not all meet on the air."""

    election: ElectionTiming = field(default_factory=ElectionTiming)
    schedule: ScheduleTiming = field(default_factory=ScheduleTiming)
    claim: ClaimTiming = field(default_factory=ClaimTiming)
    liveness: LivenessTiming = field(default_factory=LivenessTiming)

    def __post_init__(self) -> None:
        if self.schedule.frozen < self.schedule.lease + 2 * self.clock_error:
            raise ValueError("the frozen zone must outlast a lease and two clock errors: raise `schedule.frozen`")
        if self.schedule.lead < self.claim.quiet + self.claim.stall:
            raise ValueError("a slot must leave time to claim it: raise `schedule.lead` to quiet + stall or more")
        if self.liveness.suspicion <= self.schedule.lease + 2 * self.clock_error:
            raise ValueError("a leader may be replaced only after its leases have ended: raise `liveness.suspicion`")

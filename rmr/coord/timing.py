"""The constants of coordination: how often, how long, how many, each with its reason.

The safety of a schedule rests on relations between them, checked when a `Values` is made:

* the frozen zone outlasts a lease, clock errors and a frame's way, so that whoever may still enter under an
  old schedule finds the same slot in the newest one;
* slots are given far enough ahead for the claims that precede every entry;
* whoever is silent is presumed gone only after longer than any stall.
"""

from dataclasses import dataclass
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
WAY_MAX: Final = 15
"""A way (direction of passage) shares an octet with the phase."""
EXCLUSIVE_WAY: Final = WAY_MAX
"""The way of a passage that excludes every other one, those of the same way too."""
RECORDS_MAX: Final = 128
"""Robots remembered per event. More than a group may hold; the oldest of the finished make room first."""
JOBS_MAX: Final = 100
"""Jobs that one leader takes at a time; further robots ask again until there is room."""
EVENTS_MAX: Final = 32
"""Events remembered per robot; idle ones make room, oldest first."""
BANS_MAX: Final = 8
"""Leaders that one robot avoids at a time."""
OUTPUT_MAX: Final = 1024
"""Frames and events that wait to be drained, per robot. A host that never drains loses the oldest."""
IN_FLIGHT_MAX: Final = 64
"""Unicast frames whose outcome is awaited, per robot."""


PAYLOAD_MAX: Final = 116
"""Octets that an IEEE 802.15.4 data frame with short addresses leaves."""


class Order(Enum):
    """By which rule a leader orders jobs; all but the first are there to be compared with."""

    OURS = "ours"
    """Most deadlines met (`rmr.coord.schedule`)."""
    EDF = "edf"
    """The earliest deadline first."""
    FCFS = "fcfs"
    """First come, first served: as jobs have joined."""
    NONE = "none"
    """No coordination: nobody asks for a turn."""


def same_way(a: int, b: int) -> bool:
    """Return whether two passages may follow each other by a headway; else one ends before the other begins."""
    return a == b != EXCLUSIVE_WAY


@dataclass(frozen=True, slots=True)
class Values:
    """Durations in nanoseconds and counts. The defaults are those that the models were explored with."""

    order: Order = Order.OURS
    """How a leader orders the jobs of its group."""
    wait: Duration | None = None
    """The paper's waiting time n, where it is fixed instead of worked out."""

    payload_max: int = PAYLOAD_MAX
    """Octets that a frame may have; fewer where the radio secures frames. The same for all robots."""

    clock_error: Duration = 5 * MS
    """No robot's clock is farther than this from lab time (EPS)."""
    future: Duration = 100 * MS
    """A frame dated farther ahead than this is a broken clock's and is dropped."""

    ask_spread: Duration = 50 * MS
    """The first question comes after at most this, so that of several robots one usually speaks first."""
    reply_spread: Duration = 6 * MS
    """Per expected answer to a broadcast. A JOB with access and acknowledgement takes 4 ms; of 50 at 5 ms one in twenty
    would find no free channel, at 6 ms one in thirty."""
    answer_time: Duration = 20 * MS
    """What an answer needs besides: the dither, access to the channel and a repeat."""
    answers_max: int = JOBS_MAX
    """Answers are spread for at most so many: a leader takes no more jobs."""
    asks: int = 3
    """Unanswered questions after which a robot leads: three in a row are rarely all lost."""
    ask_gap: Duration = 110 * MS
    """Between questions: room for a relay after the longest spread."""
    ask_jitter: Duration = 20 * MS
    yield_wait: Duration = 460 * MS
    """Who let an earlier asker go first asks again after this: just longer than that one needs to lead."""
    yield_jitter: Duration = 50 * MS
    answer_jitter: Duration = 20 * MS
    """The leader answers a question within this."""
    relay_wait: Duration = 20 * MS
    """A member answers a question only if the leader has not within this (plus a spread)."""
    join_jitter: Duration = 10 * MS
    dither: Duration = 8 * MS
    """Robots tick on one grid; frames leave this much scattered so that they do not all meet on the air."""

    absent_wait: Duration = 1000 * MS
    """Back-off of a job that was not ready for its slot; doubles with each further slot missed in a row ..."""
    absent_wait_max: Duration = 8000 * MS
    """... up to this."""
    absent_passes: int = 2
    """Passages of others that may go before such a job; doubles likewise ..."""
    absent_passes_max: int = 16
    """... up to this many. Then the job goes before all others, for one slot."""
    bypass_max: int = 32
    """A waiting job that so many later ones have passed goes before all others: nobody is overtaken for ever."""

    repetition: Duration = 250 * MS
    """A schedule is repeated this often (R)."""
    extra_gap: Duration = 80 * MS
    """A changed schedule is sent again after this ..."""
    extra: int = 2
    """... this many times."""
    answer_gap: Duration = 100 * MS
    """A leader answers a worse one at most this often."""
    lease: Duration = 1000 * MS
    """How long a schedule entitles to enter (L): three of four repetitions may be lost."""
    frozen: Duration = 1100 * MS
    """A slot nearer than this is neither moved nor given away (F)."""
    window: Duration = 250 * MS
    """How late one may enter (w)."""
    lead: Duration = 600 * MS
    """A new slot is at least this far ahead (LEAD)."""
    clear: Duration = 20 * MS
    """Between opposite slots, beside window and clock errors."""
    replan_wait: Duration = 30 * MS
    """A leader gathers joins for this long before it plans again."""
    replan_job: Duration = 10 * MS
    """... or for this long for each job beyond those of one frame, where the news concerns nobody soon."""
    soon: Duration = 3000 * MS
    """Whoever has a slot within this is told of changes at once, others in their turn: two claim meanwhile, and none of
    the others is under way for long or may enter under what it holds, for a lease is shorter."""
    takeover_wait: Duration = 300 * MS
    """The same after taking over, while members join again."""
    wait_max: Duration = 1000 * MS
    """The paper's waiting time n is at most this."""
    grace: Duration = 400 * MS
    """A slot in time stays so for the order while its owner's news make it late by no more than this: estimates are
    upper bounds, and one that fell behind all others for tenths of a second would certainly be late."""
    spread: Duration = 250 * MS
    """How far apart the triggers of one occasion usually are (tau of the waiting time)."""

    beacon: Duration = 100 * MS
    """Who claims or is inside says so this often (H)."""
    quiet: Duration = 500 * MS
    """One claims at least this long before entering (W)."""
    claim_ahead: Duration = 50 * MS
    """Claims begin this much earlier than they must."""
    stall: Duration = 100 * MS
    """Who was not awake for longer than this begins its claims anew."""
    poll: Duration = 40 * MS
    """While claiming, one looks this often: less than a stall even when woken a tick late."""
    entry_poll: Duration = 10 * MS
    """While the window is open, one looks this often."""
    final_gap: Duration = 60 * MS
    """Between the repeats of OUT, GONE and YIELD ..."""
    finals: int = 3
    """... which are sent this many times."""
    reminder_gap: Duration = 200 * MS
    """Who is listed though finished says OUT at most this often."""
    witness_min: Duration = 5 * MS
    witness_spread: Duration = 40 * MS
    """A witness repeats the beacon of a silent robot inside after the first, and within the second of these after it
    (or 6 ms for each known robot, if that is more), unless another has done so."""

    suspicion: Duration = 1500 * MS
    """A leader that is silent for this long is replaced (T_SUS); all its leases have ended by then."""
    stagger: Duration = 150 * MS
    """The next in the list tries this much later."""
    gone: Duration = 10_000 * MS
    """A robot inside that is silent for this long is presumed gone (T_GONE): longer than any stall."""
    keep: Duration = 2000 * MS
    """A member repeats its job to the leader this often, or a spread sooner: one schedule has set all their clocks."""
    drop: Duration = 5000 * MS
    """A waiting job that is not heard of for this long is dropped: two repeats may be lost."""
    drop_provisional: Duration = 3000 * MS
    """The same for jobs known only from the predecessor's list."""
    ban: Duration = 5000 * MS
    """A leader that does not acknowledge is avoided for this long."""
    no_acks: int = 3
    """Unicasts in a row without acknowledgement after which it is."""
    rejoin_first: Duration = 100 * MS
    """An unlisted job is sent again after this, doubling up to ..."""
    rejoin_max: Duration = 800 * MS
    revision: Duration = 100 * MS
    """A change of release or duration larger than this is told to the leader."""
    path_repeats: int = 3
    """The leader's path is sent this many times ..."""
    path_gap: Duration = 120 * MS
    """... this far apart."""

    def __post_init__(self) -> None:
        if self.frozen < self.lease + 2 * self.clock_error:
            raise ValueError("the frozen zone must outlast a lease and two clock errors: raise `frozen`")
        if self.lead < self.quiet + self.stall:
            raise ValueError("a slot must leave time to claim it: raise `lead` to quiet + stall or more")
        if self.suspicion <= self.lease + 2 * self.clock_error:
            raise ValueError("a leader may be replaced only after its leases have ended: raise `suspicion`")

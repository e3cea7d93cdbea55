"""The fence: what is known of robots that claim or are inside, and whether one may enter.

A schedule is a plan; the fence decides by what robots report of themselves. It keeps the newest beacon of
each robot by (trigger, time, phase), whatever the term, so that repeats and reordering change nothing; OUT and GONE
are final for all triggers up to theirs. Leadership is never trusted with physical safety, because the
broadcast discovery has no quorum: two leaders can give overlapping slots, and here one of them yields.

* A robot is inside when its last word is IN, or a CLAIM whose window has passed without YIELD (it may have
  stalled just after entering). In the same direction its headway must have passed; in the opposite one it must have
  said OUT, or been silent for T_GONE and beyond its announced end, and then one enters with caution, as long as the
  record is kept. Silence ends nothing while the robot stands inside as far as the host knows: then nobody follows it
  in, either.
* Of two conflicting claims the smaller (start, robot) wins; the other yields. The winner claims on until it has
  heard that.
* Where more than one robot may be inside (a station with several places), those that are or may be inside, that are
  listed before, or whose claims go first are counted, and one enters while fewer than the capacity are.
* A witness repeats the last beacon of a robot inside that a claimant may not have heard.
"""

from collections.abc import Callable
from typing import NamedTuple

from rmr.base.direction import may_follow
from rmr.base.time import Duration, Instant
from rmr.coord.messages import Beacon, Phase
from rmr.coord.term import NOBODY
from rmr.coord.timing import RECORDS_MAX, Timing


class Claim(NamedTuple):
    """What a robot wants of the fence."""

    robot: int
    start: Instant
    end: Instant
    headway: Duration
    direction: int


class Verdict(NamedTuple):
    """Whether the fence is open."""

    open: bool
    lost: bool
    """A rival's claim goes first."""
    cautious: bool


class Record:
    """The newest beacon of one robot."""

    __slots__ = ("assumed", "beacon")

    def __init__(self, beacon: Beacon, assumed: bool = False) -> None:
        self.beacon = beacon
        self.assumed = assumed
        """Not a beacon but the list of a former leader says that the robot started."""


def _unknown(_group_id: bytes, _robot: int) -> bool:
    """Return that nothing is known of where a robot stands: silence ends what it has announced."""
    return False


class Fence:
    """All records of one event."""

    def __init__(self, robot: int, timing: Timing) -> None:
        self._robot = robot
        self._timing = timing
        self.stands_inside: Callable[[bytes, int], bool] = _unknown
        """Whether a robot stands inside, of a group, as far as the host knows: its silence then ends nothing."""
        self.capacity = 1
        """How many robots may be inside at a time, as the newest own job has it."""
        self._repeated = NOBODY
        """The robot that was unheard last: of several each has its beacon repeated."""
        self.records: dict[int, Record] = {}
        self.finished: dict[int, Instant] = {}
        """Greatest finished trigger per robot."""

    def note(self, beacon: Beacon) -> bool:
        """Take in a beacon; return whether it was news."""
        who = beacon.who
        if beacon.trigger <= self.finished.get(who, -1):
            return False
        if beacon.phase in (Phase.OUT, Phase.GONE):
            self.finish(who, beacon.trigger)
            return True
        record = self.records.get(who)
        if record is not None and not record.assumed:
            known = record.beacon
            if (beacon.trigger, beacon.time, beacon.phase) <= (known.trigger, known.time, known.phase):
                return False
        self.records[who] = Record(beacon)
        self._bound()
        return True

    def assume(self, beacon: Beacon) -> None:
        """Take a robot for inside because it was to start and nothing else is known."""
        known = self.records.get(beacon.who)
        if beacon.trigger > self.finished.get(beacon.who, -1) and (
            known is None or known.beacon.trigger < beacon.trigger
        ):
            self.records[beacon.who] = Record(beacon, assumed=True)
            self._bound()

    def refute(self, who: int, time: Instant) -> None:
        """Forget the assumption that `who` is inside: it said at `time` that it waits."""
        record = self.records.get(who)
        if record is not None and record.assumed and time >= record.beacon.time:
            del self.records[who]

    def finish(self, who: int, trigger: Instant) -> None:
        """Note that all jobs of `who` up to `trigger` are over."""
        if trigger > self.finished.get(who, -1):
            self.finished[who] = trigger
        record = self.records.get(who)
        if record is not None and record.beacon.trigger <= trigger:
            del self.records[who]
        self._bound()

    def is_finished(self, who: int, trigger: Instant) -> bool:
        """Return whether that job is known to be over."""
        return trigger <= self.finished.get(who, -1)

    def inside(self, now: Instant) -> list[Beacon]:
        """Return the last beacons of all robots that are to be taken for inside, this one too."""
        return [record.beacon for record in self.records.values() if self.is_inside(record.beacon, now)]

    def is_inside(self, beacon: Beacon, now: Instant) -> bool:
        """Return whether the sender of its last beacon `beacon` is to be taken for inside."""
        if self.ended(beacon, now):
            return False
        if beacon.phase is Phase.IN:
            return True
        return beacon.phase is Phase.CLAIM and now > beacon.start + self._timing.schedule.window

    def believed(self, beacon: Beacon) -> Instant:
        """Return until when silence does not end what `beacon` announces: T_GONE, and at least the announced end."""
        return max(beacon.time + self._timing.liveness.gone, beacon.end)

    def ended(self, beacon: Beacon, now: Instant) -> bool:
        """Return whether silence has ended what `beacon` announces: not while its robot is known to stand inside."""
        return now >= self.believed(beacon) and not self.stands_inside(beacon.group_id, beacon.who)

    def judge(self, now: Instant, claim: Claim) -> Verdict:
        """Return whether `claim` may be entered upon now, as far as the records go."""
        timing = self._timing
        is_open = True
        cautious = False
        for who, record in self.records.items():
            beacon = record.beacon
            if who == claim.robot or beacon.phase is Phase.YIELD:
                continue
            if beacon.phase is Phase.IN or now > beacon.start + timing.schedule.window:
                if may_follow(beacon.direction, claim.direction):
                    is_open = is_open and now >= beacon.start + claim.headway and not self._bars(beacon, now)
                elif not self.ended(beacon, now):
                    is_open = False
                else:
                    # Silence is no OUT, however long it lasts: a robot may be stopped inside for longer still.
                    cautious = True
            elif self._conflict(claim, beacon):
                if (beacon.start, who) < (claim.start, claim.robot):
                    return Verdict(False, True, False)
                is_open = False  # silence may be a link that fails one way: only its YIELD ends a claim
        return Verdict(is_open, False, cautious)

    def judge_places(self, now: Instant, claim: Claim, listed: set[int]) -> Verdict:
        """Return whether `claim` may be entered upon now where several robots may be inside.

        Every robot counts that is or may be inside, that is `listed` to go before, or whose claim conflicts. So of
        `capacity` + 1 robots that have heard of each other the last one to enter counts all the others.
        """
        timing = self._timing
        inside = set(listed)
        first: set[int] = set()
        later: set[int] = set()
        cautious = False
        for who, record in self.records.items():
            beacon = record.beacon
            if who == claim.robot or beacon.phase is Phase.YIELD:
                continue
            if beacon.phase is Phase.IN or now > beacon.start + timing.schedule.window:
                if not self.ended(beacon, now):
                    inside.add(who)
                else:
                    cautious = cautious or now < self.believed(beacon) + 2 * timing.liveness.gone
            elif self._conflict(claim, beacon):
                (first if (beacon.start, who) < (claim.start, claim.robot) else later).add(who)
        if first and len(inside | first) >= self.capacity:
            return Verdict(False, True, False)
        return Verdict(len(inside | first | later) < self.capacity, False, cautious)

    def _bars(self, beacon: Beacon, now: Instant) -> bool:
        """Return whether nobody follows the sender of `beacon` in: it has been silent for a while where it passes."""
        silent = now >= beacon.time + self._timing.liveness.follow
        return silent and beacon.phase is Phase.IN and self.stands_inside(beacon.group_id, beacon.who)

    def _conflict(self, claim: Claim, other: Beacon) -> bool:
        if may_follow(claim.direction, other.direction):
            return abs(claim.start - other.start) < claim.headway
        window = self._timing.schedule.window
        return claim.start <= other.end + window and other.start <= claim.end + window

    def unheard(self, now: Instant, claim: Beacon) -> int | None:
        """Return a robot inside, in the way of `claim`, that has been silent for a while; None when there is none.

        Where several may be inside, not the same one twice in a row.
        """
        found = None
        for beacon in self.inside(now):
            silent = now - beacon.time > 2 * self._timing.claim.beacon
            if (
                beacon.who not in (claim.who, self._robot)
                and not may_follow(beacon.direction, claim.direction)
                and silent
            ):
                if self.capacity == 1 or beacon.who != self._repeated:
                    self._repeated = beacon.who
                    return beacon.who
                found = beacon.who
        return found

    def _bound(self) -> None:
        if len(self.records) > RECORDS_MAX:
            oldest = min(self.records, key=lambda who: (self.records[who].beacon.time, who))
            del self.records[oldest]
        if len(self.finished) > RECORDS_MAX:
            oldest = min(self.finished, key=lambda who: (self.finished[who], who))
            del self.finished[oldest]

"""Rules: when a robot may enter an event, and which robots may be inside together (docs/coordination.md).

- A robot enters in the window of its slot, under a valid lease, and once for each of its jobs.
- No two robots are inside in directions that exclude each other. Under one term this holds whatever frames are lost,
  unless the leader has been restarted. Under two terms it holds if the two robots are linked and neither was stopped. A
  robot that enters "with caution" after a long silence is exempt.
- Where several may be inside, as at a station, no more are than that, with the same exceptions.
- A robot that is inside when its job starts, for it was restarted there, is inside without a slot.
- In one direction a robot follows the other by its headway, less the window in which either may enter.
"""

from rmr.base.direction import may_follow
from rmr.base.record import record
from rmr.base.time import Duration, Instant
from rmr.coord.context import OwnJob
from rmr.coord.events import Entered, EntryMissed, SlotAssigned, SlotLost
from rmr.coord.timing import Timing
from rmr.node.crossing.situation import Unforeseen
from rmr_sim.checkers.run_view import TICK, RecentTable, RunView

TIMING = Timing()


@record
class Admitted:
    """One robot's passage."""

    robot: int
    job: OwnJob
    start: Instant
    direction: int
    headway: Duration
    term: tuple[int, int]
    """Term of the schedule by which it entered: counter and leader."""
    cautious: bool


class PassageChecker:
    """Checks each entry against the robots inside."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._slots: RecentTable[tuple[int, bytes], SlotAssigned] = RecentTable()
        self._inside: dict[bytes, dict[int, Admitted]] = {}
        self._entered: RecentTable[tuple[int, bytes, Instant], None] = RecentTable()
        """Jobs that have had their entry, to detect a second one."""
        view.subscribe(SlotAssigned, self._slotted)
        view.subscribe(SlotLost, self._unslotted)
        view.subscribe(EntryMissed, self._unslotted)
        view.subscribe(Entered, self._entry)
        view.subscribe(Unforeseen, self._unforeseen)

    def __call__(self, _now: Instant) -> None:
        """Drop the robots that have left."""
        for event, inside in list(self._inside.items()):
            for robot, one in list(inside.items()):
                if not self._view.alive(robot) or self._view.node(robot).core.job(event) is not one.job:
                    del inside[robot]
            if not inside:
                del self._inside[event]

    def _slotted(self, robot: int, _now: Instant, slot: SlotAssigned) -> None:
        self._slots[robot, slot.group_id] = slot

    def _unslotted(self, robot: int, _now: Instant, lost: SlotLost | EntryMissed) -> None:
        self._slots.pop((robot, lost.group_id), None)

    def _unforeseen(self, robot: int, now: Instant, event: Unforeseen) -> None:
        words = f"robot {robot} heard of its crossing, which was {event.phase}, {event.event}"
        self._view.violate(now, "entry", (robot,), words)

    def _entry(self, robot: int, now: Instant, entered: Entered) -> None:
        self(now)  # another one may have left in this very tick, and told it
        job = self._view.node(robot).core.job(entered.group_id)
        slot = self._slots.pop((robot, entered.group_id), None)
        if job is not None and job.request.inside:
            term = (-1, robot)  # a term of its own: it is inside without a slot
        elif job is None or slot is None:
            self._view.violate(now, "entry", (robot,), f"robot {robot} entered without a slot")
            return
        else:
            self._check_entry(robot, entered.start, slot, job)
            term = (slot.term, slot.leader)
        one = Admitted(robot, job, entered.start, job.request.direction, job.request.headway, term, entered.cautious)
        inside = self._inside.setdefault(entered.group_id, {})
        others = [other for other in inside.values() if other.robot != robot]
        if job.request.capacity > 1:
            self._check_places(now, one, others)
        else:
            for other in others:
                self._check_pair(now, one, other)
        inside[robot] = one

    def _check_entry(self, robot: int, start: Instant, slot: SlotAssigned, job: OwnJob) -> None:
        violate = self._view.violate
        if not slot.start <= start <= slot.start + TIMING.schedule.window:
            late_ms = (start - slot.start) // 1_000_000
            violate(start, "entry", (robot,), f"robot {robot} entered out of its window, at {late_ms} ms of its slot")
        if start >= job.lease:
            violate(start, "entry", (robot,), f"robot {robot} entered when its lease had run out")
        key = (robot, slot.group_id, slot.trigger)
        if key in self._entered:
            violate(start, "entry", (robot,), f"robot {robot} entered twice for one job")
        self._entered[key] = None

    def _check_places(self, now: Instant, one: Admitted, others: list[Admitted]) -> None:
        """Report a violation if `one` must not enter since `others` have all places."""
        bound = [other.robot for other in others if self._bound(now, one, other)]
        places = one.job.request.capacity
        if len(bound) >= places and not one.cautious:
            words = f"robot {one.robot} entered while {len(bound)} robots had the {places} places"
            self._view.violate(now, "overlap", (*bound, one.robot), words)

    def _check_pair(self, now: Instant, one: Admitted, other: Admitted) -> None:
        """Report a violation if `one` must not enter while `other` is inside."""
        if one.cautious or not self._bound(now, one, other):
            return
        pair = (other.robot, one.robot)
        if not may_follow(one.direction, other.direction):
            words = f"robot {one.robot} entered while robot {other.robot} was inside another way"
            self._view.violate(now, "overlap", pair, words)
            return
        least = min(one.headway, other.headway) - TIMING.schedule.window - TICK
        if one.start - other.start < least:
            apart_ms = (one.start - other.start) // 1_000_000
            least_ms = least // 1_000_000
            words = f"robot {one.robot} entered {apart_ms} ms behind robot {other.robot}; {least_ms} ms is the least"
            self._view.violate(now, "spacing", pair, words)

    def _bound(self, now: Instant, one: Admitted, other: Admitted) -> bool:
        """Return whether the protocol guarantees anything for these two robots."""
        view = self._view
        if one.term == other.term:
            return not view.forgot(one.term[1], other.start - TIMING.schedule.lease)
        since = now - TIMING.claim.quiet - TIMING.claim.beacon
        if any(view.held_up(robot, since, now) or view.forgot(robot, since) for robot in (one.robot, other.robot)):
            return False
        return view.linked(one.robot, other.robot, since, now)

"""Who is inside an event, and whether it may be (docs/coordination.md).

- A robot enters in the window of its slot, under a lease that has not run out, and once for each of its jobs.
- No two robots are inside in ways that exclude each other. Under one term that holds whatever is lost, unless the
  leader has lost its memory; under two terms where the two can hear each other and neither has been stopped. Who enters
  "with caution" after a long silence has said so.
- A robot that finds itself inside as its job starts, for it was started again there, is inside without a slot.
- In the same way one follows the other by its headway, less the window in which either may enter.
"""

from dataclasses import dataclass

from rmr.base.time import Duration, Instant
from rmr.coord.context import OwnJob
from rmr.coord.events import Entered, EntryMissed, SlotAssigned, SlotLost
from rmr.coord.values import Values, same_way
from rmr.node.crossing.situation import Unforeseen
from rmr_sim.checkers.newest import Newest
from rmr_sim.checkers.scene import TICK, Scene

VALUES = Values()
NO_COUNTER = -1
"""Of the term of a robot that is inside without a slot."""


@dataclass(frozen=True, slots=True)
class Admitted:
    """One robot's passage."""

    robot: int
    job: OwnJob
    start: Instant
    way: int
    headway: Duration
    term: tuple[int, int]
    """Of the schedule by which it entered: counter and leader."""
    cautious: bool


class Passages:
    """Looks at every entry, and at who is inside then."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._slots: Newest[tuple[int, bytes], SlotAssigned] = Newest()
        self._inside: dict[bytes, dict[int, Admitted]] = {}
        self._entered: Newest[tuple[int, bytes, Instant], None] = Newest()
        """The jobs that have had their entry: a second one is noticed."""
        scene.hear(SlotAssigned, self._slotted)
        scene.hear(SlotLost, self._unslotted)
        scene.hear(EntryMissed, self._unslotted)
        scene.hear(Entered, self._entry)
        scene.hear(Unforeseen, self._unforeseen)

    def __call__(self, _now: Instant) -> None:
        """Forget those who have left."""
        for event, inside in list(self._inside.items()):
            for robot, one in list(inside.items()):
                if not self._scene.alive(robot) or self._scene.node(robot).core.job(event) is not one.job:
                    del inside[robot]
            if not inside:
                del self._inside[event]

    def _slotted(self, robot: int, _now: Instant, slot: SlotAssigned) -> None:
        self._slots[robot, slot.event] = slot

    def _unslotted(self, robot: int, _now: Instant, lost: SlotLost | EntryMissed) -> None:
        self._slots.pop((robot, lost.event), None)

    def _unforeseen(self, robot: int, now: Instant, event: Unforeseen) -> None:
        words = f"robot {robot} heard of its crossing, which was {event.phase}, {event.event}"
        self._scene.violate(now, "entry", (robot,), words)

    def _entry(self, robot: int, now: Instant, entered: Entered) -> None:
        job = self._scene.node(robot).core.job(entered.event)
        slot = self._slots.pop((robot, entered.event), None)
        if job is not None and job.request.inside:
            term = (NO_COUNTER, robot)
        elif job is None or slot is None:
            self._scene.violate(now, "entry", (robot,), f"robot {robot} entered without a slot")
            return
        else:
            self._judge_entry(robot, entered.start, slot, job)
            term = (slot.term, slot.leader)
        one = Admitted(robot, job, entered.start, job.request.way, job.request.headway, term, entered.cautious)
        inside = self._inside.setdefault(entered.event, {})
        for other in inside.values():
            if other.robot != robot:
                self._judge_pair(now, one, other)
        inside[robot] = one

    def _judge_entry(self, robot: int, start: Instant, slot: SlotAssigned, job: OwnJob) -> None:
        violate = self._scene.violate
        if not slot.start <= start <= slot.start + VALUES.window:
            late_ms = (start - slot.start) // 1_000_000
            violate(start, "entry", (robot,), f"robot {robot} entered out of its window, at {late_ms} ms of its slot")
        if start >= job.lease:
            violate(start, "entry", (robot,), f"robot {robot} entered when its lease had run out")
        key = (robot, slot.event, slot.trigger)
        if key in self._entered:
            violate(start, "entry", (robot,), f"robot {robot} entered twice for one job")
        self._entered[key] = None

    def _judge_pair(self, now: Instant, one: Admitted, other: Admitted) -> None:
        """Complain if `one` must not enter while `other` is inside."""
        if one.cautious or not self._bound(now, one, other):
            return
        pair = (other.robot, one.robot)
        if not same_way(one.way, other.way):
            words = f"robot {one.robot} entered while robot {other.robot} was inside another way"
            self._scene.violate(now, "overlap", pair, words)
            return
        least = min(one.headway, other.headway) - VALUES.window - TICK
        if one.start - other.start < least:
            apart_ms, least_ms = (one.start - other.start) // 1_000_000, least // 1_000_000
            words = f"robot {one.robot} entered {apart_ms} ms behind robot {other.robot}; {least_ms} ms is the least"
            self._scene.violate(now, "spacing", pair, words)

    def _bound(self, now: Instant, one: Admitted, other: Admitted) -> bool:
        """Return whether the protocol promises anything of these two."""
        scene = self._scene
        if one.term == other.term:
            return not scene.forgot(one.term[1], other.start - VALUES.lease)
        since = now - VALUES.quiet - VALUES.beacon
        if any(scene.held_up(robot, since, now) or scene.forgot(robot, since) for robot in (one.robot, other.robot)):
            return False
        return scene.linked(one.robot, other.robot, since, now)

"""Rules about schedules: one version for each instant of issue, and fixed slots in the near future.

- Robots that forward a schedule do not change it, and no two versions have the same instant of issue.
- A slot within the frozen zone is not moved, unless its owner missed it, was stopped, or it is long over.
- A frame fits the radio.
"""

from rmr.base.time import Instant, milliseconds
from rmr.coord.events import EntryMissed, SlotLost
from rmr.coord.messages import Entry, FrameKind, MessageError, Phase, Sched, decode
from rmr.coord.term import Term
from rmr.node.ports import Spoken
from rmr_sim.checkers.passage_checker import TIMING
from rmr_sim.checkers.recent_table import RecentTable
from rmr_sim.checkers.run_view import RunView

LET_PASS = milliseconds(1200)
"""Greatest age of a slot at the report that its owner gave it up."""

Promise = tuple[bytes, Term, int, Instant]
"""Event, term, robot, trigger."""


class ScheduleChecker:
    """Checks every schedule that is sent."""

    def __init__(self, view: RunView) -> None:
        self._view = view
        self._room = view.simulation.robots[0].payload_max
        self._said: RecentTable[tuple[bytes, Term, Instant, int], bytes] = RecentTable()
        self._promised: RecentTable[Promise, tuple[Instant, Instant]] = RecentTable()
        """The fixed slot, and the issue of the schedule that fixed it: frames may overtake one another."""
        self._given_up: RecentTable[tuple[int, bytes], Instant] = RecentTable()
        view.subscribe(Spoken, self._spoken)
        view.subscribe(SlotLost, self._gave_up)
        view.subscribe(EntryMissed, self._gave_up)

    def __call__(self, _now: Instant) -> None:
        """Do nothing: all checks are made on events."""

    def _gave_up(self, robot: int, now: Instant, lost: SlotLost | EntryMissed) -> None:
        self._given_up[robot, lost.group_id] = now

    def _spoken(self, robot: int, now: Instant, spoken: Spoken) -> None:
        payload = spoken.payload
        if len(payload) > self._room:
            words = f"robot {robot} sent {len(payload)} octets where {self._room} fit"
            self._view.violate(now, "frame", (robot,), words)
        if payload[:1] != _SCHED:
            return
        try:
            sched = decode(payload, self._room)
        except MessageError as error:
            self._view.violate(now, "frame", (robot,), f"robot {robot} sent a schedule that is none: {error}")
            return
        assert isinstance(sched, Sched)
        key = (sched.group_id, sched.term, sched.issued, sched.part)
        if self._said.get(key, payload) != payload:
            words = f"robot {robot} sent another version of the schedule that leader {sched.term.leader} issued"
            self._view.violate(now, "schedule", (robot, sched.term.leader), words)
        else:
            self._said[key] = payload
        if sched.term.leader == robot:
            for entry in sched.entries:
                self._check(now, sched, entry)

    def _check(self, now: Instant, sched: Sched, entry: Entry) -> None:
        """Report a fixed slot that has moved; record the slots that are fixed now."""
        key = (sched.group_id, sched.term, entry.robot, entry.trigger)
        promised, issued = self._promised.get(key, (None, -1))
        if sched.issued <= issued:
            return
        if promised is not None and entry.phase is Phase.WAITING and entry.start != promised:
            del self._promised[key]
            over = sched.issued > promised + entry.duration + TIMING.schedule.window
            if not over and not self._excused(entry.robot, sched, promised, now):
                words = f"leader {sched.term.leader} moved the slot of robot {entry.robot}, which stood already"
                self._view.violate(now, "frozen slot", (sched.term.leader, entry.robot), words)
        if entry.start is not None and entry.start <= sched.issued + TIMING.schedule.frozen:
            self._promised[key] = entry.start, sched.issued

    def _excused(self, robot: int, sched: Sched, promised: Instant, now: Instant) -> bool:
        """Return whether the owner of a slot gave it up or could not use it."""
        if robot not in self._view.robots:
            return True
        gave_up = self._given_up.get((robot, sched.group_id), -LET_PASS)
        since = promised - TIMING.liveness.gone
        return (
            gave_up >= promised - LET_PASS
            or bool(self._view.held_up(robot, since, now))
            or self._view.forgot(robot, since)
        )


_SCHED = bytes([FrameKind.SCHED])
